//! The true bodies of a simulated scene, and how near a method's come.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::BenchmarkError;
use sizeup_truth::evaluate::solid::{Facet, Solid};
use sizeup_truth::evaluate::{SurfaceEvaluation, TargetSurface, VolumeEvaluation, evaluate_surface, evaluate_volume};
use sizeup_truth::simulate::{RoofOrWall, SimulateConfig, SimulatedBuilding, world};

/// Simulated walls go this far below the lowest ground, metres; bodies end at the ground.
const FOUNDATION_M: f64 = 1.0;

/// Surfaces and volumes against the true bodies, roofs and all.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BodyScores {
    /// Distances of walls and roofs; `None` where they were not measured.
    pub surface: Option<SurfaceEvaluation>,
    /// Volumes; `None` where the method's meshes are not closed.
    pub volume: Option<VolumeEvaluation>,
}

/// The true bodies of a scene.
pub(super) fn true_bodies(scene: &str, config: &SimulateConfig) -> Result<Vec<Solid>, BenchmarkError> {
    let world = world(config).map_err(|source| BenchmarkError::Simulate { scene: scene.to_owned(), source })?;
    Ok(world.buildings.iter().map(body).collect())
}

/// Roofs, walls down to the lowest ground, and a bottom below the roofs, which tile the footprint.
fn body(building: &SimulatedBuilding) -> Solid {
    let corners = || building.triangles.iter().flat_map(|t| t.corners);
    let base_m = corners().map(|p| p.z).fold(f64::INFINITY, f64::min) + FOUNDATION_M;
    let cut = |corners: [DVec3; 3]| corners.map(|p| p.truncate().extend(p.z.max(base_m)));
    let mut facets: Vec<Facet> =
        building.triangles.iter().map(|t| Facet { corners: cut(t.corners), is_bottom: false }).collect();
    let roofs = building.triangles.iter().filter(|t| t.part == RoofOrWall::Roof && t.plan_area_m2() > 0.0);
    facets.extend(roofs.map(|t| {
        let [a, b, c] = t.corners.map(|p| p.truncate().extend(base_m));
        Facet { corners: [a, c, b], is_bottom: true }
    }));
    Solid { id: building.id.0.clone(), facets, prisms: Vec::new() }
}

/// Scores of a method's bodies.
pub(super) fn score(bodies: &[Solid], truth: &[Solid], seed: u64) -> BodyScores {
    let facets = |solids: &[Solid]| solids.iter().flat_map(|s| s.facets.iter().copied()).collect::<Vec<Facet>>();
    BodyScores {
        surface: evaluate_surface(&facets(bodies), &TargetSurface::Facets(&facets(truth)), seed),
        volume: evaluate_volume(bodies, truth, &[]).ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sizeup_truth::simulate::TownKind;

    #[test]
    fn true_bodies_are_closed_and_equal_to_themselves() {
        for kind in [TownKind::Village, TownKind::District, TownKind::Downtown, TownKind::Industry] {
            let mut config = SimulateConfig::default();
            (config.town.kind, config.town.n_buildings) = (kind, 20);
            let bodies = true_bodies("test", &config).unwrap();
            let scores = score(&bodies, &bodies, 1);
            let volume = scores.volume.unwrap_or_else(|| panic!("{kind:?}: open meshes"));
            assert!(volume.voxel_iou.values().all(|iou| *iou == 1.0) && volume.column_iou == 1.0);
            assert!(scores.surface.unwrap().error_95_m < 1e-6);
            // Volume is footprint area times mean height, plus what lies between mean and lowest ground.
            let world = world(&config).unwrap();
            let least: f64 = world.buildings.iter().map(|b| geo::Area::unsigned_area(&b.footprint) * b.height_m).sum();
            assert!(
                volume.volume_m3[0] > 0.97 * least && volume.volume_m3[0] < 1.3 * least,
                "{kind:?} {least} {volume:?}"
            );
        }
    }
}
