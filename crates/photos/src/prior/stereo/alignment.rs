//! Small turns of a view's neighbours, so that photos fit where poses are a little off.
//!
//! Patches of the view are looked for in every neighbour, along the line on which their height moves them and a few
//! pixels across it. A patch that shows in several neighbours has one height. With `mᵢⱼ` the place of patch `i` in
//! neighbour `j`, `zᵢ` its height, `ωⱼ` a small turn of the neighbour's camera and `π` the projection:
//!
//! ```text
//! least  Σ ρ(|mᵢⱼ − πⱼ(zᵢ, ωⱼ)|) + Σ |ωⱼ|² / σ²        by Gauss–Newton, zᵢ eliminated, ρ Cauchy's
//! ```
//!
//! The view itself stays: what its own pose is off by moves all of its depths together.

use std::ops::RangeInclusive;
use std::sync::Arc;

use glam::{DMat2, DMat3, DVec2, DVec3};

use super::levels::Levels;
use super::sweep::{homography, position};
use sizeup_heights::frames::Rigid;
use sizeup_heights::picture::{Picture, PosedCamera};
use sizeup_heights::raster::Raster;
use sizeup_heights::stats::median;

/// Patches per side of the view.
const GRID: usize = 10;
/// Half the side of a patch, pixels.
const RADIUS: i32 = 4;
/// Halvings of the pictures for the first search.
const COARSEST: u32 = 1;
/// Distance searched across the line at first, pixels of the coarsest pictures.
const ACROSS: i32 = 3;
/// Variance below which a patch has no texture, grey levels².
const LEAST_VARIANCE: f32 = 1.0;
/// Least correlation of a patch that is found.
const LEAST_SCORE: f64 = 0.75;
/// Least number of patches that a neighbour is turned by.
const LEAST_PATCHES: usize = 12;
/// Residuals beyond it count less, pixels.
const SPREAD_PX: f64 = 0.7;
/// Turns expected, radians: half a degree.
const TURN_RAD: f64 = 0.0087;
/// Steps of the iteration, first for the heights, then for all.
const N_STEPS: usize = 8;
/// Median misfit from which neighbours are turned, pixels: 0.15 to 0.28 under the poses of a bundle adjustment (Warsaw).
const LEAST_MISFIT_PX: f64 = 0.5;
/// By which factor it has to fall.
const BETTER: f64 = 0.8;

/// Turns of the neighbours.
#[derive(Debug, Clone)]
pub(super) struct Alignment {
    /// The neighbours as they fit, in their order.
    pub neighbours: Vec<PosedCamera>,
    /// Median distance of patches from where the poses put them, pixels, before and after; `None` for too few patches.
    pub misfit_px: Option<[f64; 2]>,
}

impl Alignment {
    /// Whether the photos do not fit by the poses, and the turned ones fit better.
    pub(super) fn is_better(&self) -> bool {
        self.misfit_px.is_some_and(|[before, after]| before > LEAST_MISFIT_PX && after < BETTER * before)
    }
}

/// Fits the neighbours to the view.
pub(super) fn align(view: &Picture, others: &[Arc<Picture>], levels: &Levels) -> Alignment {
    let pyramid = Pyramid::of(view);
    let patches = pyramid.patches();
    let mut fit = TurnFit::new(view.posed(), others, patches.len());
    for (j, other) in others.iter().enumerate() {
        let there = Pyramid::of(other);
        for (i, patch) in patches.iter().enumerate() {
            if let Some((z_m, place)) = find(&pyramid, &there, *patch, levels) {
                fit.patches[i].push(SeenPatch { neighbour: j, place });
                fit.heights_m[i].push(z_m);
            }
        }
    }
    fit.solve(&patches)
}

/// A picture and its halves.
struct Pyramid<'a> {
    picture: &'a Picture,
    halves: Vec<Picture>,
}

impl<'a> Pyramid<'a> {
    fn of(picture: &'a Picture) -> Self {
        let mut halves: Vec<Picture> = Vec::new();
        for _ in 0..COARSEST {
            halves.push(halves.last().unwrap_or(picture).half());
        }
        Self { picture, halves }
    }

