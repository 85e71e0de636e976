//! The poses in the project's frame: which CRS they reach, and on which level their heights and the ground's meet.

use super::datum::{self, Datum, DatumFacts, KnownGround};
use super::flight::{self, MedianHeight};
use super::folder::name_of;
use super::frame::{self, CrsCandidate, NeighbourFile};
use super::ground::TerrainFile;
use super::place::PhotoPlaces;
use super::poses::{self, PoseSource};
use super::project::{Findings, Lack, Notes};
use super::{InitError, InitRequest};
use sizeup_geo::issue::Severity;
use sizeup_geo::terrain::{self, LoadedTerrain, MapBox, Terrain, TerrainConfig};
use sizeup_survey::{
    HeightConfig, PoseWorld, Reading, Site, Survey, SurveyConfig, SurveyError, Trial, VerticalDatum, View,
    sparse_ground,
};

/// A survey in the project's frame.
pub(super) struct Placed {
    pub frame: CrsCandidate,
    pub datum: Datum,
    pub survey: Survey,
    pub terrain: Option<Terrain>,
}

/// The first CRS that the poses reach.
pub(super) fn frame_of(
    request: &InitRequest,
    found: &Findings,
    place: &PhotoPlaces,
    notes: &mut Notes,
) -> Result<Option<CrsCandidate>, InitError> {
    let photos_at = PhotoPlaces::OnEarth(found.facts.iter().filter_map(|photo| photo.place_deg).collect());
    if let Some(definition) = &request.crs {
        let place = if place.middle_deg().is_some() { place } else { &photos_at };
        let frame = frame::asked(definition, place)?;
        return Ok(found.source.is_placed().then_some(frame));
    }
    if !found.source.is_placed() {
        return Ok(None);
    }
    let layer = found.footprints.chosen.as_ref().and_then(|layer| Some((name_of(&layer.path), layer.crs.as_ref()?)));
    let raster = found.ground.chosen.as_ref().and_then(|raster| Some((name_of(&raster.path), raster.crs.as_ref()?)));
    let neighbours: Vec<NeighbourFile<'_>> =
        layer.into_iter().chain(raster).map(|(name, crs)| NeighbourFile { name, crs }).collect();
    for frame in frame::candidates(&found.source, &neighbours, &photos_at) {
        match Reading::of(&as_they_are(found), &frame.crs) {
            Ok(_) => return Ok(Some(frame)),
            Err(error) => {
                notes.warnings.push(format!(
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
    let height = HeightConfig { reference: Some(VerticalDatum::Project), ..HeightConfig::default() };
    SurveyConfig { height, ..survey_of(found) }
}

/// The survey as it is read from the folder.
fn survey_of(found: &Findings) -> SurveyConfig {
    SurveyConfig { images: found.images.clone(), ..found.source.config.clone() }
}

pub(super) fn lack_of_frame(source: &PoseSource) -> Lack {
    let name = name_of(&source.config.path);
    if let PoseWorld::Named(crs) = &source.look.world {
        let why = format!("{name} is in {}, and no projected CRS in metres is reached from there", crs.name());
        return Lack::new(
            "the CRS",
            why,
            "--crs, such as --crs EPSG:25832: a projected CRS in metres on the same datum",
        );
    }
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
pub(super) fn place_in(
    request: &InitRequest,
    found: &Findings,
    frame: CrsCandidate,
    notes: &mut Notes,
) -> Result<Placed, InitError> {
    let unusable = |error: &dyn std::fmt::Display| InitError::Named {
        option: "poses",
        path: found.source.config.path.clone(),
        reason: error.to_string(),
    };
    let reached = Reading::of(&survey_of(found), &frame.crs);
    let why_not = reached.as_ref().err().map(|error| poses::one_line(error));
    let is_reached = reached.is_ok();
    let reading = match reached.or_else(|_| Reading::of(&as_they_are(found), &frame.crs)) {
        Ok(reading) => reading,
        Err(error) => {
            // The others were tried before they were chosen: this one was asked for.
            let (why, how) = told_apart(&error);
            notes.lacks.push(Lack::new(&format!("a way of the poses into {}", frame.definition), why, how));
            let (datum, survey) = (Datum::default(), Survey::default());
            return Ok(Placed { frame, datum, survey, terrain: None });
        }
    };
    let views = &reading.survey().views;
    let unit_unsaid = found.ground.chosen.as_ref().filter(|file| file.how_to_state_unit.is_some());
    let model = found.ground.chosen.as_ref().filter(|_| unit_unsaid.is_none());
    let model = model.map(|file| level_of(file, &frame, views, notes).map(|level| (file, level)));
    let model = match model.transpose() {
        Ok(model) => model,
        Err(why) => {
            notes.warnings.push(format!("the terrain model cannot be used: {why}"));
            None
        }
    };
    let takeoff = flight::takeoff(views, &found.facts);
    let ground = match (model, unit_unsaid, request.ground_m) {
        (_, _, Some(level_m)) => KnownGround::Given(level_m),
        (Some((file, level)), ..) => KnownGround::Model(file, level),
        (None, Some(file), None) => KnownGround::Unread(file),
        (None, None, None) if takeoff.is_some() => KnownGround::Nothing,
        (None, None, None) => by_points(found, views, notes).unwrap_or(KnownGround::Nothing),
    };
    let geoid_m = PhotoPlaces::of(&found.source.look).middle_deg().and_then(datum::geoid_m);
    let stated = found.source.look.heights;
    let mut datum = datum::settle(&DatumFacts { stated, is_reached, why_not, takeoff, geoid_m, ground });
    let converted = reading.heights().split_once("; converted to metres");
    datum.unit_of_poses =
        converted.map(|(_, from)| format!("; heights are converted to metres{from}")).unwrap_or_default();
    if !datum.lacks.is_empty() {
        return Ok(Placed { frame, datum, survey: reading.into_survey(), terrain: None });
    }
    let final_config = SurveyConfig { height: datum.height.clone(), ..survey_of(found) };
    let reading = Reading::of(&final_config, &frame.crs).map_err(|e| unusable(&e))?;
    let terrain = terrain_of(&datum, &ground, &frame, &reading.survey().views);
    let report = reading.report(Site { terrain: terrain.as_ref(), area: None });
    if !report.is_sound() {
        let why = report.findings.join("; ");
        let better: Vec<String> = report.trials.iter().map(Trial::advice).collect();
        let inspect = "`sizeup survey inspect --config` says more".to_owned();
        notes.lacks.push(Lack::new("poses that look right", why, better.into_iter().next().unwrap_or(inspect)));
    }
    notes.warnings.extend(report.notes.iter().cloned());
    let mut survey = reading.into_survey();
    survey.views.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(Placed { frame, datum, survey, terrain })
}

/// Rough ground by the sparse points that lie beside the poses; points that cannot be read are told, and no ground.
fn by_points(found: &Findings, views: &[View], notes: &mut Notes) -> Option<KnownGround<'static>> {
    let ground = sparse_ground(&survey_of(found), views).unwrap_or_else(|e| {
        notes.warnings.push(format!("the model's points tell no ground: {}", told_apart(&e).0));
        None
    })?;
    let level = MedianHeight { median_m: ground.level_m, spread_m: ground.spread_m, n: ground.n };
    Some(KnownGround::Points(level, ground.relief_m))
}

/// An error without its hint, and the hint.
fn told_apart(error: &SurveyError) -> (String, String) {
    let text = error.to_string();
    let (why, how) = text.split_once("\nhint: ").unwrap_or((&text, "leave --crs out, or ask for another"));
    (why.replace('\n', " "), how.replace('\n', " "))
}

/// A terrain model's level under the cameras.
fn level_of(
    file: &TerrainFile,
    frame: &CrsCandidate,
    views: &[View],
    notes: &mut Notes,
) -> Result<MedianHeight, String> {
    let config = TerrainConfig { vertical_offset_m: Some(0.0), ..TerrainConfig::dtm(&file.path) };
    let LoadedTerrain { terrain, issues } = load(&config, frame, views)?;
    let warnings = issues.into_iter().filter(|issue| issue.severity > Severity::Note);
    notes.warnings.extend(warnings.map(|issue| format!("{}: {}", name_of(&file.path), issue.message)));
    let heights: Vec<f64> =
        views.iter().filter_map(|view| terrain.height_at(view.centre().x, view.centre().y)).collect();
    MedianHeight::of(&heights).ok_or_else(|| format!("{} has no heights under the cameras", name_of(&file.path)))
}

fn load(config: &TerrainConfig, frame: &CrsCandidate, views: &[View]) -> Result<LoadedTerrain, String> {
    /// Oblique photos look so far beyond where they are, metres.
    const AROUND_M: f64 = 100.0;
    /// Finer cells tell no more here, metres.
    const MIN_CELL_M: f64 = 2.0;
    let cameras = views.iter().map(|view| (view.centre().x, view.centre().y));
    let area = MapBox::around(cameras).ok_or("no camera has a place")?.grown(AROUND_M);
    let config = TerrainConfig { min_cell_m: MIN_CELL_M, ..config.clone() };
    terrain::load_with_issues(&config, &frame.crs, area).map_err(|e| poses::one_line(&e))
}

/// The ground as the run will have it.
fn terrain_of(datum: &Datum, ground: &KnownGround<'_>, frame: &CrsCandidate, views: &[View]) -> Option<Terrain> {
    match (ground, datum.constant_m) {
        (_, Some(level_m)) => Some(Terrain::Constant(level_m)),
        (KnownGround::Model(file, _), None) => {
            let offset = Some(datum.offset_m.unwrap_or(0.0));
            let config = TerrainConfig { vertical_offset_m: offset, ..TerrainConfig::dtm(&file.path) };
            load(&config, frame, views).ok().map(|loaded| loaded.terrain)
        }
        _ => None,
    }
}
