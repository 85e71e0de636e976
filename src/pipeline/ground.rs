//! Ground under footprints, and terrain around them as far as rays meet it.

use geo_types::Polygon;

use super::settings::GroundSettings;
use super::{FootprintStage, Frame, PhotoGround, PipelineError};
use sizeup_footprints::FootprintLayer;
use sizeup_geo::terrain::{self, GroundLevel, LoadedTerrain, MapBox, Terrain, ground_under};

/// The corrected terrain slopes under a footprint from so many standard deviations of its level on: within two it may be scatter. Of the
/// ten buildings of a real flight over level ground, the lowest level under each lay 0.2 to 0.3 m below the level in the middle.
const SLOPE_SIGMAS: f64 = 2.0;

/// Box around footprints, map frame, metres.
pub(super) fn extent<'a>(polygons: impl Iterator<Item = &'a Polygon<f64>>) -> Option<MapBox> {
    let corners = polygons.filter_map(geo::BoundingRect::bounding_rect).flat_map(|rect| [rect.min(), rect.max()]);
    MapBox::around(corners.map(|c| (c.x, c.y)))
}

/// Loads the terrain around footprints.
pub(super) fn load_terrain<'a>(
    settings: &GroundSettings<'_>,
    polygons: impl Iterator<Item = &'a Polygon<f64>>,
    margin_m: f64,
) -> Result<LoadedTerrain, PipelineError> {
    let Some(area) = extent(polygons) else {
        return Err(PipelineError::Mismatch {
            message: "none of the input's buildings has a usable footprint".to_owned(),
            hint: "issues of the footprints stage tell why, building by building",
        });
    };
    Ok(terrain::load_with_issues(&settings.terrain, settings.crs, area.grown(margin_m))?)
}

/// Footprints whose ground is known, with its level.
pub(super) fn on_known_ground(footprints: &FootprintStage) -> Vec<(&Polygon<f64>, GroundLevel)> {
    let on_ground = footprints.layer.footprints.iter().zip(&footprints.ground);
    on_ground.filter_map(|(footprint, ground)| Some((&footprint.polygon, (*ground)?))).collect()
}

/// The ground that rays meet around the buildings on known ground; there has to be one.
pub(super) fn terrain_around(
    settings: &GroundSettings<'_>,
    frame: &Frame,
    footprints: &FootprintStage,
) -> Result<Terrain, PipelineError> {
    let on_ground = on_known_ground(footprints);
    // Its issues were reported when footprints were put onto it.
    let loaded = load_terrain(settings, on_ground.iter().map(|(polygon, _)| *polygon), frame.bounds.ground_margin_m())?;
    Ok(loaded.terrain)
}

/// The same terrain, corrected by the photos.
pub(super) fn corrected_terrain_around(
    settings: &GroundSettings<'_>,
    frame: &Frame,
    footprints: &FootprintStage,
) -> Result<Terrain, PipelineError> {
    let terrain = terrain_around(settings, frame, footprints)?;
    let on_ground = on_known_ground(footprints);
    let area = extent(on_ground.iter().map(|(polygon, _)| *polygon));
    let area = area.map(|area| area.grown(frame.bounds.ground_margin_m()));
    Ok(area.and_then(|area| footprints.photo_ground.corrected(settings.is_model(), &terrain, area)).unwrap_or(terrain))
}

/// Puts footprints onto the ground.
pub(super) fn on_ground(
    settings: &GroundSettings<'_>,
    layer: FootprintLayer,
    LoadedTerrain { terrain, issues: of_terrain }: &LoadedTerrain,
) -> FootprintStage {
    let (ground, issues): (Vec<_>, Vec<_>) =
        layer.footprints.iter().map(|f| ground_under(terrain, &f.id, &f.polygon, settings.level)).unzip();
    let issues = of_terrain.iter().cloned().chain(issues.into_iter().flatten()).collect();
    FootprintStage::of_layer(layer, ground, issues)
}

/// Puts footprints onto the terrain as corrected by the photos, where they correct it.
pub(super) fn correct_ground(
    settings: &GroundSettings<'_>,
    footprints: &mut FootprintStage,
    photo_ground: PhotoGround,
) -> Result<(), PipelineError> {
    footprints.photo_ground = photo_ground;
    let polygons = || footprints.layer.footprints.iter().map(|f| &f.polygon);
    let (false, Some(area)) = (footprints.photo_ground.off_m.is_empty(), extent(polygons())) else { return Ok(()) };
    let terrain = load_terrain(settings, polygons(), 0.0)?.terrain;
    let Some(corrected) = footprints.photo_ground.corrected(settings.is_model(), &terrain, area) else { return Ok(()) };
    let measured = footprints.photo_ground.measured(settings.is_model(), &footprints.layer.footprints);
    let of_each = footprints.layer.footprints.iter().zip(&mut footprints.ground).zip(measured);
    for ((footprint, ground), middle) in of_each.filter(|((_, ground), _)| ground.is_some()) {
        // Gaps were reported when the footprint was put onto the terrain.
        let on = |terrain| ground_under(terrain, &footprint.id, &footprint.polygon, settings.level).0;
        let raised = on(&terrain).zip(middle).map(|(given, middle)| (given.raised(middle.off_m), middle.sigma_m));
        let sloped = on(&corrected).or(*ground);
        // The lowest place of a surface that only scatters lies below the ground.
        let is_slope = |(raised, sigma_m): &(GroundLevel, f64)| {
            sloped.is_some_and(|sloped| (sloped.reference_m - raised.reference_m).abs() > SLOPE_SIGMAS * sigma_m)
        };
        *ground = raised.filter(|raised| !is_slope(raised)).map_or(sloped, |(raised, _)| Some(raised));
    }
    Ok(())
}
