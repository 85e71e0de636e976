//! What heights count from: those of the poses and those of the ground have to count from one level, and a receiver's count from
//! the ellipsoid, up to 107 m from sea level. What the files do not say is estimated where something tells it, with the
//! uncertainty, and asked for where nothing does.
//!
//! ```text
//! take-off = height of a photo − its height above take-off     (in what the poses count from)
//! shift    = take-off − terrain model under the cameras        (to within the relief and the barometer)
//! ```

use std::fmt::Write as _;

use super::file::ConfigEntry;
use super::flight::MedianHeight;
use super::ground::TerrainFile;
use super::project::Lack;
use glam::DVec3;
use sizeup_geo::crs::{Crs, Transform3d};
use sizeup_photos::dtm::DtmConfig;
use sizeup_survey::{HeightConfig, StatedHeights, VerticalDatum};

/// A ground within this of the take-off is confirmed by it, metres, beyond the relief: what a barometer drifts in a flight.
const CONFIRMED_M: f64 = 3.0;
/// A ground farther than this from the take-off counts from another level, metres, beyond the relief. Between the two the drone may
/// have started from a roof or a hill, or the levels may differ: the photos have to tell.
const OTHER_LEVEL_M: f64 = 15.0;

/// Source of the geoid.
const GEOID: &str = "the geoid EGM96 here, which national zeros follow to within a metre or two";

/// Open ground within this is level, metres.
const LEVEL_GROUND_M: f64 = 2.0;

/// All that is known of the heights of poses and ground.
pub(super) struct DatumFacts<'a> {
    /// Statement of the poses on theirs.
    pub stated: StatedHeights,
    /// Whether they reach the project's vertical reference as they are, by PROJ or because both are one.
    pub is_reached: bool,
    /// Why heights cannot be brought together, where that was tried.
    pub why_not: Option<String>,
    /// Level at which the drone took off, in the poses' heights.
    pub takeoff: Option<MedianHeight>,
    /// Height of the geoid above the ellipsoid, metres.
    pub geoid_m: Option<f64>,
    /// Ground that lies there.
    pub ground: KnownGround<'a>,
}

/// Ground that lies there.
#[derive(Clone, Copy)]
pub(super) enum KnownGround<'a> {
    /// A terrain model, and its level under the cameras.
    Model(&'a TerrainFile, MedianHeight),
    /// One height that somebody gave.
    Given(f64),
    /// A terrain model that does not say in what unit its heights are.
    Unread(&'a TerrainFile),
    /// Rough level by the sparse points of the photos' model, in the poses' heights, and the relief of open ground, metres.
    Points(MedianHeight, f64),
    /// No ground is known.
    Nothing,
}

impl KnownGround<'_> {
    fn level(&self) -> Option<MedianHeight> {
        match self {
            Self::Model(_, level) | Self::Points(level, _) => Some(*level),
            Self::Unread(_) | Self::Given(_) | Self::Nothing => None,
        }
    }
}

/// Way in which heights are brought together.
#[derive(Debug, Default)]
pub(super) struct Datum {
    /// Zero of the poses' heights, as the survey takes it.
    pub height: HeightConfig,
    /// The same as entries of the configuration.
    pub height_entries: Vec<ConfigEntry>,
    /// Entries of the configuration's `[terrain]`.
    pub terrain_entries: Vec<ConfigEntry>,
    /// One height of the ground, metres.
    pub constant_m: Option<f64>,
    /// Added to a terrain model, metres.
    pub offset_m: Option<f64>,
    /// Whether the photos put the ground right.
    pub is_sharpened: bool,
    /// Greatest distance of the ground from the level that the photos start from, metres.
    pub within_m: f64,
    /// Distance of the take-off from that level, where it neither confirms nor refutes it, metres.
    gap_m: f64,
    /// Zero of the project's heights, in words.
    pub vertical_reference: Option<String>,
    /// Conversion of the poses' heights to metres, in words; empty where they are metres.
    pub unit_of_poses: String,
    /// Ground, in a line.
    pub ground_in_words: String,
    /// Zero of heights, in a line.
    pub in_words: String,
    pub warnings: Vec<String>,
    pub lacks: Vec<Lack>,
}

