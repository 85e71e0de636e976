//! From a folder to a configuration: each step takes what the ones before it found.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::datum::{self, Datum, Ground, Known};
use super::flight::{self, Flight, Level, MIN_PHOTOS, folder_of_photos};
use super::folder::{Inventory, name_of};
use super::frame::{self, Frame, Neighbour};
use super::ground::{self, GroundChoice, TerrainFile};
use super::outlines::{self, OutlineChoice, OutlineLayer};
use super::place::Place;
use super::poses::{self, Passed, PoseChoice, PoseSource};
use super::sheet;
use super::{InitError, InitRequest};
use crate::config::RunConfig;
use sizeup_footprints::{FootprintConfig, LayerParts};
use sizeup_geo::terrain::{self, MapBox, Terrain, TerrainConfig};
use sizeup_survey::{
    HeightConfig, HeightReference, PhotoFacts, PoseWorld, Reading, Site, Survey, SurveyConfig, View, photo_facts,
};

/// Something without which no run can be.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Lack {
    /// What is missing.
    pub what: String,
    /// Why it is not there.
    pub why: String,
    /// How to get it.
    pub how: String,
    /// Whether it is the flight itself.
    #[serde(skip)]
    is_of_flight: bool,
}

impl Lack {
    pub(super) fn new(what: &str, why: impl Into<String>, how: impl Into<String>) -> Self {
        Self { what: what.to_owned(), why: why.into(), how: how.into(), is_of_flight: false }
    }

    fn of_flight(self) -> Self {
        Self { is_of_flight: true, ..self }
    }

    /// Whether the flight itself lacks it, so that no file can bring it.
    #[must_use]
    pub fn is_of_flight(&self) -> bool {
        self.is_of_flight
    }
}

/// Where the poses are from.
#[derive(Debug, Clone, Serialize)]
pub struct PosesFound {
    /// File or folder.
    pub path: PathBuf,
    /// Its format.
    pub format: String,
    /// Whether they were adjusted together with the photos.
    pub is_adjusted: bool,
    /// Why these.
    pub why: String,
    /// What is there and not taken.
    pub passed: Vec<Passed>,
}

/// The project's CRS.
#[derive(Debug, Clone, Serialize)]
pub struct CrsFound {
    /// As it is written.
    pub definition: String,
    /// Its name.
    pub name: String,
    /// Why this one.
    pub why: String,
}

/// A project begun: what was found and chosen, what is missing, and the configuration.
#[derive(Debug, Serialize)]
pub struct Beginning {
    /// The configuration's file.
    pub config: PathBuf,
    /// Whether it can be run as it is.
    pub is_complete: bool,
    /// What the flight is like.
    pub flight: Flight,
    /// Where the poses are from.
    pub poses: PosesFound,
    /// The project's CRS, where it is known.
    pub crs: Option<CrsFound>,
    /// What heights count from.
    pub heights: String,
    /// The outlines.
    pub footprints: Option<OutlineLayer>,
    /// Layers that are not taken.
    pub other_layers: Vec<outlines::PassedLayer>,
    /// The terrain model.
    pub terrain: Option<TerrainFile>,
    /// One height of the ground, metres.
    pub ground_m: Option<f64>,
    /// Whether a run finds the terrain in the photos, from what is given.
    pub ground_from_photos: bool,
    /// The ground, in words.
    pub ground: String,
    /// Rasters that are not taken.
    pub other_rasters: Vec<ground::PassedRaster>,
    /// What to know of.
    pub warnings: Vec<String>,
    /// What is missing.
    pub missing: Vec<Lack>,
    /// What to type next.
    pub next: String,
    /// The configuration.
    #[serde(skip)]
    pub text: String,
}

/// What has been found before there is a frame.
pub(super) struct Findings {
    pub facts: Vec<PhotoFacts>,
    pub source: PoseSource,
    pub passed: Vec<Passed>,
    pub images: Option<PathBuf>,
    pub outlines: OutlineChoice,
    pub ground: GroundChoice,
}

/// A survey in the project's frame.
pub(super) struct Placed {
    pub frame: Frame,
    pub datum: Datum,
    pub survey: Survey,
    pub terrain: Option<Terrain>,
}

