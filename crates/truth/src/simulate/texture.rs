//! What surfaces look like: albedo as a function of the place, so that every view sees the same spots.
//!
//! Colours are linear red, green, blue in [0, 1]. Positions are `Local`, metres.

use glam::{DVec2, Vec2, Vec3};

use sizeup_heights::seed;

use super::building::BuildingKind;
use super::chance::between;
use super::clutter::Stuff;
use super::config::SimulateConfig;
use super::noise::{cell, fractal, hash, lattice, seen_share, unit};
use super::scene::{Material, TriangleSurface};
use super::streets::Land;
use super::town::SimulatedTown;

/// Height of a storey and width of a window bay, metres.
const STOREY_M: f32 = 3.0;
/// Slopes flatter than this (cosine to the vertical) are flat roofs, not tiled ones.
const FLAT_COSINE: f32 = 0.995;

/// Paints of common things, linear.
const ASPHALT: Vec3 = Vec3::new(0.085, 0.087, 0.092);
const ROAD_PAINT: Vec3 = Vec3::new(0.62, 0.62, 0.60);
const SLABS: Vec3 = Vec3::new(0.30, 0.285, 0.265);
const GRASS: Vec3 = Vec3::new(0.085, 0.135, 0.045);
const DRY_GRASS: Vec3 = Vec3::new(0.20, 0.19, 0.085);
const GRAVEL: Vec3 = Vec3::new(0.31, 0.28, 0.235);
const GLASS: Vec3 = Vec3::new(0.035, 0.05, 0.065);
const BARK: Vec3 = Vec3::new(0.09, 0.065, 0.045);

const TILES: [Vec3; 5] = [
    Vec3::new(0.36, 0.12, 0.065),
    Vec3::new(0.27, 0.10, 0.06),
    Vec3::new(0.13, 0.12, 0.12),
    Vec3::new(0.22, 0.13, 0.09),
    Vec3::new(0.40, 0.17, 0.09),
];
const MEMBRANES: [Vec3; 5] = [
    Vec3::new(0.32, 0.31, 0.29),
    Vec3::new(0.12, 0.12, 0.125),
    Vec3::new(0.42, 0.41, 0.38),
    Vec3::new(0.26, 0.22, 0.18),
    Vec3::new(0.14, 0.17, 0.08),
];
const PLASTERS: [Vec3; 7] = [
    Vec3::new(0.62, 0.56, 0.43),
    Vec3::new(0.55, 0.53, 0.50),
    Vec3::new(0.33, 0.13, 0.085),
    Vec3::new(0.60, 0.43, 0.26),
    Vec3::new(0.38, 0.40, 0.42),
    Vec3::new(0.66, 0.64, 0.60),
    Vec3::new(0.42, 0.24, 0.16),
];
const CAR_PAINTS: [Vec3; 6] = [
    Vec3::new(0.60, 0.60, 0.60),
    Vec3::new(0.03, 0.03, 0.035),
    Vec3::new(0.30, 0.31, 0.33),
    Vec3::new(0.32, 0.03, 0.03),
    Vec3::new(0.04, 0.08, 0.25),
    Vec3::new(0.62, 0.62, 0.58),
];

/// The looks of one building.
#[derive(Debug, Clone, Copy)]
struct BuildingLook {
    wall: Vec3,
    /// Albedo of sloping roofs and of level ones.
    slope: Vec3,
    deck: Vec3,
    key: u32,
    /// Direction that flat roofs' seams follow, `Local`.
    along: Vec2,
    ground_m: f32,
    bay_m: f32,
    /// Share of a bay that is glass, across and up.
    glass: Vec2,
}

/// Albedo of everything in a scene.
#[derive(Debug)]
pub(super) struct Palette<'a> {
    world: &'a SimulatedTown,
    origin: DVec2,
    looks: Vec<BuildingLook>,
    key: u32,
}

impl<'a> Palette<'a> {
    pub fn new(world: &'a SimulatedTown, origin: DVec2, config: &SimulateConfig) -> Self {
        let look = |i: usize| {
            let building = &world.buildings[i];
            let mut rng = seed::stream(config.seed, "look", &[i as u64]);
            let mut pick = |n: usize| (between(&mut rng, 0.0, n as f64) as usize).min(n - 1);
            let (tiles, deck) = (TILES[pick(TILES.len())], MEMBRANES[pick(MEMBRANES.len())]);
            let slope = if building.kind == BuildingKind::Hall { deck } else { tiles };
            let wall = PLASTERS[pick(PLASTERS.len())];
            let is_tower = building.kind == BuildingKind::Tower;
            let (glass, bays) =
                if is_tower { (Vec2::new(0.86, 0.62), (1.4, 2.2)) } else { (Vec2::new(0.44, 0.5), (2.1, 3.1)) };
            let tint = 0.85 + 0.3 * between(&mut rng, 0.0, 1.0) as f32;
            BuildingLook {
                wall: wall * tint,
                slope: slope * tint,
                deck: deck * tint,
                key: hash(i as u32, 17, config.seed as u32),
                along: DVec2::from_angle(building.heading_rad).as_vec2(),
                ground_m: building.ground_z_m as f32,
                bay_m: between(&mut rng, bays.0, bays.1) as f32,
                glass,
            }
        };
        let looks = (0..world.buildings.len()).map(look).collect();
        Self { world, origin, looks, key: hash(3, 5, config.seed as u32) }
    }