    fn grey(&self, halvings: u32) -> &Raster<f32> {
        halvings.checked_sub(1).map_or(self.picture.grey(), |i| self.halves[i as usize].grey())
    }

    /// The places with the clearest corner, one per cell of a grid.
    fn patches(&self) -> Vec<DVec2> {
        let grey = self.grey(COARSEST);
        let (width, height) = (grey.width() as i32, grey.height() as i32);
        let border = RADIUS + 2;
        let best_of = |cell: usize| {
            let (col, row) = ((cell % GRID) as i32, (cell / GRID) as i32);
            let span = |i: i32, n: i32| (i * n / GRID as i32).max(border)..((i + 1) * n / GRID as i32).min(n - border);
            let places = span(row, height).flat_map(|y| span(col, width).map(move |x| (x, y)));
            let scored = places.step_by(3).map(|(x, y)| (corner(grey, x, y), x, y));
            scored.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|best| best.0 > 1.0)
        };
        let scale = f64::from(1 << COARSEST);
        let place = |(_, x, y): (f32, i32, i32)| scale * DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        (0..GRID * GRID).filter_map(best_of).map(place).collect()
    }
}

/// The lesser eigenvalue of the mean gradient's square: how much a patch says in both directions.
fn corner(grey: &Raster<f32>, x: i32, y: i32) -> f32 {
    let at = |x: i32, y: i32| grey[(x as usize, y as usize)];
    let [mut xx, mut xy, mut yy] = [0.0_f32; 3];
    for dy in -RADIUS..=RADIUS {
        for dx in -RADIUS..=RADIUS {
            let (x, y) = (x + dx, y + dy);
            let (gx, gy) = (at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1));
            (xx, xy, yy) = (xx + gx * gx, xy + gx * gy, yy + gy * gy);
        }
    }
    let n = ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32;
    let (mean, off) = (0.5 * (xx + yy), (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt());
    (mean - off) / n
}

/// A patch in a neighbour: its height by that pair alone, and where it is, pixels.
fn find(here: &Pyramid<'_>, there: &Pyramid<'_>, patch: DVec2, levels: &Levels) -> Option<(f64, DVec2)> {
    let line = EpipolarLine::of(here.picture.posed(), there.picture.posed(), patch, levels)?;
    let search =
        |halvings: u32| Some(PatchSearch { template: Template::of(here.grey(halvings), patch, halvings)?, there });
    let mut step_px = f64::from(1 << COARSEST);
    let n = (line.length_px / step_px).ceil() as i32;
    let mut best = search(COARSEST)?.best(&line, [0.0; 2], step_px, [0..=n, -ACROSS..=ACROSS])?;
    for halvings in (0..COARSEST).rev() {
        step_px /= 2.0;
        best = search(halvings)?.best(&line, best.1, step_px, [-2..=2, -2..=2])?;
    }
    if best.0 < LEAST_SCORE {
        return None;
    }
    let [along, across] = best.1;
    let finest = search(0)?;
    let score = |a: f64, e: f64| Some(f64::from(finest.score(&line.at(along + a)?, across + e, &line)?));
    let vertex = |below: Option<f64>, above: Option<f64>| {
        let (below, above) = (below.unwrap_or(-1.0), above.unwrap_or(-1.0));
        let bend = below - 2.0 * best.0 + above;
        if bend < 0.0 { (0.5 * (below - above) / bend).clamp(-0.5, 0.5) } else { 0.0 }
    };
    let across = across + vertex(score(0.0, -1.0), score(0.0, 1.0));
    let along = along + vertex(score(-1.0, 0.0), score(1.0, 0.0));
    Some((line.height_m(along), line.at(along)?.place + across * line.across))
}

/// Line on which a neighbour shows a place of the view by its height.
struct EpipolarLine<'a> {
    ideals: [&'a PosedCamera; 2],
    patch: DVec2,
    levels: &'a Levels,
    length_px: f64,
    across: DVec2,
}

/// A place on a line.
struct OnLine {
    place: DVec2,
    /// Moves of it by a step in the view.
    steps: DMat2,
}

