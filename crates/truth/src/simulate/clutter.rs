//! Trees and cars: in the photos and in the priors, never in the truth.

use geo::{BoundingRect, Distance, Euclidean};
use geo_types::Point;
use glam::{DVec2, DVec3};
use rand_chacha::ChaCha8Rng;
use rstar::{AABB, RTree, primitives::GeomWithData, primitives::Rectangle};

use sizeup_heights::seed;

use super::chance::{between, happens};
use super::config::SimulateConfig;
use super::streets::{Land, PAVEMENT_M};
use super::town::SimulatedTown;

/// Distance of a crown from the nearest wall, metres.
const CROWN_CLEARANCE_M: f64 = 0.6;
/// Smallest and largest crown radius of a tree at a wall, metres.
const AT_WALL_RADIUS_M: (f64, f64) = (2.4, 4.2);
/// Distance of such a tree's trunk from the nearest wall, metres.
const TRUNK_CLEARANCE_M: f64 = 0.3;
/// Attempts per thing before the scene is taken to be full.
const ATTEMPTS: usize = 12;
/// Length, width, height of a car's body, metres.
const CAR_BODY_M: [f64; 3] = [4.4, 1.8, 0.95];
/// Length, width, height of a car's cabin, metres.
const CAR_CABIN_M: [f64; 3] = [2.2, 1.6, 0.55];

/// Material of a piece of clutter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stuff {
    Leaves,
    Trunk,
    CarBody,
    CarGlass,
}

/// A triangle of clutter in the map frame; `owner` tells one tree or car from another.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClutterTriangle {
    pub corners: [DVec3; 3],
    pub stuff: Stuff,
    pub owner: u32,
}

/// Number of each, in all.
#[derive(Debug, Clone, Copy)]
pub(super) struct Amounts {
    pub n_trees: usize,
    /// Number of the trees that stand at walls.
    pub n_at_walls: usize,
    pub n_cars: usize,
}

impl Amounts {
    /// As many as a configuration asks for in its world.
    pub fn of(config: &SimulateConfig, world: &SimulatedTown) -> Self {
        let n = |per_building: f64| (per_building * world.buildings.len() as f64).round() as usize;
        let per_building = config.cityjson.as_ref().map_or(config.town.trees_per_building, |c| c.trees_per_building);
        let n_trees = n(per_building);
        let n_at_walls = (config.town.trees_at_walls * n_trees as f64).round() as usize;
        Self { n_trees, n_at_walls, n_cars: n(config.town.cars_per_building) }
    }
}

/// Trees in yards and along streets, cars on carriageways, none of them in a building.
pub(super) fn scatter(world: &SimulatedTown, amounts: Amounts, root_seed: u64) -> Vec<ClutterTriangle> {
    let walls = Walls::of(world);
    let mut pieces = Vec::new();
    for i in 0..amounts.n_trees {
        let mut rng = seed::stream(root_seed, "tree", &[i as u64]);
        if i < amounts.n_at_walls {
            if let Some((foot, radius)) = at_a_wall(world, &walls, &mut rng) {
                tree(foot, radius, &mut rng, i as u32, &mut pieces);
            }
            continue;
        }
        let radius = between(&mut rng, 1.3, 3.6);
        let place = place(world, &mut rng, |rng, p| {
            let clear = walls.distance_m(p, radius + CROWN_CLEARANCE_M) > radius + CROWN_CLEARANCE_M;
            let good = match world.streets.as_ref().map(|s| s.land(p)) {
                Some(Land::Road { .. } | Land::Crossing) => false,
                Some(Land::Open) => happens(rng, 0.15),
                _ => true,
            };
            clear && good
        });
        if let Some(foot) = place {
            tree(foot, radius, &mut rng, i as u32, &mut pieces);
        }
    }
    for i in 0..amounts.n_cars {
        let mut rng = seed::stream(root_seed, "car", &[i as u64]);
        if let Some((foot, heading_rad)) = parking_space(world, &walls, &mut rng) {
            car(foot, heading_rad, (amounts.n_trees + i) as u32, &mut pieces);
        }
    }
    pieces
}

