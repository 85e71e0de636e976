//! Exact predicates on integer points of the plane, |coordinate| ≤ 10⁹ so that no product overflows.

/// Twice the signed area of the triangle `a b c`: positive if counter-clockwise.
#[must_use]
pub fn cross(a: [i64; 2], b: [i64; 2], c: [i64; 2]) -> i128 {
    let product = |u: i64, v: i64| i128::from(u) * i128::from(v);
    product(b[0] - a[0], c[1] - a[1]) - product(b[1] - a[1], c[0] - a[0])
}

/// Twice the signed area of a ring given without its closing point: positive if counter-clockwise.
#[must_use]
pub fn twice_area(ring: &[[i64; 2]]) -> i128 {
    let Some(&origin) = ring.first() else { return 0 };
    ring.windows(2).map(|edge| cross(origin, edge[0], edge[1])).sum()
}

/// Whether two closed segments have a point in common.
#[must_use]
pub fn segments_meet(a: [[i64; 2]; 2], b: [[i64; 2]; 2]) -> bool {
    let boxes_meet = (0..2).all(|axis| {
        a[0][axis].min(a[1][axis]) <= b[0][axis].max(b[1][axis])
            && b[0][axis].min(b[1][axis]) <= a[0][axis].max(a[1][axis])
    });
    let straddles = |line: [[i64; 2]; 2], other: [[i64; 2]; 2]| {
        cross(line[0], line[1], other[0]).signum() * cross(line[0], line[1], other[1]).signum() <= 0
    };
    boxes_meet && straddles(a, b) && straddles(b, a)
}

/// Whether a point lies strictly inside a ring (even-odd rule); points on the ring count as either.
#[must_use]
pub fn is_inside(point: [i64; 2], ring: &[[i64; 2]]) -> bool {
    let mut inside = false;
    for (i, &to) in ring.iter().enumerate() {
        let from = ring[(i + ring.len() - 1) % ring.len()];
        let crosses_level = (from[1] > point[1]) != (to[1] > point[1]);
        // The edge passes to the right of the point if the point is on its left, seen upwards.
        if crosses_level && (cross(from, to, point) > 0) == (to[1] > from[1]) {
            inside = !inside;
        }
    }
    inside
}

/// One edge, and where it stands: ring, position in the ring, number of edges of the ring.
struct RingEdge {
    ends: [[i64; 2]; 2],
    ring: usize,
    position: usize,
    n_edges: usize,
}

impl RingEdge {
    fn is_neighbour_of(&self, other: &Self) -> bool {
        let apart = self.position.abs_diff(other.position);
        self.ring == other.ring && (apart == 1 || apart == self.n_edges - 1)
    }

    fn west(&self) -> i64 {
        self.ends[0][0].min(self.ends[1][0])
    }

    fn east(&self) -> i64 {
        self.ends[0][0].max(self.ends[1][0])
    }
}

/// Whether no two edges meet except neighbours in their common point, and all rings after the first lie inside the
/// first and outside each other. Rings come without closing points, repeated points and spikes.
///
/// Edges are swept from west to east, so the cost is near `n log n` for footprints of buildings.
#[must_use]
pub fn rings_are_disjoint_and_nested(rings: &[Vec<[i64; 2]>]) -> bool {
    let mut edges: Vec<RingEdge> = Vec::with_capacity(rings.iter().map(Vec::len).sum());
    for (ring_idx, ring) in rings.iter().enumerate() {
        for position in 0..ring.len() {
            let ends = [ring[position], ring[(position + 1) % ring.len()]];
            edges.push(RingEdge { ends, ring: ring_idx, position, n_edges: ring.len() });
        }
    }
    edges.sort_unstable_by_key(|edge| (edge.west(), edge.ring, edge.position));
    for (i, edge) in edges.iter().enumerate() {
        for other in edges[i + 1..].iter().take_while(|other| other.west() <= edge.east()) {
            if !edge.is_neighbour_of(other) && segments_meet(edge.ends, other.ends) {
                return false;
            }
        }
    }
    let Some((exterior, holes)) = rings.split_first() else { return false };
    // No edges meet, so one point of a ring decides for the whole ring.
    holes.iter().enumerate().all(|(i, hole)| {
        is_inside(hole[0], exterior) && holes.iter().enumerate().all(|(j, other)| i == j || !is_inside(hole[0], other))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(low: i64, high: i64) -> Vec<[i64; 2]> {
        vec![[low, low], [high, low], [high, high], [low, high]]
    }

    #[test]
    fn holes_must_be_inside_and_apart() {
        assert!(rings_are_disjoint_and_nested(&[square(0, 10), square(1, 3), square(4, 6)]));
        assert!(!rings_are_disjoint_and_nested(&[square(0, 10), square(11, 12)]), "outside");
        assert!(!rings_are_disjoint_and_nested(&[square(0, 10), square(1, 8), square(2, 3)]), "nested");
        assert!(!rings_are_disjoint_and_nested(&[square(0, 10), square(1, 3), square(3, 5)]), "corner to corner");
        assert!(!rings_are_disjoint_and_nested(&[square(0, 10), square(0, 3)]), "along the exterior");
    }

    #[test]
    fn a_ring_through_one_point_twice_is_found() {
        let figure_of_eight = vec![[0, 0], [4, 0], [4, 4], [8, 4], [8, 8], [4, 8], [4, 4], [0, 4]];
        assert!(!rings_are_disjoint_and_nested(&[figure_of_eight]));
    }

    #[test]
    fn areas_are_signed() {
        assert_eq!(twice_area(&square(0, 3)), 18);
        let mut clockwise = square(0, 3);
        clockwise.reverse();
        assert_eq!(twice_area(&clockwise), -18);
    }
}
