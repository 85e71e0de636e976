//! What speaks against a run, or against trusting its heights.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::InitRequest;
use super::flight::{Flight, MIN_PHOTOS};
use super::folder::name_of;
use super::placing::Placed;
use super::project::{Findings, Lack, Notes};
use super::{ground, poses};
use sizeup_footprints::{FootprintConfig, LayerParts};
use sizeup_geo::terrain::{MapBox, Terrain};
use sizeup_survey::ground::footprint;
use sizeup_survey::{Format, View};

/// A terrain model that somebody named is taken, whatever it is called.
pub(super) fn surface_by_name(request: &InitRequest) -> Vec<String> {
    let called = request.dtm.iter().filter(|path| ground::is_called_surface(path));
    let warning = |path: &PathBuf| {
        format!(
            "{} is called a surface model: with roofs and trees as ground, heights come out near zero",
            name_of(path)
        )
    };
    called.map(warning).collect()
}

/// Properties of the flight.
pub(super) fn flight_of(found: &Findings, placed: Option<&Placed>) -> Flight {
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

/// Faults that make a flight useless for heights, said before all else.
pub(super) fn lacks_of_flight(flight: &Flight) -> Vec<Lack> {
    let mut lacks: Vec<Lack> = Vec::new();
    if flight.n_views > 0 && flight.n_oblique == 0 && (flight.n_nadir == 0 || flight.n_photos == 0) {
        let why = format!(
            "all {} views look straight down (within 15°), or up: without the photos themselves they show no heights",
            flight.n_views
        );
        lacks.push(Lack::new(
            "oblique photos",
            why,
            "fly again with the camera tilted by 30 to 60° from straight down, from several sides",
        ));
    }
    if (flight.n_oblique > 1 || flight.is_nadir_only()) && flight.lacks_baseline {
        let why = "the photos of a place were all taken from one spot: they show no depth, whatever they look at";
        lacks.push(Lack::new(
            "photos from different places",
            why,
            "fly around or past the buildings, and take photos of each from several places instead of turning the camera on the spot",
        ));
    }
    let seen_by = flight.seen_by.filter(|seen_by| flight.is_nadir_only() && *seen_by < MIN_PHOTOS as f64);
    if let Some(seen_by) = seen_by.filter(|_| flight.n_views >= MIN_PHOTOS) {
        let why = format!(
            "all {} photos look straight down, and a place is seen by {seen_by:.0} (median): stereo measures roofs where {MIN_PHOTOS} overlap",
            flight.n_views
        );
        let how =
            "fly with 80 % overlap along and across, or tilt the camera by 30 to 60° and fly around the buildings";
        lacks.push(Lack::new("overlapping photos", why, how));
    }
    if flight.n_views > 0 && flight.n_views < MIN_PHOTOS {
        let why = format!("{} with a pose, expected {MIN_PHOTOS} at the very least", flight.n_views);
        lacks.push(Lack::new("photos", why, "each building has to be seen by several photos from different sides"));
    }
    lacks.into_iter().map(Lack::of_flight).collect()
}

/// Photos whose focal length is known to some per cent only.
pub(super) fn n_uncalibrated(found: &Findings) -> Option<usize> {
    found.source.look.focal.get("35 mm equivalent").copied()
}

/// Faults that make heights poor, and do not forbid a run.
pub(super) fn doubts_of_flight(found: &Findings, flight: &Flight) -> Vec<String> {
    /// Fewer oblique photos of a place leave walls unseen.
    const FEW_OBLIQUE: f64 = 4.0;
    let mut doubts = Vec::new();
    if flight.is_nadir_only() {
        doubts.push(format!(
            "all {} photos look straight down (within 15°): roofs are measured where three and more overlap, by stereo; photos tilted by 30 to \
             60°, from several sides, make heights better",
            flight.n_views
        ));
    }
    if let Some(n) = flight.seen_by_oblique.filter(|n| *n < FEW_OBLIQUE && flight.n_oblique > 0) {
        doubts.push(format!(
            "a place is seen by {n:.0} oblique photos (median): heights want {FEW_OBLIQUE:.0} and more, from several sides"
        ));
    }
    let is_of_photos = found.source.config.format == Format::Photos;
    if is_of_photos && flight.positioning.is_empty() {
        doubts.push(
            "poses are the drone's own without a base station, metres and a degree off: the run aligns the photos with each other; \
             poses of photogrammetry are better"
                .to_owned(),
        );
    }
    if let Some(n) = n_uncalibrated(found) {
        doubts.push(format!(
            "the focal length of {n} photos is known from its 35 mm equivalent only, 2 to 8 % off: the run finds it with the poses. \
             Calibrated cameras are better: state them in [survey.camera], or take poses of photogrammetry"
        ));
    }
    doubts
}

/// The area that the photos show, and were taken in.
fn seen_area(placed: &Placed) -> Option<MapBox> {
    let shown = |view: &View| {
        let centre = view.centre();
        let level = |terrain: &Terrain| terrain.height_at(centre.x, centre.y).or_else(|| Some(terrain.range()?.0));
        // Without ground its image on the zero of heights is larger than what it shows.
        let ground_m = placed.terrain.as_ref().and_then(level).unwrap_or(0.0);
        std::iter::once(centre.truncate()).chain(footprint(view, ground_m)).map(|at| (at.x, at.y))
    };
    MapBox::around(placed.survey.views.iter().flat_map(shown))
}

/// Whether the footprints can be used where the photos look.
pub(super) fn check_footprints(found: &Findings, placed: Option<&Placed>, notes: &mut Notes) {
    let Some(layer) = &found.footprints.chosen else {
        let how = "a cadastre's or OpenStreetMap's buildings of the area, put into the folder or named by --footprints (as GeoPackage, \
                   GeoJSON, Shapefile, FlatGeobuf, .osm or .osm.pbf); openstreetmap.org and overpass-turbo.eu export an area. Or masks of \
                   the photos that look straight down: docs/footprints.md";
        let why = if found.footprints.passed.is_empty() {
            "no layer of polygons lies here"
        } else {
            "no layer here is of buildings"
        };
        notes.lacks.push(Lack::new("building footprints", why, how));
        return;
    };
    let Some(placed) = placed.filter(|placed| !placed.survey.views.is_empty()) else { return };
    let config = FootprintConfig { layer: layer.layer.clone(), ..FootprintConfig::new(&layer.path) };
    let area = seen_area(placed);
    let read = LayerParts::open(&config, &placed.frame.crs).and_then(|parts| match area {
        Some(area) => parts.around(area.grown(100.0), &BTreeMap::new()),
        None => Ok(sizeup_footprints::FootprintLayer::default()),
    });
    match read {
        Err(error) => notes.lacks.push(Lack::new(
            "footprints that can be used",
            poses::one_line(&error),
            "--footprints names another layer",
        )),
        Ok(read) if read.footprints.is_empty() => {
            let why = format!("none of {} can be used as a footprint where the photos are", name_of(&layer.path));
            notes.lacks.push(Lack::new("footprints that can be used", why, "--footprints names another layer"));
        }
        Ok(read) => {
            let n = read.footprints.len();
            if let Some(n_all) = layer.n_features.filter(|n_all| *n_all > 4 * n as u64 && *n_all > 1000) {
                notes.warnings.push(format!(
                    "{} has {n_all} features, {n} of them where the photos are: the others come out without a height. \
                     `ogr2ogr -spat` cuts a layer",
                    name_of(&layer.path)
                ));
            }
        }
    }
}