    /// The albedo at a place of a surface, averaged over a pixel of `pixel_m`.
    pub fn albedo(&self, p: Vec3, surface: &TriangleSurface, pixel_m: f32) -> Vec3 {
        match surface.material {
            Material::Ground => self.ground(p, pixel_m),
            Material::Roof(b) => roof(&self.looks[b.at()], p, surface.normal, pixel_m),
            Material::Wall(b) => wall(&self.looks[b.at()], p, surface.normal, pixel_m),
            Material::Clutter(stuff, owner) => clutter(stuff, owner, p, pixel_m),
        }
    }

    fn ground(&self, p: Vec3, pixel_m: f32) -> Vec3 {
        let at = p.truncate();
        let fine = fractal(at, 4.0, 0.12, pixel_m, self.key);
        let broad = fractal(at, 34.0, 14.0, pixel_m, self.key ^ 0x1);
        let land = self.world.streets.as_ref().map(|s| s.land(self.origin + at.as_dvec2()));
        match land {
            Some(Land::Road { across_m, along_m }) => {
                let tar = ASPHALT * (1.0 + 0.45 * fine + 0.35 * broad);
                let dash = across_m.abs() < 0.14 && along_m.rem_euclid(9.0) < 4.0;
                if dash { ROAD_PAINT.lerp(tar, 1.0 - seen_share(0.9, pixel_m)) } else { tar }
            }
            Some(Land::Crossing) => ASPHALT * (1.05 + 0.45 * fine + 0.35 * broad),
            Some(Land::Pavement) => {
                let slab = cell(at / 0.6, self.key) - 0.5;
                SLABS * (1.0 + 0.3 * fine + 0.3 * slab * seen_share(0.6, pixel_m) + 0.12 * broad)
            }
            Some(Land::Block { col, row }) => {
                let paved = unit(col as u32, row as u32, self.key ^ 0x7) - 0.5;
                meadow(fine, broad, 0.9 * paved + 1.2 * fractal(at, 22.0, 3.0, pixel_m, self.key ^ 0x9))
            }
            Some(Land::Open) => self.field(at, fine, broad, pixel_m),
            None => meadow(fine, broad, 0.15 + 1.1 * fractal(at, 30.0, 3.0, pixel_m, self.key ^ 0x9)),
        }
    }

    /// Farmland: fields of different crops with ploughing rows.
    fn field(&self, at: Vec2, fine: f32, broad: f32, pixel_m: f32) -> Vec3 {
        let turned = Vec2::from_angle(0.35).rotate(at);
        let parcel = (turned / Vec2::new(130.0, 85.0)).floor();
        let crop = unit(lattice(parcel.x), lattice(parcel.y), self.key ^ 0x15);
        let rows = ((turned.y / 1.6).fract().abs() - 0.5) * seen_share(1.6, pixel_m);
        let base = if crop < 0.4 {
            GRASS
        } else if crop < 0.75 {
            DRY_GRASS
        } else {
            Vec3::new(0.17, 0.12, 0.075)
        };
        base * (1.0 + 0.4 * fine + 0.3 * broad + 0.25 * rows + 0.4 * (crop * 7.0).fract())
    }
}

/// Lawn where `paving` is low, gravel where it is high.
fn meadow(fine: f32, broad: f32, paving: f32) -> Vec3 {
    let lawn = GRASS.lerp(DRY_GRASS, (0.35 + 0.9 * broad).clamp(0.0, 1.0)) * (1.0 + 0.5 * fine);
    let gravel = GRAVEL * (1.0 + 0.35 * fine + 0.15 * broad);
    lawn.lerp(gravel, ((paving - 0.12) * 9.0).clamp(0.0, 1.0))
}

fn roof(look: &BuildingLook, p: Vec3, normal: Vec3, pixel_m: f32) -> Vec3 {
    if normal.z > FLAT_COSINE { flat_roof(look, p, pixel_m) } else { tiled_roof(look, p, normal, pixel_m) }
}

