//! A part of a city: the stages of a run for the footprints around one place and the views that look there.
//!
//! What a whole run settles from all of its input (poses in the project's CRS, the local frame, the range of heights) is
//! given; footprints, terrain and priors are read where the part needs them.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::path::{Path, PathBuf};

use geo::BoundingRect as _;
use serde::{Deserialize, Serialize};

use super::heights::HeightSearch;
use super::scene::{correct_ground, load_terrain, on_ground, terrain_around};

use super::output::records::{records, reviews_of, view_issues};
use super::priors::PriorStore;
use super::scene::SceneStage;
use super::settings::{FootprintSettings, GroundSettings, HeightSettings};
use super::stages;
use super::{
    FootprintStage, Frame, HeightStage, PaintedTile, PhotoGround, PipelineError, RunOptions, RunSettings, Stage, Tell,
};
use sizeup_footprints::{self, FootprintConfig, FootprintLayer, FootprintSource, LayerParts, RefusedFootprint};
use sizeup_geo::hashes::Content;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::{MapBox, Terrain};
use sizeup_heights::ids::{ViewId, with_wholes};
use sizeup_heights::optimise::solve;
use sizeup_results::output::reviews::Reviews;
use sizeup_results::output::{BuildingRecord, InputFile, Lineage, sha256_hex};
use sizeup_survey::{Survey, flight_day};

/// A part of a city, ready to be solved.
pub struct CityPart<'a> {
    settings: &'a RunSettings<'a>,
    frame: Frame,
    survey: Survey,
    footprints: FootprintStage,
    /// Absent where there is no building on known ground.
    scene: Option<SceneStage>,
    priors: PriorStore,
    /// Positions of its views in the whole survey.
    positions: HashMap<ViewId, usize>,
    /// Footprints of the layer by their ids, and by those of their duplicates.
    by_id: HashMap<String, usize>,
    /// Decisions of people about its buildings.
    reviews: Reviews,
}

/// Heights found for a part.
pub struct PartHeights {
    /// Every building, in the layer's order.
    pub records: Vec<BuildingRecord>,
    /// Issues of buildings and priors.
    pub issues: Vec<Issue>,
    /// Views whose prior was used.
    pub used_views: Vec<ViewId>,
    /// Terrain by the photos in the core and close to it.
    pub ground: PhotoGround,
    /// Textures of the buildings in the core, where they are asked for.
    pub painted: Option<PaintedTile>,
}

/// Path at which the footprints of a whole city are kept for its parts, if they were found in photos; in the folder of the results.
const FOUND_FOOTPRINTS: &str = "tiles/footprints.gpkg";

/// The layer that parts of a city read their footprints from: the configuration's, or the one that [`find_footprints`] leaves
/// behind.
#[must_use]
pub fn layer_of<'a>(settings: &FootprintSettings<'a>) -> Cow<'a, FootprintConfig> {
    match settings.source {
        FootprintSource::Layer(layer) => Cow::Borrowed(layer),
        _ => Cow::Owned(sizeup_footprints::plain_config(settings.folder.join(FOUND_FOOTPRINTS))),
    }
}

/// Finds the footprints of a whole city in its photos, once for all of its parts; returns what was refused, and issues, without
/// the footprints. `None` for footprints that are in a layer already.
///
/// # Errors
/// [`PipelineError`], as a run of the stage.
pub fn find_footprints(
    run: &RunSettings<'_>,
    command: &str,
    tell: Tell<'_>,
) -> Result<Option<FootprintLayer>, PipelineError> {
    let settings = &run.footprints;
    if matches!(settings.source, FootprintSource::Layer(_)) {
        return Ok(None);
    }
    let options = RunOptions { from: Stage::Footprints, until: Stage::Footprints, command: command.to_owned() };
    stages::run(run, &options, tell, &solve)?;
    let FootprintStage { mut layer, .. } = run.artefacts.read(Stage::Footprints, &run.survey()?)?;
    if settings.source.is_of_roofs() {
        let message = "footprints of roofs stay where the photos' contours fit best: only a run in one piece moves them with the heights";
        let subject = Subject::Input("footprints".to_owned());
        layer.issues.push(Issue::new(Severity::Warning, "roofs_not_moved", subject, message));
    }
    let path = settings.folder.join(FOUND_FOOTPRINTS);
    sizeup_footprints::write_plain(&path, &layer, settings.ground.crs)?;
    layer.footprints.clear();
    Ok(Some(layer))
}

