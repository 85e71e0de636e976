//! Building forms: a footprint, and planar roof faces that tile it without gap or overlap.
//!
//! A form lives in a plane of its own (x, y in metres) with z above the building's ground. Because the faces tile
//! the footprint, the area-mean roof height is exact: `Σ ∫ z dA / Σ A` over the faces' triangles.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// The shape of a roof.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RoofKind {
    /// One horizontal plane over the whole footprint.
    Flat,
    /// Two slopes per wing, upright ends.
    Gable,
    /// Slopes on all sides.
    Hip,
    /// Several horizontal planes at different levels.
    Stepped,
    /// As measured: real geometry.
    Surveyed,
}

impl RoofKind {
    /// The name under which files have it.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Flat => "flat",
            Self::Gable => "gable",
            Self::Hip => "hip",
            Self::Stepped => "stepped",
            Self::Surveyed => "surveyed",
        }
    }
}

/// A planar polygon of a roof: first ring counter-clockwise seen from above, then holes.
#[derive(Debug, Clone, PartialEq)]
pub struct FormFace {
    /// Rings without a repeated last point; z above the building's ground, metres.
    pub rings: Vec<Vec<DVec3>>,
}

/// Footprint and roof of one building in a plane of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct BuildingForm {
    /// First ring counter-clockwise, holes clockwise, without a repeated last point.
    pub footprint: Vec<Vec<DVec2>>,
    /// They tile the footprint.
    pub faces: Vec<FormFace>,
    /// Roof that the faces make.
    pub roof: RoofKind,
}

impl BuildingForm {
    /// Makes all walls higher by so many times the eave's height; the roof stays as it is.
    pub fn lift(&mut self, by: f64) {
        let z = self.faces.iter().flat_map(|face| &face.rings).flatten().map(|corner| corner.z);
        let lift_m = by * z.fold(f64::INFINITY, f64::min);
        self.faces.iter_mut().flat_map(|face| &mut face.rings).flatten().for_each(|corner| corner.z += lift_m);
    }
}

/// A rectangle along the axes of a form's plane, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rect {
    /// Lowest x, metres.
    pub x0: f64,
    /// Highest x, metres.
    pub x1: f64,
    /// Lowest y, metres.
    pub y0: f64,
    /// Highest y, metres.
    pub y1: f64,
}

impl Rect {
    /// From its low corner and its size.
    #[must_use]
    pub fn sized(x0: f64, y0: f64, dx: f64, dy: f64) -> Self {
        Self { x0, x1: x0 + dx, y0, y1: y0 + dy }
    }

    /// Smaller by `by` on every side.
    #[must_use]
    pub fn inset(self, by: f64) -> Self {
        Self { x0: self.x0 + by, x1: self.x1 - by, y0: self.y0 + by, y1: self.y1 - by }
    }

    /// Counter-clockwise from the low corner.
    #[must_use]
    pub fn ring(self) -> Vec<DVec2> {
        [(self.x0, self.y0), (self.x1, self.y0), (self.x1, self.y1), (self.x0, self.y1)].map(DVec2::from).to_vec()
    }

    fn hole(self) -> Vec<DVec2> {
        self.ring().into_iter().rev().collect()
    }

    pub(super) fn dx(self) -> f64 {
        self.x1 - self.x0
    }

    pub(super) fn dy(self) -> f64 {
        self.y1 - self.y0
    }
}

fn lift(ring: &[DVec2], z: f64) -> Vec<DVec3> {
    ring.iter().map(|p| p.extend(z)).collect()
}

fn face(points: &[(f64, f64, f64)]) -> FormFace {
    FormFace { rings: vec![points.iter().copied().map(DVec3::from).collect()] }
}

/// A horizontal roof over any footprint.
#[must_use]
pub fn flat(footprint: Vec<Vec<DVec2>>, roof_m: f64) -> BuildingForm {
    let faces = vec![FormFace { rings: footprint.iter().map(|ring| lift(ring, roof_m)).collect() }];
    BuildingForm { footprint, faces, roof: RoofKind::Flat }
}

/// A gable roof with its ridge along x; the ends at low and high x are upright.
#[must_use]
pub fn gable(r: Rect, eave_m: f64, ridge_m: f64) -> BuildingForm {
    gable_with_wings(r, eave_m, ridge_m, &[])
}

/// A hip roof with its ridge along x, all slopes as steep as each other where the rectangle is long enough.
#[must_use]
pub fn hip(r: Rect, eave_m: f64, ridge_m: f64) -> BuildingForm {
    let (e, t) = (eave_m, ridge_m);
    let run = (r.dy() / 2.0).min(0.45 * r.dx());
    let (a, b, m) = (r.x0 + run, r.x1 - run, 0.5 * (r.y0 + r.y1));
    let faces = vec![
        face(&[(r.x0, r.y0, e), (r.x1, r.y0, e), (b, m, t), (a, m, t)]),
        face(&[(r.x1, r.y0, e), (r.x1, r.y1, e), (b, m, t)]),
        face(&[(r.x1, r.y1, e), (r.x0, r.y1, e), (a, m, t), (b, m, t)]),
        face(&[(r.x0, r.y1, e), (r.x0, r.y0, e), (a, m, t)]),
    ];
    BuildingForm { footprint: vec![r.ring()], faces, roof: RoofKind::Hip }
}

