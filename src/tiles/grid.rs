//! How an area is cut into tiles: squares that are halved in both directions until they hold few enough buildings.
//!
//! Squares lie on multiples of their own size, so that a tile's name and place do not depend on the extent of the input.

use rstar::primitives::GeomWithData;
use rstar::{AABB, RTree};

use sizeup_geo::terrain::MapBox;

/// Side of the smallest tile, metres.
const SMALLEST_M: f64 = 125.0;

/// Side beyond which squares are not made larger to bound what halos cost, metres.
const LARGEST_M: f64 = 100_000.0;

/// A square tile's core.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Core {
    west_m: f64,
    south_m: f64,
    side_m: f64,
}

impl Core {
    /// Place; west and south edge belong to it.
    #[must_use]
    pub fn area(&self) -> MapBox {
        let Self { west_m, south_m, side_m } = *self;
        MapBox { west_m, south_m, east_m: west_m + side_m, north_m: south_m + side_m }
    }

    /// Name, from its south-western corner and side, metres: `e565000_n5932000_s500`.
    #[must_use]
    pub fn id(&self) -> String {
        format!("e{}_n{}_s{}", self.west_m, self.south_m, self.side_m)
    }

    /// Four quarters, south-west first; `None` where they would be smaller than the smallest tile.
    #[must_use]
    pub fn quarters(&self) -> Option<[Self; 4]> {
        let half = 0.5 * self.side_m;
        let quarter =
            |i: f64, j: f64| Self { west_m: self.west_m + i * half, south_m: self.south_m + j * half, side_m: half };
        (half >= SMALLEST_M).then(|| [quarter(0.0, 0.0), quarter(1.0, 0.0), quarter(0.0, 1.0), quarter(1.0, 1.0)])
    }
}

/// Buildings' part of the file.
pub struct Places(RTree<GeomWithData<[f64; 2], usize>>);

impl Places {
    /// Index of the middles of all footprints.
    #[must_use]
    pub fn new(middles: &[(f64, f64)]) -> Self {
        Self(RTree::bulk_load(middles.iter().enumerate().map(|(i, &(x, y))| GeomWithData::new([x, y], i)).collect()))
    }

    /// Number that lie in a box.
    #[must_use]
    pub fn count(&self, area: &MapBox) -> usize {
        let envelope = AABB::from_corners([area.west_m, area.south_m], [area.east_m, area.north_m]);
        self.0.locate_in_envelope(&envelope).filter(|place| area.holds((place.geom()[0], place.geom()[1]))).count()
    }

    /// Box around all places; `None` where there is none.
    #[must_use]
    pub fn extent(&self) -> Option<MapBox> {
        MapBox::around(self.0.iter().map(|place| (place.geom()[0], place.geom()[1])))
    }
}

/// Squares of one side that hold any building, from south to north and west to east.
#[must_use]
pub fn even(places: &Places, side_m: f64) -> Vec<Core> {
    let Some(extent) = places.extent() else { return Vec::new() };
    let first = |low: f64| (low / side_m).floor() as i64;
    let mut cores = Vec::new();
    for row in first(extent.south_m)..=first(extent.north_m) {
        for col in first(extent.west_m)..=first(extent.east_m) {
            let core = Core { west_m: col as f64 * side_m, south_m: row as f64 * side_m, side_m };
            if places.count(&core.area()) > 0 {
                cores.push(core);
            }
        }
    }
    cores
}

/// Side of the squares that a place is first cut into: the least step that is no shorter than it.
#[must_use]
pub fn side_around(places: &Places) -> f64 {
    let extent = places.extent();
    step_of(extent.map_or(0.0, |extent| (extent.east_m - extent.west_m).max(extent.north_m - extent.south_m)))
}

/// The least side of a tile that is no shorter than a length: the smallest tile's, doubled as often as it takes.
#[must_use]
pub fn step_of(length_m: f64) -> f64 {
    let mut side_m = SMALLEST_M;
    while side_m < length_m {
        side_m *= 2.0;
    }
    side_m
}

/// Squares that hold at most `n_buildings`, unless they are as small as tiles get.
#[must_use]
pub fn by_count(places: &Places, side_m: f64, n_buildings: usize) -> Vec<Core> {
    split_while(places, even(places, side_m), &|core| places.count(&core.area()) > n_buildings)
}

