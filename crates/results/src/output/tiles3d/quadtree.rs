//! Which tile a building is in: a quadtree whose every node holds the largest buildings of its square that no node
//! above it holds.
//!
//! So a coarse tile is a skyline, finer ones add to it (`refine: ADD`), no building is in two tiles, and the error of a
//! tile is known: the size of the largest building that is still missing.

use std::collections::BTreeMap;

/// Building as the tree knows it.
#[derive(Debug, Clone, Copy)]
pub struct TreeItem {
    /// Position among the buildings.
    pub idx: usize,
    /// Middle of its box, metres.
    pub centre: [f64; 2],
    /// Diagonal of its box, metres.
    pub size_m: f64,
}

/// A tile of the tree, with the tiles below it.
#[derive(Debug)]
pub struct Node {
    /// `level/x_y`, with x and y counted from the south-west corner.
    pub name: String,
    /// Buildings, in their order.
    pub members: Vec<usize>,
    /// Size of the largest building of all tiles below, 0 at a leaf; metres.
    pub error_m: f64,
    /// Tiles of its quarters; empty ones are left out.
    pub children: Vec<Node>,
}

/// A square of the plane.
#[derive(Clone, Copy)]
struct TreeSquare {
    corner: [f64; 2],
    side: f64,
    level: u32,
    x: u64,
    y: u64,
}

/// Deepest level: squares are then far smaller than any building.
const MAX_LEVEL: u32 = 24;

impl Node {
    /// The tree over all items, with at most `max_members` in a tile; `None` without items.
    #[must_use]
    pub fn root(items: Vec<TreeItem>, max_members: usize) -> Option<Self> {
        let low: [f64; 2] = std::array::from_fn(|a| items.iter().map(|i| i.centre[a]).fold(f64::INFINITY, f64::min));
        let high: [f64; 2] =
            std::array::from_fn(|a| items.iter().map(|i| i.centre[a]).fold(f64::NEG_INFINITY, f64::max));
        let side = (high[0] - low[0]).max(high[1] - low[1]).max(1.0);
        let mut items = items;
        items.sort_by(|a, b| b.size_m.total_cmp(&a.size_m).then(a.idx.cmp(&b.idx)));
        let square = TreeSquare { corner: low, side, level: 0, x: 0, y: 0 };
        (!items.is_empty()).then(|| Self::of(items, max_members.max(1), square))
    }

    /// The tree of tiles whose names are known, which are those of an earlier tree (`2/1_0`), or of several (`TREE/2/1_0`); `None` without
    /// items.
    #[must_use]
    pub fn named(items: Vec<(TreeItem, String)>) -> Option<Self> {
        let size_m = items.iter().map(|(item, _)| item.size_m).fold(0.0, f64::max);
        let mut trees: BTreeMap<String, Vec<(TreeItem, String)>> = BTreeMap::new();
        for (item, name) in items {
            let parts: Vec<&str> = name.rsplitn(3, '/').collect();
            let tree = parts.get(2).map_or_else(String::new, |tree| format!("{tree}/"));
            let name = name[tree.len()..].to_owned();
            trees.entry(tree).or_default().push((item, name));
        }
        let mut roots: Vec<Self> =
            trees.into_iter().filter_map(|(tree, items)| Self::one_named(items, &tree)).collect();
        match roots.len() {
            0 | 1 => roots.pop(),
            _ => Some(Self { name: String::new(), members: Vec::new(), error_m: size_m, children: roots }),
        }
    }

    fn one_named(items: Vec<(TreeItem, String)>, tree: &str) -> Option<Self> {
        let mut nodes: BTreeMap<[u64; 3], (Vec<usize>, f64)> = BTreeMap::new();
        for (item, name) in items {
            let mut place = place_of(&name).unwrap_or([0; 3]);
            nodes.entry(place).or_default().0.push(item.idx);
            // All tiles above lack it.
            while let [level @ 1..=u64::MAX, x, y] = place {
                place = [level - 1, x / 2, y / 2];
                let above = nodes.entry(place).or_default();
                above.1 = item.size_m.max(above.1);
            }
        }
        // From the leaves up.
        let mut children: BTreeMap<[u64; 3], Vec<Self>> = BTreeMap::new();
        while let Some((place @ [level, x, y], (mut members, error_m))) = nodes.pop_last() {
            members.sort_unstable();
            let mut below = children.remove(&place).unwrap_or_default();
            below.reverse();
            let node = Self { name: format!("{tree}{level}/{x}_{y}"), members, error_m, children: below };
            if level == 0 {
                return Some(node);
            }
            children.entry([level - 1, x / 2, y / 2]).or_default().push(node);
        }
        None
    }

