//! A bounding volume hierarchy over axis-aligned boxes: packed nodes, binned surface-area heuristic.
//!
//! The primitives stay with the caller: a traversal hands out their indices, near boxes first, and the caller answers
//! with the ray's new end. Frame: [`crate::frames::Local`], metres, `f32`.
//!
//! Source: Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", RT 2007.

use glam::Vec3;

use crate::ray::{Aabb, Ray};

/// A search for primitives: one ray, or many at once.
pub trait Probe {
    /// Ray parameter at which it first enters a box within its reach, if it does.
    fn enters(&self, bounds: &Aabb) -> Option<f32>;
    /// Reach that is left.
    fn reach(&self) -> f32;
    /// Looks at a primitive.
    fn visit(&mut self, primitive: usize);
}

/// One ray, and what is done with primitives near it.
struct SingleRay<'a, F> {
    ray: &'a Ray,
    t_max: f32,
    visit: F,
}

impl<F: FnMut(usize, f32) -> f32> Probe for SingleRay<'_, F> {
    fn enters(&self, bounds: &Aabb) -> Option<f32> {
        self.ray.enters(bounds.min, bounds.max, self.t_max)
    }

    fn reach(&self) -> f32 {
        self.t_max
    }

    fn visit(&mut self, primitive: usize) {
        self.t_max = (self.visit)(primitive, self.t_max);
    }
}

/// Split candidates per axis of the binned heuristic.
const N_BINS: usize = 16;
/// Below this many primitives a node is a leaf.
const LEAF_SIZE: usize = 2;
/// Deepest path the traversal can hold; the builder falls back to halving long before.
const MAX_DEPTH: usize = 64;

/// 32 bytes: a box, and either two children (at `first` and `first + 1`) or `count` primitives from `first`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct BvhNode {
    min: Vec3,
    first: u32,
    max: Vec3,
    count: u32,
}

impl BvhNode {
    fn bounds(&self) -> Aabb {
        Aabb { min: self.min, max: self.max }
    }
}

/// The hierarchy; primitives are known by their index in the slice it was built from.
#[derive(Debug, Clone)]
pub struct Bvh {
    nodes: Vec<BvhNode>,
    primitives: Vec<u32>,
}

impl Bvh {
    /// Builds over one box per primitive. Empty boxes are never visited.
    #[must_use]
    pub fn build(boxes: &[Aabb]) -> Self {
        let mut builder = BvhBuilder { boxes, primitives: Vec::new(), nodes: Vec::with_capacity(2 * boxes.len()) };
        builder.primitives =
            (0..boxes.len()).filter(|&i| boxes[i].min.cmple(boxes[i].max).all()).map(|i| i as u32).collect();
        if !builder.primitives.is_empty() {
            let n = builder.primitives.len();
            builder.nodes.push(builder.leaf(0, n));
            builder.split(0, 0);
        }
        Self { nodes: builder.nodes, primitives: builder.primitives }
    }

    /// Visits the primitives whose boxes the ray enters before `t_max`, near nodes first. `visit` gets a primitive's
    /// index and the present `t_max` and returns the new one: the same to go on, less after a hit, `0` to stop.
    pub fn traverse(&self, ray: &Ray, t_max: f32, visit: impl FnMut(usize, f32) -> f32) {
        self.walk(&mut SingleRay { ray, t_max, visit });
    }

    /// Shows a probe the primitives that it may meet, near nodes first.
    #[expect(clippy::inline_always, reason = "probes that hold vector registers are compiled with it")]
    #[inline(always)]
    pub fn walk(&self, probe: &mut impl Probe) {
        let mut stack = [(0_u32, 0.0_f32); MAX_DEPTH];
        let mut depth = 0;
        let Some(root) = self.nodes.first() else { return };
        if let Some(enter) = probe.enters(&root.bounds()) {
            stack[0] = (0, enter);
            depth = 1;
        }
        while depth > 0 {
            depth -= 1;
            let (node_idx, enter) = stack[depth];
            if enter > probe.reach() {
                continue;
            }
            let node = &self.nodes[node_idx as usize];
            if node.count > 0 {
                let range = node.first as usize..(node.first + node.count) as usize;
                for &primitive in &self.primitives[range] {
                    probe.visit(primitive as usize);
                }
                continue;
            }
            let (left, right) = (node.first, node.first + 1);
            let left = (left, probe.enters(&self.nodes[left as usize].bounds()));
            let right = (right, probe.enters(&self.nodes[right as usize].bounds()));
            let mut push = |(child, enter): (u32, Option<f32>)| {
                if let Some(enter) = enter {
                    stack[depth] = (child, enter);
                    depth += 1;
                }
            };
            // The nearer child goes on top of the stack.
            if left.1.unwrap_or(f32::INFINITY) <= right.1.unwrap_or(f32::INFINITY) {
                push(right);
                push(left);
            } else {
                push(left);
                push(right);
            }
        }
    }
}

struct BvhBuilder<'a> {
    boxes: &'a [Aabb],
    primitives: Vec<u32>,
    nodes: Vec<BvhNode>,
}

