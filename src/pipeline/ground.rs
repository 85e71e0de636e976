//! Terrain under footprints, and around them as far as rays meet it.

use geo_types::Polygon;

use super::settings::GroundSettings;
use super::{FootprintStage, Frame, PipelineError};
use sizeup_geo::terrain::{self, GroundLevel, LoadedTerrain, MapBox, Terrain};

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
    Ok(area.and_then(|area| footprints.told.corrected(settings.is_model(), &terrain, area)).unwrap_or(terrain))
}