/// The geoid (EGM96) above the ellipsoid at a place, metres, where PROJ has its grid.
pub(super) fn geoid_m((lon_deg, lat_deg): (f64, f64)) -> Option<f64> {
    let (from, to) = (Crs::parse("EPSG:4979").ok()?, Crs::parse("EPSG:4326+5773").ok()?);
    let on_ellipsoid = DVec3::new(lon_deg, lat_deg, 0.0);
    Some(-Transform3d::new(&from, &to).ok()?.point(on_ellipsoid).ok()?.z)
}

/// Brings the heights together.
pub(super) fn settle(known: &DatumFacts<'_>) -> Datum {
    let mut datum = by_ground(known);
    let spreads = [known.takeoff.map(|level| level.spread_m), known.ground.level().map(|level| level.spread_m)];
    let unsure_m = 2.0 * spreads.into_iter().flatten().fold(0.0, f64::max);
    datum.within_m = DtmConfig::default().within_m.max((unsure_m + datum.gap_m).ceil());
    datum
}

fn by_ground(known: &DatumFacts<'_>) -> Datum {
    match known.ground {
        KnownGround::Model(file, level) => on_model(known, file, level),
        KnownGround::Given(level_m) => {
            let mut datum = as_they_are(known);
            datum.constant_m = Some(level_m);
            datum.ground_in_words = format!("{level_m} m everywhere, as given by --ground");
            datum.terrain_entries.push(ConfigEntry::new(
                "constant_m",
                format!("{level_m:?}"),
                datum.ground_in_words.clone(),
            ));
            doubt_given(&mut datum, known, level_m);
            datum
        }
        KnownGround::Unread(file) => without_unit(known, file),
        KnownGround::Points(level, relief_m) => from_points(known, level, relief_m),
        KnownGround::Nothing => from_takeoff(known),
    }
}

/// The poses' heights as they are, and the project's with them.
fn as_they_are(known: &DatumFacts<'_>) -> Datum {
    let mut datum = Datum::default();
    if known.is_reached {
        datum.in_words = match known.stated {
            StatedHeights::Ellipsoidal | StatedHeights::ByCrs => {
                "the poses' reach the project's vertical reference".to_owned()
            }
            _ => "what the poses' heights count from is not said: the project counts from the same".to_owned(),
        };
        return datum;
    }
    match known.stated {
        StatedHeights::Ellipsoidal => {
            datum.height.keep_ellipsoidal = true;
            let why =
                "heights stay above the ellipsoid, as the receiver gave them; national heights differ by up to 107 m";
            datum.height_entries.push(ConfigEntry::new("keep_ellipsoidal", "true", why));
            datum.vertical_reference = Some("ellipsoid".to_owned());
            "ellipsoidal, in poses and results".clone_into(&mut datum.in_words);
        }
        StatedHeights::Unreliable => {
            datum.height.reference = Some(VerticalDatum::Project);
            let why = "heights stay as the drone counted them (barometer, no base station): right beside each other, not absolutely";
            datum.height_entries.push(ConfigEntry::new("reference", "\"project\"", why));
            datum.vertical_reference = Some("the drone's own altitude".to_owned());
            "the drone's own altitude, in poses and results; no national heights".clone_into(&mut datum.in_words);
        }
        StatedHeights::ByCrs | StatedHeights::Unsaid => {
            let why = known.why_not.clone().unwrap_or_default();
            datum.lacks.push(Lack::new(
                "the poses' heights",
                why,
                "set [survey.height], or a --crs with the heights of the poses",
            ));
        }
    }
    datum
}

/// The ground that the photos tell: the level of the take-off.
fn from_takeoff(known: &DatumFacts<'_>) -> Datum {
    let mut datum = as_they_are(known);
    let Some(level) = known.takeoff else {
        let how = "a terrain model (DTM) from the national survey, put into the folder or named by --dtm; or the rough height of the \
                   ground by --ground METRES, counted from what the poses' heights count from";
        let why = "no terrain model lies here, and the photos do not tell how high they are above take-off";
        datum.lacks.push(Lack::new("the ground", why, how));
        return datum;
    };
    let MedianHeight { median_m, spread_m, n } = level;
    let level_m = (10.0 * median_m).round() / 10.0;
    datum.constant_m = Some(level_m);
    datum.is_sharpened = true;
    datum.ground_in_words = format!(
        "about {level_m:.1} m, the place of take-off by {n} photos (within {spread_m:.1} m of each other; the ground elsewhere may \
         differ by the relief); the photos find the terrain from there"
    );
    datum.terrain_entries.push(ConfigEntry::new("constant_m", format!("{level_m:?}"), datum.ground_in_words.clone()));
    datum
}

