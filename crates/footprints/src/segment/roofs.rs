//! Footprints on the ground from roofs, told apart where they are seen and moved to where their walls meet the ground.
//!
//! ```text
//! foot = n + (1 − r) · (p − n)         r = h · cos t / Z       roof = n + (g − n) / (1 − r)
//! ```
//!
//! `p`: a roof's pixel, `g`: a pixel of the ground, `n`: the nadir, `h`: height of the roof above its foot, `Z`: depth of the foot,
//! `t`: tilt of the photo. The *rise* `r` of a flat roof over level ground is one number, however the photo is tilted, for all
//! verticals meet in the nadir. The edges of roofs are what a photo shows; where walls stand between two houses it does not.
//!
//! A watershed tells the roofs of a map apart (`apart.rs`), parts that no valley divides are joined (`valleys.rs`), and each is laid on the ground by the median of its own rise, and what a
//! map of the ground says decides how far footprints reach: pixels of it that no roof covers fall to the nearest one.

use std::collections::VecDeque;

use glam::DVec2;
use sizeup_heights::raster::Raster;

use super::apart::{Apart, split};
use super::valleys::join;

/// The rise that a network's fourth map says by a 1: a roof of 40 m seen from 100 m.
pub const MOST_RISE: f32 = 0.4;
/// Height that no roof exceeds, metres: the highest at which contours of roofs are tried, too (`consensus.rs`).
const HIGHEST_M: f64 = 100.0;
/// How far the map of middles falls between two parts of the watershed, which are joined again where they are one roof.
const FLOOD_DIP: f32 = 0.003;
/// Probability of the ground below which a roof that was laid there is not believed.
const GROUND_FROM: f32 = 0.15;

/// Maps that a network gives for a photo, `rows × columns` each, 0 to 1.
#[derive(Debug, Clone)]
pub struct Maps {
    /// Whether there is a building on the ground, hidden or not.
    pub ground: Raster<f32>,
    /// Whether a roof is seen.
    pub roof: Raster<f32>,
    /// How near to the middle of its roof a pixel lies.
    pub middle: Raster<f32>,
    /// The rise of the roof, over [`MOST_RISE`].
    pub rise: Raster<f32>,
    /// Whether two roofs meet.
    pub seam: Raster<f32>,
}

/// Limits a map of rises to what is possible where feet are `foot_depth_m` away: in an orthophoto, or from far above, roofs are not
/// displaced, and a network that learned from photos does not know.
#[must_use]
pub fn possible_rise(rise: &Raster<f32>, foot_depth_m: f64) -> Raster<f32> {
    let most = (HIGHEST_M / foot_depth_m) as f32 / MOST_RISE;
    rise.map(|r| r.min(most))
}

/// Labels of the buildings on the ground, from 1; 0 is none. `how.dip`: how far middles less seams fall along the border of two roofs.
#[must_use]
pub fn footprints(maps: &Maps, nadir: DVec2, how: Apart) -> Raster<u32> {
    let parts = split(&maps.roof, &maps.middle, Apart { dip: FLOOD_DIP, ..how });
    let roofs = join(&parts, &less_seams(&maps.middle, &maps.seam), how.dip);
    let laid = laid_down(&roofs, &of_each(&roofs, &maps.rise), maps, nadir);
    grown(laid, &maps.ground, how.above)
}

/// How near to a middle a pixel lies less the probability of a seam: both tell two roofs apart, from −1 at a sure seam to 1.
fn less_seams(middle: &Raster<f32>, seam: &Raster<f32>) -> Raster<f32> {
    let mut both = middle.clone();
    both.data_mut().iter_mut().zip(seam.data()).for_each(|(middle, seam)| *middle -= seam);
    both
}

/// Bounds of a label and its rise.
#[derive(Debug, Clone, Copy)]
struct LabelExtent {
    rise: f64,
    /// First column and row, and one after the last.
    bounds: [usize; 4],
}

