//! What a network is told of a photo besides its colours: how far things stand out, and which way they lean.
//!
//! ```text
//! relief:  r = (v − v₀) / s        v: inverse depth (up to scale and shift), v₀: plane of the ground, s: spread of v − v₀
//! lean:    l = (p − n) / f         p: pixel, n: pixel of the nadir, f: focal length in pixels
//! ```
//!
//! The inverse depth of a plane is linear in the pixel, so a level or sloping ground is 0 in `r` however the photo is
//! tilted, and what stands on it is positive. In a photo that looks straight down, a point `h` above the ground appears
//! `l · f · h / (H − h)` away from its foot, flown at `H`: a wall's foot lies towards the nadir.

use glam::{DMat3, DVec2, DVec3};

use super::holes::fill;
use sizeup_geo::geodata::raster::CellWindow;
use sizeup_heights::prior::DepthPrior;
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

/// Rounds of fitting the ground's plane, each with less weight on what stands out of it.
const ROUNDS: usize = 6;
/// At most so many values take part in the fit.
const MOST_VALUES: usize = 20_000;
/// Relief beyond this is cut off, in spreads.
const MOST: f32 = 6.0;

/// Height of things above the ground's plane, `H × W` as the prior; holes are filled from around them (`holes.rs`).
#[must_use]
pub fn relief(prior: &DepthPrior) -> Raster<f32> {
    let values = prior.values.map(|v| prior.disparity(*v));
    let (width, height) = (values.width(), values.height());
    let at = |i: usize| DVec3::new((i % width) as f64 / width as f64, (i / width) as f64 / height as f64, 1.0);
    let step = (width * height).div_ceil(MOST_VALUES).max(1);
    let sample: Vec<(DVec3, f64)> = (0..width * height)
        .step_by(step)
        .filter(|&i| values.data()[i].is_finite())
        .map(|i| (at(i), f64::from(values.data()[i])))
        .collect();
    let (plane, spread) = ground_plane(&sample);
    let value = |i: usize| {
        let v = values.data()[i];
        ((f64::from(v) - plane.dot(at(i))) / spread) as f32
    };
    let mut relief = Raster::filled(width, height, 0.0);
    relief.data_mut().iter_mut().enumerate().for_each(|(i, cut)| *cut = value(i).clamp(-MOST, MOST));
    fill(&mut relief);
    relief
}

/// Least squares with weights that fall with the residual (Geman and `McClure`), and above the plane faster than below it:
/// buildings stand on the ground. The spread is the root mean square of what is left.
fn ground_plane(sample: &[(DVec3, f64)]) -> (DVec3, f64) {
    let mut plane = DVec3::ZERO;
    let mut spread = f64::INFINITY;
    for _ in 0..ROUNDS {
        let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for (x, v) in sample {
            let off = (v - plane.dot(*x)) / spread;
            let weight = if off > 0.0 { (1.0 + 9.0 * off * off).powi(-2) } else { (1.0 + off * off).powi(-2) };
            normal += weight * DMat3::from_cols(*x * x.x, *x * x.y, *x * x.z);
            right += weight * *v * *x;
        }
        if normal.determinant().abs() < 1e-9 {
            break;
        }
        plane = normal.inverse() * right;
        let squares: f64 = sample.iter().map(|(x, v)| (v - plane.dot(*x)).powi(2)).sum();
        spread = (squares / sample.len() as f64).sqrt().max(f64::MIN_POSITIVE);
    }
    // Nothing to go by, or a plane to the last bit: no relief.
    (plane, if spread.is_finite() && spread > 1e-12 { spread } else { f64::INFINITY })
}

/// A photo's map at the cells of a tile: bilinear; the map is the whole photo, resized.
#[must_use]
pub fn resample(map: &Raster<f32>, photo: (usize, usize), tile: CellWindow, side: (usize, usize)) -> Vec<f32> {
    let scale = (map.width() as f64 / photo.0 as f64, map.height() as f64 / photo.1 as f64);
    cells(tile, side).map(|p| map.bilinear(p.x * scale.0, p.y * scale.1)).collect()
}

/// The pixels of the photo that a tile's cells are centred on, row by row.
fn cells(tile: CellWindow, (columns, rows): (usize, usize)) -> impl Iterator<Item = DVec2> {
    let step = DVec2::new(tile.width as f64 / columns as f64, tile.height as f64 / rows as f64);
    let first = DVec2::new(tile.col as f64, tile.row as f64);
    let centre = move |i: usize| DVec2::new((i % columns) as f64 + 0.5, (i / columns) as f64 + 0.5);
    (0..columns * rows).map(move |i| first + centre(i) * step)
}

/// Which way, and how much, upright things lean in a photo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lean {
    /// Nadir of the camera, pixels.
    pub nadir_px: [f64; 2],
    /// Focal length of the camera, pixels.
    pub focal_px: f64,
}

impl Lean {
    /// Geometry of a view; `None` where its lens has no pixel for the nadir.
    #[must_use]
    pub fn of(view: &View) -> Option<Self> {
        let nadir = view.camera.project(view.camera_from_map.vector(DVec3::NEG_Z))?;
        let focal_px = 0.5 * (view.camera.fx_px + view.camera.fy_px);
        Some(Self { nadir_px: nadir.to_array(), focal_px })
    }

    /// The lean at a pixel.
    #[must_use]
    pub fn at(&self, pixel: DVec2) -> DVec2 {
        (pixel - DVec2::from(self.nadir_px)) / self.focal_px
    }

    /// The lean at the cells of a tile: all columns' parts, then all rows' parts.
    #[must_use]
    pub fn of_tile(&self, tile: CellWindow, side: (usize, usize)) -> Vec<f32> {
        let part = |axis: usize| cells(tile, side).map(move |p| self.at(p)[axis] as f32);
        part(0).chain(part(1)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sizeup_heights::prior::{PriorGeometry, PriorKind};

    /// A ground that falls away, with a block over a twelfth of it, seen as a network might: any scale, any shift.
    #[test]
    fn relief_is_nought_on_sloping_ground_and_positive_on_what_stands_on_it() {
        let is_block = |x: usize, y: usize| (20..40).contains(&x) && (30..45).contains(&y);
        let value = |i: usize| {
            let (x, y) = (i % 60, i / 60);
            3.0 + 0.02 * x as f32 - 0.01 * y as f32 + if is_block(x, y) { 0.5 } else { 0.0 }
        };
        let values = Raster::from_vec(60, 60, (0..3600).map(value).collect()).unwrap();
        let prior = DepthPrior { values, kind: PriorKind::InverseDepth, geometry: PriorGeometry::ZDepth };
        let found = relief(&prior);
        assert!(found[(5, 5)].abs() < 0.05 && found[(55, 50)].abs() < 0.05, "{} {}", found[(5, 5)], found[(55, 50)]);
        assert!(found[(30, 37)] > 2.0, "{}", found[(30, 37)]);
        let flat = DepthPrior { values: Raster::filled(9, 9, 4.0), ..prior };
        assert!(relief(&flat).data().iter().all(|v| *v == 0.0));
    }
}
