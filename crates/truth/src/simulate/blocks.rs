//! What stands in one block of a procedural town.
//!
//! Block frame: origin in the block's low corner, x along the town's heading, metres. Buildings keep clear of each
//! other by at least [`GAP_M`], or share whole walls.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec2;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::building::{BuildingKind, Placement};
use super::chance::{between, happens};
use super::config::TownKind;
use super::form::{self, BuildingForm, Rect, Wing};
use super::streets::Rhythm;

/// Shortest distance between buildings that do not share a wall, metres.
pub(super) const GAP_M: f64 = 2.0;
/// Distance of outer walls from the block's edge, metres.
const SETBACK_M: f64 = 3.0;

/// A form, where it stands in its block, and what it is.
pub(super) type Lot = (BuildingForm, Placement, BuildingKind);

/// Block sizes along and across the town's heading.
pub(super) fn rhythms(kind: TownKind) -> (Rhythm, Rhythm) {
    let rhythm = |low, high, street_m| Rhythm { block_m: (low, high), street_m };
    match kind {
        TownKind::Village | TownKind::Suburb => (rhythm(66.0, 84.0, 10.0), rhythm(52.0, 60.0, 9.0)),
        TownKind::District => (rhythm(74.0, 94.0, 14.0), rhythm(66.0, 76.0, 14.0)),
        TownKind::Downtown => (rhythm(74.0, 88.0, 20.0), rhythm(64.0, 74.0, 18.0)),
        TownKind::Industry => (rhythm(112.0, 140.0, 13.0), rhythm(84.0, 100.0, 13.0)),
    }
}

/// The buildings of one block.
pub(super) fn fill(kind: TownKind, size: DVec2, rng: &mut ChaCha8Rng) -> Vec<Lot> {
    let dice = rng.random::<f64>();
    match kind {
        TownKind::Village => village(size, rng),
        TownKind::Suburb => suburb(size, rng),
        TownKind::District if dice < 0.25 => closed_block(size, rng),
        TownKind::District if dice < 0.55 => town_rows(size, rng),
        TownKind::District if dice < 0.78 => angled(size, rng),
        TownKind::District if dice < 0.92 => slabs(size, (12.0, 25.0), rng),
        TownKind::District => high_rise(size, (26.0, 38.0), rng),
        TownKind::Downtown if dice < 0.38 => high_rise(size, (34.0, 115.0), rng),
        TownKind::Downtown if dice < 0.55 => towers(size, (30.0, 115.0), rng),
        TownKind::Downtown if dice < 0.8 => slabs(size, (18.0, 45.0), rng),
        TownKind::Downtown => angled(size, rng),
        TownKind::Industry => halls(size, rng),
    }
}

fn here() -> Placement {
    Placement { origin: DVec2::ZERO, angle_rad: 0.0 }
}

/// The two long fronts of a block, each with its own frame: x along the street, y away from it.
fn fronts(size: DVec2) -> [Placement; 2] {
    [here(), Placement { origin: size, angle_rad: PI }]
}

fn rise(width_m: f64, pitch_deg: f64) -> f64 {
    0.5 * width_m * pitch_deg.to_radians().tan()
}

fn village(size: DVec2, rng: &mut ChaCha8Rng) -> Vec<Lot> {
    let mut lots = Vec::new();
    for front in fronts(size) {
        if happens(rng, 0.3) {
            lots.extend(row(front, size.x, (5.4, 7.4), (5.2, 6.6), (9.0, 10.5), rng));
        } else {
            lots.extend(detached(front, size.x, rng));
        }
    }
    lots
}

fn detached(front: Placement, length: f64, rng: &mut ChaCha8Rng) -> Vec<Lot> {
    let mut lots = Vec::new();
    let mut x = SETBACK_M;
    loop {
        let width = between(rng, 14.0, 19.0);
        if x + width > length - SETBACK_M {
            return lots;
        }
        let long = between(rng, 8.5, width - 2.0 * GAP_M - 0.8);
        let deep = between(rng, 7.5, long.min(10.0));
        let (eave, pitch) = (between(rng, 3.0, 6.2), between(rng, 28.0, 46.0));
        let ridge = eave + rise(deep, pitch);
        let body = Rect::sized(-0.5 * long, -0.5 * deep, long, deep);
        let dice = rng.random::<f64>();
        let house = if dice < 0.5 {
            form::gable(body, eave, ridge)
        } else if dice < 0.72 {
            let wing = Wing { x0: body.x0, x1: body.x0 + 0.8 * deep, reach: between(rng, 2.0, 3.5) };
            form::gable_with_wings(body, eave, ridge, &[wing])
        } else if dice < 0.92 {
            form::hip(body, eave, ridge)
        } else {
            form::flat(vec![body.ring()], eave)
        };
        let turn = if happens(rng, 0.3) { FRAC_PI_2 } else { 0.0 } + between(rng, -0.05, 0.05);
        let centre = DVec2::new(x + 0.5 * width, between(rng, 12.0, 15.0));
        lots.push((house, front.then(centre, turn), BuildingKind::House));
        x += width;
    }
}