/// The roofs by their labels, from 1: each with the median of its rise.
fn of_each(roofs: &Raster<u32>, rise: &Raster<f32>) -> Vec<LabelExtent> {
    let n = roofs.data().iter().copied().max().unwrap_or(0) as usize;
    let mut rises: Vec<Vec<f32>> = vec![Vec::new(); n];
    let mut bounds = vec![[usize::MAX, usize::MAX, 0, 0]; n];
    for (i, &label) in roofs.data().iter().enumerate().filter(|(_, l)| **l != 0) {
        let (col, row) = (i % roofs.width(), i / roofs.width());
        let [left, top, right, bottom] = bounds[label as usize - 1];
        bounds[label as usize - 1] = [left.min(col), top.min(row), right.max(col + 1), bottom.max(row + 1)];
        rises[label as usize - 1].push(rise.data()[i]);
    }
    let median = |values: &mut Vec<f32>| {
        let middle = values.len() / 2;
        values.select_nth_unstable_by(middle, f32::total_cmp).1.to_owned()
    };
    let of = |(values, bounds): (&mut Vec<f32>, [usize; 4])| LabelExtent {
        rise: f64::from(MOST_RISE * median(values)),
        bounds,
    };
    rises.iter_mut().zip(bounds).map(of).collect()
}

/// Roofs laid on the ground; of two in one pixel, the one whose middle is nearer has it.
fn laid_down(labels: &Raster<u32>, roofs: &[LabelExtent], maps: &Maps, nadir: DVec2) -> Raster<u32> {
    let (width, height) = (labels.width(), labels.height());
    let mut laid = Raster::filled(width, height, 0);
    let mut depth = Raster::filled(width, height, f32::NEG_INFINITY);
    for (label, roof) in (1..).zip(roofs) {
        let foot = |col: usize, row: usize| nadir + (1.0 - roof.rise) * (DVec2::new(col as f64, row as f64) - nadir);
        let [left, top, right, bottom] = roof.bounds;
        let (low, high) = (foot(left, top), foot(right, bottom));
        for row in low.y.floor().max(0.0) as usize..(high.y.ceil().max(0.0) as usize).min(height) {
            for col in low.x.floor().max(0.0) as usize..(high.x.ceil().max(0.0) as usize).min(width) {
                let ground = DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
                let seen = nadir + (ground - nadir) / (1.0 - roof.rise);
                let is_inside = seen.x >= 0.0 && seen.y >= 0.0;
                let at = (seen.x as usize, seen.y as usize);
                if !is_inside || labels.get(at.0, at.1) != Some(&label) || maps.ground[(col, row)] < GROUND_FROM {
                    continue;
                }
                let middle = maps.middle[at];
                if middle > depth[(col, row)] {
                    (laid[(col, row)], depth[(col, row)]) = (label, middle);
                }
            }
        }
    }
    laid
}

