//! What a flight is like: how many photos look where, from how high, how fine, and how often a place is seen.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::folder::Inventory;
use sizeup_geo::terrain::Terrain;
use sizeup_heights::stats::{median, quantile};
use sizeup_survey::ground::centre_on_ground;
use sizeup_survey::{PhotoFacts, PhotoIndex, Spread, Survey, View, ViewKind, Viewpoints};

/// Fewer photos are no flight: a height needs three that see the building.
pub(super) const MIN_PHOTOS: usize = 3;
/// So many places on the ground tell how often one is seen.
const N_PLACES: usize = 200;
/// Names that are listed before the rest is counted.
pub(super) const N_NAMED: usize = 5;

/// Properties of a flight.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Flight {
    /// Folder of the photos.
    pub folder: Option<PathBuf>,
    /// Number of photo files.
    pub n_photos: usize,
    /// Photos with a pose that can be used.
    pub n_views: usize,
    /// Number of them that look down, within 15° of the vertical.
    pub n_nadir: usize,
    /// Number of them that are tilted more.
    pub n_oblique: usize,
    /// Heights above the ground, metres.
    pub above_ground_m: Option<Spread>,
    /// Median size of a pixel on the ground, in the middle of the photos, metres.
    pub pixel_m: Option<f64>,
    /// Photos that see a place, median over where photos look.
    pub seen_by: Option<f64>,
    /// Oblique ones of them.
    pub seen_by_oblique: Option<f64>,
    /// Whether the oblique photos of most places were taken from one spot.
    #[serde(skip)]
    pub lacks_baseline: bool,
    /// States of satellite positioning, counted.
    pub positioning: BTreeMap<String, usize>,
    /// Median standard deviations of positions that the photos state, metres: horizontal, vertical.
    pub position_sigma_m: Option<(f64, f64)>,
    /// Photos and poses that cannot be used, the first few with the reason.
    pub unused: Vec<String>,
    /// Number of all photos and poses that cannot be used.
    pub n_unused: usize,
}

impl Flight {
    /// Whether heights are measured in photos that look straight down, for lack of others.
    pub(super) fn is_nadir_only(&self) -> bool {
        self.n_oblique == 0 && self.n_nadir > 0 && self.n_photos > 0
    }

    /// Flight of a survey in the project's frame; without ground nothing is said of heights and pixels.
    pub(super) fn of(survey: &Survey, ground: Option<&Terrain>, facts: &[PhotoFacts]) -> Self {
        let n_of = |kind: ViewKind| survey.views.iter().filter(|view| view.kind() == kind).count();
        let sees = ground.map(|ground| overlap(&survey.views, ground));
        let unused = survey.issues.iter().filter(|issue| issue.severity == sizeup_geo::issue::Severity::Refused);
        let unused: Vec<String> = unused.map(|issue| format!("{}: {}", issue.subject.name(), issue.message)).collect();
        let (across, up): (Vec<f64>, Vec<f64>) = facts.iter().filter_map(|photo| photo.sigma_m).unzip();
        Self {
            n_photos: facts.len(),
            n_views: survey.views.len(),
            n_nadir: n_of(ViewKind::Nadir),
            n_oblique: n_of(ViewKind::Oblique),
            above_ground_m: ground
                .and_then(|ground| Spread::of(survey.views.iter().filter_map(|view| above(view, ground)))),
            pixel_m: ground.and_then(|ground| {
                let sizes: Vec<f64> = survey.views.iter().filter_map(|view| pixel_m(view, ground)).collect();
                median(&sizes)
            }),
            seen_by: sees.as_ref().and_then(|(all, _)| median(all)),
            seen_by_oblique: sees
                .as_ref()
                .and_then(|(_, oblique)| median(&oblique.iter().map(|seen| seen.n_views as f64).collect::<Vec<f64>>())),
            lacks_baseline: sees.is_some_and(|(_, oblique)| is_from_one_spot(&oblique)),
            position_sigma_m: median(&across).zip(median(&up)),
            n_unused: unused.len(),
            unused: unused.into_iter().take(N_NAMED).collect(),
            ..Self::default()
        }
    }

    /// The flight in a line of words.
    #[must_use]
    pub fn in_words(&self) -> String {
        let Self { n_photos, n_views, n_nadir, n_oblique, .. } = self;
        let s = if *n_photos == 1 { "" } else { "s" };
        let counts =
            format!("{n_photos} photo{s}, {n_views} with a usable pose: {n_nadir} straight down, {n_oblique} oblique");
        let above = self.above_ground_m.map(|height| format!("{:.0} m above ground", height.median));
        let pixel = self.pixel_m.map(|pixel_m| format!("{:.1} cm per pixel", 100.0 * pixel_m));
        let oblique = self.seen_by_oblique.filter(|_| *n_oblique > 0);
        let oblique = oblique.map_or_else(String::new, |oblique| format!(", {oblique:.0} of them oblique"));
        let seen = self.seen_by.map(|all| format!("photos per place: {all:.0}{oblique} (median)"));
        [Some(counts), above, pixel, seen].into_iter().flatten().collect::<Vec<_>>().join("; ")
    }