/// Looks into a folder and makes a configuration of what is there. Nothing is written.
///
/// # Errors
/// [`InitError`] where the folder holds no photos with poses, or what was asked for cannot be used.
pub fn begin(request: &InitRequest) -> Result<Beginning, InitError> {
    let found = find(request)?;
    let place = Place::of(&found.source.look);
    let (mut warnings, mut lacks) = (surface_by_name(request), Vec::new());
    let placed = match frame_of(request, &found, &place, &mut warnings)? {
        Some(frame) => Some(place_in(request, &found, frame, &mut warnings, &mut lacks)?),
        None => {
            lacks.push(lack_of_frame(&found.source));
            None
        }
    };
    let flight = flight_of(&found, placed.as_ref());
    lacks.splice(0..0, lacks_of_flight(&flight));
    check_outlines(&found, placed.as_ref(), &mut warnings, &mut lacks);
    if found.images.is_none() {
        lacks.push(Lack::new(
            "the photos",
            format!("{} lies here without the photos it is of", name_of(&found.source.config.path)),
            "put the photos into the folder, or set survey.images to theirs",
        ));
    }
    if let Some(placed) = &placed {
        warnings.extend(placed.datum.warnings.iter().cloned());
        lacks.extend(placed.datum.lacks.iter().cloned());
    }
    conclude(request, Story { found, placed, flight, warnings, lacks })
}

/// A terrain model that somebody named is taken, whatever it is called.
fn surface_by_name(request: &InitRequest) -> Vec<String> {
    let called = request.dtm.iter().filter(|path| ground::is_called_surface(path));
    let warning = |path: &PathBuf| {
        format!(
            "{} is called a surface model: with roofs and trees as ground, heights come out near zero",
            name_of(path)
        )
    };
    called.map(warning).collect()
}

/// All that is to be told.
pub(super) struct Story {
    pub found: Findings,
    pub placed: Option<Placed>,
    pub flight: Flight,
    pub warnings: Vec<String>,
    pub lacks: Vec<Lack>,
}

fn find(request: &InitRequest) -> Result<Findings, InitError> {
    let home = home_of(&request.output);
    let beside = std::path::absolute(&request.folder).ok().and_then(|folder| folder.parent().map(Path::to_owned));
    let is_beside = beside.is_some() && beside == std::path::absolute(&home).ok();
    let inventory = Inventory::of(&request.folder, is_beside.then_some(home.as_path()))?;
    let facts = photo_facts(&inventory.photos);
    let PoseChoice { chosen, passed } = poses::choose(&inventory, &facts, request.offset);
    let source = chosen.ok_or_else(|| super::empty::why(&inventory, &facts, &passed))?;
    let own = source.config.images.clone().filter(|folder| folder.is_dir());
    let images = folder_of_photos(&inventory, &source.look.names).or(own);
    let place = Place::of(&source.look);
    let outlines = match &request.footprints {
        Some(path) => OutlineChoice { chosen: Some(outlines::named(path, &place)?), passed: Vec::new() },
        None => outlines::choose(&inventory, &place),
    };
    let ground = match (&request.dtm, request.ground_m) {
        (Some(path), _) => GroundChoice { chosen: Some(ground::named(path, &place)?), passed: Vec::new() },
        (None, Some(_)) => GroundChoice::default(),
        (None, None) => ground::choose(&inventory, &place),
    };
    Ok(Findings { facts, source, passed, images, outlines, ground })
}

/// The folder of a file.
pub(super) fn home_of(file: &Path) -> PathBuf {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned()
}

