//! Looking a survey over before anything is computed from it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use geo::{BoundingRect as _, Contains as _};
use glam::{DVec2, DVec3};

use super::locate::{Facts, POSSIBLE_HEIGHTS_M, locate};
use super::poses::Poses;
use super::report::{Spread, SurveyReport};
use super::{Survey, SurveyConfig, SurveyError, View, ViewKind, ground, trials};
use sizeup_geo::crs::{Crs, Transform};
use sizeup_geo::terrain::Terrain;

/// Fewer views than this share looking down, or above the ground, and the poses are wrong.
const MIN_LOOKS_DOWN: f64 = 0.9;
/// Fewer image centres than this share in the area of interest, and the survey may be of somewhere else. Flights reach
/// beyond their area: oblique views at its rim look outward.
const MIN_SEES_AREA: f64 = 0.5;
/// A flight much larger than the area shows at least this share of it.
const MIN_AREA_SEEN: f64 = 0.5;
/// Image centres in the area per camera above it, at least: photos of a flight over it look there as often as elsewhere.
const MIN_LOOKS_PER_CAMERA: f64 = 0.5;
/// So few cameras above an area say nothing of where they look.
const FEW_CAMERAS: usize = 10;
/// Places along each side of the area's box at which it is asked whether a photo shows them.
const AREA_STEPS: usize = 12;
/// Drones and survey aircraft fly lower above the ground than this, metres.
const MAX_ABOVE_GROUND_M: f64 = 10_000.0;
/// Views further outside the area that a CRS is meant for, degrees, are not in it. Grids are often used beyond their zone.
const MAX_OUTSIDE_DEG: f64 = 6.0;
/// Projected positions this near the origin are local, metres: no national grid has land there.
pub(crate) const LOCAL_WITHIN_M: f64 = 2e4;
/// Code of the issue of a view that looks up.
pub(crate) const LOOKS_UP: &str = "view_looks_up";
/// Code of the issue of a camera too deep or too high.
pub(crate) const IMPOSSIBLE_HEIGHT: &str = "height_impossible";

/// The place as far as it is known, to hold a survey against.
#[derive(Debug, Clone, Copy, Default)]
pub struct Site<'a> {
    /// Ground of the place.
    pub terrain: Option<&'a Terrain>,
    /// The area of interest in the project's CRS, such as the hull of all footprints.
    pub area: Option<&'a geo::Polygon>,
}

/// Shares by which a reading of a survey is judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Judgement {
    pub looks_down: f64,
    pub sees_area: Option<f64>,
    pub of_area: Option<AreaSeen>,
    pub above_ground: Option<f64>,
}

/// The area of interest in the photos of a flight that may be larger.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct AreaSeen {
    /// Share of its places that some photo shows.
    pub share: f64,
    /// Whether photos taken above it look at it as often as elsewhere.
    is_looked_at: bool,
}

impl AreaSeen {
    fn of(views: &[View], area: &geo::Polygon, terrain: &Terrain, n_looks: usize) -> Self {
        let contains = |place: DVec2| area.contains(&geo::Point::new(place.x, place.y));
        let n_above = views.iter().filter(|view| contains(view.camera_from_map.centre().truncate())).count();
        let is_looked_at = n_above < FEW_CAMERAS || n_looks as f64 >= MIN_LOOKS_PER_CAMERA * n_above as f64;
        let places = places_in(area);
        let is_shown = |place: &&DVec2| {
            let Some(ground_m) = terrain.height_at(place.x, place.y) else { return false };
            views.iter().any(|view| view.pixel_of(place.extend(ground_m)).is_some())
        };
        let n_shown = places.iter().filter(is_shown).count();
        Self { share: if places.is_empty() { 0.0 } else { n_shown as f64 / places.len() as f64 }, is_looked_at }
    }

    fn is_enough(self) -> bool {
        self.is_looked_at && self.share >= MIN_AREA_SEEN
    }
}

