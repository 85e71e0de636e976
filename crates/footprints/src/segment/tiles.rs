//! Large photos in tiles that overlap, and what tiles say put together again.
//!
//! Probabilities are averaged with weights that fall towards a tile's border, where networks see least. Instances of
//! neighbouring tiles are one if they agree where the tiles overlap: half of the smaller one's pixels there.

use std::collections::BTreeMap;

use sizeup_geo::geodata::raster::CellWindow;
use sizeup_heights::raster::Raster;

/// Share of the smaller instance's pixels in the overlap that two halves of one building share.
const SAME_SHARE: f64 = 0.5;
/// Least weight of a pixel at a tile's border.
const BORDER_WEIGHT: f32 = 0.02;

/// Side of a tile that a network of `side` pixels sees reduced by `factor`; never enlarged, and no more than a square of the photo, so that it is
/// reduced alike in both directions.
pub(super) fn reduced_side(side: usize, photo: (usize, usize), factor: f64) -> usize {
    ((side as f64 * factor).round() as usize).min(photo.0).min(photo.1).max(side)
}

/// Tiles of a photo, at most `tile_px` wide and high, `overlap_px` shared with the next one; all of one size.
pub(super) fn tiles((width, height): (usize, usize), tile_px: usize, overlap_px: usize) -> Vec<CellWindow> {
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
        .flat_map(|row| columns.iter().map(move |&col| CellWindow { col, row, width: w, height: h }))
        .collect()
}

/// A tile's map at the photo's own pixels: bilinear from however many cells the network gives.
pub(super) fn at_photo_size(map: &Raster<f32>, tile: CellWindow) -> Raster<f32> {
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
    pub(super) fn add(&mut self, tile: CellWindow, map: &Raster<f32>) {
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
    pub(super) fn add(&mut self, tile: CellWindow, mut instances: Vec<(Raster<f32>, f32)>) {
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
        assert_eq!(tiles((300, 200), 512, 64), [CellWindow { col: 0, row: 0, width: 300, height: 200 }]);
    }

    /// A network of 256 pixels that sees 0.34 m per pixel: photos of 0.085 m are reduced to a quarter, coarser ones than 0.34 m are not enlarged.
    #[test]
    fn fine_photos_are_reduced_as_far_as_they_reach() {
        assert_eq!(reduced_side(256, (4000, 3000), 0.34 / 0.085), 1024);
        assert_eq!(reduced_side(256, (4000, 3000), 0.34 / 0.5), 256);
        assert_eq!(reduced_side(256, (480, 360), 0.34 / 0.2), 360);
        assert_eq!(reduced_side(256, (480, 200), 0.34 / 0.2), 256);
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
}