/// A terrain model in feet or metres, which only its maker knows.
fn without_unit(known: &DatumFacts<'_>, file: &TerrainFile) -> Datum {
    let mut datum = as_they_are(known);
    let name = super::folder::name_of(&file.path);
    let why = format!("{name} counts positions in feet and does not say in what it counts heights");
    datum.ground_in_words.clone_from(&file.why);
    let code = file.crs.as_ref().and_then(Crs::horizontal_epsg);
    let plane = code.map_or_else(|| "EPSG:2263".to_owned(), |code| format!("EPSG:{code}"));
    let about = format!(
        "MISSING: the unit of {name}: in the USA \"{plane}+6360\" (NAVD88 in US survey feet) or \"{plane}+5703\" (in metres)"
    );
    datum.terrain_entries.push(ConfigEntry::off("crs", format!("\"{plane}+6360\""), about));
    datum.lacks.push(Lack::new(
        "the unit of the terrain model",
        why,
        file.how_to_state_unit.clone().unwrap_or_default(),
    ));
    datum
}

/// The ground that the sparse points of the photos' model tell.
fn from_points(known: &DatumFacts<'_>, level: MedianHeight, relief_m: f64) -> Datum {
    let mut datum = as_they_are(known);
    let level_m = (10.0 * level.median_m).round() / 10.0;
    datum.constant_m = Some(level_m);
    // On level ground one height is better than what photos find between buildings of which some have no footprint.
    datum.is_sharpened = relief_m > LEVEL_GROUND_M;
    let then =
        if datum.is_sharpened { "the photos find the terrain from there" } else { "level enough for one height" };
    datum.ground_in_words = format!(
        "about {level_m:.1} m by the lowest of the model's sparse points ({} squares of 50 m, the open ones within {relief_m:.1} m); {then}",
        level.n
    );
    datum.terrain_entries.push(ConfigEntry::new("constant_m", format!("{level_m:?}"), datum.ground_in_words.clone()));
    datum
}

/// Says so where the given height of the ground and the take-off are not of one level.
fn doubt_given(datum: &mut Datum, known: &DatumFacts<'_>, level_m: f64) {
    let given = MedianHeight { median_m: level_m, spread_m: 0.0, n: 1 };
    let Some((takeoff, shift)) = known.takeoff.map(|takeoff| (takeoff, DatumShift::of(takeoff, given))) else { return };
    let what =
        format!("--ground {level_m} is {:.0} m from the take-off at {:.1} m", shift.metres.abs(), takeoff.median_m);
    match shift.verdict() {
        TakeoffVerdict::Same => {}
        TakeoffVerdict::Unclear => {
            datum.leave_to_photos(shift);
            datum
                .warnings
                .push(format!("{what} in the poses' heights: the photos look for the ground between ([dtm])"));
        }
        TakeoffVerdict::Other => datum.warnings.push(format!(
            "{what} in the poses' heights: does it count from another level (sea level against the ellipsoid)?"
        )),
    }
}

/// Poses over a terrain model.
fn on_model(known: &DatumFacts<'_>, file: &TerrainFile, level: MedianHeight) -> Datum {
    let mut datum = Datum { vertical_reference: file.vertical.clone(), ..Datum::default() };
    datum.ground_in_words =
        format!("{:.1} m under the cameras (± {:.1} m); {}", level.median_m, level.spread_m, file.why);
    if !file.is_named {
        datum.warnings.push(format!(
            "nothing says whether {} is terrain or a surface model with roofs on it: look at it before you trust heights",
            super::folder::name_of(&file.path)
        ));
    }
    match known.stated {
        StatedHeights::Ellipsoidal if !known.is_reached => from_ellipsoid(&mut datum, known, level),
        StatedHeights::Unreliable if !known.is_reached => from_barometer(&mut datum, known, level),
        _ if !known.is_reached => {
            let why = known.why_not.clone().unwrap_or_default();
            datum.lacks.push(Lack::new(
                "the poses' heights",
                why,
                "set [survey.height], or a --crs with the heights of the poses",
            ));
        }
        StatedHeights::Ellipsoidal | StatedHeights::ByCrs => {
            "the poses' reach the project's vertical reference by PROJ".clone_into(&mut datum.in_words);
            if let Some(takeoff) = known.takeoff {
                hold_against(&mut datum, DatumShift::of(takeoff, level));
            }
            if file.vertical.is_none() {
                datum.warnings.push(format!(
                    "{} does not say what its heights count from: it is taken to be the project's vertical reference",
                    super::folder::name_of(&file.path)
                ));
            }
        }
        _ => unsaid(&mut datum, known, level),
    }
    datum
}