/// Places spread evenly over an area.
fn places_in(area: &geo::Polygon) -> Vec<DVec2> {
    let Some(rect) = area.bounding_rect() else { return Vec::new() };
    let at = |step: usize, low: f64, size: f64| low + (step as f64 + 0.5) / AREA_STEPS as f64 * size;
    let place = |i: usize| {
        let (column, row) = (i % AREA_STEPS, i / AREA_STEPS);
        DVec2::new(at(column, rect.min().x, rect.width()), at(row, rect.min().y, rect.height()))
    };
    let is_in = |place: &DVec2| area.contains(&geo::Point::new(place.x, place.y));
    (0..AREA_STEPS * AREA_STEPS).map(place).filter(is_in).collect()
}

impl Judgement {
    pub(crate) fn of(survey: &Survey, site: Site<'_>) -> Self {
        let n_up = survey.issues.iter().filter(|issue| issue.code == LOOKS_UP).count();
        let n_views = survey.views.len();
        let share = |n: usize, of: usize| if of == 0 { 0.0 } else { n as f64 / of as f64 };
        // Cameras beyond the rim of the terrain have no say.
        let above = site.terrain.and_then(|terrain| {
            let heights_m: Vec<f64> = above_ground_m(survey, terrain).collect();
            let n = heights_m.iter().filter(|&&height_m| height_m > 0.0).count();
            (!heights_m.is_empty()).then(|| share(n, heights_m.len()))
        });
        let flat = Terrain::Constant(0.0);
        let terrain = site.terrain.unwrap_or(&flat);
        let n_looks = site.area.map(|area| {
            let is_in = |place: &DVec2| area.contains(&geo::Point::new(place.x, place.y));
            survey.views.iter().filter_map(|view| ground::centre_on_ground(view, terrain)).filter(is_in).count()
        });
        Self {
            looks_down: share(n_views, n_views + n_up),
            sees_area: n_looks.map(|n| share(n, n_views + n_up)),
            of_area: site.area.zip(n_looks).map(|(area, n)| AreaSeen::of(&survey.views, area, terrain, n)),
            above_ground: above,
        }
    }

    pub(crate) fn is_sound(&self) -> bool {
        self.looks_down >= MIN_LOOKS_DOWN
            && self.sees_enough()
            && self.above_ground.is_none_or(|share| share >= MIN_LOOKS_DOWN)
    }

    /// Whether the photos are of the area: most look there, or they show most of it and much around it.
    fn sees_enough(&self) -> bool {
        self.sees_area.is_none_or(|share| share >= MIN_SEES_AREA) || self.of_area.is_some_and(AreaSeen::is_enough)
    }

    /// For comparing readings of one survey. An area that is shown by photos that mostly look elsewhere counts less.
    pub(crate) fn score(&self) -> f64 {
        let shown = self.of_area.filter(|seen| seen.is_enough()).map_or(0.0, |seen| MIN_SEES_AREA * seen.share);
        let sees = self.sees_area.map_or(1.0, |share| share.max(shown));
        self.looks_down * sees * self.above_ground.unwrap_or(1.0)
    }
}

fn above_ground_m<'a>(survey: &'a Survey, terrain: &'a Terrain) -> impl Iterator<Item = f64> + 'a {
    survey.views.iter().filter_map(|view| {
        let centre = view.camera_from_map.centre();
        Some(centre.z - terrain.height_at(centre.x, centre.y)?)
    })
}

/// A survey that was read, ready to be held against what is known of the place: once its cameras tell where to look
/// for terrain, it need not be read again.
pub struct Reading {
    config: SurveyConfig,
    project_crs: Crs,
    survey: Survey,
    facts: Facts,
    /// Some of the poses as the file has them, for other readings of it.
    sample: Poses,
    about_positions: Option<String>,
}

impl Reading {
    /// Reads a survey. One without a usable view is returned: its report says why.
    ///
    /// # Errors
    /// [`SurveyError`] when the file as a whole cannot be read or its CRS cannot be reached.
    pub fn of(config: &SurveyConfig, project_crs: &Crs) -> Result<Self, SurveyError> {
        let config = super::with_own_photos(config)?;
        let poses = super::read_poses(&config)?;
        let (sample, about_positions) = (trials::sample(&poses), hints_of_positions(&poses, &config));
        let (survey, facts) = locate(poses, &config, project_crs)?;
        Ok(Self { config, project_crs: project_crs.clone(), survey, facts, sample, about_positions })
    }

    /// The views and issues, which do not depend on the place.
    #[must_use]
    pub fn survey(&self) -> &Survey {
        &self.survey
    }