/// Houses in a row: neighbours share a wall exactly, corner by corner.
fn row(
    front: Placement,
    length: f64,
    (narrow, wide): (f64, f64),
    (low, high): (f64, f64),
    (shallow, deep): (f64, f64),
    rng: &mut ChaCha8Rng,
) -> Vec<Lot> {
    let (y0, depth) = (between(rng, SETBACK_M, SETBACK_M + 2.0), between(rng, shallow, deep));
    let pitch = between(rng, 26.0, 42.0);
    let flat_share = if high > 10.0 { 0.4 } else { 0.1 };
    let mut x = SETBACK_M + between(rng, 0.0, 4.0);
    let mut lots = Vec::new();
    loop {
        let end = x + between(rng, narrow, wide);
        if end > length - SETBACK_M {
            return lots;
        }
        let eave = between(rng, low, high);
        let house = Rect { x0: x, x1: end, y0, y1: y0 + depth };
        let form = if happens(rng, flat_share) {
            form::flat(vec![house.ring()], eave)
        } else {
            form::gable(house, eave, eave + rise(depth, pitch))
        };
        lots.push((form, front, BuildingKind::RowHouse));
        x = end;
    }
}

/// Houses whose width does not tell whether they stand alone: lone ones, pairs and rows side by side along both streets.
fn suburb(size: DVec2, rng: &mut ChaCha8Rng) -> Vec<Lot> {
    let mut lots = Vec::new();
    for front in fronts(size) {
        let mut x = SETBACK_M + between(rng, 0.0, 4.0);
        loop {
            let dice = rng.random::<f64>();
            let widths: Vec<f64> = if dice < 0.5 {
                vec![between(rng, 8.0, 16.0)]
            } else {
                let n = if dice < 0.75 { 2 } else { 3 + usize::from(happens(rng, 0.5)) };
                let (narrow, wide) = if happens(rng, 0.3) { (9.5, 12.5) } else { (5.0, 9.5) };
                (0..n).map(|_| between(rng, narrow, wide)).collect()
            };
            let length: f64 = widths.iter().sum();
            if x + length > size.x - SETBACK_M {
                break;
            }
            let back = between(rng, SETBACK_M, SETBACK_M + 3.0);
            let depth = between(rng, 7.0, 11.0);
            if let [width] = widths[..] {
                lots.push(lone(front, Rect::sized(x, back, width, depth), rng));
            } else {
                lots.extend(joined(front, DVec2::new(x, back), depth, &widths, rng));
            }
            x += length + between(rng, GAP_M + 0.5, 8.0);
        }
    }
    lots
}

/// A house that stands alone, under any roof; its ridge runs along its front or across it.
fn lone(front: Placement, body: Rect, rng: &mut ChaCha8Rng) -> Lot {
    let is_across = happens(rng, if body.dy() > body.dx() { 0.8 } else { 0.2 });
    let (long, deep) = if is_across { (body.dy(), body.dx()) } else { (body.dx(), body.dy()) };
    let own = Rect::sized(-0.5 * long, -0.5 * deep, long, deep);
    let eave = between(rng, 3.0, 6.5);
    let ridge = eave + rise(deep, between(rng, 24.0, if deep > 11.0 { 34.0 } else { 44.0 }));
    let dice = rng.random::<f64>();
    let form = if dice < 0.45 {
        form::gable(own, eave, ridge)
    } else if dice < 0.7 {
        form::hip(own, eave, ridge)
    } else if dice < 0.94 {
        form::flat(vec![own.ring()], eave)
    } else {
        form::stacked(&[(own, eave), (own.inset(1.5), eave + between(rng, 2.5, 3.5))])
    };
    let centre = DVec2::new(0.5 * (body.x0 + body.x1), 0.5 * (body.y0 + body.y1));
    (form, front.then(centre, if is_across { FRAC_PI_2 } else { 0.0 }), BuildingKind::House)
}