impl BvhBuilder<'_> {
    fn leaf(&self, first: usize, count: usize) -> BvhNode {
        let bounds =
            self.primitives[first..first + count].iter().fold(Aabb::EMPTY, |b, &p| b.union(self.boxes[p as usize]));
        BvhNode { min: bounds.min, first: first as u32, max: bounds.max, count: count as u32 }
    }

    /// Turns a leaf into an inner node while that makes traversal cheaper.
    fn split(&mut self, node_idx: usize, depth: usize) {
        let (first, count) = (self.nodes[node_idx].first as usize, self.nodes[node_idx].count as usize);
        if count <= LEAF_SIZE {
            return;
        }
        let n_left = match self.best_split(first, count) {
            Some((axis, threshold)) if depth < MAX_DEPTH / 2 => self.partition(first, count, axis, threshold),
            _ => 0,
        };
        // No plane separates the centres (or the tree is deep): halve by count, in the order they stand.
        let n_left = if n_left == 0 || n_left == count { count / 2 } else { n_left };
        let left = self.leaf(first, n_left);
        let right = self.leaf(first + n_left, count - n_left);
        let left_idx = self.nodes.len();
        self.nodes.push(left);
        self.nodes.push(right);
        self.nodes[node_idx].first = left_idx as u32;
        self.nodes[node_idx].count = 0;
        self.split(left_idx, depth + 1);
        self.split(left_idx + 1, depth + 1);
    }

    /// Axis and position of the plane with the least expected cost, by binned SAH.
    fn best_split(&self, first: usize, count: usize) -> Option<(usize, f32)> {
        let members = &self.primitives[first..first + count];
        let centres = Aabb::around(members.iter().map(|&p| self.boxes[p as usize].centre()));
        let mut best: Option<(f32, usize, f32)> = None;
        for axis in 0..3 {
            let (low, extent) = (centres.min[axis], centres.max[axis] - centres.min[axis]);
            if extent <= 0.0 {
                continue;
            }
            let mut bins = [(Aabb::EMPTY, 0_usize); N_BINS];
            for &p in members {
                let b = self.boxes[p as usize];
                let bin = &mut bins[bin_of(b.centre()[axis], low, extent)];
                *bin = (bin.0.union(b), bin.1 + 1);
            }
            let mut right_cost = [0.0_f32; N_BINS];
            let mut running = (Aabb::EMPTY, 0_usize);
            for i in (1..N_BINS).rev() {
                running = (running.0.union(bins[i].0), running.1 + bins[i].1);
                right_cost[i] = running.0.half_area() * running.1 as f32;
            }
            running = (Aabb::EMPTY, 0);
            for i in 1..N_BINS {
                running = (running.0.union(bins[i - 1].0), running.1 + bins[i - 1].1);
                let cost = running.0.half_area() * running.1 as f32 + right_cost[i];
                if running.1 > 0 && running.1 < count && best.is_none_or(|(least, ..)| cost < least) {
                    best = Some((cost, axis, low + extent * i as f32 / N_BINS as f32));
                }
            }
        }
        best.map(|(_, axis, threshold)| (axis, threshold))
    }

    /// Moves the primitives whose centre lies below the threshold to the front, keeping their order; returns how many.
    fn partition(&mut self, first: usize, count: usize, axis: usize, threshold: f32) -> usize {
        let boxes = self.boxes;
        let members = &mut self.primitives[first..first + count];
        // A stable sort on a boolean: same input, same tree.
        members.sort_by_key(|&p| boxes[p as usize].centre()[axis] >= threshold);
        members.partition_point(|&p| boxes[p as usize].centre()[axis] < threshold)
    }
}

fn bin_of(centre: f32, low: f32, extent: f32) -> usize {
    (((centre - low) / extent * N_BINS as f32) as usize).min(N_BINS - 1)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_box() -> impl Strategy<Value = Aabb> {
        (prop::array::uniform3(-50.0..50.0_f32), prop::array::uniform3(0.0..9.0_f32)).prop_map(|(min, size)| {
            let min = Vec3::from(min);
            Aabb { min, max: min + Vec3::from(size) }
        })
    }

    fn enters(ray: &Ray, b: &Aabb, t_max: f32) -> bool {
        ray.enters(b.min, b.max, t_max).is_some()
    }

    proptest! {
        #[test]
        fn finds_just_what_a_linear_search_finds(
            boxes in prop::collection::vec(any_box(), 0..80),
            origin in prop::array::uniform3(-90.0..90.0_f32),
            direction in prop::array::uniform3(-1.0..1.0_f32),
        ) {
            let ray = Ray::new(origin.into(), direction.into());
            let mut found = Vec::new();
            Bvh::build(&boxes).traverse(&ray, 100.0, |i, t_max| {
                if enters(&ray, &boxes[i], t_max) { found.push(i); }
                t_max
            });
            found.sort_unstable();
            let expected: Vec<usize> = (0..boxes.len()).filter(|&i| enters(&ray, &boxes[i], 100.0)).collect();
            prop_assert_eq!(found, expected);
        }
    }

    #[test]
    fn identical_boxes_still_make_a_tree() {
        let boxes = vec![Aabb { min: Vec3::ZERO, max: Vec3::ONE }; 1000];
        let mut n_visited = 0;
        Bvh::build(&boxes).traverse(&Ray::new(Vec3::splat(-1.0), Vec3::ONE), 10.0, |_, t_max| {
            n_visited += 1;
            t_max
        });
        assert_eq!(n_visited, 1000);
    }

    #[test]
    fn a_hit_prunes_what_lies_behind_it() {
        let boxes: Vec<Aabb> = (0..64)
            .map(|i| Aabb { min: Vec3::new(i as f32 * 2.0, 0.0, 0.0), max: Vec3::new(i as f32 * 2.0 + 1.0, 1.0, 1.0) })
            .collect();
        let mut n_visited = 0;
        Bvh::build(&boxes).traverse(&Ray::new(Vec3::new(-1.0, 0.5, 0.5), Vec3::X), 1e9, |i, t_max| {
            n_visited += 1;
            t_max.min(i as f32 * 2.0 + 1.0)
        });
        assert!(n_visited <= 2 * LEAF_SIZE, "{n_visited} boxes visited for one hit in the first");
    }
}
