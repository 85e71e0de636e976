//! From a folder to a configuration: each step takes what the ones before it found.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::checks::{check_footprints, doubts_of_flight, flight_of, lacks_of_flight, surface_by_name};
use super::flight::{Flight, folder_of_photos};
use super::folder::{Inventory, name_of};
use super::footprints::{self, LayerChoice, UsableLayer};
use super::ground::{self, GroundChoice, TerrainFile};
use super::place::PhotoPlaces;
use super::placing::{Placed, frame_of, lack_of_frame, place_in};
use super::poses::{self, Passed, PoseChoice, PoseSource};
use super::sheet;
use super::{InitError, InitRequest};
use crate::config::RunConfig;
use sizeup_heights::stats::median;
use sizeup_survey::{FirstLook, Format, PhotoFacts, PoseWorld, photo_facts};

/// Drones and survey aircraft fly lower than this, metres.
const HIGHEST_FLIGHT_M: f64 = 10_000.0;

/// Something without which no run can be.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Lack {
    /// The missing part, in words.
    pub what: String,
    /// Why it is not there.
    pub why: String,
    /// Way to get it.
    pub how: String,
    /// Whether it is the flight itself.
    #[serde(skip)]
    is_of_flight: bool,
}

impl Lack {
    pub(super) fn new(what: &str, why: impl Into<String>, how: impl Into<String>) -> Self {
        Self { what: what.to_owned(), why: why.into(), how: how.into(), is_of_flight: false }
    }

    /// As one of the flight itself.
    pub(super) fn of_flight(self) -> Self {
        Self { is_of_flight: true, ..self }
    }

    /// Whether the flight itself lacks it, so that no file can bring it.
    #[must_use]
    pub fn is_of_flight(&self) -> bool {
        self.is_of_flight
    }
}

/// Source of the poses.
#[derive(Debug, Clone, Serialize)]
pub struct PosesFound {
    /// File or folder of the poses.
    pub path: PathBuf,
    /// Format of the poses, as the configuration names it.
    pub format: String,
    /// Whether they were adjusted together with the photos.
    pub is_adjusted: bool,
    /// Why these poses were taken.
    pub why: String,
    /// Poses that were not taken, and why.
    pub passed: Vec<Passed>,
}

/// CRS that the project takes.
#[derive(Debug, Clone, Serialize)]
pub struct CrsFound {
    /// Definition of the CRS, as it is written in the configuration.
    pub definition: String,
    /// Name of the CRS, in words.
    pub name: String,
    /// Why this CRS was taken.
    pub why: String,
}

/// A project begun: what was found and chosen, what is missing, and the configuration.
#[derive(Debug, Serialize)]
pub struct Beginning {
    /// Path of the configuration that is written.
    pub config: PathBuf,
    /// Whether it can be run as it is.
    pub is_complete: bool,
    /// Properties of the flight.
    pub flight: Flight,
    /// Source of the poses.
    pub poses: PosesFound,
    /// The project's CRS, where it is known.
    pub crs: Option<CrsFound>,
    /// Vertical datum of the heights, in words.
    pub heights: String,
    /// Footprint layer that is taken; `None` where there is none.
    pub footprints: Option<UsableLayer>,
    /// Layers that are not taken.
    pub other_layers: Vec<footprints::PassedLayer>,
    /// Terrain model that is taken; `None` where there is none.
    pub terrain: Option<TerrainFile>,
    /// One height of the ground, metres.
    pub ground_m: Option<f64>,
    /// Whether a run finds the terrain in the photos, from what is given.
    pub ground_from_photos: bool,
    /// The ground, in words.
    pub ground: String,
    /// Rasters that are not taken.
    pub other_rasters: Vec<ground::PassedRaster>,
    /// Remarks that a person should read before a run.
    pub warnings: Vec<String>,
    /// Parts without which no run can be.
    pub missing: Vec<Lack>,
    /// Command to type next.
    pub next: String,
    /// Text of the configuration, TOML.
    #[serde(skip)]
    pub text: String,
}

