//! Holes and specks of depth that photos were matched for: next to what one photo alone sees there is no value, or any value.
//!
//! Networks give a value everywhere, and theirs stay as they are.

use sizeup_heights::raster::Raster;

/// How far a hole is filled from its rim, pixels: beyond that nothing is known, which is the ground's 0.
const REACH_PX: usize = 12;
/// How far a value beside a hole may lie from what is around it, spreads of the relief.
const MOST_OFF: f32 = 0.7;
/// Rows and columns to each side that say what is around a value.
const AROUND_PX: usize = 2;

/// Fills what is not finite from its rim inwards, the lower values first: what is hidden lies behind what hides it. Specks beside
/// holes take the median around them before.
pub fn fill(relief: &mut Raster<f32>) {
    if relief.data().iter().all(|v| v.is_finite()) {
        return;
    }
    without_specks(relief);
    let mut rim: Vec<usize> = (0..relief.data().len()).filter(|&i| !relief.data()[i].is_finite()).collect();
    for _ in 0..REACH_PX {
        let (mut filled, mut rest) = (Vec::new(), Vec::new());
        for &i in &rim {
            let known = around(relief, i, 1);
            if known.is_empty() { rest.push(i) } else { filled.push((i, known[(known.len() - 1) / 2])) }
        }
        for (i, value) in filled {
            relief.data_mut()[i] = value;
        }
        rim = rest;
    }
    rim.into_iter().for_each(|i| relief.data_mut()[i] = 0.0);
}

fn without_specks(relief: &mut Raster<f32>) {
    let side = 2 * AROUND_PX + 1;
    let median = |i: usize| {
        let value = relief.data()[i];
        let known = around(relief, i, AROUND_PX);
        let is_beside_hole = value.is_finite() && known.len() + 1 < side * side;
        let median = *known.get(known.len() / 2)?;
        (is_beside_hole && (value - median).abs() > MOST_OFF).then_some((i, median))
    };
    let specks: Vec<(usize, f32)> = (0..relief.data().len()).filter_map(median).collect();
    for (i, median) in specks {
        relief.data_mut()[i] = median;
    }
}

/// Finite values of the rows and columns around a cell, without its own, in order.
fn around(map: &Raster<f32>, i: usize, reach: usize) -> Vec<f32> {
    let (col, row) = (i % map.width(), i / map.width());
    let rows = row.saturating_sub(reach)..(row + reach + 1).min(map.height());
    let columns = col.saturating_sub(reach)..(col + reach + 1).min(map.width());
    let cells = rows.flat_map(|r| columns.clone().map(move |c| (c, r))).filter(|at| *at != (col, row));
    let mut known: Vec<f32> = cells.map(|at| map[at]).filter(|v| v.is_finite()).collect();
    known.sort_by(f32::total_cmp);
    known
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block of height 3 in a plane, with a gap between them, a speck in the gap, and nothing known far to the right.
    #[test]
    fn a_gap_beside_a_block_is_ground_and_specks_in_it_are_gone() {
        let value = |col: usize, row: usize| match (col, row) {
            (13, 10) => 9.0,
            (12..=15, 5..=15) | (40.., _) => f32::NAN,
            (6..=11, 5..=15) => 3.0,
            _ => 0.1,
        };
        let values = (0..60 * 20).map(|i| value(i % 60, i / 60)).collect();
        let mut map = Raster::from_vec(60, 20, values).unwrap();
        fill(&mut map);
        assert!(map.data().iter().all(|v| v.is_finite() && *v <= 3.0));
        assert_eq!((map[(8, 10)], map[(15, 10)], map[(45, 10)], map[(58, 10)]), (3.0, 0.1, 0.1, 0.0));
    }

    #[test]
    fn depth_without_holes_stays_to_the_bit() {
        let values: Vec<f32> = (0..100).map(|i| if i == 44 { 9.0 } else { (i % 7) as f32 }).collect();
        let mut map = Raster::from_vec(10, 10, values.clone()).unwrap();
        fill(&mut map);
        assert_eq!(map.data(), values);
    }
}