impl<'a> EpipolarLine<'a> {
    fn of(here: &'a PosedCamera, there: &'a PosedCamera, patch: DVec2, levels: &'a Levels) -> Option<Self> {
        let mut line = Self { ideals: [here, there], patch, levels, length_px: 1.0, across: DVec2::ZERO };
        let whole = line.place(levels.to_m)? - line.place(levels.from_m)?;
        line.length_px = whole.length();
        line.across = whole.normalize_or_zero().perp();
        (line.length_px > 1.0).then_some(line)
    }

    fn height_m(&self, along_px: f64) -> f64 {
        self.levels.height_m((self.levels.n - 1) as f64 * along_px / self.length_px)
    }

    fn place(&self, z_m: f64) -> Option<DVec2> {
        position(&homography(self.ideals[0], self.ideals[1], z_m), self.patch)
    }

    fn at(&self, along_px: f64) -> Option<OnLine> {
        let homography = homography(self.ideals[0], self.ideals[1], self.height_m(along_px));
        let place = position(&homography, self.patch)?;
        let right = position(&homography, self.patch + DVec2::X)? - place;
        let down = position(&homography, self.patch + DVec2::Y)? - place;
        Some(OnLine { place, steps: DMat2::from_cols(right, down) })
    }
}

/// Pixels of a patch, as steps from its middle.
fn offsets() -> impl Iterator<Item = DVec2> {
    let side = -RADIUS..=RADIUS;
    side.clone().flat_map(move |dy| side.clone().map(move |dx| DVec2::new(f64::from(dx), f64::from(dy))))
}

/// A patch as the view shows it, with mean 0 and mean square 1.
struct Template {
    halvings: u32,
    values: Vec<f32>,
}

impl Template {
    /// `None` without texture, and at the view's border.
    fn of(grey: &Raster<f32>, patch: DVec2, halvings: u32) -> Option<Self> {
        let middle = patch / f64::from(1 << halvings);
        let mut values: Vec<f32> = offsets().map(|o| middle + o).map(|p| grey.bilinear(p.x, p.y)).collect();
        let n = values.len() as f32;
        let mean = values.iter().sum::<f32>() / n;
        values.iter_mut().for_each(|v| *v -= mean);
        let variance = values.iter().map(|v| v * v).sum::<f32>() / n;
        // NaN where the patch leaves the picture.
        (variance > LEAST_VARIANCE).then(|| {
            let per_deviation = variance.sqrt().recip();
            values.iter_mut().for_each(|v| *v *= per_deviation);
            Self { halvings, values }
        })
    }
}

/// A patch looked for in a neighbour.
struct PatchSearch<'a> {
    template: Template,
    there: &'a Pyramid<'a>,
}

impl PatchSearch<'_> {
    /// The best place on a grid: its correlation, and pixels along the line and across it.
    fn best(
        &self,
        line: &EpipolarLine<'_>,
        from_px: [f64; 2],
        step_px: f64,
        [along, across]: [RangeInclusive<i32>; 2],
    ) -> Option<(f64, [f64; 2])> {
        let mut best: Option<(f32, [f64; 2])> = None;
        for along in along {
            let along_px = from_px[0] + f64::from(along) * step_px;
            let Some(on_line) = line.at(along_px) else { continue };
            for across in across.clone() {
                let across_px = from_px[1] + f64::from(across) * step_px;
                let Some(score) = self.score(&on_line, across_px, line) else { continue };
                if best.is_none_or(|best| score > best.0) {
                    best = Some((score, [along_px, across_px]));
                }
            }
        }
        best.map(|(score, at)| (f64::from(score), at))
    }

    /// Correlation of the patch so many pixels beside a place on the line; `None` outside and without texture.
    fn score(&self, on_line: &OnLine, across_px: f64, line: &EpipolarLine<'_>) -> Option<f32> {
        let there = self.there.grey(self.template.halvings);
        let middle = (on_line.place + across_px * line.across) / f64::from(1 << self.template.halvings);
        let reach = f64::from(RADIUS) * (on_line.steps.x_axis.abs() + on_line.steps.y_axis.abs());
        let size = DVec2::new(there.width() as f64, there.height() as f64);
        if !((middle - reach).cmpge(DVec2::ZERO).all() && (middle + reach).cmple(size).all()) {
            return None;
        }
        let [mut sum, mut squares, mut products] = [0.0_f32; 3];
        for (offset, value) in offsets().zip(&self.template.values) {
            let place = middle + on_line.steps * offset;
            let seen = there.bilinear(place.x, place.y);
            sum += seen;
            squares += seen * seen;
            products += seen * value;
        }
        let n = self.template.values.len() as f32;
        let variance = squares / n - (sum / n) * (sum / n);
        (variance > LEAST_VARIANCE).then(|| products / n / variance.sqrt())
    }
}

