//! Walls of a solid with a roof: upright, counter-clockwise seen from outside.

use super::super::prism::{FaceKind, GridFace};
use super::plan::{NodeLevels, RoofPlan};

/// Walls along the footprint, one per edge of it, from the base to the roof; they end where the roof's faces do.
pub(super) fn outer(plan: &RoofPlan, levels: &NodeLevels, base: i64) -> impl Iterator<Item = GridFace> {
    plan.border.iter().map(move |nodes| {
        let n = nodes.len();
        let planes: Vec<usize> = nodes.windows(2).map(|edge| plan.left_of[&[edge[0], edge[1]]]).collect();
        let (from, to) = (nodes[0], nodes[n - 1]);
        let mut ring = vec![[from[0], from[1], base], [to[0], to[1], base]];
        ring.extend(levels.between(to, base, levels.level(to, planes[n - 2])));
        for i in (0..n - 1).rev() {
            // Back along the roof, and up or down where another plane begins.
            let (begin, end) = (nodes[i], nodes[i + 1]);
            let corner = levels.at(end, planes[i]);
            if ring.last() != Some(&corner) {
                ring.push(corner);
            }
            ring.push(levels.at(begin, planes[i]));
            if i > 0 {
                let (here, next) = (levels.level(begin, planes[i]), levels.level(begin, planes[i - 1]));
                ring.extend(levels.between(begin, here, next));
            }
        }
        ring.extend(levels.between(from, levels.level(from, planes[0]), base));
        GridFace::new(FaceKind::Wall, vec![ring])
    })
}

/// Walls between patches, where one is higher than its neighbour; `None` where two cross between nodes.
pub(super) fn inner(plan: &RoofPlan, levels: &NodeLevels) -> Option<Vec<GridFace>> {
    let mut walls = Vec::new();
    for (&[from, to], &left) in &plan.left_of {
        let Some(&right) = plan.left_of.get(&[to, from]) else { continue };
        let (low, high) = ([from, to].map(|p| levels.level(p, right)), [from, to].map(|p| levels.level(p, left)));
        let lead = [high[0] - low[0], high[1] - low[1]];
        if lead[0] * lead[1] < 0 {
            return None;
        }
        // Each wall once: with the higher patch on its left, so that it is seen from the lower one.
        if lead[0] + lead[1] <= 0 {
            continue;
        }
        let mut ring = vec![levels.at(from, right), levels.at(to, right)];
        ring.extend(levels.between(to, low[1], high[1]));
        if high[1] > low[1] {
            ring.push(levels.at(to, left));
        }
        if high[0] > low[0] {
            ring.push(levels.at(from, left));
        }
        ring.extend(levels.between(from, high[0], low[0]));
        walls.push(GridFace::new(FaceKind::Wall, vec![ring]));
    }
    Some(walls)
}
