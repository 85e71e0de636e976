//! Labels of one photo: footprints on the ground, roofs, what is visible.

use std::collections::BTreeMap;

use glam::DVec2;
use sizeup_geo::terrain::Terrain;
use sizeup_heights::raster::Raster;
use sizeup_survey::View;
use sizeup_truth::simulate::{SeenObject, SimulatedTown, VisibleWorld, ground_contact, roofs};

/// Ground labels of pixels of which it is not known whether there is a building.
pub const UNKNOWN: u16 = u16::MAX;

/// `H × W` each: index of the building + 1, 0 = none.
#[derive(Debug, Clone, PartialEq)]
pub struct Labels {
    /// Whose footprint a pixel lies in; [`UNKNOWN`] where there are none.
    pub ground: Raster<u16>,
    /// Building whose roof each pixel shows.
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
    pub fn of(
        view: &View,
        world: &SimulatedTown,
        sight: &VisibleWorld,
        complete_m: Option<[f64; 4]>,
    ) -> (Self, Vec<Instance>) {
        let mut ground = ground_contact(view, &world.buildings, &world.terrain);
        if let Some(area) = complete_m {
            leave_out(&mut ground, view, &world.terrain, area);
        }
        let roof = roofs(view, &world.buildings);
        let seen = sight.see(view).seen;
        let visible = seen.map(|s| match s {
            SeenObject::Building(idx) => idx.at() as u16 + 1,
            SeenObject::Sky | SeenObject::Ground | SeenObject::Clutter => 0,
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

fn instances(ground: &Raster<u16>, seen: &Raster<SeenObject>) -> Vec<Instance> {
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
            SeenObject::Clutter => true,
            SeenObject::Building(idx) => idx.at() + 1 != usize::from(label),
            SeenObject::Sky | SeenObject::Ground => false,
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

/// Pixels to each side of where two buildings meet that are its seam.
const SEAM_PX: usize = 2;

/// What a network is to say of each pixel besides whether it is a building.
#[derive(Debug, Clone, PartialEq)]
pub struct Middles {
    /// How near to the middle of its building: 0 outside and at its footprint, walls to its neighbours included, 1 in its middle.
    pub near: Vec<f32>,
    /// Whether another building is within reach.
    pub is_shared: Vec<bool>,
    /// Whether another building is so near that the two meet here.
    pub is_seam: Vec<bool>,
}

/// See [`Middles`]: `min(d / min(D, reach), 1)`, `d` being the distance from a pixel's centre to what is not its building, less
/// half a pixel, and `D` the largest of the building. Where nothing is known there is no wall, nor at the photo's border.
#[must_use]
pub fn middles(ground: &Raster<u16>, reach_px: usize) -> Middles {
    let (width, height, labels) = (ground.width(), ground.height(), ground.data());
    let is_building = |label: u16| label != 0 && label != UNKNOWN;
    // Squares of distances to something else and to another building; what is beyond reach is as far as reach.
    let nearest = |is_other: &(dyn Fn(u16, u16) -> bool + Sync)| -> Vec<usize> {
        let far = reach_px + 1;
        let along = |i: usize| {
            let (col, row) = (i % width, i / width);
            let differs = |c: usize| is_other(labels[i], labels[row * width + c]);
            (1..far).find(|&d| (col >= d && differs(col - d)) || (col + d < width && differs(col + d))).unwrap_or(far)
        };
        let along: Vec<usize> = (0..labels.len()).map(along).collect();
        let square = |i: usize| {
            let (col, row) = (i % width, i / width);
            let rows = row.saturating_sub(reach_px)..(row + reach_px + 1).min(height);
            let of_row = |r: usize| {
                let j = r * width + col;
                let beside = if is_other(labels[i], labels[j]) {
                    0
                } else if labels[j] == labels[i] {
                    along[j]
                } else {
                    far
                };
                r.abs_diff(row).pow(2) + beside.pow(2)
            };
            rows.map(of_row).min().unwrap_or(usize::MAX).min(far.pow(2))
        };
        (0..labels.len()).map(|i| if is_building(labels[i]) { square(i) } else { 0 }).collect()
    };
    let own = nearest(&|own, other| other != own && other != UNKNOWN);
    let shared = nearest(&|own, other| other != own && is_building(other));
    let mut widest: BTreeMap<u16, usize> = BTreeMap::new();
    for (label, square) in labels.iter().zip(&own) {
        let most = widest.entry(*label).or_default();
        *most = (*most).max(*square);
    }
    let depth = |square: usize| (square as f32).sqrt().min(reach_px as f32) - 0.5;
    let near = labels.iter().zip(&own).map(|(label, square)| match widest.get(label) {
        Some(&widest) if is_building(*label) => (depth(*square) / depth(widest)).min(1.0),
        _ => 0.0,
    });
    let is_shared = labels.iter().zip(&shared).map(|(l, s)| is_building(*l) && *s <= reach_px.pow(2));
    let is_seam = labels.iter().zip(&shared).map(|(l, s)| is_building(*l) && *s <= SEAM_PX.pow(2));
    Middles { near: near.collect(), is_shared: is_shared.collect(), is_seam: is_seam.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two houses of 5 columns that share a wall, one that stands alone and is as wide, and what is not known beside it.
    #[test]
    fn middles_fall_to_the_walls_between_houses_as_to_all_others() {
        let label = |i: usize| match (i % 24, i / 24) {
            (1..=5, 1..=9) => 7,
            (6..=10, 1..=9) => 9,
            (13..=17, 1..=9) => 3,
            (18..=23, _) => UNKNOWN,
            _ => 0,
        };
        let ground = Raster::from_vec(24, 11, (0..264).map(label).collect()).unwrap();
        let found = middles(&ground, 4);
        let row: Vec<f32> = found.near[5 * 24..6 * 24].iter().map(|v| (v * 100.0).round() / 100.0).collect();
        // Distances 1, 2, 3, 2, 1 less a half, of 2.5 at most.
        let house = [0.2, 0.6, 1.0, 0.6, 0.2];
        assert_eq!(row[1..6], house);
        assert_eq!(row[6..11], house);
        // The third ends in what is not known: there is no wall there, and it is wider than its part that is seen.
        assert_eq!(row[13..18], [0.14, 0.43, 0.71, 1.0, 1.0]);
        assert!(row[18..].iter().chain(&row[11..13]).all(|v| *v == 0.0));
        let shared: String = (120..144).map(|i| if found.is_shared[i] { 'x' } else { '.' }).collect();
        assert_eq!(shared, "..xxxxxxxxx..xx.........");
        let seam: String = (120..144).map(|i| if found.is_seam[i] { 'x' } else { '.' }).collect();
        assert_eq!(seam, "....xxxx................");
        // At a corner as along a wall.
        assert_eq!(found.near[24 + 1], 0.2);
    }

    /// Against every pixel with every other one.
    #[test]
    fn distances_are_those_of_a_search_through_all_pixels() {
        let label = |i: usize| [0, 1, 1, 2, 2, 2, 3, 1][((i % 19) / 5 * 3 + (i / 19) / 4 * 5 + (i / 7) % 2) % 8];
        let ground = Raster::from_vec(19, 14, (0..19 * 14).map(label).collect()).unwrap();
        let found = middles(&ground, 3);
        let at = |i: usize| ((i % 19) as f32, (i / 19) as f32);
        let distance = |i: usize| {
            let others = (0..266).filter(|&j| ground.data()[j] != ground.data()[i]);
            others.map(|j| (at(i).0 - at(j).0).hypot(at(i).1 - at(j).1)).fold(3.0, f32::min)
        };
        for i in (0..266).filter(|&i| ground.data()[i] != 0) {
            let same = (0..266).filter(|&j| ground.data()[j] == ground.data()[i]);
            let most = same.map(distance).fold(0.0, f32::max);
            assert!((found.near[i] - (distance(i) - 0.5) / (most - 0.5)).abs() < 1e-6, "pixel {i}");
        }
    }
}
