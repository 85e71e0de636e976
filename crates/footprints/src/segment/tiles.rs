//! Large photos in tiles that overlap, and what tiles say put together again.
//!
//! Probabilities are averaged with weights that fall towards a tile's border, where networks see least. Instances of
//! neighbouring tiles are one if they agree where the tiles overlap: half of the smaller one's pixels there.

use std::collections::BTreeMap;

use sizeup_geo::geodata::raster::Window;
use sizeup_heights::raster::Raster;

/// Share of the smaller instance's pixels in the overlap that two halves of one building share.
const SAME_SHARE: f64 = 0.5;
/// Least weight of a pixel at a tile's border.
const BORDER_WEIGHT: f32 = 0.02;

/// Tiles of a photo, at most `tile_px` wide and high, `overlap_px` shared with the next one; all of one size.
pub(super) fn tiles((width, height): (usize, usize), tile_px: usize, overlap_px: usize) -> Vec<Window> {
    let starts = |n: usize| -> Vec<usize> {
        let tile = tile_px.min(n);
        if tile == n {
            return vec![0];
        }
        let step = tile - overlap_px.min(tile - 1);
        let n_tiles = (n - tile).div_ceil(step) + 1;
        // Spread evenly, so that the last one ends at the border.
        (0..n_tiles).map(|i| i * (n - tile) / (n_tiles - 1)).collect()
    };
    let (w, h) = (tile_px.min(width), tile_px.min(height));
    let columns = starts(width);
    starts(height)
        .into_iter()
        .flat_map(|row| columns.iter().map(move |&col| Window { col, row, width: w, height: h }))
        .collect()
}

/// A tile's map at the photo's own pixels: bilinear from however many cells the network gives.
pub(super) fn at_photo_size(map: &Raster<f32>, tile: Window) -> Raster<f32> {
    let (sx, sy) = (map.width() as f64 / tile.width as f64, map.height() as f64 / tile.height as f64);
    let value = |i: usize| {
        let (col, row) = (i % tile.width, i / tile.width);
        map.bilinear((col as f64 + 0.5) * sx, (row as f64 + 0.5) * sy)
    };
    Raster::from_vec(tile.width, tile.height, (0..tile.width * tile.height).map(value).collect())
        .expect("one value per pixel")
}

/// Averages tiles into a map of the photo.
pub(super) struct Mosaic {
    sum: Raster<f32>,
    weight: Raster<f32>,
}

impl Mosaic {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { sum: Raster::filled(width, height, 0.0), weight: Raster::filled(width, height, 0.0) }
    }

    /// Adds a tile's map at the photo's own pixels.
    pub(super) fn add(&mut self, tile: Window, map: &Raster<f32>) {
        for row in 0..tile.height {
            for col in 0..tile.width {
                let weight = tent(col, tile.width) * tent(row, tile.height);
                let at = (tile.col + col, tile.row + row);
                self.sum[at] += weight * map[(col, row)];
                self.weight[at] += weight;
            }
        }
    }

    pub(super) fn finish(self) -> Raster<f32> {
        let mut map = self.sum;
        map.data_mut().iter_mut().zip(self.weight.data()).for_each(|(v, w)| *v /= w.max(f32::MIN_POSITIVE));
        map
    }
}

fn tent(i: usize, n: usize) -> f32 {
    let from_border = (i.min(n - 1 - i) as f32 + 0.5) / (0.5 * n as f32);
    from_border.max(BORDER_WEIGHT)
}

/// Instances of tiles joined into those of the photo.
pub(super) struct Joiner {
    labels: Raster<u32>,
    /// Per label, its score.
    scores: Vec<f32>,
    /// Number of looks at each pixel.
    looks: Raster<u8>,
}