/// Houses that share walls: of one height or of several, under one ridge, or each under a gable or a flat roof of its own.
fn joined(front: Placement, corner: DVec2, depth: f64, widths: &[f64], rng: &mut ChaCha8Rng) -> Vec<Lot> {
    let (eave, pitch) = (between(rng, 3.0, 6.5), between(rng, 24.0, 40.0));
    let has_one_eave = happens(rng, 0.4);
    let (has_own_gables, is_flat) = (happens(rng, 0.25), happens(rng, 0.3));
    let mut x = corner.x;
    widths
        .iter()
        .map(|width| {
            let body = Rect { x0: x, x1: x + width, y0: corner.y, y1: corner.y + depth };
            x = body.x1;
            let eave = if has_one_eave { eave } else { (eave + between(rng, -1.2, 1.2)).max(3.0) };
            if is_flat || happens(rng, 0.1) {
                (form::flat(vec![body.ring()], eave), front, BuildingKind::RowHouse)
            } else if has_own_gables {
                let own = Rect::sized(-0.5 * depth, -0.5 * width, depth, *width);
                let centre = DVec2::new(body.x0 + 0.5 * width, corner.y + 0.5 * depth);
                let gable = form::gable(own, eave, eave + rise(*width, pitch));
                (gable, front.then(centre, FRAC_PI_2), BuildingKind::RowHouse)
            } else {
                (form::gable(body, eave, eave + rise(depth, pitch)), front, BuildingKind::RowHouse)
            }
        })
        .collect()
}

fn town_rows(size: DVec2, rng: &mut ChaCha8Rng) -> Vec<Lot> {
    fronts(size)
        .into_iter()
        .flat_map(|front| row(front, size.x, (10.0, 16.0), (10.5, 19.0), (11.0, 13.5), rng))
        .collect()
}

fn pavilion(r: Rect, rng: &mut ChaCha8Rng) -> Lot {
    (form::flat(vec![r.ring()], between(rng, 3.0, 5.5)), here(), BuildingKind::Pavilion)
}

fn closed_block(size: DVec2, rng: &mut ChaCha8Rng) -> Vec<Lot> {
    let outer = Rect::sized(0.0, 0.0, size.x, size.y).inset(between(rng, SETBACK_M, SETBACK_M + 2.0));
    let (wing, eave) = (between(rng, 11.0, 14.0), between(rng, 13.0, 22.0));
    let ridge = if happens(rng, 0.6) { eave + rise(wing, between(rng, 24.0, 36.0)) } else { eave };
    let yard = outer.inset(wing + 8.0);
    let shed = Rect { x1: yard.x0 + between(rng, 8.0, 14.0), y1: yard.y0 + between(rng, 6.0, 10.0), ..yard };
    vec![(form::courtyard(outer, wing, eave, ridge), here(), BuildingKind::Courtyard), pavilion(shed, rng)]
}

fn angled(size: DVec2, rng: &mut ChaCha8Rng) -> Vec<Lot> {
    let deep = between(rng, 12.0, 15.0);
    let main = Rect { x0: SETBACK_M, x1: size.x - SETBACK_M, y0: size.y - SETBACK_M - deep, y1: size.y - SETBACK_M };
    let wing_width = deep - between(rng, 0.8, 2.0);
    let reach = between(rng, 12.0, 18.0);
    let left = Wing { x0: main.x0, x1: main.x0 + wing_width, reach };
    let right = Wing { x0: main.x1 - wing_width, x1: main.x1, reach };
    let wings = if happens(rng, 0.5) { vec![left, right] } else { vec![right] };
    let eave = between(rng, 9.0, 21.0);
    let block = if happens(rng, 0.5) {
        form::flat(vec![form::winged_footprint(main, &wings)], eave)
    } else {
        form::gable_with_wings(main, eave, eave + rise(deep, between(rng, 22.0, 38.0)), &wings)
    };
    let slab =
        Rect::sized(SETBACK_M + between(rng, 0.0, 6.0), SETBACK_M, between(rng, 28.0, 42.0), between(rng, 10.0, 13.0));
    let eave = between(rng, 8.0, 17.0);
    let slab_form = form::hip(slab, eave, eave + rise(slab.y1 - slab.y0, between(rng, 18.0, 32.0)));
    let kiosk = Rect::sized(size.x - 17.0, SETBACK_M, between(rng, 7.0, 13.0), between(rng, 6.0, 9.0));
    vec![(block, here(), BuildingKind::Angled), (slab_form, here(), BuildingKind::Slab), pavilion(kiosk, rng)]
}