fn from_ellipsoid(datum: &mut Datum, known: &DatumFacts<'_>, level: MedianHeight) {
    let by_takeoff = known.takeoff.map(|takeoff| DatumShift::of(takeoff, level));
    let geoid = known.geoid_m.filter(|geoid_m| by_takeoff.is_none_or(|takeoff| takeoff.allows(*geoid_m)));
    let told = geoid
        .map(|geoid_m| (geoid_m, GEOID.to_owned()))
        .or_else(|| by_takeoff.map(|takeoff| (takeoff.metres, takeoff.in_words())));
    let Some((shift_m, source)) = told else {
        let how = "state how far the zero of the terrain model lies above the ellipsoid: geoid_offset in [survey.height]; or a --crs \
                   with heights, such as EPSG:25832+7837";
        let why = "the poses' heights are ellipsoidal, the terrain model's are not said";
        datum.height_entries.push(ConfigEntry::off(
            "geoid_offset",
            "44.0",
            "metres; national surveys and geoid calculators tell it",
        ));
        datum.lacks.push(Lack::new("what heights count from", why, how));
        return;
    };
    let shift_m = (10.0 * shift_m).round() / 10.0;
    datum.height.geoid_offset = Some(shift_m);
    datum.height_entries.push(ConfigEntry::new(
        "geoid_offset",
        format!("{shift_m:?}"),
        format!("metres, ESTIMATED: {source}"),
    ));
    datum.is_sharpened = true;
    datum.gap_m = by_takeoff.map_or(0.0, |takeoff| (takeoff.metres - shift_m).abs());
    datum.in_words = format!("ellipsoidal minus {shift_m} m, into those of the terrain model");
    datum.warnings.push(format!(
        "the poses' heights are ellipsoidal and the terrain model's are not said: {shift_m} m are taken off, estimated ({source}); the \
         photos put the rest right. State the true geoid_offset for exact levels"
    ));
    let contradicted = known.geoid_m.zip(by_takeoff).filter(|(geoid_m, takeoff)| !takeoff.allows(*geoid_m));
    if let Some((geoid_m, takeoff)) = contradicted {
        datum.warnings.push(format!(
            "the take-off lies {:.0} m (± {:.0} m) above the terrain model, and the geoid {geoid_m:.0} m above the ellipsoid: the poses' \
             heights may not be ellipsoidal, or the terrain model's are",
            takeoff.metres, takeoff.within_m
        ));
    }
}

/// Shift of the poses' heights against a terrain model's.
#[derive(Debug, Clone, Copy)]
struct DatumShift {
    metres: f64,
    /// How well it is known: the relief under the cameras, and what the photos differ by.
    within_m: f64,
}

impl DatumShift {
    fn of(takeoff: MedianHeight, model: MedianHeight) -> Self {
        Self { metres: takeoff.median_m - model.median_m, within_m: takeoff.spread_m + model.spread_m }
    }

    /// Whether another figure for it can be right as well.
    fn allows(self, metres: f64) -> bool {
        (self.metres - metres).abs() <= OTHER_LEVEL_M + self.within_m
    }

    /// Verdict on a ground that is taken to be of one level with the poses.
    fn verdict(self) -> TakeoffVerdict {
        match self.metres.abs() - self.within_m {
            gap if gap <= CONFIRMED_M => TakeoffVerdict::Same,
            _ if self.allows(0.0) => TakeoffVerdict::Unclear,
            _ => TakeoffVerdict::Other,
        }
    }

    fn in_words(self) -> String {
        let within_m = self.within_m.max(2.0);
        format!("the take-off by the photos minus the terrain model under the cameras, good to {within_m:.0} m")
    }
}

/// Verdict of the take-off on the ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TakeoffVerdict {
    /// Both count from one level.
    Same,
    /// They may, or not.
    Unclear,
    /// They count from different levels.
    Other,
}