    /// The same, for good.
    #[must_use]
    pub fn into_survey(self) -> Survey {
        self.survey
    }

    /// Way of heights to the project's, in words.
    #[must_use]
    pub fn heights(&self) -> &str {
        &self.facts.heights
    }

    /// The content, and whether it looks right. A survey that looks wrong has [`SurveyReport::is_sound`] false and
    /// the readings that look better: the caller decides to stop.
    #[must_use]
    pub fn report(&self, site: Site<'_>) -> SurveyReport {
        let judgement = Judgement::of(&self.survey, site);
        let mut report = report_of(self, site, judgement);
        report.findings.extend(outside_of_use(&self.survey, &self.project_crs));
        if report.is_sound() {
            report.equally_plausible = trials::opposite(&self.config, &self.project_crs, site);
            report.notes.extend(self.about_positions.clone());
        } else {
            report.trials = trials::run(&self.sample, &self.config, &self.project_crs, site, judgement);
            report.findings.extend(self.about_positions.clone());
        }
        report
    }
}

/// Reads a survey and reports on it: [`Reading`] in one step.
///
/// # Errors
/// As [`Reading::of`].
pub fn inspect(
    config: &SurveyConfig,
    project_crs: &Crs,
    site: Site<'_>,
) -> Result<(Survey, SurveyReport), SurveyError> {
    let reading = Reading::of(config, project_crs)?;
    let report = reading.report(site);
    Ok((reading.into_survey(), report))
}

fn report_of(reading: &Reading, site: Site<'_>, judgement: Judgement) -> SurveyReport {
    let Reading { config, project_crs, survey, facts, .. } = reading;
    let n_of = |kind: ViewKind| survey.views.iter().filter(|view| view.kind() == kind).count();
    let cameras: BTreeSet<usize> = survey.views.iter().map(|view| Arc::as_ptr(&view.camera) as usize).collect();
    let mut issue_counts: BTreeMap<String, usize> = BTreeMap::new();
    for issue in &survey.issues {
        *issue_counts.entry(issue.code.clone()).or_default() += 1;
    }
    let above_ground_m = site.terrain.and_then(|terrain| Spread::of(above_ground_m(survey, terrain)));
    let format = super::format_of(config).ok().and_then(|format| serde_json::to_value(format).ok());
    SurveyReport {
        path: config.path.display().to_string(),
        format: format.and_then(|f| f.as_str().map(str::to_owned)).unwrap_or_default(),
        poses_crs: facts.world.clone(),
        project_crs: project_crs.to_string(),
        heights: facts.heights.clone(),
        transform: facts.transform.clone(),
        n_poses: facts.n_poses,
        n_views: survey.views.len(),
        n_photos: survey.views.iter().filter(|view| view.image.is_some()).count(),
        n_nadir: n_of(ViewKind::Nadir),
        n_oblique: n_of(ViewKind::Oblique),
        n_cameras: cameras.len(),
        looks_down: judgement.looks_down,
        sees_area: judgement.sees_area,
        area_seen: judgement.of_area.map(|seen| seen.share),
        height_m: Spread::of(survey.views.iter().map(|view| view.camera_from_map.centre().z)),
        above_ground_m,
        convergence_deg: Spread::of(facts.convergence_deg.iter().copied()),
        point_scale: Spread::of(facts.point_scale.iter().copied()),
        rtk: facts.counts.rtk.clone(),
        focal: facts.counts.focal.clone(),
        issue_counts,
        accepted: false,
        notes: Vec::new(),
        findings: findings(judgement, above_ground_m, survey),
        trials: Vec::new(),
        equally_plausible: Vec::new(),
        issues: survey.issues.clone(),
    }
}