/// Flat roofs of different heights side by side along x, in equal shares of the length.
#[must_use]
pub fn stepped(r: Rect, roofs_m: &[f64]) -> BuildingForm {
    let cut = |i: usize| r.x0 + r.dx() * i as f64 / roofs_m.len() as f64;
    let faces = roofs_m.iter().enumerate().map(|(i, &z)| {
        let part = Rect { x0: cut(i), x1: if i + 1 == roofs_m.len() { r.x1 } else { cut(i + 1) }, ..r };
        FormFace { rings: vec![lift(&part.ring(), z)] }
    });
    BuildingForm { footprint: vec![r.ring()], faces: faces.collect(), roof: RoofKind::Stepped }
}

/// Flat roofs stacked like a telescope: each level stands on the one before (a podium, a tower, its plant room).
#[must_use]
pub fn stacked(levels: &[(Rect, f64)]) -> BuildingForm {
    let faces = levels.iter().enumerate().map(|(i, &(level, z))| {
        let mut rings = vec![lift(&level.ring(), z)];
        if let Some(&(above, _)) = levels.get(i + 1) {
            rings.push(lift(&above.hole(), z));
        }
        FormFace { rings }
    });
    let footprint = levels.first().map(|(r, _)| r.ring()).into_iter().collect();
    let roof = if levels.len() == 1 { RoofKind::Flat } else { RoofKind::Stepped };
    BuildingForm { footprint, faces: faces.collect(), roof }
}

/// A wing that leaves the low-y side of a main body at right angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wing {
    /// Lowest x, metres.
    pub x0: f64,
    /// Highest x, metres.
    pub x1: f64,
    /// Reach from the main body.
    pub reach: f64,
}

/// The footprint of a main body with wings (sorted by x, apart from each other): L, T or U.
#[must_use]
pub fn winged_footprint(r: Rect, wings: &[Wing]) -> Vec<DVec2> {
    let mut ring = Vec::new();
    if wings.first().is_none_or(|w| w.x0 > r.x0) {
        ring.push(DVec2::new(r.x0, r.y0));
    }
    for w in wings {
        let y = r.y0 - w.reach;
        if w.x0 > r.x0 {
            ring.push(DVec2::new(w.x0, r.y0));
        }
        ring.extend([DVec2::new(w.x0, y), DVec2::new(w.x1, y)]);
        if w.x1 < r.x1 {
            ring.push(DVec2::new(w.x1, r.y0));
        }
    }
    if wings.last().is_none_or(|w| w.x1 < r.x1) {
        ring.push(DVec2::new(r.x1, r.y0));
    }
    ring.extend([DVec2::new(r.x1, r.y1), DVec2::new(r.x0, r.y1)]);
    ring
}

/// Gable roofs over a main body (ridge along x) and its wings (ridges along y), all with one pitch; the wings, not
/// wider than the main body, run into its low-y slope along two valleys.
#[must_use]
pub fn gable_with_wings(r: Rect, eave_m: f64, ridge_m: f64, wings: &[Wing]) -> BuildingForm {
    let (e, t, m) = (eave_m, ridge_m, 0.5 * (r.y0 + r.y1));
    let rise_per_m = (ridge_m - eave_m) / (0.5 * r.dy());
    // The low-y slope of the main body, notched where the wings run into it.
    let mut slope = Vec::new();
    if wings.first().is_none_or(|w| w.x0 > r.x0) {
        slope.push((r.x0, r.y0, e));
    }
    let mut faces = Vec::new();
    for w in wings {
        let (half, middle, end) = (0.5 * (w.x1 - w.x0), 0.5 * (w.x0 + w.x1), r.y0 - w.reach);
        let top = e + rise_per_m * half;
        let apex = (middle, r.y0 + half, top);
        slope.extend([(w.x0, r.y0, e), apex, (w.x1, r.y0, e)]);
        faces.push(face(&[(w.x0, end, e), (middle, end, top), apex, (w.x0, r.y0, e)]));
        faces.push(face(&[(middle, end, top), (w.x1, end, e), (w.x1, r.y0, e), apex]));
    }
    if wings.last().is_none_or(|w| w.x1 < r.x1) {
        slope.push((r.x1, r.y0, e));
    }
    slope.extend([(r.x1, m, t), (r.x0, m, t)]);
    faces.push(face(&slope));
    faces.push(face(&[(r.x1, r.y1, e), (r.x0, r.y1, e), (r.x0, m, t), (r.x1, m, t)]));
    BuildingForm { footprint: vec![winged_footprint(r, wings)], faces, roof: RoofKind::Gable }
}

/// A closed block around a courtyard: flat, or a ring of gables where `ridge_m > eave_m`.
#[must_use]
pub fn courtyard(r: Rect, wing_m: f64, eave_m: f64, ridge_m: f64) -> BuildingForm {
    let footprint = vec![r.ring(), r.inset(wing_m).hole()];
    if ridge_m <= eave_m {
        return flat(footprint, eave_m);
    }
    let rings = [lift(&r.ring(), eave_m), lift(&r.inset(0.5 * wing_m).ring(), ridge_m)];
    let inner = lift(&r.inset(wing_m).ring(), eave_m);
    let [outer, ridge] = rings;
    let mut faces = Vec::new();
    for i in 0..4 {
        let j = (i + 1) % 4;
        faces.push(FormFace { rings: vec![vec![outer[i], outer[j], ridge[j], ridge[i]]] });
        faces.push(FormFace { rings: vec![vec![ridge[i], ridge[j], inner[j], inner[i]]] });
    }
    BuildingForm { footprint, faces, roof: RoofKind::Gable }
}
