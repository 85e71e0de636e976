//! Labels of one photo: footprints on the ground, roofs, what is visible.

use std::collections::BTreeMap;

use glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sizeup_geo::terrain::Terrain;
use sizeup_heights::raster::Raster;
use sizeup_lab::simulate::{Seen, Sight, World, ground_contact, roofs};
use sizeup_survey::View;

/// Ground labels of pixels of which it is not known whether there is a building.
pub const UNKNOWN: u16 = u16::MAX;

/// `H × W` each: index of the building + 1, 0 = none.
#[derive(Debug, Clone, PartialEq)]
pub struct Labels {
    /// Whose footprint a pixel lies in; [`UNKNOWN`] where there are none.
    pub ground: Raster<u16>,
    /// Whose roof.
    pub roof: Raster<u16>,
    /// Which building is seen.
    pub visible: Raster<u16>,
}

/// One building in one photo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instance {
    /// Index of the building + 1.
    pub label: u16,
    /// Pixels of its footprint on the ground.
    pub area_px: usize,
    /// Share of these that no other building, tree or car hides.
    pub visible_share: f64,
    /// First column and row, and one after the last.
    pub bounds: [usize; 4],
    /// Whether the photo's border cuts it off.
    pub is_cut: bool,
}

impl Labels {
    /// Of a view of a world; `complete_m` as in the configuration.
    #[must_use]
    pub fn of(view: &View, world: &World, sight: &Sight, complete_m: Option<[f64; 4]>) -> (Self, Vec<Instance>) {
        let mut ground = ground_contact(view, &world.buildings, &world.terrain);
        if let Some(area) = complete_m {
            leave_out(&mut ground, view, &world.terrain, area);
        }
        let roof = roofs(view, &world.buildings);
        let seen = sight.see(view).seen;
        let visible = seen.map(|s| match s {
            Seen::Building(idx) => idx.at() as u16 + 1,
            Seen::Sky | Seen::Ground | Seen::Clutter => 0,
        });
        let instances = instances(&ground, &seen);
        (Self { ground, roof, visible }, instances)
    }
}

/// Marks what lies beyond an area as unknown.
fn leave_out(ground: &mut Raster<u16>, view: &View, terrain: &Terrain, [west, south, east, north]: [f64; 4]) {
    let (centre, width) = (view.camera_from_map.centre(), ground.width());
    let map_from_camera = view.camera_from_map.rotation.transpose();
    for (i, label) in ground.data_mut().iter_mut().enumerate() {
        let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let place = view.camera.unproject(pixel).and_then(|ray| terrain.meets(centre, map_from_camera * ray));
        let is_inside = place.is_some_and(|p| (west..=east).contains(&p.x) && (south..=north).contains(&p.y));
        if !is_inside {
            *label = UNKNOWN;
        }
    }
}

fn instances(ground: &Raster<u16>, seen: &Raster<Seen>) -> Vec<Instance> {
    let (width, height) = (ground.width(), ground.height());
    let mut found: BTreeMap<u16, (Instance, usize)> = BTreeMap::new();
    for (i, (&label, seen)) in ground.data().iter().zip(seen.data()).enumerate() {
        if label == 0 || label == UNKNOWN {
            continue;
        }
        let (col, row) = (i % width, i / width);
        let fresh = Instance { label, area_px: 0, visible_share: 0.0, bounds: [col, row, col, row], is_cut: false };
        let (instance, n_hidden) = found.entry(label).or_insert((fresh, 0));
        instance.area_px += 1;
        let [left, top, right, bottom] = instance.bounds;
        instance.bounds = [left.min(col), top.min(row), right.max(col + 1), bottom.max(row + 1)];
        *n_hidden += usize::from(match seen {
            Seen::Clutter => true,
            Seen::Building(idx) => idx.at() + 1 != usize::from(label),
            Seen::Sky | Seen::Ground => false,
        });
    }
    let finish = |(mut instance, n_hidden): (Instance, usize)| {
        instance.visible_share = 1.0 - n_hidden as f64 / instance.area_px as f64;
        let [left, top, right, bottom] = instance.bounds;
        instance.is_cut = left == 0 || top == 0 || right == width || bottom == height;
        instance
    };
    found.into_values().map(finish).collect()
}

/// What a border is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Borders {
    /// Where buildings touch.
    Touching,
    /// All around every building, on its inside.
    #[default]
    Around,
}

/// Pixels of a building within `reach_px` of another building, or with [`Borders::Around`] of its own end: where a network has
/// to tell neighbours apart.
#[must_use]
pub fn borders(ground: &Raster<u16>, reach_px: usize, which: Borders) -> Vec<bool> {
    let (width, height) = (ground.width(), ground.height());
    let is_building = |label: u16| label != 0 && label != UNKNOWN;
    // Per pixel and window: does it hold another label? Rows first, then columns, as the lowest and highest label.
    let span = |lines: &[Option<(u16, u16)>], n: usize, step: usize, count: usize, jump: usize| {
        let mut out = vec![None; lines.len()];
        for line in 0..count {
            for i in 0..n {
                let around = i.saturating_sub(reach_px)..(i + reach_px + 1).min(n);
                let join = |a: Option<(u16, u16)>, k: usize| match (a, lines[line * jump + k * step]) {
                    (Some((l, h)), Some((l2, h2))) => Some((l.min(l2), h.max(h2))),
                    (a, b) => a.or(b),
                };
                out[line * jump + i * step] = around.fold(None, join);
            }
        }
        out
    };
    let counts = |l: u16| is_building(l) || (l == 0 && which == Borders::Around);
    let own: Vec<Option<(u16, u16)>> = ground.data().iter().map(|&l| counts(l).then_some((l, l))).collect();
    let along = span(&own, width, 1, height, width);
    let around = span(&along, height, width, width, 1);
    let is_border =
        |(&label, around): (&u16, Option<(u16, u16)>)| is_building(label) && around.is_some_and(|(l, h)| l != h);
    ground.data().iter().zip(around).map(is_border).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_lie_where_buildings_touch_or_all_around_them() {
        let label = |i: usize| match (i % 12, i / 12) {
            (1..=3, 1..=4) => 7,
            (4..=6, 1..=4) => 9,
            (9..=10, 1..=4) => 3,
            (0..=11, 6) => UNKNOWN,
            _ => 0,
        };
        let ground = Raster::from_vec(12, 7, (0..84).map(label).collect()).unwrap();
        for (which, expected) in [(Borders::Touching, "...xx......."), (Borders::Around, ".x.xx.x..xx.")] {
            let found = borders(&ground, 1, which);
            let row: String = (24..36).map(|i| if found[i] { 'x' } else { '.' }).collect();
            assert_eq!(row, expected);
            assert!(found[60..].iter().all(|b| !b));
        }
    }
}