fn tiled_roof(look: &BuildingLook, p: Vec3, normal: Vec3, pixel_m: f32) -> Vec3 {
    let level = Vec2::new(-normal.y, normal.x).normalize_or_zero();
    let along = p.truncate().dot(level);
    // Metres up the slope from the fall line's height.
    let up = (p.z - look.ground_m) / (1.0 - normal.z * normal.z).sqrt();
    let at = Vec2::new(along, up);
    let key = look.key ^ (normal.x > 0.0) as u32;
    let tile = at / Vec2::new(0.28, 0.36);
    let shadow_line = if tile.y.rem_euclid(1.0) < 0.22 { -0.3 } else { 0.08 };
    let single = 0.5 * (cell(tile, key) - 0.5);
    let weather = fractal(at, 6.0, 0.25, pixel_m, key);
    let colour = look.slope * (1.0 + (shadow_line + single) * seen_share(0.36, pixel_m) + 0.42 * weather);
    // Now and then a roof window.
    let bay = at / Vec2::new(3.4, 3.0);
    let inside = (bay - bay.floor() - Vec2::splat(0.5)).abs() * Vec2::new(3.4, 3.0);
    if cell(bay, key ^ 0x5) < 0.16 && inside.x < 0.45 && inside.y < 0.65 { GLASS * 1.6 } else { colour }
}

fn flat_roof(look: &BuildingLook, p: Vec3, pixel_m: f32) -> Vec3 {
    let q = p.truncate();
    let at = Vec2::new(q.dot(look.along), q.dot(look.along.perp()));
    let weather = fractal(at, 9.0, 0.15, pixel_m, look.key);
    let puddles = fractal(at, 14.0, 3.5, pixel_m, look.key ^ 0x3);
    let seam = if (at.y / 1.1).rem_euclid(1.0) < 0.07 { -0.35 * seen_share(0.4, pixel_m) } else { 0.0 };
    let mut colour = look.deck * (1.0 + 0.4 * weather + seam + if puddles > 0.25 { -0.3 } else { 0.0 });
    // Skylights, hatches and machines, drawn rather than built: at most 1.6 m across.
    let bay = at / 5.5;
    let dice = cell(bay, look.key ^ 0xb);
    if dice < 0.3 {
        let n = bay.floor();
        let (x, y) = (lattice(n.x), lattice(n.y));
        let centre = Vec2::new(unit(x, y, look.key ^ 0xc), unit(x, y, look.key ^ 0xd)) * 3.0 + Vec2::splat(1.25);
        let size = Vec2::new(0.35 + 0.45 * unit(x, y, look.key ^ 0xe), 0.35 + 0.45 * unit(x, y, look.key ^ 0xf));
        let inside = (at - n * 5.5 - centre).abs();
        if inside.x < size.x && inside.y < size.y {
            colour = if dice < 0.12 { Vec3::splat(0.62) } else { GLASS * 1.5 };
        }
    }
    colour
}

fn wall(look: &BuildingLook, p: Vec3, normal: Vec3, pixel_m: f32) -> Vec3 {
    let level = Vec2::new(-normal.y, normal.x);
    let at = Vec2::new(p.truncate().dot(level), p.z - look.ground_m);
    let side = hash(lattice(normal.x * 8.0 + 0.5), lattice(normal.y * 8.0 + 0.5), look.key);
    let stain = fractal(at, 5.0, 0.2, pixel_m, side);
    let plaster = look.wall * (1.0 + 0.28 * stain) * (0.75 + 0.25 * (at.y / 4.0).clamp(0.0, 1.0));
    let bay = at / Vec2::new(look.bay_m, STOREY_M);
    let inside = (bay - bay.floor() - Vec2::new(0.5, 0.52)).abs();
    let is_window = at.y > 0.0 && inside.x < 0.5 * look.glass.x && inside.y < 0.5 * look.glass.y;
    let is_blind = cell(bay, side ^ 0x2) < 0.08;
    if !is_window || is_blind {
        return plaster;
    }
    let glint = cell(bay, side ^ 0x4);
    let curtain = if glint > 0.8 { Vec3::splat(0.25) } else { GLASS * (0.6 + 1.6 * glint) };
    plaster.lerp(curtain, seen_share(2.0 * STOREY_M, pixel_m).max(0.55))
}

fn clutter(stuff: Stuff, owner: u32, p: Vec3, pixel_m: f32) -> Vec3 {
    let mood = unit(owner, 2, 77);
    match stuff {
        Stuff::Leaves => {
            let at = Vec2::new(p.x + 0.7 * p.z, p.y + 0.5 * p.z);
            let green = Vec3::new(0.05 + 0.05 * mood, 0.10 + 0.045 * mood, 0.028);
            green * (1.0 + 0.85 * fractal(at, 1.6, 0.12, pixel_m, owner))
        }
        Stuff::Trunk => BARK,
        Stuff::CarBody => CAR_PAINTS[(mood * CAR_PAINTS.len() as f32) as usize % CAR_PAINTS.len()],
        Stuff::CarGlass => GLASS,
    }
}