/// The first CRS that the poses reach.
fn frame_of(
    request: &InitRequest,
    found: &Findings,
    place: &Place,
    warnings: &mut Vec<String>,
) -> Result<Option<Frame>, InitError> {
    let photos_at = Place::OnEarth(found.facts.iter().filter_map(|photo| photo.place_deg).collect());
    if let Some(definition) = &request.crs {
        let place = if place.middle_deg().is_some() { place } else { &photos_at };
        let frame = frame::asked(definition, place)?;
        return Ok(found.source.is_placed().then_some(frame));
    }
    if !found.source.is_placed() {
        return Ok(None);
    }
    let layer = found.outlines.chosen.as_ref().and_then(|layer| Some((name_of(&layer.path), layer.crs.as_ref()?)));
    let raster = found.ground.chosen.as_ref().and_then(|raster| Some((name_of(&raster.path), raster.crs.as_ref()?)));
    let neighbours: Vec<Neighbour<'_>> =
        layer.into_iter().chain(raster).map(|(name, crs)| Neighbour { name, crs }).collect();
    for frame in frame::candidates(&found.source, &neighbours, &photos_at) {
        match Reading::of(&as_they_are(found), &frame.crs) {
            Ok(_) => return Ok(Some(frame)),
            Err(error) => {
                warnings.push(format!(
                    "{} ({}) is not the project's CRS: {}",
                    frame.definition,
                    frame.why,
                    poses::one_line(&error)
                ));
            }
        }
    }
    Ok(None)
}

/// The survey with its heights as they are, whatever these count from.
fn as_they_are(found: &Findings) -> SurveyConfig {
    let height = HeightConfig { reference: Some(HeightReference::Project), ..HeightConfig::default() };
    SurveyConfig { height, ..survey_of(found) }
}

/// The survey as it is read from the folder.
fn survey_of(found: &Findings) -> SurveyConfig {
    SurveyConfig { images: found.images.clone(), ..found.source.config.clone() }
}

fn lack_of_frame(source: &PoseSource) -> Lack {
    let name = name_of(&source.config.path);
    if source.is_placed() {
        let why = format!("{name} does not say which CRS its positions are in, and nothing here tells");
        return Lack::new(
            "the CRS",
            why,
            "--crs, such as --crs EPSG:25832: the projected CRS that the poses were computed in",
        );
    }
    let why = format!("the positions of {name} are local: nothing says where on the map they lie");
    let how = "--offset X,Y,Z with what was taken off the positions, and --crs; or georeference the poses (`colmap model_aligner`, ground \
               control or GPS in your photogrammetry) and export them again";
    Lack::new("the place of the poses", why, how)
}

/// Brings the poses into the frame, and heights to one level.
fn place_in(
    request: &InitRequest,
    found: &Findings,
    frame: Frame,
    warnings: &mut Vec<String>,
    lacks: &mut Vec<Lack>,
) -> Result<Placed, InitError> {
    let unusable = |error: &dyn std::fmt::Display| InitError::Named {
        option: if frame.is_asked { "poses" } else { "survey" },
        path: found.source.config.path.clone(),
        reason: error.to_string(),
    };
    let reached = Reading::of(&survey_of(found), &frame.crs);
    let why_not = reached.as_ref().err().map(poses::one_line);
    let is_reached = reached.is_ok();
    let reading = match reached {
        Ok(reading) => reading,
        Err(_) => Reading::of(&as_they_are(found), &frame.crs).map_err(|e| unusable(&e))?,
    };
    let views = &reading.survey().views;
    let model = found.ground.chosen.as_ref().map(|file| level_of(file, &frame, views).map(|level| (file, level)));
    let model = match model.transpose() {
        Ok(model) => model,
        Err(why) => {
            warnings.push(format!("the terrain model cannot be used: {why}"));
            None
        }
    };
    let ground = match (model, request.ground_m) {
        (_, Some(level_m)) => Ground::Given(level_m),
        (Some((file, level)), None) => Ground::Model(file, level),
        (None, None) => Ground::Nothing,
    };
    let geoid_m = Place::of(&found.source.look).middle_deg().and_then(datum::geoid_m);
    let takeoff = flight::takeoff(views, &found.facts);
    let stated = found.source.look.heights;
    let datum = datum::settle(&Known { stated, is_reached, why_not, takeoff, geoid_m, ground });
    if !datum.lacks.is_empty() {
        return Ok(Placed { frame, datum, survey: reading.into_survey(), terrain: None });
    }
    let final_config = SurveyConfig { height: datum.height.clone(), ..survey_of(found) };
    let reading = Reading::of(&final_config, &frame.crs).map_err(|e| unusable(&e))?;
    let terrain = terrain_of(&datum, &ground, &frame, &reading.survey().views);
    let report = reading.report(Site { terrain: terrain.as_ref(), area: None });
    if !report.is_sound() {
        let why = report.findings.join("; ");
        let better: Vec<String> = report.trials.iter().map(ToString::to_string).collect();
        let inspect = "`sizeup survey inspect --config` says more".to_owned();
        lacks.push(Lack::new("poses that look right", why, better.into_iter().next().unwrap_or(inspect)));
    }
    warnings.extend(report.notes.iter().cloned());
    let mut survey = reading.into_survey();
    survey.views.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(Placed { frame, datum, survey, terrain })
}

