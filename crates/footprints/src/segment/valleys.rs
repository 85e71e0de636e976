//! Parts of a watershed joined where the map between them hardly falls along *all* of their border.
//!
//! ```text
//! fall(a, b) = min(height(a), height(b)) − mean over the border of a and b of the map
//! ```
//!
//! `height`: the map's value that nine tenths of a part lie below. A watershed by itself joins two parts where the map falls least; one gap in a wall
//! then joins two houses, and one speck on a roof, whose border falls nowhere but around itself, is a house.

use std::collections::BTreeMap;

use sizeup_heights::raster::Raster;

/// Share of a part's pixels below its height.
const HEIGHT_SHARE: f64 = 0.9;

/// Two labels, the lower one first.
type LabelPair = (u32, u32);

/// Sum of the map over a border, and the number of its pixels.
#[derive(Debug, Clone, Copy, Default)]
struct Border {
    sum: f64,
    n: usize,
}

/// A part, or several joined ones.
#[derive(Debug, Clone, Copy)]
struct JoinedPart {
    height: f64,
    n_px: usize,
}

/// Joins labelled parts of a map, those between which it falls least first, until it falls by `least` between any two. The labels that
/// come out have no gaps.
#[must_use]
pub fn join(labels: &Raster<u32>, map: &Raster<f32>, least: f32) -> Raster<u32> {
    let mut parts = parts(labels, map);
    let mut borders = borders(labels, map);
    let mut label_of: Vec<u32> = (0..=parts.len() as u32).collect();
    let part = |parts: &[JoinedPart], label: u32| parts[label as usize - 1];
    loop {
        let fall = |(pair, border): (&LabelPair, &Border)| {
            let height = part(&parts, pair.0).height.min(part(&parts, pair.1).height);
            (*pair, height - border.sum / border.n as f64)
        };
        let least_fall = borders.iter().map(fall).min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        let Some(((kept, gone), _)) = least_fall.filter(|(_, fall)| *fall < f64::from(least)) else {
            let numbers = numbered(&label_of);
            return labels.map(|label| numbers[*label as usize]);
        };
        let (a, b) = (part(&parts, kept), part(&parts, gone));
        let n_px = a.n_px + b.n_px;
        let height = (a.height * a.n_px as f64 + b.height * b.n_px as f64) / n_px as f64;
        parts[kept as usize - 1] = JoinedPart { height, n_px };
        label_of.iter_mut().filter(|l| **l == gone).for_each(|l| *l = kept);
        borders = renamed(&borders, gone, kept);
    }
}

/// The same labels without gaps between them; 0 stays.
fn numbered(label_of: &[u32]) -> Vec<u32> {
    let mut kept: Vec<u32> = label_of.to_vec();
    kept.sort_unstable();
    kept.dedup();
    label_of.iter().map(|label| kept.partition_point(|k| k < label) as u32).collect()
}

fn parts(labels: &Raster<u32>, map: &Raster<f32>) -> Vec<JoinedPart> {
    let n = labels.data().iter().copied().max().unwrap_or(0) as usize;
    let mut values: Vec<Vec<f32>> = vec![Vec::new(); n];
    for (label, value) in labels.data().iter().zip(map.data()).filter(|(l, _)| **l != 0) {
        values[*label as usize - 1].push(*value);
    }
    let part = |values: &mut Vec<f32>| {
        let nth = ((values.len() as f64 * HEIGHT_SHARE) as usize).min(values.len().saturating_sub(1));
        let height = if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(nth, f32::total_cmp).1 };
        JoinedPart { height: f64::from(height), n_px: values.len() }
    };
    values.iter_mut().map(part).collect()
}

/// Every border between two parts, the lower value of each pair of pixels.
fn borders(labels: &Raster<u32>, map: &Raster<f32>) -> BTreeMap<LabelPair, Border> {
    let mut borders: BTreeMap<LabelPair, Border> = BTreeMap::new();
    for (i, &label) in labels.data().iter().enumerate().filter(|(_, l)| **l != 0) {
        for j in labels.beside(i).filter(|&j| labels.data()[j] > label) {
            let border = borders.entry((label, labels.data()[j])).or_default();
            border.sum += f64::from(map.data()[i].min(map.data()[j]));
            border.n += 1;
        }
    }
    borders
}

fn renamed(borders: &BTreeMap<LabelPair, Border>, gone: u32, kept: u32) -> BTreeMap<LabelPair, Border> {
    let mut all: BTreeMap<LabelPair, Border> = BTreeMap::new();
    let name = |label: u32| if label == gone { kept } else { label };
    for (&(a, b), border) in borders {
        let (a, b) = (name(a), name(b));
        if a != b {
            let both = all.entry((a.min(b), a.max(b))).or_default();
            (both.sum, both.n) = (both.sum + border.sum, both.n + border.n);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parts as letters and the map as tenths.
    fn joined(parts: &[&str], tenths: &[&str], least: f32) -> Vec<String> {
        let width = parts[0].len();
        let cells = |rows: &[&str]| rows.iter().flat_map(|r| r.bytes()).collect::<Vec<u8>>();
        let label = |b: &u8| if *b == b'.' { 0 } else { u32::from(b - b'a') + 1 };
        let labels = Raster::from_vec(width, parts.len(), cells(parts).iter().map(label).collect()).unwrap();
        let value = |b: &u8| f32::from(b - b'0') / 10.0;
        let map = Raster::from_vec(width, parts.len(), cells(tenths).iter().map(value).collect()).unwrap();
        let found = join(&labels, &map, least);
        let letter = |l: &u32| if *l == 0 { '.' } else { char::from(b'a' + *l as u8 - 1) };
        found.data().chunks(width).map(|row| row.iter().map(letter).collect()).collect()
    }

    const TWO: [&str; 4] = ["aaabbb.", "aaabbb.", "aaabbb.", "aaabbb."];

    #[test]
    fn a_wall_with_a_gap_is_one_and_a_dent_at_the_rim_is_none() {
        let wall = ["9922990", "9922990", "9988990", "9922990"];
        assert_eq!(joined(&TWO, &wall, 0.3), TWO);
        let dent = ["9922990", "9988990", "9988990", "9988990"];
        assert_eq!(joined(&TWO, &dent, 0.3), ["aaaaaa."; 4]);
    }

    #[test]
    fn a_piece_of_a_roof_joins_the_one_it_is_of() {
        let parts = ["aabbcc", "aabbcc", "aabbcc"];
        let tenths = ["997799", "998199", "997199"];
        assert_eq!(joined(&parts, &tenths, 0.4), ["aaaabb"; 3]);
    }

    #[test]
    fn nothing_is_joined_where_nothing_meets() {
        assert_eq!(joined(&["a.b"], &["909"], 0.5), ["a.b"]);
        assert_eq!(joined(&["..."], &["909"], 0.5), ["..."]);
    }
}