/// The footprints whose middle lies in a box, with the ground under each. `renamed` is what a reading of the whole layer
/// found ([`LayerParts::visit`]).
///
/// # Errors
/// [`PipelineError`] where the layer or the terrain cannot be read.
pub fn footprints_around(
    settings: &FootprintSettings<'_>,
    area: MapBox,
    renamed: &BTreeMap<u64, String>,
) -> Result<FootprintStage, PipelineError> {
    let mut layer = LayerParts::open(&layer_of(settings), settings.ground.crs)?.around(area, renamed)?;
    if !matches!(settings.source, FootprintSource::Layer(_)) {
        sizeup_footprints::unpack(&mut layer.footprints);
    }
    if layer.footprints.is_empty() {
        let layer = FootprintLayer::default();
        return Ok(FootprintStage::of_layer(layer, Vec::new(), Vec::new()));
    }
    // A part is the same in whatever order the layer lists its buildings; their attributes are listed as a reader meets them.
    layer.footprints.sort_by(|a, b| a.id.cmp(&b.id));
    layer.footprints.iter_mut().for_each(|footprint| footprint.attributes.sort_keys());
    layer.issues.sort_by(|a, b| (&a.subject, &a.code, &a.message).cmp(&(&b.subject, &b.code, &b.message)));
    let terrain = load_terrain(&settings.ground, layer.footprints.iter().map(|f| &f.polygon), 0.0)?;
    Ok(on_ground(&settings.ground, layer, &terrain))
}

/// Hashes of what a part reads of the files that all parts share.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartHashes {
    /// Footprints, each with its ground.
    pub footprints: Content,
    /// The terrain around them, as it was read; `None` where no footprint has ground.
    pub terrain: Option<Content>,
    /// Decisions of people about them; `None` where nothing was decided.
    pub reviews: Option<Content>,
}

impl PartHashes {
    /// Hashes of a part that will be solved in a frame.
    ///
    /// # Errors
    /// [`PipelineError`] where the terrain cannot be read.
    pub fn of(
        settings: &GroundSettings<'_>,
        frame: &Frame,
        footprints: &FootprintStage,
        reviews: &Reviews,
    ) -> Result<Self, PipelineError> {
        let has_ground = footprints.ground.iter().any(Option::is_some);
        let terrain = has_ground.then(|| terrain_around(settings, frame, footprints)).transpose()?;
        Ok(Self::over(footprints, terrain.as_ref(), &about(footprints, reviews)))
    }

    fn over(footprints: &FootprintStage, terrain: Option<&Terrain>, reviews: &Reviews) -> Self {
        let of_text = |value: serde_json::Value| Content::of_bytes(value.to_string().as_bytes());
        Self {
            footprints: of_text(serde_json::json!(footprints)),
            terrain: terrain.map(content_of),
            reviews: (!reviews.is_empty()).then(|| of_text(serde_json::json!(reviews))),
        }
    }
}

/// Decisions about the footprints of a part.
fn about(footprints: &FootprintStage, reviews: &Reviews) -> Reviews {
    let layer = &footprints.layer;
    let ids = layer.footprints.iter().map(|f| &f.id).chain(layer.refused.iter().map(|refused| &refused.id));
    let ids: HashSet<&str> = ids.map(|id| id.0.as_str()).collect();
    reviews.about(|id| ids.contains(id))
}

fn content_of(terrain: &Terrain) -> Content {
    let bytes: Vec<u8> = match terrain {
        Terrain::Constant(z_m) => z_m.to_le_bytes().to_vec(),
        Terrain::Grid(dem) => {
            let place = [dem.corner_m().0, dem.corner_m().1, dem.cell_m().0, dem.cell_m().1];
            let heights = dem.heights_m().data().iter().flat_map(|z| z.to_le_bytes());
            place.into_iter().flat_map(f64::to_le_bytes).chain(heights).collect()
        }
    };
    Content::of_bytes(&bytes)
}

