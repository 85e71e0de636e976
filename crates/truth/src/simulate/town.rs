//! A procedural town: streets, blocks, buildings on hilly ground.

use glam::DVec2;

use sizeup_geo::terrain::Terrain;
use sizeup_heights::ids::BuildingId;
use sizeup_heights::seed;

use super::SimulateError;
use super::blocks::{self, Lot};
use super::building::{Placement, SimulatedBuilding};
use super::config::SimulateConfig;
use super::relief::{self, MapRect};
use super::streets::StreetPlan;

/// Buildings on the ground, and the streets between them.
#[derive(Debug, Clone)]
pub struct SimulatedTown {
    /// Every building, in the order of its id.
    pub buildings: Vec<SimulatedBuilding>,
    /// The ground, wider than the buildings.
    pub terrain: Terrain,
    /// The streets of a procedural town.
    pub(super) streets: Option<StreetPlan>,
    /// Rectangle around all buildings.
    pub extent: MapRect,
    /// Definition of the map frame's CRS.
    pub crs: String,
}

/// Builds the town that `config.town` and `config.terrain` describe.
///
/// # Errors
/// [`SimulateError`] for a town without buildings or a terrain without cells.
pub(super) fn build(config: &SimulateConfig) -> Result<SimulatedTown, SimulateError> {
    let placement = Placement { origin: DVec2::from(config.centre_m), angle_rad: config.town.heading_deg.to_radians() };
    let (along, across) = blocks::rhythms(config.town.kind);
    // Every block holds at least one building, so these are enough.
    let n_blocks = (config.town.n_buildings as f64).sqrt().ceil() as usize + 2;
    let mut rng = seed::stream(config.seed, "streets", &[]);
    let mut streets = StreetPlan::new(placement, n_blocks, along, across, &mut rng);
    let mut lots = lots(config, &mut streets);
    let corners = lots.iter().flat_map(|(form, at, _)| form.footprint[0].iter().map(|&p| at.point(p)));
    let extent = MapRect::of(corners).ok_or(SimulateError::NoBuildings { wanted: config.town.n_buildings })?;
    let terrain = relief::hills(&config.terrain, &extent.grown(config.terrain.margin_m), config.seed)?;
    let digits = lots.len().to_string().len().max(3);
    let raised = |lots: &[Lot]| -> Vec<SimulatedBuilding> {
        let id = |i: usize| BuildingId(format!("b{:0digits$}", i + 1));
        let raise = |(i, (form, at, kind)): (usize, &Lot)| SimulatedBuilding::raise(form, at, &terrain, *kind, id(i));
        lots.iter().enumerate().map(raise).collect()
    };
    let mut buildings = raised(&lots);
    if let Some(wanted_m) = config.town.mean_height_m {
        let sum = |height_m: fn(&SimulatedBuilding) -> f64| buildings.iter().map(height_m).sum::<f64>();
        let n = buildings.len() as f64;
        let by = (n * wanted_m - sum(|b| b.height_m)) / sum(|b| b.eave_m);
        lots.iter_mut().for_each(|(form, ..)| form.lift(by));
        buildings = raised(&lots);
    }
    Ok(SimulatedTown { buildings, terrain, streets: Some(streets), extent, crs: config.crs.clone() })
}

