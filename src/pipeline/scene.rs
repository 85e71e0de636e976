//! The scene: ground and buildings that rays meet.
//!
//! Footprints are put onto the ground, the terrain reaches as far around them as rays do, and footprints are split into the parts
//! that the method returns. The parts of a city share one [`Frame`], so that a building comes out the same in all of them.

use geo_types::Polygon;
use glam::DVec3;

use super::checks::{check_views, clearance_m, extent, height_bounds};
use super::settings::{GroundSettings, SceneSettings};
use super::{FootprintStage, HeightStage, PhotoGround, PipelineError, photo_ground};
use sizeup_footprints::{Footprint, FootprintLayer};
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::{self, GroundLevel, LoadedTerrain, MapBox, Terrain, ground_under};
use sizeup_heights::estimate::{Building, LevelEvidence, LocalFrame, Part, Split, move_footprints};
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::ids::BuildingId;
use sizeup_heights::optimise::LevelGain;
use sizeup_heights::scene::{HeightBounds, HeightsConfig, Scene};
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

/// The local frame and the heights that are looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Origin of the local frame in the map.
    pub origin: LocalOrigin,
    /// The range of heights of every building.
    pub bounds: HeightBounds,
    /// Distance between the places where the photos are searched for ground, metres.
    pub ground_spacing_m: f64,
}

impl Frame {
    /// Frame of a whole city: its survey, the box around all its footprints, and its highest ground.
    ///
    /// # Errors
    /// [`PipelineError`] where the views do not look down at such ground, or the settings leave no range of heights.
    pub fn of_city(
        settings: &HeightsConfig,
        survey: &Survey,
        area: MapBox,
        highest_ground_m: f64,
    ) -> Result<Self, PipelineError> {
        let lowest_flight_m = clearance_m(survey, highest_ground_m)?;
        let bounds = height_bounds(settings, lowest_flight_m)?;
        Ok(Self { origin: origin(survey, area), bounds, ground_spacing_m: photo_ground::spacing_m(area) })
    }
}

/// Origin in the middle of the footprints, at the height of the lowest view: the ground need not be known.
pub(super) fn origin(survey: &Survey, area: MapBox) -> LocalOrigin {
    let corners = [area.west_m, area.south_m, area.east_m, area.north_m];
    LocalFrame::origin(survey.views.iter().map(|view| view.camera_from_map.centre()), corners)
}

/// The corrected terrain slopes under a footprint from so many standard deviations of its level on: within two it may be scatter. Of the
/// ten buildings of a real flight over level ground, the lowest level under each lay 0.2 to 0.3 m below the level in the middle.
const SLOPE_SIGMAS: f64 = 2.0;

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

/// The buildings whose ground is known, in the order of the layer.
pub(super) fn buildings_of(footprints: &FootprintStage) -> Vec<Building> {
    let on_ground = footprints.layer.footprints.iter().zip(&footprints.ground);
    let building = |(footprint, ground): (&Footprint, &Option<_>)| {
        Some(Building { footprint: footprint.polygon.clone(), ground: (*ground)? })
    };
    on_ground.filter_map(building).collect()
}

/// Replaces footprints by the parts that the heights are of; each gets the name of the whole and its number. Returns the positions of
/// the parts in the layer.
pub(super) fn split_footprints(footprints: &mut FootprintStage, heights: &HeightStage) -> Vec<usize> {
    let whole = std::mem::take(&mut footprints.layer.footprints);
    let grounds = std::mem::take(&mut footprints.ground);
    let known: Vec<usize> = (0..whole.len()).filter(|&at| grounds[at].is_some()).collect();
    let id_of = |building: usize, path: &[usize]| name_of(&whole[known[building]].id, path);
    for Split { building, path, n_parts, evidence } in &heights.splits {
        let id = id_of(*building, path);
        footprints.issues.push(split_note(&id, *n_parts, evidence));
        if let LevelEvidence::Priors(gain) = evidence {
            footprints.levels.push((id, gain.clone()));
        }
    }
    let mut joined: Vec<BuildingId> = heights.joined.iter().map(|(building, path)| id_of(*building, path)).collect();
    joined.sort();
    footprints.issues.extend(joined.iter().map(joined_note));
    let mut solved = Vec::with_capacity(heights.parts.len());
    let mut parts = heights.parts.iter().peekable();
    let mut n_buildings = 0;
    for (footprint, ground) in whole.into_iter().zip(grounds) {
        let building = n_buildings;
        n_buildings += usize::from(ground.is_some());
        if ground.is_some() {
            while let Some(part) = parts.next_if(|part| part.building == building) {
                solved.push(footprints.layer.footprints.len());
                footprints.layer.footprints.push(part_of(&footprint, part));
                footprints.ground.push(ground);
            }
        } else {
            footprints.layer.footprints.push(footprint);
            footprints.ground.push(ground);
        }
    }
    solved
}

/// A footprint, or a part of it.
fn part_of(whole: &Footprint, part: &Part) -> Footprint {
    if part.path.is_empty() {
        return whole.clone();
    }
    Footprint {
        id: name_of(&whole.id, &part.path),
        part_of: Some(whole.part_of.clone().unwrap_or_else(|| whole.id.clone())),
        polygon: part.footprint.clone(),
        attributes: whole.attributes.clone(),
    }
}

/// `ID`, `ID#2`, `ID#2#1`, …
fn name_of(whole: &BuildingId, path: &[usize]) -> BuildingId {
    BuildingId(path.iter().fold(whole.0.clone(), |id, number| format!("{id}#{number}")))
}

fn split_note(id: &BuildingId, n_parts: usize, evidence: &LevelEvidence) -> Issue {
    let (message, hint) = match evidence {
        LevelEvidence::Priors(gain) => {
            (split_by_priors(n_parts, gain), "optimise.search.split_levels = false keeps footprints whole")
        }
        LevelEvidence::Photos(heights_m) => {
            (split_by_photos(heights_m), "look at the parts in the report; correct the footprint if the cut is wrong")
        }
    };
    Issue::new(Severity::Note, "footprint_split", Subject::Building(id.to_string()), message).hint(hint)
}

fn split_by_priors(n_parts: usize, gain: &LevelGain) -> String {
    let one = gain.one.iter().map(|(_, score)| *score).fold(f64::NEG_INFINITY, f64::max);
    let [inner_m, outer_m] = gain.heights_m;
    let (low_m, high_m) = (inner_m.min(outer_m), inner_m.max(outer_m));
    format!(
        "its footprint holds roofs at two levels, about {low_m:.0} and {high_m:.0} m, and was split into {n_parts} parts: \
         over {} photos two levels score {:.2}, one level {one:.2} at best",
        gain.n_views, gain.two
    )
}

fn split_by_photos(heights_m: &[f64]) -> String {
    let levels: Vec<String> = heights_m.iter().map(|height_m| format!("{height_m:.1}")).collect();
    format!(
        "the photos show roofs at several levels in its footprint ({} m): it was split into parts",
        levels.join(", ")
    )
}

fn joined_note(id: &BuildingId) -> Issue {
    let message =
        "its roof looked like two levels, but the heights of its two parts did not bear them out: it was left whole";
    Issue::new(Severity::Note, "levels_joined_again", Subject::Building(id.to_string()), message)
}