    /// The node of a square; items are sorted, largest first.
    fn of(mut items: Vec<TreeItem>, max_members: usize, square: TreeSquare) -> Self {
        let rest = if square.level == MAX_LEVEL { Vec::new() } else { items.split_off(items.len().min(max_members)) };
        let mut members: Vec<usize> = items.iter().map(|item| item.idx).collect();
        members.sort_unstable();
        let error_m = rest.first().map_or(0.0, |item| item.size_m);
        let mut quarters: [Vec<TreeItem>; 4] = Default::default();
        for item in rest {
            quarters[square.quarter_of(item.centre)].push(item);
        }
        let children = quarters.into_iter().enumerate().filter(|(_, items)| !items.is_empty());
        Self {
            name: format!("{}/{}_{}", square.level, square.x, square.y),
            members,
            error_m,
            children: children.map(|(i, items)| Self::of(items, max_members, square.quarter(i))).collect(),
        }
    }
}

/// Level, x and y of a tile's name; `None` for another text.
fn place_of(name: &str) -> Option<[u64; 3]> {
    let (level, rest) = name.split_once('/')?;
    let (x, y) = rest.split_once('_')?;
    let level = level.parse().ok().filter(|level| *level <= u64::from(MAX_LEVEL))?;
    let (x, y): (u64, u64) = (x.parse().ok()?, y.parse().ok()?);
    (x >> level == 0 && y >> level == 0).then_some([level, x, y])
}

impl TreeSquare {
    fn quarter_of(&self, point: [f64; 2]) -> usize {
        let is_upper = |axis: usize| usize::from(point[axis] >= self.corner[axis] + self.side / 2.0);
        is_upper(0) + 2 * is_upper(1)
    }

    fn quarter(&self, i: usize) -> Self {
        let (dx, dy) = ((i % 2) as u64, (i / 2) as u64);
        let side = self.side / 2.0;
        let corner = [self.corner[0] + side * dx as f64, self.corner[1] + side * dy as f64];
        Self { corner, side, level: self.level + 1, x: 2 * self.x + dx, y: 2 * self.y + dy }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walk<'a>(node: &'a Node, visit: &mut dyn FnMut(&'a Node)) {
        visit(node);
        node.children.iter().for_each(|child| walk(child, visit));
    }

    #[test]
    fn every_building_is_in_one_tile_and_no_tile_hides_a_larger_one_than_it_says() {
        let sizes: Vec<f64> = (0..500).map(|i| 5.0 + f64::from((i * 7919) % 613)).collect();
        let item = |idx: usize| TreeItem {
            idx,
            centre: [(idx * 37 % 101) as f64, (idx * 53 % 97) as f64],
            size_m: sizes[idx],
        };
        let root = Node::root((0..500).map(item).collect(), 20).unwrap();
        let mut seen: Vec<usize> = Vec::new();
        walk(&root, &mut |node| {
            assert!(!node.members.is_empty() && node.members.len() <= 20, "{}", node.name);
            seen.extend(&node.members);
            let mut largest_below: f64 = 0.0;
            node.children.iter().for_each(|child| {
                walk(child, &mut |n| largest_below = n.members.iter().map(|&i| sizes[i]).fold(largest_below, f64::max));
            });
            assert_eq!(node.error_m, largest_below, "{}", node.name);
        });
        seen.sort_unstable();
        assert_eq!(seen, (0..500).collect::<Vec<_>>());
    }

    #[test]
    fn a_tree_is_made_again_from_the_names_of_its_tiles() {
        let item = |idx: usize| TreeItem {
            idx,
            centre: [(idx * 37 % 101) as f64, (idx * 53 % 97) as f64],
            size_m: 5.0 + ((idx * 7919) % 613) as f64,
        };
        let first = Node::root((0..500).map(item).collect(), 20).unwrap();
        let mut named = Vec::new();
        walk(&first, &mut |node| named.extend(node.members.iter().map(|&i| (item(i), node.name.clone()))));
        let again = Node::named(named).unwrap();
        let listed = |root: &Node| {
            let mut all = Vec::new();
            walk(root, &mut |node| all.push((node.name.clone(), node.members.clone(), node.error_m)));
            all.sort_by(|a, b| a.0.cmp(&b.0));
            all
        };
        assert_eq!(listed(&again), listed(&first));
        // Of two trees beside each other, each is the same below one root.
        let mut named = Vec::new();
        walk(&first, &mut |node| {
            named.extend(node.members.iter().map(|&i| (item(i), format!("{}/{}", i % 2, node.name))));
        });
        let both = Node::named(named).unwrap();
        assert!(both.members.is_empty() && both.children.len() == 2 && both.children[1].name == "1/0/0_0");
        let mut n = 0;
        walk(&both, &mut |node| n += node.members.len());
        assert_eq!(n, 500);
        for name in ["", "0", "x/0_0", "1/2_0", "99/0_0"] {
            assert_eq!(place_of(name), None, "{name}");
        }
    }

    #[test]
    fn buildings_on_one_spot_end_somewhere() {
        let items = (0..50).map(|idx| TreeItem { idx, centre: [3.0, 4.0], size_m: 9.0 }).collect();
        let mut n = 0;
        walk(&Node::root(items, 1).unwrap(), &mut |node| n += node.members.len());
        assert_eq!(n, 50);
        assert!(Node::root(Vec::new(), 1).is_none());
    }
}