impl Joiner {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { labels: Raster::filled(width, height, 0), scores: vec![0.0], looks: Raster::filled(width, height, 0) }
    }

    /// Adds a tile's instances: probabilities at the photo's own pixels, and scores; a building is where they are above
    /// a half.
    pub(super) fn add(&mut self, tile: Window, mut instances: Vec<(Raster<f32>, f32)>) {
        // The surest first: it has the pixels that two instances claim.
        instances.sort_by(|a, b| b.1.total_cmp(&a.1));
        let at = |i: usize| (tile.col + i % tile.width, tile.row + i / tile.width);
        let is_old: Vec<bool> = (0..tile.width * tile.height).map(|i| self.looks[at(i)] > 0).collect();
        // Pixels of every known instance where this tile looks again.
        let mut known: BTreeMap<u32, usize> = BTreeMap::new();
        for i in (0..is_old.len()).filter(|&i| is_old[i]) {
            *known.entry(self.labels[at(i)]).or_default() += 1;
        }
        let mut is_taken = vec![false; is_old.len()];
        for (map, score) in instances {
            let own: Vec<usize> = (0..is_old.len()).filter(|&i| map.data()[i] > 0.5 && !is_taken[i]).collect();
            let n_again = own.iter().filter(|&&i| is_old[i]).count();
            let mut shared: BTreeMap<u32, usize> = BTreeMap::new();
            for &i in own.iter().filter(|&&i| is_old[i]) {
                *shared.entry(self.labels[at(i)]).or_default() += 1;
            }
            let partner = shared
                .iter()
                .filter(|(label, _)| **label != 0)
                .filter(|(label, n)| **n as f64 >= SAME_SHARE * n_again.min(known[label]) as f64)
                .max_by_key(|(label, n)| (**n, std::cmp::Reverse(**label)))
                .map(|(label, _)| *label);
            let label = partner.unwrap_or_else(|| {
                self.scores.push(0.0);
                self.scores.len() as u32 - 1
            });
            let best = &mut self.scores[label as usize];
            *best = best.max(score);
            for i in own {
                is_taken[i] = true;
                let cell = &mut self.labels[at(i)];
                if *cell == 0 {
                    *cell = label;
                }
            }
        }
        for i in 0..is_old.len() {
            let looks = &mut self.looks[at(i)];
            *looks = looks.saturating_add(1);
        }
    }

    /// Labels of the photo (0 = none), and the score of each.
    pub(super) fn finish(self) -> (Raster<u32>, Vec<f32>) {
        (self.labels, self.scores)
    }
}

/// Rule that tells buildings of a map apart.
#[derive(Debug, Clone, Copy)]
pub(super) struct Apart {
    /// Probability above which there is a building.
    pub above: f32,
    /// Probability of a border up to which a pixel is the core of a building.
    pub core: f32,
    /// Least pixels of a core.
    pub least_px: usize,
}

/// Levels of the border's probability from cores to the border's crest.
const N_LEVELS: usize = 6;