    /// Accuracy of positions, in a line; `None` where nothing tells.
    #[must_use]
    pub fn positioning_in_words(&self) -> Option<String> {
        let states: Vec<String> = self.positioning.iter().map(|(state, n)| format!("{n} {state}")).collect();
        let sigma = self
            .position_sigma_m
            .map(|(across, up)| format!("stated accuracy {across:.2} m across, {up:.2} m in height (median)"));
        let words: Vec<String> = (!states.is_empty())
            .then(|| format!("base station (RTK): {}", states.join(", ")))
            .into_iter()
            .chain(sigma)
            .collect();
        (!words.is_empty()).then(|| words.join("; "))
    }
}

fn above(view: &View, ground: &Terrain) -> Option<f64> {
    let centre = view.centre();
    Some(centre.z - ground.height_at(centre.x, centre.y)?)
}

/// Size of the middle pixel on the ground, along the photo's level direction.
fn pixel_m(view: &View, ground: &Terrain) -> Option<f64> {
    let far_m = above(view, ground)? / view.off_nadir_rad().cos();
    (far_m > 0.0).then(|| far_m / view.camera.fx_px)
}

/// Whether of the places that several oblique photos see, most are seen from one spot.
fn is_from_one_spot(oblique: &[Viewpoints]) -> bool {
    let several = || oblique.iter().filter(|seen| seen.n_views > 1);
    let n_from_one = several().filter(|seen| seen.lack_baseline()).count();
    2 * n_from_one > several().count()
}

/// Number of photos that see a place, and those of them that measure heights, at places that photos look at.
fn overlap(views: &[View], ground: &Terrain) -> (Vec<f64>, Vec<Viewpoints>) {
    let step = views.len().div_ceil(N_PLACES).max(1);
    let has_oblique = views.iter().any(|view| view.kind() == ViewKind::Oblique);
    let kind = if has_oblique { ViewKind::Oblique } else { ViewKind::Nadir };
    let places = views.iter().step_by(step).filter_map(|view| {
        let place = centre_on_ground(view, ground)?;
        Some(place.extend(ground.height_at(place.x, place.y)?))
    });
    let counts = places.map(|place| {
        let n_seeing = views.iter().filter(|view| view.pixel_of(place).is_some()).count();
        (n_seeing as f64, Viewpoints::of(views.iter().filter(|view| view.kind() == kind), place))
    });
    counts.unzip()
}

/// The folder that holds the photos of poses: most of them, and as little else as can be.
pub(super) fn folder_of_photos(inventory: &Inventory, names: &[String]) -> Option<PathBuf> {
    let counted = inventory.folders.iter().filter_map(|folder| {
        let below = || inventory.photos.iter().map(PathBuf::as_path).filter(|photo| photo.starts_with(folder));
        let n_known = PhotoIndex::new(below(), folder).count(names);
        let depth = folder.components().count();
        (n_known > 0).then(|| ((n_known, Reverse(below().count()), depth), folder))
    });
    counted.max_by_key(|(merit, _)| *merit).map(|(_, folder)| folder.clone())
}

/// A height that many photos tell, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct MedianHeight {
    /// Median of what the photos tell, metres.
    pub median_m: f64,
    /// Half of what lies between the lowest and the highest tenth.
    pub spread_m: f64,
    /// Number of photos that tell it.
    pub n: usize,
}

impl MedianHeight {
    pub(super) fn of(heights_m: &[f64]) -> Option<Self> {
        let spread_m = 0.5 * (quantile(heights_m, 0.9)? - quantile(heights_m, 0.1)?);
        Some(Self { median_m: median(heights_m)?, spread_m, n: heights_m.len() })
    }
}

/// The level of the place of take-off in what the poses count from: their heights minus those above take-off in the photos.
pub(super) fn takeoff(views: &[View], facts: &[PhotoFacts]) -> Option<MedianHeight> {
    let relative: BTreeMap<&Path, f64> =
        facts.iter().filter_map(|photo| Some((photo.path.as_path(), photo.relative_m?))).collect();
    let level = |view: &View| Some(view.centre().z - relative.get(view.image.as_deref()?)?);
    let levels: Vec<f64> = views.iter().filter_map(level).collect();
    MedianHeight::of(&levels)
}