/// Foot and crown radius of a tree that touches a building: somewhere along its walls, no farther off than its crown reaches.
fn at_a_wall(world: &SimulatedTown, walls: &Walls, rng: &mut ChaCha8Rng) -> Option<(DVec3, f64)> {
    let radius = between(rng, AT_WALL_RADIUS_M.0, AT_WALL_RADIUS_M.1);
    (0..ATTEMPTS).find_map(|_| {
        let pick = between(rng, 0.0, world.buildings.len() as f64) as usize;
        let ring = world.buildings.get(pick)?.footprint.exterior();
        let edge = ring.lines().nth(between(rng, 0.0, ring.lines().count() as f64) as usize)?;
        let (a, b) = (DVec2::new(edge.start.x, edge.start.y), DVec2::new(edge.end.x, edge.end.y));
        // Rings run counter-clockwise: outside is on the right.
        let outwards = -(b - a).normalize().perp();
        let p = a.lerp(b, between(rng, 0.0, 1.0)) + outwards * between(rng, 0.2, 0.8) * radius;
        let is_free = walls.distance_m(p, radius) > TRUNK_CLEARANCE_M;
        is_free.then_some(())?;
        Some((p.extend(world.terrain.height_at(p.x, p.y)?), radius))
    })
}

fn place(
    world: &SimulatedTown,
    rng: &mut ChaCha8Rng,
    mut is_good: impl FnMut(&mut ChaCha8Rng, DVec2) -> bool,
) -> Option<DVec3> {
    let area = world.extent.grown(25.0);
    (0..ATTEMPTS).find_map(|_| {
        let p = DVec2::new(between(rng, area.west_m, area.east_m), between(rng, area.south_m, area.north_m));
        if !is_good(rng, p) {
            return None;
        }
        Some(p.extend(world.terrain.height_at(p.x, p.y)?))
    })
}

/// A place by the kerb or on a lane, and the direction of the street.
fn parking_space(world: &SimulatedTown, walls: &Walls, rng: &mut ChaCha8Rng) -> Option<(DVec3, f64)> {
    let streets = world.streets.as_ref()?;
    for _ in 0..ATTEMPTS {
        let of_columns = happens(rng, 0.5);
        let (blocks, others) =
            if of_columns { (&streets.columns, &streets.rows) } else { (&streets.rows, &streets.columns) };
        let pick = (between(rng, 0.0, (blocks.len() - 1) as f64) as usize).min(blocks.len().checked_sub(2)?);
        let (low, high) = (blocks[pick].1, blocks[pick + 1].0);
        let kerb = 0.5 * (high - low) - PAVEMENT_M - 0.5 * CAR_BODY_M[1] - 0.2;
        let side = if happens(rng, 0.5) { 1.0 } else { -1.0 };
        let across = if happens(rng, 0.7) { side * kerb } else { side * 0.45 * kerb };
        let along = between(rng, others.first()?.0, others.last()?.1);
        let street = 0.5 * (low + high) + across;
        let (u, v, turn) = if of_columns { (street, along, std::f64::consts::FRAC_PI_2) } else { (along, street, 0.0) };
        let p = streets.placement.point(DVec2::new(u, v));
        if world.extent.grown(25.0).contains(p) && walls.distance_m(p, 4.0) > 3.0 {
            return Some((p.extend(world.terrain.height_at(p.x, p.y)?), streets.placement.angle_rad + turn));
        }
    }
    None
}

/// Search tree of the buildings' footprints, for distances to their walls.
struct Walls<'a> {
    world: &'a SimulatedTown,
    boxes: RTree<GeomWithData<Rectangle<[f64; 2]>, usize>>,
}

impl<'a> Walls<'a> {
    fn of(world: &'a SimulatedTown) -> Self {
        let boxes = world.buildings.iter().enumerate().filter_map(|(i, b)| {
            let r = b.footprint.bounding_rect()?;
            Some(GeomWithData::new(Rectangle::from_corners([r.min().x, r.min().y], [r.max().x, r.max().y]), i))
        });
        Self { world, boxes: RTree::bulk_load(boxes.collect()) }
    }

