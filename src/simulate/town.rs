//! A procedural town: streets, blocks, buildings on hilly ground.

use glam::DVec2;

use crate::ids::BuildingId;
use crate::seed;
use crate::terrain::Terrain;

use super::SimulateError;
use super::blocks::{self, Lot};
use super::building::{Building, Placement};
use super::config::SimulateConfig;
use super::relief::{self, Extent};
use super::streets::StreetPlan;

/// Buildings on the ground, and the streets between them.
#[derive(Debug, Clone)]
pub struct World {
    /// Every building, in the order of its id.
    pub buildings: Vec<Building>,
    /// The ground, wider than the buildings.
    pub terrain: Terrain,
    /// The streets of a procedural town.
    pub(super) streets: Option<StreetPlan>,
    /// Around all buildings.
    pub extent: Extent,
}

/// Builds the town that `config.town` and `config.terrain` describe.
///
/// # Errors
/// [`SimulateError`] for a town without buildings or a terrain without cells.
pub(super) fn build(config: &SimulateConfig) -> Result<World, SimulateError> {
    let placement = Placement { origin: DVec2::from(config.centre_m), angle_rad: config.town.heading_deg.to_radians() };
    let (along, across) = blocks::rhythms(config.town.kind);
    // Every block holds at least one building, so these are enough.
    let n_blocks = (config.town.n_buildings as f64).sqrt().ceil() as usize + 2;
    let mut rng = seed::stream(config.seed, "streets", &[]);
    let streets = StreetPlan::new(placement, n_blocks, along, across, &mut rng);
    let lots = lots(config, &streets);
    let corners = lots.iter().flat_map(|(form, at, _)| form.outline[0].iter().map(|&p| at.point(p)));
    let extent = Extent::of(corners).ok_or(SimulateError::NoBuildings { wanted: config.town.n_buildings })?;
    let terrain = relief::hills(&config.terrain, &extent.grown(config.terrain.margin_m), config.seed)?;
    let digits = lots.len().to_string().len().max(3);
    let buildings = lots
        .iter()
        .enumerate()
        .map(|(i, (form, at, kind))| {
            Building::raise(form, at, &terrain, *kind, BuildingId(format!("b{:0digits$}", i + 1)))
        })
        .collect();
    Ok(World { buildings, terrain, streets: Some(streets), extent })
}

/// Lots in the map frame, from the middle outwards, exactly as many as wanted.
fn lots(config: &SimulateConfig, streets: &StreetPlan) -> Vec<Lot> {
    let mut lots = Vec::new();
    for (col, row) in streets.blocks_from_the_middle() {
        let ((u0, u1), (v0, v1)) = (streets.columns[col], streets.rows[row]);
        let mut rng = seed::stream(config.seed, "block", &[col as u64, row as u64]);
        let block = streets.placement.then(DVec2::new(u0, v0), 0.0);
        for (form, at, kind) in blocks::fill(config.town.kind, DVec2::new(u1 - u0, v1 - v0), &mut rng) {
            if lots.len() == config.town.n_buildings {
                return lots;
            }
            lots.push((form, block.then(at.origin, at.angle_rad), kind));
        }
    }
    lots
}