fn findings(judgement: Judgement, above_ground_m: Option<Spread>, survey: &Survey) -> Vec<String> {
    let mut findings = Vec::new();
    let percent = |share: f64| 100.0 * share;
    if survey.views.is_empty() {
        findings.push("no view can be used".to_owned());
    }
    if judgement.looks_down < MIN_LOOKS_DOWN {
        let share = percent(judgement.looks_down);
        findings
            .push(format!("{share:.0} % of the views look down, expected at least {:.0} %", percent(MIN_LOOKS_DOWN)));
    }
    let n_impossible = survey.issues.iter().filter(|issue| issue.code == IMPOSSIBLE_HEIGHT).count();
    let n_placed = survey.views.len() + n_impossible;
    if n_impossible as f64 > (1.0 - MIN_LOOKS_DOWN) * n_placed as f64 {
        let (low, high) = (POSSIBLE_HEIGHTS_M.start(), POSSIBLE_HEIGHTS_M.end());
        findings.push(format!("{n_impossible} of {n_placed} cameras are not between {low:.0} and {high:.0} m high"));
    }
    if let (Some(share), Some(seen)) = (judgement.sees_area.filter(|_| !judgement.sees_enough()), judgement.of_area) {
        let (share, least, shown) = (percent(share), percent(MIN_SEES_AREA), percent(seen.share));
        findings.push(format!(
            "{share:.0} % of the image centres lie in the area of interest, expected at least {least:.0} %, or a larger \
             flight that shows the area: {shown:.0} % of it is in a photo"
        ));
    }
    if let Some(spread) = above_ground_m {
        if judgement.above_ground.is_some_and(|share| share < MIN_LOOKS_DOWN) {
            findings.push(format!(
                "cameras lie below the ground (median {:.1} m above it): a wrong vertical reference, or terrain in another",
                spread.median
            ));
        } else if spread.median > MAX_ABOVE_GROUND_M {
            findings
                .push(format!("cameras fly {:.0} m above the ground: heights in feet, or a wrong CRS?", spread.median));
        }
    }
    findings
}

/// Says so when most views are far from where the project's CRS is meant to be used.
fn outside_of_use(survey: &Survey, project_crs: &Crs) -> Option<String> {
    let [west, south, east, north] = project_crs.area_of_use_deg()?;
    let lonlat_from_map = Transform::new(project_crs, &project_crs.geographic_base().ok()?).ok()?;
    let place = |view: &View| lonlat_from_map.point(view.centre().x, view.centre().y).ok();
    let is_outside = |place: Option<(f64, f64)>| {
        place.is_none_or(|(lon_deg, lat_deg)| {
            let off_deg = (west - lon_deg).max(lon_deg - east).max(south - lat_deg).max(lat_deg - north);
            off_deg > MAX_OUTSIDE_DEG
        })
    };
    let step = survey.views.len().div_ceil(trials::SAMPLE).max(1);
    let places: Vec<_> = survey.views.iter().step_by(step).map(place).collect();
    let n_outside = places.iter().filter(|place| is_outside(**place)).count();
    let first = places.iter().flatten().next();
    let first = first.map_or(String::new(), |(lon, lat)| format!(" (such as {lon:.2}°, {lat:.2}°)"));
    (2 * n_outside > places.len()).then(|| {
        format!(
            "the cameras lie{first} far outside the area of {project_crs}: {west}° to {east}°, {south}° to {north}°; \
             a wrong CRS, or an `offset` that is missing"
        )
    })
}

pub(crate) fn looks_like_degrees(position: DVec3) -> bool {
    position.x.abs() <= 180.0 && position.y.abs() <= 90.0
}

pub(crate) fn looks_earth_centred(position: DVec3) -> bool {
    const EARTH_RADII_M: std::ops::Range<f64> = 6.3e6..6.5e6;
    EARTH_RADII_M.contains(&position.length()) && position.z.abs() > LOCAL_WITHIN_M
}

/// Hints at the CRS that positions alone give away.
fn hints_of_positions(poses: &Poses, config: &SurveyConfig) -> Option<String> {
    let first = poses.poses.first()?.centre;
    if config.crs.is_some() || poses.world != super::poses::World::Unsaid {
        return None;
    }
    let is_on = |test: fn(DVec3) -> bool| poses.poses.iter().all(|pose| test(pose.centre));
    if is_on(looks_like_degrees) {
        return Some(format!("positions such as {first} look like degrees: `crs = \"EPSG:4979\"`?"));
    }
    if is_on(looks_earth_centred) {
        return Some(format!("positions such as {first} look earth-centred: `crs = \"EPSG:4978\"`?"));
    }
    let has_offset = config.offset != [0.0; 3] || config.enu_origin.is_some();
    (!has_offset && is_on(|centre| centre.truncate().length() < LOCAL_WITHIN_M))
        .then(|| format!("positions such as {first} look local: set `offset`, or `enu_origin`"))
}