    /// To the nearest footprint: 0 inside, and `within` or more where there is none so near.
    fn distance_m(&self, p: DVec2, within: f64) -> f64 {
        let area = AABB::from_corners([p.x - within, p.y - within], [p.x + within, p.y + within]);
        let near = self.boxes.locate_in_envelope_intersecting(&area);
        let distances =
            near.map(|b| Euclidean.distance(&Point::new(p.x, p.y), &self.world.buildings[b.data].footprint));
        distances.fold(f64::INFINITY, f64::min)
    }
}

/// A lumpy ball of leaves on a trunk.
fn tree(foot: DVec3, radius: f64, rng: &mut ChaCha8Rng, owner: u32, pieces: &mut Vec<ClutterTriangle>) {
    let height = radius * between(rng, 2.2, 3.4);
    let trunk = 0.25 * height;
    let half = 0.5 * (height - trunk);
    let middle = foot + DVec3::Z * (trunk + half);
    let lumps: Vec<f64> = (0..42).map(|_| between(rng, 0.78, 1.1)).collect();
    let (points, faces) = ball();
    let at = |i: usize| middle + points[i] * DVec3::new(radius, radius, half) * lumps[i];
    pieces.extend(faces.iter().map(|f| ClutterTriangle { corners: f.map(at), stuff: Stuff::Leaves, owner }));
    let stem = boxed(foot - 0.5 * DVec3::Z, 0.0, [0.15 * radius, 0.15 * radius, trunk + half]);
    pieces.extend(stem.into_iter().map(|corners| ClutterTriangle { corners, stuff: Stuff::Trunk, owner }));
}

fn car(foot: DVec3, heading_rad: f64, owner: u32, pieces: &mut Vec<ClutterTriangle>) {
    let body = boxed(foot + 0.25 * DVec3::Z, heading_rad, CAR_BODY_M);
    pieces.extend(body.into_iter().map(|corners| ClutterTriangle { corners, stuff: Stuff::CarBody, owner }));
    let roof = 0.25 + CAR_BODY_M[2];
    for corners in boxed(foot + roof * DVec3::Z, heading_rad, CAR_CABIN_M) {
        let is_top = corners.iter().all(|c| c.z > foot.z + roof + 0.1);
        pieces.push(ClutterTriangle { corners, stuff: if is_top { Stuff::CarBody } else { Stuff::CarGlass }, owner });
    }
}

/// Four sides and the top of a box that stands on `foot`, turned by `heading_rad`.
fn boxed(foot: DVec3, heading_rad: f64, [long, wide, high]: [f64; 3]) -> Vec<[DVec3; 3]> {
    let turn = DVec2::from_angle(heading_rad);
    let corner = |x: f64, y: f64, z: f64| foot + turn.rotate(DVec2::new(x * long, y * wide)).extend(z);
    let plan = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)];
    let low = plan.map(|(x, y)| corner(x, y, 0.0));
    let top = plan.map(|(x, y)| corner(x, y, high));
    let sides = (0..4).flat_map(|i| {
        let j = (i + 1) % 4;
        [[low[i], low[j], top[j]], [low[i], top[j], top[i]]]
    });
    sides.chain([[top[0], top[1], top[2]], [top[0], top[2], top[3]]]).collect()
}

/// An icosahedron with every face cut in four: 42 points on the unit sphere, 80 faces.
fn ball() -> (Vec<DVec3>, Vec<[usize; 3]>) {
    let g = 0.5 * (1.0 + 5.0_f64.sqrt());
    let raw = [
        (-1.0, g, 0.0),
        (1.0, g, 0.0),
        (-1.0, -g, 0.0),
        (1.0, -g, 0.0),
        (0.0, -1.0, g),
        (0.0, 1.0, g),
        (0.0, -1.0, -g),
        (0.0, 1.0, -g),
        (g, 0.0, -1.0),
        (g, 0.0, 1.0),
        (-g, 0.0, -1.0),
        (-g, 0.0, 1.0),
    ];
    let faces = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    let mut points: Vec<DVec3> = raw.map(|p| DVec3::from(p).normalize()).to_vec();
    let mut middles = std::collections::BTreeMap::new();
    let mut fine = Vec::with_capacity(80);
    for [a, b, c] in faces {
        let mut middle = |i: usize, j: usize| {
            *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                points.push((points[i] + points[j]).normalize());
                points.len() - 1
            })
        };
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        fine.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    (points, fine)
}