/// Lots in the map frame, from the middle outwards, exactly as many as wanted. The streets end with the last block in
/// use.
fn lots(config: &SimulateConfig, streets: &mut StreetPlan) -> Vec<Lot> {
    let mut lots = Vec::new();
    let mut used = Vec::new();
    for (col, row) in streets.blocks_from_the_middle() {
        let n_missing = config.town.n_buildings - lots.len();
        if n_missing == 0 {
            break;
        }
        let ((u0, u1), (v0, v1)) = (streets.columns[col], streets.rows[row]);
        let mut rng = seed::stream(config.seed, "block", &[col as u64, row as u64]);
        let block = streets.placement.then(DVec2::new(u0, v0), 0.0);
        let content = blocks::fill(config.town.kind, DVec2::new(u1 - u0, v1 - v0), &mut rng);
        lots.extend(
            content
                .into_iter()
                .take(n_missing)
                .map(|(form, at, kind)| (form, block.then(at.origin, at.angle_rad), kind)),
        );
        used.push((col, row));
    }
    streets.keep(&used);
    lots
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use geo::{Area, BooleanOps, Validation};

    use super::*;
    use crate::simulate::building::BuildingKind;
    use crate::simulate::config::TownKind;
    use crate::simulate::disturb::open_ring;
    use crate::simulate::form::RoofKind;

    fn town(kind: TownKind, n_buildings: usize) -> SimulatedTown {
        let mut config = SimulateConfig::default();
        (config.town.kind, config.town.n_buildings) = (kind, n_buildings);
        build(&config).unwrap()
    }

    const KINDS: [TownKind; 5] =
        [TownKind::Village, TownKind::Suburb, TownKind::District, TownKind::Downtown, TownKind::Industry];

    #[test]
    fn footprints_are_valid_and_do_not_overlap() {
        for kind in KINDS {
            let world = town(kind, 90);
            assert_eq!(world.buildings.len(), 90);
            for (i, a) in world.buildings.iter().enumerate() {
                assert!(a.footprint.is_valid(), "{kind:?} {}", a.id);
                for b in &world.buildings[..i] {
                    let common = a.footprint.intersection(&b.footprint).unsigned_area();
                    assert!(common < 1e-3, "{kind:?} {} {} share {common} m²", a.id, b.id);
                }
            }
        }
    }

    #[test]
    fn a_town_is_as_high_as_it_is_asked_to_be_with_its_roofs_as_steep() {
        let (low, high) = (town(TownKind::District, 40), {
            let mut config = SimulateConfig::default();
            (config.town.kind, config.town.n_buildings) = (TownKind::District, 40);
            config.town.mean_height_m = Some(50.0);
            build(&config).unwrap()
        });
        let mean_m = high.buildings.iter().map(|b| b.height_m).sum::<f64>() / 40.0;
        assert!((mean_m - 50.0).abs() < 1e-6, "{mean_m} m");
        for (low, high) in low.buildings.iter().zip(&high.buildings) {
            assert!((high.ridge_m - high.eave_m - low.ridge_m + low.eave_m).abs() < 1e-6, "{}", low.id);
        }
    }

    #[test]
    fn row_houses_share_walls_corner_by_corner() {
        let world = town(TownKind::Village, 90);
        let rows: Vec<&SimulatedBuilding> =
            world.buildings.iter().filter(|b| b.kind == BuildingKind::RowHouse).collect();
        let edges = |b: &SimulatedBuilding| -> Vec<[[u64; 2]; 2]> {
            let ring = open_ring(b.footprint.exterior());
            let bits = |p: DVec2| [p.x.to_bits(), p.y.to_bits()];
            (0..ring.len()).map(|i| [bits(ring[i]), bits(ring[(i + 1) % ring.len()])]).collect()
        };
        let all: BTreeSet<_> = rows.iter().flat_map(|b| edges(b)).collect();
        let sharing = rows.iter().filter(|b| edges(b).iter().any(|[a, c]| all.contains(&[*c, *a]))).count();
        assert!(rows.len() > 15 && sharing == rows.len(), "{sharing} of {}", rows.len());
    }

    /// From 8 m to 12 m, and from 10 m to 16 m for two together, there are lone houses and parts of rows.
    #[test]
    fn no_width_tells_lone_houses_of_a_suburb_from_rows() {
        let world = town(TownKind::Suburb, 250);
        let widths = |kind: BuildingKind| -> Vec<f64> {
            let of_kind = world.buildings.iter().filter(|b| b.kind == kind);
            let longest = |b: &SimulatedBuilding| {
                let ring = open_ring(b.footprint.exterior());
                (0..ring.len()).map(|i| ring[i].distance(ring[(i + 1) % ring.len()])).fold(0.0, f64::max)
            };
            of_kind.map(longest).collect()
        };
        let (lone, joined) = (widths(BuildingKind::House), widths(BuildingKind::RowHouse));
        assert!(lone.len() > 60 && joined.len() > 100 && lone.len() + joined.len() == 250, "{} lone", lone.len());
        let n_within = |widths: &[f64], low: f64, high: f64| widths.iter().filter(|w| (low..high).contains(*w)).count();
        for (low, high) in [(8.0, 10.0), (10.0, 12.0)] {
            assert!(n_within(&lone, low, high) > 8 && n_within(&joined, low, high) > 8, "{low} to {high} m");
        }
        assert!(n_within(&lone, 12.0, 16.1) > 20);
        let roofs: BTreeSet<RoofKind> = world.buildings.iter().map(|b| b.roof).collect();
        assert_eq!(roofs.len(), 4, "flat, gable, hip, stepped");
    }

    #[test]
    fn towns_have_their_forms_and_heights() {
        for (kind, low, high) in [
            (TownKind::Village, 3.0, 12.0),
            (TownKind::Suburb, 3.0, 12.5),
            (TownKind::District, 3.0, 45.0),
            (TownKind::Downtown, 3.0, 120.0),
            (TownKind::Industry, 5.0, 19.0),
        ] {
            let world = town(kind, 150);
            assert!(world.buildings.iter().all(|b| b.eave_m >= low && b.ridge_m <= high), "{kind:?}");
            assert!(world.buildings.iter().all(|b| b.eave_m <= b.height_m + 1e-9 && b.height_m <= b.ridge_m + 1e-9));
        }
        let roofs: BTreeSet<RoofKind> = KINDS.iter().flat_map(|&k| town(k, 90).buildings).map(|b| b.roof).collect();
        assert_eq!(roofs.len(), 4, "flat, gable, hip, stepped");
        let downtown = town(TownKind::Downtown, 53);
        assert!(downtown.buildings.iter().any(|b| b.height_m > 60.0), "a tower of its own");
    }
}
