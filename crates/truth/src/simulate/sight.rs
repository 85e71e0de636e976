//! What photos of a known world show, pixel by pixel, without taking them: labels for networks that learn from it.

use geo_types::Polygon;
use glam::DVec2;

use sizeup_geo::terrain::Terrain;
use sizeup_heights::ids::BuildingId;
use sizeup_survey::View;

use super::SimulateError;
use super::building::{BuildingKind, Placement, SimulatedBuilding};
use super::clutter::{self, Amounts};
use super::config::SimulateConfig;
use super::form;
use super::relief::MapRect;
use super::scene::TracedScene;
use super::town::SimulatedTown;
use super::trace::{self, TrueDepth};

impl SimulatedTown {
    /// Buildings as prisms over footprints that are known from elsewhere: id, footprint, metres above the ground.
    ///
    /// # Errors
    /// [`SimulateError::NoBuildings`] without any footprint that has corners.
    pub fn of_prisms(
        prisms: &[(BuildingId, Polygon<f64>, f64)],
        terrain: Terrain,
        crs: &str,
    ) -> Result<Self, SimulateError> {
        let open = |ring: &geo_types::LineString<f64>| -> Vec<DVec2> {
            ring.coords().skip(1).map(|c| DVec2::new(c.x, c.y)).collect()
        };
        let corners = || prisms.iter().flat_map(|(_, footprint, _)| open(footprint.exterior()));
        let extent = MapRect::of(corners()).ok_or(SimulateError::NoBuildings { wanted: prisms.len() })?;
        // Single precision is exact enough near the origin of a form's plane only.
        let at = Placement { origin: extent.centre(), angle_rad: 0.0 };
        let raise = |(id, footprint, height_m): &(BuildingId, Polygon<f64>, f64)| {
            let rings = std::iter::once(footprint.exterior()).chain(footprint.interiors());
            let rings = rings.map(|ring| open(ring).into_iter().map(|p| p - at.origin).collect()).collect();
            SimulatedBuilding::raise(&form::flat(rings, *height_m), &at, &terrain, BuildingKind::Real, id.clone())
        };
        let buildings = prisms.iter().map(raise).collect();
        Ok(Self { buildings, terrain, streets: None, extent, crs: crs.to_owned() })
    }
}

/// A world ready to be looked at.
#[derive(Debug)]
pub struct VisibleWorld {
    scene: TracedScene,
}

impl VisibleWorld {
    /// The buildings and the ground, with the trees and cars that the photos of the same configuration show.
    #[must_use]
    pub fn of_simulation(config: &SimulateConfig, world: &SimulatedTown) -> Self {
        Self { scene: TracedScene::new(world, &clutter::scatter(world, Amounts::of(config, world), config.seed)) }
    }

    /// The buildings and the ground alone.
    #[must_use]
    pub fn of_buildings(world: &SimulatedTown) -> Self {
        Self { scene: TracedScene::new(world, &[]) }
    }

    /// Labels of each pixel of a view, at the photo's size.
    #[must_use]
    pub fn see(&self, view: &View) -> TrueDepth {
        trace::true_depth(&self.scene, view, &view.camera)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::scene::SeenObject;
    use super::super::{ground_contact, pose};
    use super::*;
    use geo_types::polygon;
    use glam::DVec3;
    use sizeup_heights::camera::Camera;
    use sizeup_heights::ids::BuildingIdx;

    #[test]
    fn a_prism_of_a_cadastre_stands_on_its_footprint_and_leans_away_from_the_nadir() {
        let footprint = polygon![(x: 565_010.0, y: 0.0), (x: 565_020.0, y: 0.0), (x: 565_020.0, y: 10.0), (x: 565_010.0, y: 10.0), (x: 565_010.0, y: 0.0)];
        let world =
            SimulatedTown::of_prisms(&[("a".into(), footprint, 20.0)], Terrain::Constant(5.0), "EPSG:25832").unwrap();
        assert!((world.buildings[0].height_m - 20.0).abs() < 1e-6);
        let camera = Arc::new(Camera::pinhole(200, 160, 200.0));
        let camera_from_map = pose(DVec3::new(565_000.0, 5.0, 105.0), 0.0, 0.0);
        let view = View { id: "a.jpg".into(), camera, camera_from_map, image: None };
        let seen = VisibleWorld::of_buildings(&world).see(&view).seen;
        let ground = ground_contact(&view, &world.buildings, &world.terrain);
        // A pixel is half a metre on the ground and 0.4 m on the roof: 20 to 40 pixels right of the nadir, 25 to 50.
        assert!(ground[(121, 80)] == 1 && ground[(139, 80)] == 1 && ground[(141, 80)] == 0 && ground[(119, 80)] == 0);
        let building = SeenObject::Building(BuildingIdx(0));
        assert!(seen[(121, 80)] == building && seen[(149, 80)] == building && seen[(151, 80)] == SeenObject::Ground);
    }
}
