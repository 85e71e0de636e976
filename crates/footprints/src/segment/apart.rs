//! Buildings of a map told apart by a second one, which says how near to the middle of its building each pixel lies.
//!
//! ```text
//! m(p) = min(d(p) / min(D, R), 1)      d: distance to the building's own footprint, walls to its neighbours included
//! ```
//!
//! `D`: the largest `d` of the building, `R`: a reach of some pixels. It is 0 along every footprint and 1 in every middle, so that
//! between two houses that share a wall it falls and rises again. A watershed finds them: the map is flooded from its peaks
//! down, and where two peaks' parts meet they are one building unless the map fell by `dip` between them. A network that is
//! not sure where the wall is still says that there is one: its map falls less far, and wider.

use sizeup_heights::raster::Raster;

/// How buildings of a map are told apart.
#[derive(Debug, Clone, Copy)]
pub struct Apart {
    /// Probability above which there is a building.
    pub above: f32,
    /// How far the map of middles falls from the lower of two peaks to where their parts meet, if they are two buildings.
    pub dip: f32,
    /// Least pixels of a part that is a building of its own where parts meet.
    pub least_px: usize,
}

/// Parts of the flood: each with its peak and its pixels, joined into larger ones.
#[derive(Default)]
struct FloodParts {
    parent: Vec<u32>,
    peak: Vec<f32>,
    n_px: Vec<usize>,
}

impl FloodParts {
    fn start(&mut self, peak: f32) -> u32 {
        self.parent.push(self.parent.len() as u32);
        self.peak.push(peak);
        self.n_px.push(0);
        self.parent.len() as u32 - 1
    }

    fn root(&mut self, mut part: u32) -> u32 {
        while self.parent[part as usize] != part {
            let above = self.parent[self.parent[part as usize] as usize];
            self.parent[part as usize] = above;
            part = above;
        }
        part
    }

    fn join(&mut self, into: u32, part: u32) {
        self.parent[part as usize] = into;
        self.n_px[into as usize] += self.n_px[part as usize];
    }
}

/// Labels of the buildings of a map of probabilities, from 1; 0 is none. Equal values are taken in the map's order, so that the
/// outcome is the same everywhere.
#[must_use]
pub fn split(buildings: &Raster<f32>, middles: &Raster<f32>, how: Apart) -> Raster<u32> {
    const NONE: u32 = u32::MAX;
    let (built, middle) = (buildings.data(), middles.data());
    let mut order: Vec<u32> = (0..built.len() as u32).filter(|&i| built[i as usize] > how.above).collect();
    order.sort_by(|&a, &b| middle[b as usize].total_cmp(&middle[a as usize]).then(a.cmp(&b)));
    let mut parts = FloodParts::default();
    let mut part_of = vec![NONE; built.len()];
    for i in order.iter().map(|&i| i as usize) {
        // The part to join first: that of the neighbour which lies nearest to a middle.
        let mut around: Vec<usize> = buildings.beside(i).filter(|&j| part_of[j] != NONE).collect();
        around.sort_by(|&a, &b| middle[b].total_cmp(&middle[a]).then(a.cmp(&b)));
        let mut roots: Vec<u32> = Vec::with_capacity(4);
        for j in around {
            let root = parts.root(part_of[j]);
            if !roots.contains(&root) {
                roots.push(root);
            }
        }
        let own = roots.first().copied().unwrap_or_else(|| parts.start(middle[i]));
        part_of[i] = own;
        parts.n_px[own as usize] += 1;
        // The highest peak keeps its part; every other one has to fall far enough, and to be large enough, to keep its own.
        roots.sort_by(|&a, &b| parts.peak[b as usize].total_cmp(&parts.peak[a as usize]).then(a.cmp(&b)));
        for (k, &lower) in roots.iter().enumerate().skip(1) {
            let stays =
                |r: u32| parts.peak[r as usize] - middle[i] >= how.dip && parts.n_px[r as usize] >= how.least_px;
            let higher = roots[0];
            if !stays(lower) {
                let into = parts.root(higher);
                parts.join(into, lower);
            } else if k == 1 && !stays(higher) {
                // A speck with a high peak beside a building.
                parts.join(lower, higher);
            }
        }
    }
    let mut label_of = vec![0; parts.parent.len()];
    let mut next = 0;
    let mut labels = Raster::filled(buildings.width(), buildings.height(), 0_u32);
    for (i, label) in labels.data_mut().iter_mut().enumerate().filter(|(i, _)| part_of[*i] != NONE) {
        let root = parts.root(part_of[i]) as usize;
        if label_of[root] == 0 {
            next += 1;
            label_of[root] = next;
        }
        *label = label_of[root];
    }
    labels
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of a map of one pixel a letter: `.` is no building, a digit the tenths of how near a middle it is.
    fn labels_of(rows: &[&str], dip: f32, least_px: usize) -> Vec<String> {
        let letters: Vec<char> = rows.iter().flat_map(|row| row.chars()).collect();
        let raster = |f: &dyn Fn(&char) -> f32| {
            Raster::from_vec(rows[0].len(), rows.len(), letters.iter().map(f).collect()).unwrap()
        };
        let buildings = raster(&|c| if *c == '.' { 0.1 } else { 0.9 });
        let middles = raster(&|c| c.to_digit(10).map_or(0.0, |d| d as f32 / 10.0));
        let labels = split(&buildings, &middles, Apart { above: 0.5, dip, least_px });
        let row = |r: usize| (0..labels.width()).map(|c| char::from(b'0' + labels[(c, r)] as u8)).collect();
        (0..labels.height()).map(row).collect()
    }

    #[test]
    fn row_houses_come_apart_in_the_valley_between_them_and_leave_no_gap() {
        assert_eq!(labels_of(&[".2898118982."; 2], 0.5, 2), ["011111222220"; 2]);
        // The valley may lie anywhere, and be shallow.
        assert_eq!(labels_of(&[".29876567892."; 2], 0.3, 2), ["0111111222220"; 2]);
    }

    #[test]
    fn a_valley_that_is_not_deep_enough_is_none() {
        assert_eq!(labels_of(&[".2897798982."; 2], 0.3, 2), ["011111111110"; 2]);
    }

    /// Peaks of a pixel or two are noise, however high, where a larger part is beside them; alone they stay.
    #[test]
    fn a_speck_with_a_peak_falls_to_the_building_beside_it() {
        assert_eq!(labels_of(&["888888190", "888888190", "888888111"], 0.5, 6), ["111111111"; 3]);
        assert_eq!(labels_of(&["919888888", "111888888"], 0.5, 6), ["111111111"; 2]);
        assert_eq!(labels_of(&["88....", "88....", ".....9"], 0.5, 6), ["110000", "110000", "000002"]);
    }

    /// Three houses around one point, each with its own peak.
    #[test]
    fn three_that_meet_in_a_point_are_three() {
        let found = labels_of(&["8883888", "8883888", "3333333", "8888888", "8888888"], 0.4, 3);
        let (a, b, c) = (found[0].as_bytes()[0], found[0].as_bytes()[6], found[4].as_bytes()[3]);
        assert!(a != b && b != c && a != c, "{found:?}");
    }
}
