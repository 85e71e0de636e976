//! How well the neighbours agree with a view at every height level.
//!
//! A pixel `u` of the view, seen through the plane at height `z`, lies in a neighbour at `H(z)·u`. With projection
//! centres `C`, `M = Rᵣᵀ·Kᵣ⁻¹` (pixel to direction in the map), `m` its third row and `B = Kₛ·Rₛ·M`:
//!
//! ```text
//! H(z) = (Kₛ·Rₛ·(Cᵣ − Cₛ)) ⊗ m + (z − Cᵣ.z)·B
//! ```

use std::ops::Range;
use std::sync::Arc;

use glam::{DMat3, DVec2};

use super::correlate::{CorrelationTile, NeighbourImage, WORST, Windows};
use super::levels::Levels;
use sizeup_heights::picture::{Picture, PosedCamera};
use sizeup_heights::raster::Raster;

/// Rows and columns compared at a time: what is known of so many pixels stays in the processor's cache, and a tile of a
/// finer picture holds few surfaces.
const TILE_PX: [usize; 2] = [28, 84];
/// Around a height that the coarse picture found, levels of its own that are tried again.
const AROUND_LEVELS: f64 = 1.5;
/// Pixels of the coarse picture that make a height worth trying in a tile.
const LEAST_COARSE_PX: usize = 4;

/// Mismatch per pixel and level: pixel-major, so that a pixel's levels lie together.
#[derive(Debug)]
pub(super) struct Volume {
    pub width: usize,
    pub height: usize,
    pub n_levels: usize,
    /// 0 (same) to [`super::correlate::WORST`], `[(row · width + col) · n_levels + level]`.
    pub costs: Vec<u8>,
}

/// Findings in the picture of half the size: of each tile, the heights that are worth trying.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coarse<'a> {
    /// Heights, metres; `NaN` where it is in doubt.
    pub heights_m: &'a Raster<f32>,
    /// The planes that they were chosen from.
    pub levels: &'a Levels,
}

impl Coarse<'_> {
    /// Per level whether it is tried in a tile. A tile without any height has all of them.
    fn wanted(&self, levels: &Levels, rows: &Range<usize>, cols: &Range<usize>) -> Vec<bool> {
        let part = |r: &Range<usize>, n: usize| (r.start / 2).saturating_sub(2)..(r.end / 2 + 2).min(n);
        let (rows, cols) = (part(rows, self.heights_m.height()), part(cols, self.heights_m.width()));
        let mut n_found = vec![0_usize; levels.n];
        for row in rows.clone() {
            let heights = &self.heights_m.data()[row * self.heights_m.width()..][cols.clone()];
            for z in heights.iter().filter(|z| !z.is_nan()) {
                n_found[(levels.level(f64::from(*z)).round().max(0.0) as usize).min(levels.n - 1)] += 1;
            }
        }
        let mut wanted = vec![false; levels.n];
        for (level, _) in n_found.iter().enumerate().filter(|(_, n)| **n >= LEAST_COARSE_PX) {
            wanted[levels.near(level, AROUND_LEVELS, self.levels)].fill(true);
        }
        if !wanted.contains(&true) {
            wanted.fill(true);
        }
        wanted
    }
}

/// Input of a sweep.
pub(super) struct Sweep<'a> {
    /// Picture of the view that depth is looked for in.
    pub reference: &'a Picture,
    /// Pictures of the neighbours that it is compared with.
    pub others: &'a [Arc<Picture>],
    /// Cameras of these: their own poses, or corrected ones.
    pub ideals: &'a [PosedCamera],
    /// Heights of the planes that are swept.
    pub levels: &'a Levels,
    /// Heights found at a coarser size; `None` at the first.
    pub coarse: Option<Coarse<'a>>,
    /// Verdict on a level that some neighbours do not see.
    pub unseen: Unseen,
}

/// Verdict of neighbours on a level at which a pixel leaves their picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unseen {
    /// Nothing: roofs at the border, which fewer see than the ground under them, are found.
    IsNothing,
    /// That it is not there: high levels that one neighbour is left for look like it somewhere by chance, and are not found.
    IsAgainst,
}

impl Sweep<'_> {
    /// The mismatch of every pixel with its neighbours at every level; the worst where a level is not tried. On one
    /// thread: views are many.
    pub(super) fn volume(&self, radius_px: usize) -> Volume {
        let Self { reference, others, levels, .. } = *self;
        let (width, height) = (reference.grey().width(), reference.grey().height());
        let windows = Windows::new(reference.grey(), radius_px);
        let neighbours: Vec<NeighbourImage> = others.iter().map(|other| NeighbourImage::new(other.grey())).collect();
        let homographies: Vec<Vec<DMat3>> = (0..levels.n)
            .map(|level| {
                let z_m = levels.height_m(level as f64);
                self.ideals.iter().map(|ideal| homography(reference.posed(), ideal, z_m)).collect()
            })
            .collect();
        let mut costs = vec![WORST; width * height * levels.n];
        let starts = |n: usize, step: usize| (0..n).step_by(step).map(move |start| start..(start + step).min(n));
        for rows in starts(height, TILE_PX[0]) {
            for cols in starts(width, TILE_PX[1]) {
                let wanted = self.coarse.map(|coarse| coarse.wanted(levels, &rows, &cols));
                let mut tile = CorrelationTile::new(&windows, rows.clone(), cols.clone(), neighbours.len());
                let n_pixels = rows.len() * cols.len();
                let tried: Vec<usize> =
                    (0..levels.n).filter(|level| wanted.as_ref().is_none_or(|wanted| wanted[*level])).collect();
                let mut votes = Vec::with_capacity(tried.len() * n_pixels);
                for level in &tried {
                    tile.forget();
                    for (neighbour, homography) in neighbours.iter().zip(&homographies[*level]) {
                        tile.compare(neighbour, homography);
                    }
                    votes.extend(tile.votes());
                }
                let mut n_most = vec![0_u8; n_pixels];
                if self.unseen == Unseen::IsAgainst {
                    for of_level in votes.chunks_exact(n_pixels) {
                        n_most.iter_mut().zip(of_level).for_each(|(most, vote)| *most = vote.n_seen.max(*most));
                    }
                }
                for (level, of_level) in tried.iter().zip(votes.chunks_exact(n_pixels)) {
                    for (i, (vote, n_most)) in of_level.iter().zip(&n_most).enumerate() {
                        let (row, col) = (rows.start + i / cols.len(), cols.start + i % cols.len());
                        costs[(row * width + col) * levels.n + level] = vote.cost(vote.n_seen.max(*n_most));
                    }
                }
            }
        }
        Volume { width, height, n_levels: levels.n, costs }
    }
}

pub(super) fn homography(reference: &PosedCamera, other: &PosedCamera, z_m: f64) -> DMat3 {
    let (here, there) = (&reference.camera_from_map, &other.camera_from_map);
    let map_from_pixel = here.rotation.transpose() * reference.calibration().inverse();
    let pixel_from_map = other.calibration() * there.rotation;
    let shift = pixel_from_map * (here.centre() - there.centre());
    let m = map_from_pixel.row(2);
    let through = pixel_from_map * map_from_pixel;
    // Negated, because rays go down (`m·u < 0`) and a point in front shall have a positive last coordinate.
    let outer = DMat3::from_cols(shift * m.x, shift * m.y, shift * m.z);
    -(outer + through * (z_m - here.centre().z))
}

pub(super) fn position(homography: &DMat3, pixel: DVec2) -> Option<DVec2> {
    let p = *homography * pixel.extend(1.0);
    (p.z > 0.0).then(|| p.truncate() / p.z)
}