/// Findings before there is a frame.
pub(super) struct Findings {
    pub facts: Vec<PhotoFacts>,
    pub source: PoseSource,
    pub passed: Vec<Passed>,
    pub images: Option<PathBuf>,
    pub footprints: LayerChoice,
    pub ground: GroundChoice,
}

impl Findings {
    /// Why these poses, in words.
    pub(super) fn why_these_poses(&self) -> String {
        let source = &self.source;
        let placed = source.placed_by.as_ref().map_or_else(String::new, |by| format!(", placed by {by}"));
        let n = source.look.names.len();
        let format = source.config.format.name();
        let world = match &source.look.world {
            PoseWorld::Named(crs) => format!(" in {}", crs.name()),
            _ => String::new(),
        };
        if source.is_adjusted() {
            format!("{n} poses adjusted with the photos ({format}){world}{placed}")
        } else if source.config.format == Format::Photos {
            let s = if n == 1 { "" } else { "s" };
            let others =
                if self.passed.is_empty() { "no adjusted poses lie here" } else { "nothing better can be used" };
            format!("{n} photo{s} with position and direction in EXIF and XMP; {others}")
        } else {
            format!("{n} poses from a table ({format}){world}{placed}")
        }
    }
}

/// Warnings, and parts that are missing.
#[derive(Debug, Default)]
pub(super) struct Notes {
    pub warnings: Vec<String>,
    pub lacks: Vec<Lack>,
}

/// All that is to be told.
pub(super) struct Story {
    pub found: Findings,
    pub placed: Option<Placed>,
    pub flight: Flight,
    pub notes: Notes,
}

/// Looks into a folder and makes a configuration of what is there. Nothing is written.
///
/// # Errors
/// [`InitError`] where the folder holds no photos with poses, or what was asked for cannot be used.
pub fn begin(request: &InitRequest) -> Result<Beginning, InitError> {
    let found = find(request)?;
    let place = PhotoPlaces::of(&found.source.look).read_in(request.crs.as_deref());
    let mut notes = Notes { warnings: surface_by_name(request), lacks: Vec::new() };
    let placed = match frame_of(request, &found, &place, &mut notes)? {
        Some(frame) => Some(place_in(request, &found, frame, &mut notes)?),
        None => {
            notes.lacks.push(lack_of_frame(&found.source));
            None
        }
    };
    let flight = flight_of(&found, placed.as_ref());
    notes.lacks.splice(0..0, lacks_of_flight(&flight));
    notes.warnings.extend(doubts_of_flight(&found, &flight));
    check_footprints(&found, placed.as_ref(), &mut notes);
    if found.images.is_none() {
        let why = format!("{} lies here without the photos it is of", name_of(&found.source.config.path));
        notes.lacks.push(Lack::new(
            "the photos",
            why,
            "put the photos into the folder, or set survey.images to theirs",
        ));
    }
    if let Some(placed) = &placed {
        notes.warnings.extend(placed.datum.warnings.iter().cloned());
        notes.lacks.extend(placed.datum.lacks.iter().cloned());
    }
    conclude(request, Story { found, placed, flight, notes })
}

