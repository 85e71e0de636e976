//! How views vote on the cells of one building: see [`super::consensus`] for the formula.

use geo::Intersects as _;
use geo_types::{LineString, MultiPolygon, Polygon};

use super::candidate::{FootprintCandidate, SeenGround, bounds, joint};
use super::cluster::Cluster;
use super::coverage::{GridWindow, Scratch, cover};

/// Cells around a building beyond its widest candidate.
const MARGIN: i64 = 2;
/// Mean share of the votes for a building within a hole from which on it is none. Segmenters leave holes in roofs much
/// more often than they fill courtyards, so a tie is no courtyard.
const DOUBTFUL_HOLE: f64 = 0.35;

/// The votes on one building.
pub(super) struct Votes {
    /// Cells of the shared grid that the votes are counted in.
    pub window: GridWindow,
    /// `f` of each cell: see [`super::consensus`].
    pub share: Vec<f32>,
    /// Per candidate: how it covers the window, and what its view sees of it where it is cut off.
    ballots: Vec<(Vec<f32>, Option<Vec<f32>>)>,
}

impl Votes {
    /// Counts the votes of a cluster's candidates.
    pub(super) fn count(
        cluster: &Cluster,
        candidates: &[FootprintCandidate],
        seen: &[SeenGround],
        cell_m: f64,
        scratch: &mut Scratch,
    ) -> Self {
        let members = || cluster.members.iter().map(|&m| &candidates[m]);
        let all = members().filter_map(|c| bounds(&c.shape)).reduce(joint).unwrap_or(([0.0; 2], [1.0; 2]));
        let window = GridWindow::around(all.0, all.1, cell_m, MARGIN);
        let (mut yes, mut of) = (vec![0.0_f32; window.len()], vec![0.0_f32; window.len()]);
        let mut whole = 0.0_f32;
        let ballots = members()
            .map(|candidate| {
                let weight = (candidate.weight * f64::from(candidate.score)) as f32;
                let mut covered = Vec::new();
                cover(&candidate.shape, &window, scratch, &mut covered);
                yes.iter_mut().zip(&covered).for_each(|(y, c)| *y += weight * c);
                if !candidate.is_cut {
                    whole += weight;
                    return (covered, None);
                }
                let mut sees = Vec::new();
                let area = MultiPolygon::new(vec![seen[candidate.view].area.clone()]);
                cover(&area, &window, scratch, &mut sees);
                of.iter_mut().zip(&sees).for_each(|(o, s)| *o += weight * s);
                (covered, Some(sees))
            })
            .collect();
        // One view's parts of one building are candidates of their own: they add up, and count once.
        let share = yes.iter().zip(&of).map(|(y, o)| if y + o + whole > 0.0 { y / (o + whole).max(1e-9) } else { 0.0 });
        Self { share: share.map(|s| s.min(1.0)).collect(), window, ballots }
    }

    /// The vote on a cell of the shared grid.
    pub(super) fn at(&self, col: i64, row: i64) -> f32 {
        let (col, row) = (col - self.window.first_col, row - self.window.first_row);
        let is_inside =
            col >= 0 && row >= 0 && (col as usize) < self.window.width && (row as usize) < self.window.height;
        if is_inside { self.share[row as usize * self.window.width + col as usize] } else { 0.0 }
    }
    /// The footprint without holes that too many views do not see; what stands in a hole keeps it.
    pub(super) fn without_doubtful_holes(
        &self,
        footprint: &Polygon<f64>,
        others: &[&Polygon<f64>],
        scratch: &mut Scratch,
    ) -> Polygon<f64> {
        let is_sure = |hole: &&LineString<f64>| {
            let mut covered = Vec::new();
            // Holes run clockwise; the coverage is of what runs counter-clockwise.
            let filled = Polygon::new(hole.0.iter().rev().copied().collect(), Vec::new());
            if others.iter().any(|other| filled.intersects(*other)) {
                return true;
            }
            cover(&MultiPolygon::new(vec![filled]), &self.window, scratch, &mut covered);
            let votes: f64 = covered.iter().zip(&self.share).map(|(c, s)| f64::from(c * s)).sum();
            votes < DOUBTFUL_HOLE * covered.iter().map(|c| f64::from(*c)).sum::<f64>()
        };
        let holes = footprint.interiors().iter().filter(is_sure).cloned().collect();
        Polygon::new(footprint.exterior().clone(), holes)
    }

    /// Mean intersection over union of the ballots with a footprint.
    pub(super) fn agreement(&self, polygon: &Polygon<f64>, scratch: &mut Scratch) -> f64 {
        let mut footprint = Vec::new();
        cover(&MultiPolygon::new(vec![polygon.clone()]), &self.window, scratch, &mut footprint);
        let of_ballot = |(covered, sees): &(Vec<f32>, Option<Vec<f32>>)| {
            let (mut shared, mut all) = (0.0_f64, 0.0_f64);
            for i in 0..footprint.len() {
                let sees = sees.as_ref().map_or(1.0, |s| s[i]);
                let (a, b) = (covered[i] * sees, footprint[i] * sees);
                shared += f64::from(a.min(b));
                all += f64::from(a.max(b));
            }
            if all > 0.0 { shared / all } else { 0.0 }
        };
        self.ballots.iter().map(of_ballot).sum::<f64>() / self.ballots.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use geo_types::Rect;

    use super::*;
    use crate::consensus::{ConsensusConfig, agree};

    fn house(hole: Option<Rect<f64>>) -> MultiPolygon<f64> {
        let walls = Rect::new((0.0, 0.0), (20.0, 12.0)).to_polygon().into_inner().0;
        let holes = hole.map(|h| h.to_polygon().into_inner().0.0.into_iter().rev().collect());
        Polygon::new(walls, holes.into_iter().collect()).into()
    }

    /// Holes of the footprint that views with these shapes agree on; the first counts most.
    fn n_holes(shapes: &[MultiPolygon<f64>]) -> usize {
        let area = Rect::new((-50.0, -50.0), (50.0, 50.0)).to_polygon();
        let seen = vec![SeenGround { area }; shapes.len()];
        let of_view = |(view, shape): (usize, &MultiPolygon<f64>)| {
            let weight = 12.0 - 0.5 * view as f64;
            FootprintCandidate { view, shape: shape.clone(), weight, score: 1.0, is_cut: false }
        };
        let candidates: Vec<FootprintCandidate> = shapes.iter().enumerate().map(of_view).collect();
        let agreed = agree(&candidates, &seen, &ConsensusConfig::default());
        assert_eq!(agreed.buildings.len(), 1);
        agreed.buildings[0].polygon.interiors().len()
    }

    #[test]
    fn a_tie_is_no_courtyard_and_a_clear_majority_is() {
        let yard = house(Some(Rect::new((5.0, 4.0), (11.0, 8.0))));
        let closed = house(None);
        assert_eq!(n_holes(&[yard.clone(), closed.clone()]), 0);
        assert_eq!(n_holes(&[yard.clone(), yard.clone(), closed.clone()]), 1);
        assert_eq!(n_holes(&[closed.clone(), yard.clone(), closed]), 0);
        assert_eq!(n_holes(&[yard]), 1);
    }
}
