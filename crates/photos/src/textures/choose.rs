//! The photo of each surface: of great worth, and that of the surfaces beside it where others are hardly better.

use std::collections::BTreeMap;

use super::views::Candidate;
use super::{Choice, Surface};

/// Gain in worth of a photo that all surfaces beside one have too, as a share; a first choice.
const SAME_PHOTO: f64 = 0.15;
/// Rounds over the surfaces of a building; a first choice.
const N_ROUNDS: usize = 4;

/// Position of the chosen candidate for each surface; 0 where there is none.
pub(super) fn photos(surfaces: &[Surface], candidates: &[Vec<Candidate>], choice: Choice) -> Vec<usize> {
    let mut chosen = vec![0; surfaces.len()];
    if choice == Choice::BestPerSurface {
        return chosen;
    }
    let mut first = 0;
    for group in surfaces.chunk_by(|a, b| a.building == b.building) {
        let of_group = &candidates[first..first + group.len()];
        let beside = beside(group);
        for _ in 0..N_ROUNDS {
            for i in 0..group.len() {
                let photo_of = |j: usize| of_group[j].get(chosen[first + j]).map(|candidate| candidate.view);
                let length_m = beside[i].iter().map(|(_, length_m)| length_m).sum::<f64>().max(f64::MIN_POSITIVE);
                let worth = |candidate: &Candidate| {
                    let same = beside[i].iter().filter(|(j, _)| photo_of(*j) == Some(candidate.view));
                    candidate.worth * (1.0 + SAME_PHOTO * same.map(|(_, m)| m).sum::<f64>() / length_m)
                };
                let best = (of_group[i].iter().enumerate())
                    .max_by(|(k, a), (l, b)| worth(a).total_cmp(&worth(b)).then(l.cmp(k)));
                chosen[first + i] = best.map_or(0, |(k, _)| k);
            }
        }
        first += group.len();
    }
    chosen
}

/// For each surface of a building those that share an edge with it, and the length of that, metres.
fn beside(group: &[Surface]) -> Vec<Vec<(usize, f64)>> {
    let key = |p: &glam::DVec3| p.to_array().map(|v| (v * 1000.0).round() as i64);
    let mut edges: BTreeMap<_, (usize, f64)> = BTreeMap::new();
    let mut beside = vec![Vec::new(); group.len()];
    for (i, surface) in group.iter().enumerate() {
        for ring in &surface.rings {
            for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
                let length_m = a.distance(*b);
                if let Some((other, _)) = edges.get(&(key(b), key(a))) {
                    beside[i].push((*other, length_m));
                    beside[*other].push((i, length_m));
                }
                edges.insert((key(a), key(b)), (i, length_m));
            }
        }
    }
    beside
}