/// A terrain model's level under the cameras.
fn level_of(file: &TerrainFile, frame: &Frame, views: &[View]) -> Result<Level, String> {
    let config = TerrainConfig { vertical_offset_m: Some(0.0), ..TerrainConfig::dtm(&file.path) };
    let terrain = load(&config, frame, views)?;
    let heights: Vec<f64> =
        views.iter().filter_map(|view| terrain.height_at(view.centre().x, view.centre().y)).collect();
    Level::of(&heights).ok_or_else(|| format!("{} has no heights under the cameras", name_of(&file.path)))
}

fn load(config: &TerrainConfig, frame: &Frame, views: &[View]) -> Result<Terrain, String> {
    /// Oblique photos look so far beyond where they are, metres.
    const AROUND_M: f64 = 100.0;
    /// Finer cells tell no more here, metres.
    const MIN_CELL_M: f64 = 2.0;
    let cameras = views.iter().map(|view| (view.centre().x, view.centre().y));
    let area = MapBox::around(cameras).ok_or("no camera has a place")?.grown(AROUND_M);
    let config = TerrainConfig { min_cell_m: MIN_CELL_M, ..config.clone() };
    terrain::load(&config, &frame.crs, area).map_err(|e| e.to_string().replace('\n', " "))
}

/// The ground as the run will have it.
fn terrain_of(datum: &Datum, ground: &Ground<'_>, frame: &Frame, views: &[View]) -> Option<Terrain> {
    match (ground, datum.constant_m) {
        (_, Some(level_m)) => Some(Terrain::Constant(level_m)),
        (Ground::Model(file, _), None) => {
            let offset = Some(datum.offset_m.unwrap_or(0.0));
            load(&TerrainConfig { vertical_offset_m: offset, ..TerrainConfig::dtm(&file.path) }, frame, views).ok()
        }
        _ => None,
    }
}

fn flight_of(found: &Findings, placed: Option<&Placed>) -> Flight {
    let flight =
        placed.map_or_else(Flight::default, |placed| Flight::of(&placed.survey, placed.terrain.as_ref(), &found.facts));
    let by_photo = || {
        let states = found.facts.iter().filter_map(|photo| photo.rtk);
        states.fold(BTreeMap::new(), |mut counts, state| {
            *counts.entry(state.to_owned()).or_insert(0) += 1;
            counts
        })
    };
    let mut positioning = found.source.look.rtk.clone();
    positioning.remove("none");
    let positioning = if positioning.is_empty() { by_photo() } else { positioning };
    Flight { folder: found.images.clone(), n_photos: found.facts.len(), positioning, ..flight }
}

/// What makes a flight useless for heights, said before all else.
fn lacks_of_flight(flight: &Flight) -> Vec<Lack> {
    let mut lacks: Vec<Lack> = Vec::new();
    if flight.n_views > 0 && flight.n_oblique == 0 {
        let why =
            format!("all {} photos look straight down (within 15°): they show roofs, and no heights", flight.n_views);
        lacks.push(Lack::new(
            "oblique photos",
            why,
            "fly again with the camera tilted by 30 to 60° from straight down, from several sides",
        ));
    }
    if flight.n_views > 0 && flight.n_views < MIN_PHOTOS {
        let why = format!("{} with a pose, expected {MIN_PHOTOS} at the very least", flight.n_views);
        lacks.push(Lack::new("photos", why, "each building has to be seen by several photos from different sides"));
    }
    lacks.into_iter().map(Lack::of_flight).collect()
}