/// Labels that grow over the rest of the ground's map, evenly to all sides; what none of them reaches is a building of its own.
fn grown(mut labels: Raster<u32>, ground: &Raster<f32>, above: f32) -> Raster<u32> {
    let mut next = labels.data().iter().copied().max().unwrap_or(0) + 1;
    let mut queue: VecDeque<usize> = (0..labels.data().len()).filter(|&i| labels.data()[i] != 0).collect();
    let mut first = 0;
    loop {
        while let Some(i) = queue.pop_front() {
            for j in ground.beside(i) {
                if labels.data()[j] == 0 && ground.data()[j] > above {
                    labels.data_mut()[j] = labels.data()[i];
                    queue.push_back(j);
                }
            }
        }
        let Some(seed) = (first..labels.data().len()).find(|&i| labels.data()[i] == 0 && ground.data()[i] > above)
        else {
            return labels;
        };
        labels.data_mut()[seed] = next;
        (next, first) = (next + 1, seed + 1);
        queue.push_back(seed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (60, 40);
    const NADIR: DVec2 = DVec2::new(-40.0, 20.0);

    fn map(value: &dyn Fn(usize, usize) -> f32) -> Raster<f32> {
        let values = (0..SIZE.0 * SIZE.1).map(|i| value(i % SIZE.0, i / SIZE.0)).collect();
        Raster::from_vec(SIZE.0, SIZE.1, values).unwrap()
    }

    /// Two houses of 10 columns on the ground that share a wall at column 20, the second one higher; their roofs are seen to the right.
    fn row_houses(middle: &dyn Fn(usize, usize) -> f32) -> Maps {
        let in_rows = |row: usize| (14..26).contains(&row);
        let is_roof = |col: usize, row: usize| in_rows(row) && ((17..28).contains(&col) || (35..47).contains(&col));
        Maps {
            ground: map(&|col, row| if in_rows(row) && (10..30).contains(&col) { 0.9 } else { 0.05 }),
            roof: map(&|col, row| if is_roof(col, row) { 0.9 } else { 0.1 }),
            middle: map(middle),
            // (17 + 40)(1 − r) = 50 and (35 + 40)(1 − r) = 60.
            seam: map(&|_, _| 0.0),
            rise: map(&|col, _| (if col < 31 { 1.0 - 50.0 / 57.0 } else { 1.0 - 60.0 / 75.0 }) / MOST_RISE),
        }
    }

    const HOW: Apart = Apart { above: 0.5, dip: 0.2, least_px: 8 };

    #[test]
    fn roofs_at_their_own_heights_divide_the_ground_where_their_walls_stand() {
        let found = footprints(&row_houses(&|_, _| 0.8), NADIR, HOW);
        let row: Vec<u32> = (0..SIZE.0).map(|col| found[(col, 20)]).collect();
        assert!(row[..10].iter().chain(&row[30..]).all(|l| *l == 0), "{row:?}");
        assert!(row[10..20].iter().all(|l| *l == row[10]) && row[20..30].iter().all(|l| *l == row[29]), "{row:?}");
        assert_ne!(row[10], row[29]);
    }

    /// Two roofs at one height in one piece: the seam between them is all that tells.
    #[test]
    fn roofs_that_touch_come_apart_at_their_seam() {
        let mut maps = row_houses(&|_, _| 0.8);
        let in_rows = |row: usize| (14..26).contains(&row);
        maps.roof = map(&|col, row| if in_rows(row) && (17..40).contains(&col) { 0.9 } else { 0.1 });
        maps.rise = map(&|_, _| (1.0 - 50.0 / 57.0) / MOST_RISE);
        // A dent that is too shallow for a wall: the flood parts there, and only a seam keeps the parts from being joined.
        maps.middle = map(&|col, _| if (28..30).contains(&col) { 0.75 } else { 0.8 });
        assert_eq!(footprints(&maps, NADIR, HOW)[(12, 20)], footprints(&maps, NADIR, HOW)[(27, 20)]);
        maps.seam = map(&|col, _| if (28..30).contains(&col) { 0.6 } else { 0.0 });
        let found = footprints(&maps, NADIR, HOW);
        assert_ne!(found[(12, 20)], found[(27, 20)]);
    }

    /// The same roofs in an orthophoto, where the ground lies under each: they stay where they are. From 100 m they move as ever.
    #[test]
    fn roofs_of_an_orthophoto_are_not_displaced() {
        let maps = row_houses(&|_, _| 0.8);
        let from = |foot_depth_m: f64, ground: &Raster<f32>| {
            let rise = possible_rise(&maps.rise, foot_depth_m);
            let found = footprints(&Maps { rise, ground: ground.clone(), ..maps.clone() }, NADIR, HOW);
            (0..SIZE.0).map(|col| u32::from(found[(col, 20)] != 0)).collect::<Vec<u32>>()
        };
        let seen = from(70_000.0, &maps.roof);
        assert!(
            (0..60).all(|col| (seen[col] != 0) == ((17..28).contains(&col) || (35..47).contains(&col))),
            "{seen:?}"
        );
        let on_ground = from(100.0, &maps.ground);
        assert!((0..60).all(|col| (on_ground[col] != 0) == (10..30).contains(&col)), "{on_ground:?}");
    }

    /// No roof is seen, yet the ground knows a building: it is one.
    #[test]
    fn a_building_without_a_roof_is_still_one() {
        let mut maps = row_houses(&|_, _| 0.8);
        maps.roof = map(&|_, _| 0.1);
        let found = footprints(&maps, NADIR, HOW);
        assert!((10..30).all(|col| found[(col, 20)] == 1) && found[(9, 20)] == 0);
    }

    #[test]
    fn a_roof_where_the_ground_knows_no_building_is_none() {
        let mut maps = row_houses(&|_, _| 0.8);
        maps.ground = map(&|_, _| 0.05);
        assert!(footprints(&maps, NADIR, HOW).data().iter().all(|l| *l == 0));
    }
}
