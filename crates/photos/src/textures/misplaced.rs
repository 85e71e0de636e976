//! Photos that show other things than their poses say: turned, of another place, or with a pose that is far off.
//!
//! ```text
//! disagreeing share of a photo = cells whose mean differs from the median of at least three photos / cells that so many photos show
//! ```

use rayon::prelude::*;

use super::chart::Chart;
use super::paint::{AGREES_WITHIN, LEAST_PHOTOS, difference, median};
use super::views::{Candidate, Shown};
use sizeup_geo::files::{FileError, UnnamedFile};

/// Fewest cells that a photo is judged by; a first choice.
const LEAST_CELLS: usize = 40;
/// Share of these that may disagree. Of good photos 1 to 6 % do over a real block and up to 12 % over a simulated town with trees; of a photo that
/// was exchanged for another one 65 %.
const MOST_DISAGREEING: f64 = 0.4;

/// Returns the views whose photos disagree with the others, and their disagreeing shares.
pub(super) fn find(
    n_views: usize,
    charts: &[Option<Chart>],
    candidates: &[Vec<Candidate>],
    gains: &[f32],
    file: &UnnamedFile,
) -> Result<Vec<(usize, f64)>, FileError> {
    let counts = |(chart, of_surface): (&Option<Chart>, &Vec<Candidate>)| {
        let mut counts = vec![(0_usize, [0_usize; 2]); of_surface.len()];
        counts.iter_mut().zip(of_surface).for_each(|(count, candidate)| count.0 = candidate.view);
        let Some(chart) = chart else { return Ok(counts) };
        let means = of_surface.iter().map(|candidate| candidate.means(file)).collect::<Result<Vec<_>, FileError>>()?;
        for cell in 0..chart.cells.len() {
            let clear = of_surface.iter().enumerate().filter(|(_, candidate)| candidate.shown[cell] == Shown::Clear);
            let mean = |(k, candidate): (usize, &Candidate)| (k, means[k][cell].map(|v| v * gains[candidate.view]));
            let means: Vec<(usize, [f32; 3])> = clear.map(mean).collect();
            if means.len() < LEAST_PHOTOS {
                continue;
            }
            let median = median(&means.iter().map(|(_, mean)| *mean).collect::<Vec<_>>());
            for (k, mean) in means {
                counts[k].1[0] += 1;
                counts[k].1[1] += usize::from(difference(&mean, &median) > AGREES_WITHIN);
            }
        }
        Ok(counts)
    };
    let counts: Result<Vec<Vec<_>>, FileError> = charts.par_iter().zip(candidates).map(counts).collect();
    let mut of_view = vec![[0_usize; 2]; n_views];
    for (view, [n, n_disagreeing]) in counts?.into_iter().flatten() {
        of_view[view][0] += n;
        of_view[view][1] += n_disagreeing;
    }
    let shares = of_view.into_iter().enumerate().filter(|(_, [n, _])| *n >= LEAST_CELLS);
    let shares = shares.map(|(view, [n, n_disagreeing])| (view, n_disagreeing as f64 / n as f64));
    let shares: Vec<(usize, f64)> = shares.collect();
    tracing::debug!("share of its cells in which each photo disagrees with the others: {shares:.2?}");
    Ok(shares.into_iter().filter(|(_, share)| *share > MOST_DISAGREEING).collect())
}