/// Buildings without a usable footprint, as they are written.
#[must_use]
pub fn refused_records(run: &RunSettings<'_>, refused: Vec<RefusedFootprint>) -> Vec<BuildingRecord> {
    let layer = FootprintLayer { refused, ..FootprintLayer::default() };
    let footprints = FootprintStage::of_layer(layer, Vec::new(), Vec::new());
    let heights = HeightStage::empty();
    // Without a ground none of them takes a height.
    let bounds = run.footprints.heights.bounds(0.0);
    records((&run.records, bounds), &Survey::default(), &footprints, &heights, &Reviews::default())
}

/// Priors of a part's views over a terrain.
fn priors_over(
    terrain: &Terrain,
    (settings, frame): (&HeightSettings<'_>, &Frame),
    survey: &Survey,
    positions: &HashMap<ViewId, usize>,
) -> Result<PriorStore, PipelineError> {
    let mut priors = settings.prior.open(&survey.views, terrain, frame.bounds.max_m)?;
    priors.set_positions(positions.clone());
    Ok(PriorStore::forgetful(settings, priors, survey))
}

impl<'a> CityPart<'a> {
    /// Brings footprints and views together; priors are not read yet. `positions` are those of the views in the whole
    /// survey.
    ///
    /// # Errors
    /// [`PipelineError`] where terrain or decisions cannot be read, or the priors' settings cannot work.
    pub fn new(
        settings: &'a RunSettings<'a>,
        frame: Frame,
        survey: Survey,
        positions: HashMap<ViewId, usize>,
        footprints: FootprintStage,
    ) -> Result<Self, PipelineError> {
        let has_ground = footprints.ground.iter().any(Option::is_some);
        let scene =
            has_ground.then(|| SceneStage::in_frame(&settings.footprints.ground, &frame, &footprints)).transpose()?;
        let terrain = scene.as_ref().map_or(&Terrain::Constant(0.0), |scene| &scene.terrain);
        let priors = priors_over(terrain, (&settings.heights, &frame), &survey, &positions)?;
        let ids = footprints.layer.footprints.iter().map(|f| f.id.0.clone());
        let mut by_id: HashMap<String, usize> = ids.zip(0..).collect();
        // A building that the layer has twice belongs where the one is that is measured.
        for refused in &footprints.layer.refused {
            let first = refused.duplicate_of.as_ref().and_then(|first| by_id.get(&first.0).copied());
            by_id.extend(first.map(|at| (refused.id.0.clone(), at)));
        }
        let reviews = about(&footprints, &reviews_of(settings.reviews)?);
        Ok(Self { settings, frame, survey, footprints, scene, priors, positions, by_id, reviews })
    }

    /// The frame it lies in.
    #[must_use]
    pub fn frame(&self) -> Frame {
        self.frame
    }

    /// Footprints on their ground.
    #[must_use]
    pub fn footprints(&self) -> &FootprintStage {
        &self.footprints
    }

    /// Views that the tile uses.
    #[must_use]
    pub fn survey(&self) -> &Survey {
        &self.survey
    }

    /// Hashes of what it has read of the files that all parts share.
    #[must_use]
    pub fn hashes(&self) -> PartHashes {
        PartHashes::over(&self.footprints, self.scene.as_ref().map(|scene| &scene.terrain), &self.reviews)
    }

    /// Files that the priors of some of its views are made from, each once, sorted.
    ///
    /// # Errors
    /// [`PipelineError`] where a file name has a placeholder that a view does not fill.
    pub fn prior_files(&self, is_wanted: impl Fn(&ViewId) -> bool) -> Result<BTreeSet<PathBuf>, PipelineError> {
        let views = self.survey.views.iter().filter(|view| is_wanted(&view.id));
        let files: Result<Vec<_>, _> = views.map(|view| self.priors.source().file_of(view)).collect();
        Ok(files?.into_iter().flatten().collect())
    }

    /// Finds the heights; those of its core are the part's. A part that no view sees, or without usable priors, is solved all
    /// the same: its buildings are unknown. Ground in the photos is reported for the whole city, not here.
    ///
    /// # Errors
    /// [`PipelineError`] where the terrain cannot be read again after footprints were split.
    pub fn solve(&self, core: &MapBox, scratch: &Path, tell: Tell<'_>) -> Result<PartHeights, PipelineError> {
        // What is measured of a layer as a whole is not measured tile by tile: neighbours would come apart.
        let search = HeightSearch::within_a_city(&self.settings.heights, &self.survey, tell, &solve);
        let (mut footprints, ground) = (self.footprints.clone(), &self.settings.footprints.ground);
        let mut solved_scene = None;
        let heights = match &self.scene {
            Some(given) => {
                let photo_ground = given.ground_in_photos(ground, &self.survey, &footprints, Some(*core));
                correct_ground(ground, &mut footprints, photo_ground)?;
                let mut scene = SceneStage::in_frame(ground, &self.frame, &footprints)?;
                // Computed priors depend on the terrain.
                let priors = (scene.terrain != given.terrain)
                    .then(|| {
                        priors_over(
                            &scene.terrain,
                            (&self.settings.heights, &self.frame),
                            &self.survey,
                            &self.positions,
                        )
                    })
                    .transpose()?;
                let found = search.in_parts(&mut footprints, &mut scene, priors.as_ref().unwrap_or(&self.priors));
                solved_scene = Some(scene);
                found
            }
            None => HeightStage::empty(),
        };
        let mut issues = footprints.layer.issues.clone();
        issues.extend(footprints.issues.iter().cloned());
        issues.extend(view_issues(&self.survey, &heights));
        let records =
            records((&self.settings.records, self.frame.bounds), &self.survey, &footprints, &heights, &self.reviews);
        let is_painted = self.settings.output.config.textures.enabled;
        let painted =
            solved_scene.filter(|_| is_painted).map(|scene| self.paint(&records, core, &scene, scratch)).transpose()?;
        Ok(PartHeights {
            painted,
            records,
            issues,
            used_views: heights.solution.used_views.iter().map(|&v| self.survey.views[v].id.clone()).collect(),
            ground: heights.ground.around(core),
        })
    }

    /// Whether a building of the result belongs to the part itself: its footprint's middle is in the core.
    #[must_use]
    pub fn owns(&self, id: &str, core: &MapBox) -> bool {
        self.middle_of(id).is_some_and(|middle| core.holds(middle))
    }

    /// Textures of the buildings in the core.
    fn paint(
        &self,
        records: &[BuildingRecord],
        core: &MapBox,
        scene: &SceneStage,
        scratch: &Path,
    ) -> Result<PaintedTile, PipelineError> {
        let (own, others): (Vec<_>, Vec<_>) = records.iter().cloned().partition(|record| self.owns(&record.id, core));
        PaintedTile::new(self.settings.output.config, (&own, &others), core, &self.survey, scene, scratch)
    }

    /// Middle of the footprint that a building of the result comes from, by the building's id: its own, or that of the
    /// footprint that was split into it.
    #[must_use]
    pub fn middle_of(&self, id: &str) -> Option<(f64, f64)> {
        let at = *with_wholes(id).find_map(|id| self.by_id.get(id))?;
        self.footprints.layer.footprints[at].polygon.bounding_rect().map(|rect| rect.center().x_y())
    }

    /// The origin of its results, made from some files by the settings that concern it.
    #[must_use]
    pub fn lineage(&self, command: &str, inputs: Vec<InputFile>) -> Lineage {
        let settings = self.settings.of_part().to_string();
        let lineage = self.settings.origin.lineage(command, inputs);
        let photos = self.survey.views.iter().filter_map(|view| view.image.as_ref());
        Lineage { config_sha256: sha256_hex(settings.as_bytes()), ..lineage.of_day(|| flight_day(photos)) }
    }
}
