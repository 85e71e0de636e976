//! How much two shapes have in common, on a small raster of their own; and who is near whom.

use geo_types::MultiPolygon;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use super::candidate::{Bounds, envelope};
use super::coverage::{GridWindow, Scratch, cover};

/// Cells of the raster that two shapes are compared on; more change the overlap by less than a hundredth.
const COMPARE_CELLS: f64 = 900.0;

/// Search tree of footprints' bounding boxes, each with the position of its footprint.
pub(super) type Tree = RTree<GeomWithData<Rectangle<[f64; 2]>, usize>>;

/// A box with the position of what it is around.
pub(super) fn entry(bounds: Bounds, i: usize) -> GeomWithData<Rectangle<[f64; 2]>, usize> {
    GeomWithData::new(Rectangle::from_aabb(envelope(bounds)), i)
}

/// Positions of what a box touches, in order.
pub(super) fn near(tree: &Tree, envelope: &AABB<[f64; 2]>) -> Vec<usize> {
    let mut found: Vec<usize> = tree.locate_in_envelope_intersecting(envelope).map(|e| e.data).collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// Compares shapes on a small raster.
#[derive(Default)]
pub(super) struct Comparer {
    scratch: Scratch,
    a: Vec<f32>,
    b: Vec<f32>,
    seen: Vec<f32>,
}

/// Areas of two shapes, m².
pub(super) struct Overlap {
    /// Area that both cover, m².
    pub shared_m2: f64,
    /// Area that at least one of them covers, m².
    pub joint_m2: f64,
}

impl Overlap {
    /// Intersection over union of the two, 0 to 1.
    pub(super) fn iou(&self) -> f64 {
        self.shared_m2 / self.joint_m2.max(1e-9)
    }
}

impl Comparer {
    /// Within `bounds`, which hold both, and what `seen` leaves of them.
    pub(super) fn overlap(
        &mut self,
        a: &MultiPolygon<f64>,
        b: &MultiPolygon<f64>,
        bounds: Bounds,
        seen: &[&MultiPolygon<f64>],
    ) -> Overlap {
        let size = [bounds.1[0] - bounds.0[0], bounds.1[1] - bounds.0[1]];
        let cell_m = (size[0] * size[1] / COMPARE_CELLS).sqrt().max(0.05);
        let window = GridWindow::around(bounds.0, bounds.1, cell_m, 0);
        cover(a, &window, &mut self.scratch, &mut self.a);
        cover(b, &window, &mut self.scratch, &mut self.b);
        for area in seen {
            cover(area, &window, &mut self.scratch, &mut self.seen);
            for i in 0..self.seen.len() {
                self.a[i] *= self.seen[i];
                self.b[i] *= self.seen[i];
            }
        }
        let (mut shared, mut all) = (0.0_f64, 0.0_f64);
        for (&x, &y) in self.a.iter().zip(&self.b) {
            shared += f64::from(x.min(y));
            all += f64::from(x.max(y));
        }
        let cell_m2 = cell_m * cell_m;
        Overlap { shared_m2: shared * cell_m2, joint_m2: all * cell_m2 }
    }
}