fn slabs(size: DVec2, (low, high): (f64, f64), rng: &mut ChaCha8Rng) -> Vec<Lot> {
    let mut lots = Vec::new();
    for front in fronts(size) {
        let deep = between(rng, 11.0, 15.0);
        let length = between(rng, 36.0, size.x - 2.0 * SETBACK_M - 16.0);
        let body = Rect::sized(SETBACK_M, SETBACK_M + between(rng, 0.0, 4.0), length, deep);
        let top = between(rng, low, high);
        let dice = rng.random::<f64>();
        let form = if dice < 0.4 {
            form::stepped(body, &[top, top - between(rng, 3.0, 6.0), top - between(rng, 6.5, 8.5)])
        } else if dice < 0.7 {
            form::stacked(&[(body, top), (body.inset(2.5), top + 3.0)])
        } else {
            form::flat(vec![body.ring()], top)
        };
        lots.push((form, front, BuildingKind::Slab));
        if happens(rng, 0.6) {
            let kiosk = Rect::sized(size.x - 15.0, SETBACK_M, between(rng, 7.0, 11.0), between(rng, 7.0, 12.0));
            let (form, _, kind) = pavilion(kiosk, rng);
            lots.push((form, front, kind));
        }
    }
    lots
}

fn high_rise(size: DVec2, (low, high): (f64, f64), rng: &mut ChaCha8Rng) -> Vec<Lot> {
    let podium = Rect::sized(SETBACK_M, SETBACK_M, size.x - 26.0, size.y - 2.0 * SETBACK_M - between(rng, 0.0, 16.0));
    let side = between(rng, 19.0, 27.0);
    let deep = between(rng, 18.0, 25.0);
    let tower = Rect::sized(podium.x0 + between(rng, 5.0, 14.0), podium.y0 + between(rng, 4.0, 10.0), side, deep);
    // Most towers are not the tallest: the square pulls the draw down.
    let top = low + (high - low) * rng.random::<f64>().powi(2);
    let levels = [(podium, between(rng, 5.0, 14.0)), (tower, top), (tower.inset(5.0), top + between(rng, 3.0, 5.0))];
    let mut lots = vec![(form::stacked(&levels), here(), BuildingKind::Tower)];
    let strip = Rect::sized(size.x - 15.0, SETBACK_M, between(rng, 8.0, 12.0), between(rng, 9.0, 20.0));
    lots.push(pavilion(strip, rng));
    if happens(rng, 0.6) {
        let second = Rect::sized(size.x - 15.0, size.y - 24.0, between(rng, 8.0, 12.0), between(rng, 10.0, 18.0));
        let top = between(rng, 9.0, 30.0);
        lots.push((form::flat(vec![second.ring()], top), here(), BuildingKind::Slab));
    }
    lots
}

/// Two towers without podiums, and a pavilion between them.
fn towers(size: DVec2, (low, high): (f64, f64), rng: &mut ChaCha8Rng) -> Vec<Lot> {
    let mut lots = Vec::new();
    for front in fronts(size) {
        let foot = Rect::sized(
            SETBACK_M + between(rng, 0.0, 3.0),
            SETBACK_M,
            between(rng, 18.0, 24.0),
            between(rng, 17.0, 23.0),
        );
        let top = low + (high - low) * rng.random::<f64>();
        let form = form::stacked(&[(foot, top), (foot.inset(5.5), top + between(rng, 2.5, 4.0))]);
        lots.push((form, front, BuildingKind::Tower));
    }
    let middle = Rect::sized(0.5 * size.x - 6.0, 0.5 * size.y - 5.0, 12.0, between(rng, 8.0, 10.0));
    lots.push(pavilion(middle, rng));
    lots
}

fn halls(size: DVec2, rng: &mut ChaCha8Rng) -> Vec<Lot> {
    let mut lots = Vec::new();
    for front in fronts(size) {
        let mut x = SETBACK_M + 2.0;
        let deepest = 0.5 * size.y - 2.0 * SETBACK_M;
        loop {
            let end = x + between(rng, 24.0, 52.0);
            if end > size.x - SETBACK_M {
                break;
            }
            let deep = between(rng, 0.7 * deepest, deepest);
            let body = Rect { x0: x, x1: end, y0: SETBACK_M + 1.0, y1: SETBACK_M + 1.0 + deep };
            let eave = between(rng, 5.0, 14.0);
            let dice = rng.random::<f64>();
            let form = if dice < 0.45 {
                form::gable(body, eave, eave + rise(deep, between(rng, 5.0, 12.0)))
            } else if dice < 0.75 {
                form::flat(vec![body.ring()], eave)
            } else {
                form::stepped(body, &[eave + between(rng, 2.0, 4.0), eave])
            };
            lots.push((form, front, BuildingKind::Hall));
            x = end + between(rng, 6.0, 11.0);
        }
    }
    lots
}
