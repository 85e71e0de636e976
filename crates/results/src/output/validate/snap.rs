//! Vertices of one geometry, with those closer than a tolerance taken as one.

use std::collections::HashMap;

use super::super::cityjson::read::{CityFile, CityGeometry};

/// Loss of a CRS's coordinates in double precision, metres: vertices one quantum of a millimetre apart are that far apart
/// or a little more, and count as one all the same.
const NOISE_M: f64 = 1e-8;

/// Distinct positions of a geometry, relative to its first vertex.
pub struct Snapped {
    /// Positions in metres from [`Self::origin`].
    pub points: Vec<[f64; 3]>,
    /// Place of the first vertex in the file's CRS.
    pub origin: [f64; 3],
    /// Vertices closer than this are one, metres.
    pub tolerance_m: f64,
    /// From the file's index to an index into `points`.
    index_of: HashMap<u32, usize>,
}

impl Snapped {
    /// Grid of the vertices that a geometry uses, in the order of their use.
    pub fn new(city: &CityFile, geometry: &CityGeometry, tolerance_m: f64) -> Self {
        let used = || geometry.surfaces.iter().flat_map(|s| s.rings.iter().flatten().copied());
        let origin = used().next().map_or([0.0; 3], |i| city.vertices[i as usize]);
        let mut snapped = Self { points: Vec::new(), origin, tolerance_m, index_of: HashMap::new() };
        let mut cells: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
        let cell_m = tolerance_m + NOISE_M;
        for vertex in used() {
            if snapped.index_of.contains_key(&vertex) {
                continue;
            }
            let position = city.vertices[vertex as usize];
            let point: [f64; 3] = std::array::from_fn(|axis| position[axis] - origin[axis]);
            let cell = point.map(|v| (v / cell_m).floor() as i64);
            let index = snapped.near(point, cell, &cells).unwrap_or_else(|| {
                snapped.points.push(point);
                cells.entry(cell).or_default().push(snapped.points.len() - 1);
                snapped.points.len() - 1
            });
            snapped.index_of.insert(vertex, index);
        }
        snapped
    }

    /// A known point within the tolerance: it lies in the same cell or one beside it.
    fn near(&self, point: [f64; 3], cell: [i64; 3], cells: &HashMap<[i64; 3], Vec<usize>>) -> Option<usize> {
        let steps = || -1..=1_i64;
        let around = steps().flat_map(|dx| steps().flat_map(move |dy| steps().map(move |dz| [dx, dy, dz])));
        around
            // Far out, with a tiny tolerance, cells end where whole numbers do.
            .filter_map(|step| cells.get(&std::array::from_fn(|axis| cell[axis].saturating_add(step[axis]))))
            .flatten()
            .copied()
            .filter(|&i| distance(self.points[i], point) <= self.tolerance_m + NOISE_M)
            .min()
    }

    /// Index into `points` of a vertex of the file.
    pub fn index(&self, vertex: u32) -> usize {
        self.index_of[&vertex]
    }

    /// A point in the file's CRS.
    pub fn position(&self, index: usize) -> [f64; 3] {
        std::array::from_fn(|axis| self.points[index][axis] + self.origin[axis])
    }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}