/// A patch as a neighbour shows it.
#[derive(Debug, Clone, Copy)]
struct SeenPatch {
    neighbour: usize,
    place: DVec2,
}

/// The turns to be found, and what they are found by.
struct TurnFit<'a> {
    view: &'a PosedCamera,
    neighbours: Vec<PosedCamera>,
    patches: Vec<Vec<SeenPatch>>,
    /// Height of each patch, by each neighbour that shows it.
    heights_m: Vec<Vec<f64>>,
}

impl<'a> TurnFit<'a> {
    fn new(view: &'a PosedCamera, others: &[Arc<Picture>], n_patches: usize) -> Self {
        let neighbours = others.iter().map(|other| other.posed().clone()).collect();
        Self { view, neighbours, patches: vec![Vec::new(); n_patches], heights_m: vec![Vec::new(); n_patches] }
    }

    fn solve(mut self, patches: &[DVec2]) -> Alignment {
        let mut heights_m: Vec<f64> = self.heights_m.iter().map(|z| median(z).unwrap_or(0.0)).collect();
        let given = self.neighbours.clone();
        // Heights first, so that what is left before any turn is known.
        (0..N_STEPS).for_each(|_| self.step(patches, &mut heights_m, Turns::Held));
        let before = self.misfit_px(patches, &heights_m);
        (0..N_STEPS).for_each(|_| self.step(patches, &mut heights_m, Turns::Free));
        let after = self.misfit_px(patches, &heights_m);
        for (j, neighbour) in self.neighbours.iter_mut().enumerate() {
            let n = self.patches.iter().flatten().filter(|seen| seen.neighbour == j).count();
            if n < LEAST_PATCHES {
                neighbour.clone_from(&given[j]);
            }
        }
        Alignment { neighbours: self.neighbours, misfit_px: before.zip(after).map(|(before, after)| [before, after]) }
    }

    /// Median over the patches that more than one neighbour shows: one alone can be explained by its height.
    fn misfit_px(&self, patches: &[DVec2], heights_m: &[f64]) -> Option<f64> {
        let off = |(i, seen): (usize, &SeenPatch)| {
            Some((seen.place - self.project(seen.neighbour, patches[i], heights_m[i])?.0).length())
        };
        let all: Vec<f64> = self
            .patches
            .iter()
            .enumerate()
            .filter(|(_, seen)| seen.len() > 1)
            .flat_map(|(i, seen)| seen.iter().map(move |seen| (i, seen)))
            .filter_map(off)
            .collect();
        if all.len() < LEAST_PATCHES { None } else { median(&all) }
    }

    /// Pixel at which a neighbour shows a place of the view at a height, and how that changes by metre, and by its turn.
    fn project(&self, neighbour: usize, patch: DVec2, z_m: f64) -> Option<(DVec2, DVec2, [DVec2; 3])> {
        let pose = &self.view.camera_from_map;
        let ray = pose.rotation.transpose() * self.view.calibration().inverse() * patch.extend(1.0);
        let place = pose.centre() + (z_m - pose.centre().z) / ray.z * ray;
        let there = &self.neighbours[neighbour];
        let p = there.camera_from_map.point(place);
        if p.z <= 0.0 {
            return None;
        }
        let camera = &there.camera;
        let at = DVec2::new(camera.fx_px * p.x / p.z + camera.cx_px, camera.fy_px * p.y / p.z + camera.cy_px);
        let moved =
            |d: DVec3| DVec2::new(camera.fx_px * (d.x - p.x / p.z * d.z), camera.fy_px * (d.y - p.y / p.z * d.z)) / p.z;
        let by_height = moved(there.camera_from_map.rotation * ray / ray.z);
        Some((at, by_height, [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| moved(axis.cross(p)))))
    }