/// Buildings that squares of one side solve with their halos, for each building that there is.
#[must_use]
pub fn solved_per_building(places: &Places, cores: &[Core], halo_m: f64) -> f64 {
    let n_solved: usize = cores.iter().map(|core| places.count(&core.area().grown(halo_m))).sum();
    let n_own: usize = cores.iter().map(|core| places.count(&core.area())).sum();
    n_solved as f64 / n_own.max(1) as f64
}

/// Side of squares whose halos solve at most `most` times the buildings that there are: as small as that allows, so that there
/// are many to share out.
#[must_use]
pub fn side_bounded(places: &Places, halo_m: f64, most: f64) -> f64 {
    // Over an even town a square of side s solves (1 + 2 halo / s)² times its own.
    let mut side_m = step_of(2.0 * halo_m / (most.sqrt() - 1.0));
    loop {
        let cores = even(places, side_m);
        if cores.len() <= 1 || side_m > LARGEST_M || solved_per_building(places, &cores, halo_m) <= most {
            return side_m;
        }
        side_m *= 2.0;
    }
}

/// Quarters squares that are too large, and what comes of them; empty ones are left out. Ordered as [`even`].
#[must_use]
pub fn split_while(places: &Places, cores: Vec<Core>, is_too_large: &dyn Fn(&Core) -> bool) -> Vec<Core> {
    let mut waiting = cores;
    let mut settled = Vec::new();
    while let Some(core) = waiting.pop() {
        match core.quarters().filter(|_| is_too_large(&core)) {
            Some(quarters) => waiting.extend(quarters.into_iter().filter(|q| places.count(&q.area()) > 0)),
            None => settled.push(core),
        }
    }
    settled.sort_by(|a, b| a.south_m.total_cmp(&b.south_m).then(a.west_m.total_cmp(&b.west_m)));
    settled
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dense corner and a sparse rest.
    fn town() -> Vec<(f64, f64)> {
        let dense = (0..400).map(|i| (1000.0 + f64::from(i % 20) * 10.0, -300.0 + f64::from(i / 20) * 10.0));
        let sparse = (0..25).map(|i| (f64::from(i % 5) * 500.0, f64::from(i / 5) * 400.0));
        dense.chain(sparse).collect()
    }

    #[test]
    fn every_building_lies_in_one_core_and_no_core_holds_too_many() {
        let middles = town();
        let places = Places::new(&middles);
        for cores in [even(&places, 250.0), by_count(&places, 2000.0, 100)] {
            for &middle in &middles {
                assert_eq!(cores.iter().filter(|core| core.area().holds(middle)).count(), 1, "{middle:?}");
            }
            assert!(cores.iter().all(|core| places.count(&core.area()) > 0));
        }
        let cores = by_count(&places, side_around(&places), 100);
        assert!(cores.iter().all(|core| places.count(&core.area()) <= 100 || core.side_m <= SMALLEST_M));
        assert!(cores.iter().any(|core| core.side_m > 500.0), "the sparse part is not cut up");
    }

    #[test]
    fn halos_cost_no_more_than_is_allowed_where_tiles_can_be_large_enough() {
        // 10,000 houses, 20 m apart.
        let middles: Vec<(f64, f64)> =
            (0..10_000).map(|i| (f64::from(i % 100) * 20.0 + 565_000.0, f64::from(i / 100) * 20.0)).collect();
        let places = Places::new(&middles);
        for halo_m in [20.0, 100.0, 700.0, 2600.0] {
            let side_m = side_bounded(&places, halo_m, 1.5);
            let cores = even(&places, side_m);
            let cost = solved_per_building(&places, &cores, halo_m);
            assert!(cost <= 1.5, "{halo_m} m: {cost} in {} tiles of {side_m} m", cores.len());
            assert!(halo_m > 20.0 || cores.len() > 10, "small halos leave many tiles: {}", cores.len());
        }
    }

    #[test]
    fn a_tile_keeps_its_name_when_the_area_grows() {
        let few = even(&Places::new(&[(1010.0, 20.0)]), 500.0);
        let many = even(&Places::new(&town()), 500.0);
        assert_eq!(few[0].id(), "e1000_n0_s500");
        assert!(many.contains(&few[0]));
    }
}
