//! The scene: ground and buildings that rays meet.

use glam::DVec3;

use super::frame::{Frame, origin};
use super::ground::{correct_ground, corrected_terrain_around, extent, on_known_ground};
use super::input::{check_views, height_bounds};
use super::parts::split_footprints;
use super::settings::{GroundSettings, SceneSettings};
use super::{FootprintStage, HeightStage, PhotoGround, PipelineError, photo_ground};
use sizeup_geo::terrain::{MapBox, Terrain};
use sizeup_heights::estimate::move_footprints;
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::scene::Scene;
use sizeup_survey::Survey;

/// Everything that rays meet.
pub(super) struct SceneStage {
    /// The buildings whose ground is known.
    pub scene: Scene,
    /// Their positions in the layer.
    pub solved: Vec<usize>,
    /// Ground around the buildings.
    pub terrain: Terrain,
    /// Distance between the places where the photos are searched for ground, metres.
    pub ground_spacing_m: f64,
}

impl SceneStage {
    pub fn new(
        settings: &SceneSettings<'_>,
        survey: &Survey,
        footprints: &FootprintStage,
    ) -> Result<Self, PipelineError> {
        let bounds = height_bounds(settings.heights, check_views(settings, survey, footprints)?)?;
        let area = extent(footprints.layer.footprints.iter().map(|f| &f.polygon));
        let (origin, ground_spacing_m) =
            area.map_or((LocalOrigin(DVec3::ZERO), 0.0), |area| (origin(survey, area), photo_ground::spacing_m(area)));
        Self::in_frame(&settings.ground, &Frame { origin, bounds, ground_spacing_m }, footprints)
    }

    /// The same over the terrain as corrected by the photos, which are read for that.
    pub fn on_measured_ground(
        settings: &SceneSettings<'_>,
        survey: &Survey,
        footprints: &mut FootprintStage,
    ) -> Result<Self, PipelineError> {
        let given = Self::new(settings, survey, footprints)?;
        let photo_ground = given.ground_in_photos(&settings.ground, survey, footprints, None);
        correct_ground(&settings.ground, footprints, photo_ground)?;
        Self::new(settings, survey, footprints)
    }

    /// Searches the photos for open ground; of a part of a city around its core.
    pub fn ground_in_photos(
        &self,
        settings: &GroundSettings<'_>,
        survey: &Survey,
        footprints: &FootprintStage,
        core: Option<MapBox>,
    ) -> PhotoGround {
        let around = (&self.terrain, self.ground_spacing_m);
        photo_ground::look(settings, survey, &footprints.layer.footprints, around, core)
    }

    /// The same in a frame that is given.
    pub fn in_frame(
        settings: &GroundSettings<'_>,
        frame: &Frame,
        footprints: &FootprintStage,
    ) -> Result<Self, PipelineError> {
        let terrain = corrected_terrain_around(settings, frame, footprints)?;
        Ok(Self::over(terrain, frame, footprints))
    }

    fn over(terrain: Terrain, frame: &Frame, footprints: &FootprintStage) -> Self {
        let solved: Vec<usize> = (0..footprints.ground.len()).filter(|&i| footprints.ground[i].is_some()).collect();
        let margin_m = frame.bounds.ground_margin_m();
        let scene = Scene::at(frame.origin, &on_known_ground(footprints), &terrain, frame.bounds, margin_m);
        Self { scene, solved, terrain, ground_spacing_m: frame.ground_spacing_m }
    }

    /// The scene of heights that were found, on the ground that they were found over.
    pub fn of_heights(
        settings: &SceneSettings<'_>,
        survey: &Survey,
        footprints: &mut FootprintStage,
        mut heights: HeightStage,
    ) -> Result<(HeightStage, Self), PipelineError> {
        correct_ground(&settings.ground, footprints, heights.ground.clone())?;
        let mut stage = Self::new(settings, survey, footprints)?;
        stage.split(footprints, &mut heights);
        Ok((heights, stage))
    }

    /// Splits the footprints into the parts that heights were found for, and moves those that the photos show elsewhere.
    pub fn split(&mut self, footprints: &mut FootprintStage, heights: &mut HeightStage) {
        heights.solved = split_footprints(footprints, heights);
        if !heights.splits.is_empty() {
            *self = Self::over(self.terrain.clone(), &self.frame(), footprints);
        }
        move_footprints(&mut self.scene, &heights.solution);
    }

    /// Frame of the scene.
    pub fn frame(&self) -> Frame {
        Frame { origin: self.scene.origin, bounds: self.scene.bounds, ground_spacing_m: self.ground_spacing_m }
    }
}

/// Corrects the ground levels of footprints to those that a run found heights over. Returns its terrain.
///
/// # Errors
/// [`PipelineError`]: the terrain cannot be read.
pub fn terrain_of_heights(
    settings: &SceneSettings<'_>,
    survey: &Survey,
    footprints: &mut FootprintStage,
    heights: &HeightStage,
) -> Result<Terrain, PipelineError> {
    correct_ground(&settings.ground, footprints, heights.ground.clone())?;
    Ok(SceneStage::new(settings, survey, footprints)?.terrain)
}