/// Whether the outlines can be used where the photos look.
fn check_outlines(found: &Findings, placed: Option<&Placed>, warnings: &mut Vec<String>, lacks: &mut Vec<Lack>) {
    let Some(layer) = &found.outlines.chosen else {
        let how = "a cadastre's or OpenStreetMap's buildings of the area, put into the folder or named by --footprints (as GeoPackage, \
                   GeoJSON, Shapefile, FlatGeobuf, .osm or .osm.pbf); openstreetmap.org and overpass-turbo.eu export an area. Or masks of \
                   the photos that look straight down: docs/footprints.md";
        let why = if found.outlines.passed.is_empty() {
            "no layer of polygons lies here"
        } else {
            "no layer here is of buildings"
        };
        lacks.push(Lack::new("building outlines", why, how));
        return;
    };
    let Some(placed) = placed else { return };
    let config = FootprintConfig { layer: layer.layer.clone(), ..FootprintConfig::new(&layer.path) };
    let area = MapBox::around(placed.survey.views.iter().map(|view| (view.centre().x, view.centre().y)));
    let read = LayerParts::open(&config, &placed.frame.crs).and_then(|parts| match area {
        Some(area) => parts.around(area.grown(100.0), &BTreeMap::new()),
        None => Ok(sizeup_footprints::FootprintLayer::default()),
    });
    match read {
        Err(error) => lacks.push(Lack::new(
            "outlines that can be used",
            error.to_string().replace('\n', " "),
            "--footprints names another layer",
        )),
        Ok(read) if read.footprints.is_empty() => {
            let why = format!("none of {} can be used as an outline where the photos are", name_of(&layer.path));
            lacks.push(Lack::new("outlines that can be used", why, "--footprints names another layer"));
        }
        Ok(read) => {
            let n = read.footprints.len();
            if let Some(n_all) = layer.n_features.filter(|n_all| *n_all > 4 * n as u64 && *n_all > 1000) {
                warnings.push(format!(
                    "{} has {n_all} features, {n} of them where the photos are: the others come out without a height. \
                     `ogr2ogr -spat` cuts a layer",
                    name_of(&layer.path)
                ));
            }
        }
    }
}

fn conclude(request: &InitRequest, story: Story) -> Result<Beginning, InitError> {
    let text = sheet::text(request, &story);
    let is_complete = story.lacks.is_empty();
    if is_complete {
        // Whatever is found, what is written has to be a configuration.
        RunConfig::from_text(&text, &request.output, &[]).map_err(|error| InitError::Named {
            option: "configuration",
            path: request.output.clone(),
            reason: error.to_string(),
        })?;
    }
    let Story { found, placed, flight, warnings, lacks } = story;
    let why = why_these(&found);
    let output = request.output.display();
    let next = format!("sizeup run {output}");
    let (datum, frame) = placed.map_or_else(|| (Datum::default(), None), |placed| (placed.datum, Some(placed.frame)));
    let crs =
        frame.map(|frame| CrsFound { name: frame.crs.name().to_owned(), definition: frame.definition, why: frame.why });
    Ok(Beginning {
        config: request.output.clone(),
        is_complete,
        flight,
        poses: PosesFound {
            path: found.source.config.path.clone(),
            format: found.source.config.format.name(),
            is_adjusted: found.source.is_adjusted(),
            why,
            passed: found.passed,
        },
        crs,
        heights: datum.in_words,
        footprints: found.outlines.chosen,
        other_layers: found.outlines.passed,
        terrain: found.ground.chosen.filter(|_| datum.constant_m.is_none()),
        ground_m: datum.constant_m,
        ground_from_photos: datum.is_sharpened,
        ground: datum.ground_in_words,
        other_rasters: found.ground.passed,
        warnings,
        missing: lacks,
        next,
        text,
    })
}

/// Why these poses, in words.
pub(super) fn why_these(found: &Findings) -> String {
    let source = &found.source;
    let placed = source.placed_by.as_ref().map_or_else(String::new, |by| format!(", placed by {by}"));
    let n = source.look.names.len();
    let world = match &source.look.world {
        PoseWorld::Named(crs) => format!(" in {}", crs.name()),
        _ => String::new(),
    };
    if source.is_adjusted() {
        format!("{n} poses adjusted with the photos ({}){world}{placed}", source.config.format.name())
    } else if source.config.format == sizeup_survey::Format::Photos {
        format!("{n} photos with position and direction in their EXIF and XMP; no adjusted poses lie here")
    } else {
        format!("{n} poses from a table ({}){world}{placed}", source.config.format.name())
    }
}