/// Buildings of a map of probabilities, told apart by a map of borders between them: a watershed. Cores with little border
/// grow over the mask, level by level of the border's probability and nearest first; what no core reaches at a level is a core
/// itself, once it is large enough. So neighbours meet on the crest between them, and a house full of border is not lost.
pub(super) fn split(buildings: &Raster<f32>, borders: &Raster<f32>, how: Apart) -> Raster<u32> {
    let (width, height) = (buildings.width(), buildings.height());
    let mut labels = Raster::filled(width, height, 0_u32);
    let neighbours = |i: usize| {
        let (col, row) = (i % width, i / width);
        [
            (col > 0).then(|| i - 1),
            (col + 1 < width).then(|| i + 1),
            (row > 0).then(|| i - width),
            (row + 1 < height).then(|| i + width),
        ]
        .into_iter()
        .flatten()
    };
    let (built, border) = (buildings.data(), borders.data());
    let mut next = 0;
    // Labelled pixels that have neighbours without a label.
    let mut rim: Vec<usize> = Vec::new();
    for step in 0..=N_LEVELS {
        let is_last = step == N_LEVELS;
        let level = how.core + (1.0 - how.core) * step as f32 / N_LEVELS as f32;
        let is_open =
            |i: usize, labels: &[u32]| labels[i] == 0 && built[i] > how.above && (is_last || border[i] <= level);
        let labels = labels.data_mut();
        let mut front = std::mem::take(&mut rim);
        while !front.is_empty() {
            let mut further = Vec::new();
            for &i in &front {
                for j in neighbours(i) {
                    if is_open(j, labels) {
                        labels[j] = labels[i];
                        further.push(j);
                    }
                }
            }
            rim.append(&mut front);
            front = further;
        }
        let mut is_seen = vec![false; labels.len()];
        for start in 0..labels.len() {
            if is_seen[start] || !is_open(start, labels) {
                continue;
            }
            is_seen[start] = true;
            let mut part = vec![start];
            let mut at = 0;
            while at < part.len() {
                for j in neighbours(part[at]) {
                    if !is_seen[j] && is_open(j, labels) {
                        is_seen[j] = true;
                        part.push(j);
                    }
                }
                at += 1;
            }
            if is_last || part.len() >= how.least_px {
                next += 1;
                part.iter().for_each(|&i| labels[i] = next);
                rim.append(&mut part);
            }
        }
        rim.retain(|&i| neighbours(i).any(|j| labels[j] == 0 && built[j] > how.above));
    }
    labels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_the_photo_and_overlap_as_asked() {
        let found = tiles((1000, 700), 512, 64);
        assert!(found.iter().all(|t| (t.width, t.height) == (512, 512)));
        let mut looks = Raster::filled(1000, 700, 0);
        for t in &found {
            for i in 0..t.width * t.height {
                looks[(t.col + i % t.width, t.row + i / t.width)] += 1;
            }
        }
        assert!(looks.data().iter().all(|n| *n > 0));
        for pair in found.windows(2).filter(|p| p[0].row == p[1].row) {
            assert!(pair[0].col + pair[0].width >= pair[1].col + 64 || pair[1].col + 512 == 1000);
        }
        assert_eq!(tiles((300, 200), 512, 64), [Window { col: 0, row: 0, width: 300, height: 200 }]);
    }

    /// A building over a seam, and one beside it in the second tile only.
    #[test]
    fn a_building_over_a_seam_is_one_and_its_neighbour_another() {
        let photo = |col: usize, row: usize| match (col, row) {
            (20..40, 5..15) => 1,
            (40..50, 5..15) => 2,
            _ => 0,
        };
        let mut joiner = Joiner::new(60, 20);
        for tile in tiles((60, 20), 36, 12) {
            let map = |which: u32| {
                let value = |i: usize| {
                    f32::from(u8::from(photo(tile.col + i % tile.width, tile.row + i / tile.width) == which))
                };
                Raster::from_vec(tile.width, tile.height, (0..tile.width * tile.height).map(value).collect()).unwrap()
            };
            joiner.add(tile, [1, 2].map(|which| (map(which), 0.9)).into());
        }
        let (labels, _) = joiner.finish();
        let at = |col| labels[(col, 10)];
        assert!(at(21) != 0 && at(21) == at(39) && at(45) != 0 && at(45) != at(39));
        assert_eq!((at(10), at(55)), (0, 0));
    }

    /// Rows of a map of one pixel a letter: `.` is no building, a digit the tenths of the border's probability.
    fn maps(rows: &[&str]) -> (Raster<f32>, Raster<f32>) {
        let letters: Vec<char> = rows.iter().flat_map(|row| row.chars()).collect();
        let raster = |f: &dyn Fn(&char) -> f32| {
            Raster::from_vec(rows[0].len(), rows.len(), letters.iter().map(f).collect()).unwrap()
        };
        (raster(&|c| if *c == '.' { 0.1 } else { 0.9 }), raster(&|c| c.to_digit(10).map_or(0.0, |d| d as f32 / 10.0)))
    }

    fn labels_of(rows: &[&str], core: f32, least_px: usize) -> Vec<String> {
        let (buildings, borders) = maps(rows);
        let labels = split(&buildings, &borders, Apart { above: 0.5, core, least_px });
        let row = |r: usize| (0..labels.width()).map(|c| char::from(b'0' + labels[(c, r)] as u8)).collect();
        (0..labels.height()).map(row).collect()
    }

    #[test]
    fn borders_split_row_houses_and_leave_no_gap() {
        assert_eq!(labels_of(&[".0009000."; 2], 0.5, 2), ["011112220"; 2]);
        // They meet on the crest, wherever that lies between the cores.
        assert_eq!(labels_of(&[".06667900."; 2], 0.5, 2), ["0111112220"; 2]);
    }

    /// A house full of border beside one with a core, and specks that are no houses.
    #[test]
    fn a_house_full_of_border_is_one_of_its_own_and_a_speck_is_not() {
        let rows = ["0000096669", "0070096669", "0060096669", "0000096669"];
        assert_eq!(labels_of(&rows, 0.5, 4), ["1111112222"; 4]);
        // Small ones are still told where nothing else is near.
        assert_eq!(labels_of(&["00....", "00....", ".....9"], 0.5, 3), ["110000", "110000", "000002"]);
    }
}