impl Datum {
    /// The photos look for the ground, as far off as the take-off is.
    fn leave_to_photos(&mut self, shift: DatumShift) {
        self.is_sharpened = true;
        self.gap_m = shift.metres.abs();
    }
}

fn from_barometer(datum: &mut Datum, known: &DatumFacts<'_>, level: MedianHeight) {
    if known.takeoff.is_none() {
        let why = "the poses' heights have no known reference (no base station), and the photos do not tell theirs above take-off";
        let how = "set [survey.height], as in reference = \"above_takeoff\" with base, the height of the take-off in the terrain model";
        datum.height_entries.push(ConfigEntry::off("reference", "\"above_takeoff\"", ""));
        datum.height_entries.push(ConfigEntry::off("base", format!("{:.1}", level.median_m), "metres"));
        datum.lacks.push(Lack::new("what heights count from", why, how));
        return;
    }
    let base_m = (10.0 * level.median_m).round() / 10.0;
    datum.height =
        HeightConfig { reference: Some(VerticalDatum::AboveTakeoff), base: Some(base_m), ..HeightConfig::default() };
    let why = "the drone's heights have no known zero (no base station): those above take-off are used";
    datum.height_entries.push(ConfigEntry::new("reference", "\"above_takeoff\"", why));
    let why = format!(
        "metres, ESTIMATED: the terrain model under the cameras (± {:.1} m); better: its height where the drone took off",
        level.spread_m
    );
    datum.height_entries.push(ConfigEntry::new("base", format!("{base_m:?}"), why));
    datum.is_sharpened = true;
    datum.in_words = format!("above take-off, taken to be at {base_m} m in the terrain model");
    datum.warnings.push(format!(
        "the drone's heights have no known zero: the take-off is taken to be at {base_m} m, the terrain model under the cameras (± {:.1} m); \
         the photos put the rest right. State the true survey.height.base for exact levels",
        level.spread_m
    ));
}

/// Poses that do not say what their heights count from, or say the terrain's.
fn unsaid(datum: &mut Datum, known: &DatumFacts<'_>, level: MedianHeight) {
    let Some(takeoff) = known.takeoff else {
        "the poses do not say: taken to be the terrain model's".clone_into(&mut datum.in_words);
        datum.warnings.push(
            "what the poses' heights count from is not said: they are taken to count from what the terrain model counts from".to_owned(),
        );
        return;
    };
    let shift = DatumShift::of(takeoff, level);
    "the poses do not say: taken to be the terrain model's".clone_into(&mut datum.in_words);
    hold_against(datum, shift);
    if shift.verdict() == TakeoffVerdict::Same {
        let said = format!(", which the take-off confirms to {:.0} m (± {:.0} m)", shift.metres.abs(), shift.within_m);
        datum.in_words.push_str(&said);
    }
}

/// Holds the terrain model against the take-off: it confirms it, leaves it to the photos, or moves it.
fn hold_against(datum: &mut Datum, shift: DatumShift) {
    let (shift_m, within_m) = ((10.0 * shift.metres).round() / 10.0, shift.within_m);
    match shift.verdict() {
        TakeoffVerdict::Same => {}
        TakeoffVerdict::Unclear => {
            datum.leave_to_photos(shift);
            let _ = write!(datum.in_words, "; the take-off lies {shift_m} m (± {within_m:.0} m) above it");
            datum.warnings.push(format!(
                "the take-off lies {shift_m} m (± {within_m:.0} m) above the terrain model under the cameras: the drone started from \
                 another height than the ground of the photos (a roof, a hill), or the model counts from another level. The photos look \
                 for the ground around the model ([dtm]); where they do not find it, heights may be off by so much"
            ));
        }
        TakeoffVerdict::Other => {
            datum.offset_m = Some(shift_m);
            datum.is_sharpened = true;
            datum.vertical_reference = None;
            let why = format!(
                "metres, ESTIMATED: the take-off by the photos lies so much above the terrain model (± {within_m:.0} m)"
            );
            datum.terrain_entries.push(ConfigEntry::new("vertical_offset_m", format!("{shift_m:?}"), why));
            datum.in_words = format!("those of the poses, {shift_m} m from the terrain model's");
            datum.warnings.push(format!(
                "the poses' heights and the terrain model's count from different levels: the take-off lies {shift_m} m (± {within_m:.0} m) \
                 above the model; the model is moved by that (vertical_offset_m), and the photos put the rest right"
            ));
        }
    }
}