    /// One step of Gauss–Newton.
    fn step(&mut self, patches: &[DVec2], heights_m: &mut [f64], turns: Turns) {
        let n = 3 * self.neighbours.len();
        let (mut matrix, mut right) = (vec![0.0; n * n], vec![0.0; n]);
        (0..n).for_each(|i| matrix[i * n + i] = (SPREAD_PX / TURN_RAD).powi(2));
        let mut eliminated = Vec::with_capacity(patches.len());
        for (i, seen) in self.patches.iter().enumerate() {
            let rows: Vec<_> = seen
                .iter()
                .filter_map(|seen| {
                    let (at, by_height, by_turn) = self.project(seen.neighbour, patches[i], heights_m[i])?;
                    let off = seen.place - at;
                    let weight = 1.0 / (1.0 + off.length_squared() / (SPREAD_PX * SPREAD_PX));
                    Some((seen.neighbour, off, weight, by_height, by_turn))
                })
                .collect();
            let of_height: f64 = rows.iter().map(|(_, _, w, dz, _)| w * dz.length_squared()).sum();
            let pull: f64 = rows.iter().map(|(_, off, w, dz, _)| w * dz.dot(*off)).sum();
            if of_height <= 0.0 {
                eliminated.push((0.0, Vec::new()));
                continue;
            }
            let mut mixed = vec![0.0; n];
            for (j, off, w, dz, turn) in &rows {
                for a in 0..3 {
                    mixed[3 * j + a] += w * turn[a].dot(*dz);
                    right[3 * j + a] += w * turn[a].dot(*off);
                    for b in 0..3 {
                        matrix[(3 * j + a) * n + 3 * j + b] += w * turn[a].dot(turn[b]);
                    }
                }
            }
            for a in 0..n {
                right[a] -= mixed[a] * pull / of_height;
                for b in 0..n {
                    matrix[a * n + b] -= mixed[a] * mixed[b] / of_height;
                }
            }
            eliminated.push((pull / of_height, mixed.iter().map(|m| m / of_height).collect()));
        }
        let turn = match turns {
            Turns::Held => vec![0.0; n],
            Turns::Free => solve_positive(matrix, right),
        };
        for (z, (pull, mixed)) in heights_m.iter_mut().zip(&eliminated) {
            *z += pull - mixed.iter().zip(&turn).map(|(m, t)| m * t).sum::<f64>();
        }
        for (neighbour, turn) in self.neighbours.iter_mut().zip(turn.chunks_exact(3)) {
            turn_camera(neighbour, DVec3::new(turn[0], turn[1], turn[2]));
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Turns {
    Held,
    Free,
}

/// Turns a camera about its centre by a vector in its own frame, radians.
fn turn_camera(posed: &mut PosedCamera, by: DVec3) {
    let pose = &posed.camera_from_map;
    let turned = DMat3::from_quat(glam::DQuat::from_scaled_axis(by)) * pose.rotation;
    posed.camera_from_map = Rigid::from_rotation_and_centre(turned, pose.centre());
}

/// Solves a symmetric positive definite system by Cholesky's factors.
fn solve_positive(mut matrix: Vec<f64>, mut right: Vec<f64>) -> Vec<f64> {
    let n = right.len();
    for col in 0..n {
        for row in col..n {
            let sum: f64 = (0..col).map(|k| matrix[row * n + k] * matrix[col * n + k]).sum();
            let value = matrix[row * n + col] - sum;
            matrix[row * n + col] = if row == col { value.max(1e-12).sqrt() } else { value / matrix[col * n + col] };
        }
    }
    for row in 0..n {
        let sum: f64 = (0..row).map(|k| matrix[row * n + k] * right[k]).sum();
        right[row] = (right[row] - sum) / matrix[row * n + row];
    }
    for row in (0..n).rev() {
        let sum: f64 = (row + 1..n).map(|k| matrix[k * n + row] * right[k]).sum();
        right[row] = (right[row] - sum) / matrix[row * n + row];
    }
    right
}