fn find(request: &InitRequest) -> Result<Findings, InitError> {
    let home = home_of(&request.output);
    let beside = std::path::absolute(&request.folder).ok().and_then(|folder| folder.parent().map(Path::to_owned));
    let is_beside = beside.is_some() && beside == std::path::absolute(&home).ok();
    let inventory = Inventory::of(&request.folder, is_beside.then_some(home.as_path()))?;
    let facts = photo_facts(&inventory.photos);
    let PoseChoice { chosen, passed } = poses::choose(&inventory, &facts, request.offset);
    let source = chosen.ok_or_else(|| super::empty::why(&inventory, &facts, &passed))?;
    let images = images_of(&source, &inventory);
    // Pictures elsewhere in the folder are none of the flight's.
    let is_of_flight = |photo: &PhotoFacts| images.as_ref().is_none_or(|folder| photo.path.starts_with(folder));
    let facts: Vec<PhotoFacts> = facts.into_iter().filter(is_of_flight).collect();
    let place = PhotoPlaces::of(&source.look).read_in(request.crs.as_deref());
    let seen = place.clone().seen_from(flying_height_m(&source.look, &facts));
    let footprints = match &request.footprints {
        Some(path) => LayerChoice { chosen: Some(footprints::named(path, &seen)?), passed: Vec::new() },
        None => footprints::choose(&inventory, &seen),
    };
    let ground = match (&request.dtm, request.ground_m) {
        (Some(path), _) => GroundChoice { chosen: Some(ground::named(path, &place)?), passed: Vec::new() },
        (None, Some(_)) => GroundChoice::default(),
        (None, None) => ground::choose(&inventory, &place),
    };
    Ok(Findings { facts, source, passed, images, footprints, ground })
}

/// How high above the ground the photos were taken, as far as that is known before there is any ground: as the drone counted from its
/// take-off, else at most as high as above the zero of heights, metres.
fn flying_height_m(look: &FirstLook, facts: &[PhotoFacts]) -> f64 {
    let above_takeoff: Vec<f64> = facts.iter().filter_map(|photo| photo.relative_m).collect();
    let above_zero = || median(&look.positions.iter().map(|position| position.z).collect::<Vec<f64>>());
    // Positions from the earth's centre tell no height so.
    median(&above_takeoff).or_else(above_zero).filter(|height_m| *height_m < HIGHEST_FLIGHT_M).unwrap_or(0.0)
}

/// The folder of the photos.
fn images_of(source: &PoseSource, inventory: &Inventory) -> Option<PathBuf> {
    if source.config.format == Format::Photos {
        return Some(source.config.path.clone());
    }
    let own = source.config.images.clone().filter(|folder| folder.is_dir());
    folder_of_photos(inventory, &source.look.names).or(own)
}

/// The folder of a file.
pub(super) fn home_of(file: &Path) -> PathBuf {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned()
}

/// Files and words in the end.
fn conclude(request: &InitRequest, story: Story) -> Result<Beginning, InitError> {
    let text = sheet::text(request, &story);
    let Story { found, placed, flight, notes } = story;
    let is_complete = notes.lacks.is_empty();
    if is_complete {
        check_text(&text, &request.output)?;
    }
    let (datum, frame) = placed.map(|placed| (placed.datum, placed.frame)).unzip();
    let datum = datum.unwrap_or_default();
    Ok(Beginning {
        config: request.output.clone(),
        is_complete,
        flight,
        poses: PosesFound {
            path: found.source.config.path.clone(),
            format: found.source.config.format.name(),
            is_adjusted: found.source.is_adjusted(),
            why: found.why_these_poses() + &datum.unit_of_poses,
            passed: found.passed,
        },
        crs: frame.map(|f| CrsFound { name: f.crs.name().to_owned(), definition: f.definition, why: f.why }),
        heights: datum.in_words,
        footprints: found.footprints.chosen,
        other_layers: found.footprints.passed,
        terrain: found.ground.chosen.filter(|_| datum.constant_m.is_none()),
        ground_m: datum.constant_m,
        ground_from_photos: datum.is_sharpened,
        ground: datum.ground_in_words,
        other_rasters: found.ground.passed,
        warnings: notes.warnings,
        missing: notes.lacks,
        next: format!("sizeup run {}", request.output.display()),
        text,
    })
}

/// Whatever was found, what is written has to be a configuration.
fn check_text(text: &str, path: &Path) -> Result<(), InitError> {
    let refuse = |error: crate::config::ConfigError| InitError::Named {
        option: "configuration",
        path: path.to_owned(),
        reason: error.to_string(),
    };
    RunConfig::from_text(text, path, &[]).map(drop).map_err(refuse)
}
