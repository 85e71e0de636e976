//! Ground level of each building by the photos, as a correction of the terrain.
//!
//! ```text
//! d_i      ground in the photos minus terrain, at squares of open ground between the buildings
//! d, σ     level and standard deviation of a surface through the d_i ([`GroundSurface`])
//! terrain  a model is corrected by d where |d| ≥ 0.5 m and 3 σ; one height for all is corrected wherever d is known
//! ```
//!
//! The terrain is corrected before heights are looked for: an error of it passes one to one into heights, low houses over a terrain
//! that is too high end at the least height, and views are chosen by what the terrain hides. Poses and photos are the same for roofs
//! and ground, so their common error cancels here.
//!
//! The whole area is reported too: the median of all `d_i`, and the ninth of the area that differs most from it, both from 1 m and
//! three standard errors on.

use std::collections::BTreeMap;
use std::path::Path;

use geo::Centroid as _;
use geo_types::Polygon;
use glam::DVec2;
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::GeomWithData;
use serde::{Deserialize, Serialize};

use super::settings::GroundSettings;
use sizeup_footprints::Footprint;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::terrain::{Dem, MapBox, Terrain};
use sizeup_heights::raster::Raster;
use sizeup_heights::stats;
use sizeup_photos::dtm::{self, DtmConfig, GroundSquare, GroundSurface, SquareOutcome};
use sizeup_photos::prior::Album;
use sizeup_survey::Survey;

/// Number of squares searched, about: spread evenly, no closer than those of a terrain model, and no farther apart than ground
/// follows from its neighbours, metres; in round numbers, so that a house more leaves them where they are.
const N_SQUARES: f64 = 600.0;
const MOST_SPACING_M: f64 = 40.0;
const SPACING_STEP_M: f64 = 4.0;
/// Squares that a square's neighbours are taken from, in spacings around it.
const NEIGHBOURS: f64 = 10.0;
/// Around the footprints, metres.
const MARGIN_M: f64 = 30.0;
/// Fewer squares with ground say nothing, of the whole or of a ninth of the area.
const MIN_SQUARES: usize = 12;
const MIN_OF_NINTH: usize = 4;
/// Less than this is within what poses and matching are off by, metres; and in standard errors of the median.
const REPORTED_M: f64 = 1.0;
const STANDARD_ERRORS: f64 = 3.0;
/// Standard error of a median, in standard errors of a mean, for normal errors.
const OF_MEDIAN: f64 = 1.2533;
/// From one node to the next at which the terrain is corrected, metres; between them it is interpolated. The surface through the squares
/// has a range of 45 m.
const NODE_M: f64 = 20.0;
/// A terrain model is corrected from this on, metres and standard deviations: what a good one and matching differ by.
const CORRECTED_M: f64 = 0.5;
const CORRECTED_SIGMAS: f64 = 3.0;
/// Standard deviation of a terrain model that the photos do not contradict, metres: a national laser-scanned one, with its cells.
const MODEL_SIGMA_M: f64 = 0.3;
/// Ground beside a building and under it differ by this, metres: kerbs, courts, light wells.
const BESIDE_M: f64 = 0.15;
/// A ground level less certain than this makes the height doubtful, metres.
const UNSURE_M: f64 = 1.0;

/// Terrain by the photos.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PhotoGround {
    /// Places where they show the ground, map, and its height above the terrain, metres.
    pub off_m: Vec<([f64; 2], f64)>,
    /// Standard deviation of these heights, by their neighbours, metres.
    #[serde(default)]
    pub sigma_m: f64,
}

/// Distance from one square to the next over a city whose footprints lie within a box, metres: the same in all of its parts.
pub(super) fn spacing_m(footprints: MapBox) -> f64 {
    let area = footprints.grown(MARGIN_M);
    let area_m2 = (area.east_m - area.west_m) * (area.north_m - area.south_m);
    let spacing_m = (area_m2 / N_SQUARES).sqrt().clamp(DtmConfig::default().spacing_m, MOST_SPACING_M);
    // Rather closer: a building's ground comes from the squares around it.
    (spacing_m / SPACING_STEP_M).floor().max(1.0) * SPACING_STEP_M
}

/// Memory that looking at the ground takes at most with so many photos, bytes.
pub(super) fn photo_bytes(n_photos: usize) -> usize {
    dtm::PICTURE_BYTES.min(n_photos.saturating_mul(Album::bytes_of_one(dtm::LONG_SIDE_PX)))
}

/// Searches the photos for open ground; empty where there are too few. Where the terrain was made from them, reads that ground. For a
/// part of a city it searches the part's core and around it as far as the ground of its buildings depends on.
pub(super) fn look(
    ground: &GroundSettings<'_>,
    survey: &Survey,
    footprints: &[Footprint],
    (terrain, spacing_m): (&Terrain, f64),
    core: Option<MapBox>,
) -> PhotoGround {
    if let Some(squares) = &ground.squares {
        return PhotoGround::read(squares);
    }
    if !survey.views.iter().any(|view| view.image.is_some()) {
        return PhotoGround::default();
    }
    let polygons: Vec<&Polygon<f64>> = footprints.iter().map(|f| &f.polygon).collect();
    let settings = DtmConfig { margin_m: MARGIN_M, spacing_m, ..DtmConfig::default() };
    let area = dtm::area(&survey.views, &polygons, &settings);
    let area = core.map_or(area, |core| core.grown(dtm::REACH_M + NEIGHBOURS * spacing_m).shared_with(&area));
    // The survey reports photos that cannot be read.
    let Ok((squares, sigma_m)) = dtm::off_by(&survey.views, &polygons, terrain, area, &settings, &|_, _| ()) else {
        return PhotoGround::default();
    };
    PhotoGround::of(&squares, sigma_m, |_| Some(0.0))
}

impl PhotoGround {
    /// Reads the squares that the terrain model of a run was made from, against it; none where they are not kept.
    fn read(path: &Path) -> Self {
        let file = std::fs::read(path);
        file.ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default()
    }

    /// Squares of ground, each against a level there; `None` takes it out.
    pub(super) fn of(squares: &[GroundSquare], sigma_m: f64, level_at: impl Fn(DVec2) -> Option<f64>) -> Self {
        let ground = squares.iter().filter_map(|square| match square.outcome {
            SquareOutcome::Ground(z_m) => Some((square.at.to_array(), z_m - level_at(square.at)?)),
            SquareOutcome::Outlier(_) | SquareOutcome::Unclear | SquareOutcome::Unseen => None,
        });
        // Without neighbours there is no spread.
        Self { off_m: ground.collect(), sigma_m: if sigma_m.is_finite() { sigma_m } else { 0.0 } }
    }

    /// Places that the ground of buildings in a core depends on.
    pub(super) fn around(&self, core: &MapBox) -> Self {
        let area = core.grown(dtm::REACH_M);
        let off_m = self.off_m.iter().filter(|(at, _)| area.holds((at[0], at[1]))).copied().collect();
        Self { off_m, sigma_m: self.sigma_m }
    }

    /// Joins the places of a city's parts, each with its core: of a place that several searched, the part with the closest core
    /// counts, the first of equals.
    #[must_use]
    pub fn of_parts(parts: impl IntoIterator<Item = (MapBox, Self)>) -> Self {
        let mut closest: BTreeMap<[u64; 2], ([f64; 2], f64, f64)> = BTreeMap::new();
        let mut sigma_m: f64 = 0.0;
        for (core, part) in parts {
            sigma_m = sigma_m.max(part.sigma_m);
            for (at, off_m) in part.off_m {
                let distance_m = core.distance_m((at[0], at[1]));
                // Squares lie on one grid: places are the same to the bit.
                let known = closest.entry(at.map(f64::to_bits)).or_insert((at, distance_m, off_m));
                if distance_m < known.1 {
                    *known = (at, distance_m, off_m);
                }
            }
        }
        Self { off_m: closest.into_values().map(|(at, _, off_m)| (at, off_m)).collect(), sigma_m }
    }

    /// Issue of the terrain as a whole: a shift, or where it differs most.
    #[must_use]
    pub fn issue(&self) -> Option<Issue> {
        if self.off_m.len() < MIN_SQUARES {
            return None;
        }
        let all: Vec<f64> = self.off_m.iter().map(|(_, off_m)| *off_m).collect();
        let (shift_m, is_shift) = median_off(&all, 0.0)?;
        let worst = self.worst_ninth(shift_m);
        let n = all.len();
        let (code, message) = match (is_shift, worst) {
            (true, None) => {
                let code = if shift_m < 0.0 { "terrain_too_high" } else { "terrain_too_low" };
                (
                    code,
                    format!(
                        "the ground lies {} the terrain says, the median of {n} places in the photos",
                        than(shift_m)
                    ),
                )
            }
            (_, Some((name, median_m, n_there))) => {
                let rest = format!("the median of all {n} is {} it", against(shift_m));
                (
                    "terrain_differs",
                    format!(
                        "the ground lies {} the terrain says {name} ({n_there} places in the photos; {rest})",
                        than(median_m)
                    ),
                )
            }
            (false, None) => return None,
        };
        let subject = Subject::Input("terrain".to_owned());
        let hint = "heights count from the ground that the photos show: check whether the terrain and the poses have one vertical datum";
        Some(Issue::new(Severity::Warning, code, subject, message).hint(hint))
    }

    /// The ninth of the area where the ground differs most from the shift, if it does: its name, median and number of places.
    fn worst_ninth(&self, shift_m: f64) -> Option<(&'static str, f64, usize)> {
        const NAMES: [&str; 9] = [
            "in the south-west",
            "in the south",
            "in the south-east",
            "in the west",
            "in the middle",
            "in the east",
            "in the north-west",
            "in the north",
            "in the north-east",
        ];
        let at = |i: usize| self.off_m.iter().map(move |(at, _)| at[i]);
        let low = [0, 1].map(|i| at(i).fold(f64::INFINITY, f64::min));
        let high = [0, 1].map(|i| at(i).fold(f64::NEG_INFINITY, f64::max));
        let third = |i: usize, v: f64| ((3.0 * (v - low[i]) / (high[i] - low[i]).max(1.0)) as usize).min(2);
        let of_ninth = |ninth: usize| -> Vec<f64> {
            let is_in = |p: &[f64; 2]| third(0, p[0]) + 3 * third(1, p[1]) == ninth;
            self.off_m.iter().filter(|(p, _)| is_in(p)).map(|(_, off_m)| *off_m).collect()
        };
        let ninth_off = |(ninth, name): (usize, &'static str)| {
            let off_m = of_ninth(ninth);
            let (median_m, is_off) = median_off(&off_m, shift_m).filter(|_| off_m.len() >= MIN_OF_NINTH)?;
            is_off.then_some((name, median_m, off_m.len()))
        };
        let found = NAMES.into_iter().enumerate().filter_map(ninth_off);
        found.max_by(|a, b| (a.1 - shift_m).abs().total_cmp(&(b.1 - shift_m).abs()))
    }

    /// Ground of some footprints by the squares around them, in their order; `None` where too few are near.
    pub(super) fn measured(&self, is_model: bool, footprints: &[Footprint]) -> Vec<Option<GroundCorrection>> {
        let surface = self.surface();
        let of = |polygon: &Polygon<f64>| {
            let middle = polygon.centroid()?;
            let (off_m, sigma_m) = surface.at(DVec2::new(middle.x(), middle.y()))?;
            Some(GroundCorrection::of(off_m, sigma_m.hypot(BESIDE_M), is_model))
        };
        footprints.par_iter().map(|footprint| of(&footprint.polygon)).collect()
    }

    /// The same, with what is known of the others.
    pub(super) fn corrections(&self, is_model: bool, footprints: &[Footprint]) -> Vec<Option<GroundCorrection>> {
        let found = self.measured(is_model, footprints);
        let corrected: Vec<f64> = found.iter().flatten().map(|ground| ground.off_m.abs()).collect();
        // One height that is wrong elsewhere is not to be trusted where no photo shows the ground.
        let is_wrong = !is_model && stats::median(&corrected).is_some_and(|off_m| off_m >= CORRECTED_M);
        let unknown = is_wrong
            .then_some(GroundCorrection { off_m: 0.0, sigma_m: stats::quantile(&corrected, 0.68).unwrap_or(0.0) });
        found.into_iter().map(|ground| ground.or(unknown)).collect()
    }

    fn surface(&self) -> GroundSurface {
        GroundSurface::new(self.off_m.iter().copied(), self.sigma_m)
    }

    /// A terrain as the photos correct it: a model over itself, one height for all over an area; `None` where they leave it as it is.
    pub(super) fn corrected(&self, is_model: bool, terrain: &Terrain, area: MapBox) -> Option<Terrain> {
        if self.off_m.is_empty() {
            return None;
        }
        let area = match terrain {
            Terrain::Constant(_) => area,
            Terrain::Grid(dem) => extent_of(dem),
        };
        let raised = self.raised(is_model, area)?;
        let corrected = match terrain {
            Terrain::Constant(level_m) => {
                let ((west_m, north_m), (cell_m, _)) = (raised.corner_m(), raised.cell_m());
                Dem::new(raised.heights_m().map(|off_m| off_m + *level_m as f32), west_m, north_m, cell_m, cell_m)
            }
            Terrain::Grid(dem) => {
                let (heights_m, (west_m, north_m), (cell_x_m, cell_y_m)) =
                    (dem.heights_m(), dem.corner_m(), dem.cell_m());
                let width = heights_m.width();
                let value = |(i, z_m): (usize, &f32)| {
                    let x = west_m + cell_x_m * ((i % width) as f64 + 0.5);
                    let y = north_m - cell_y_m * ((i / width) as f64 + 0.5);
                    raised.height_at(x, y).map_or(*z_m, |off_m| (f64::from(*z_m) + off_m) as f32)
                };
                let values = heights_m.data().par_iter().enumerate().map(value).collect();
                let values =
                    Raster::from_vec(width, heights_m.height(), values).expect("as many cells as the model has");
                Dem::new(values, west_m, north_m, cell_x_m, cell_y_m)
            }
        };
        corrected.ok().map(Terrain::Grid)
    }

    /// The correction over an area, on nodes that lie where they do whatever the area; `None` where it is none. Nodes without squares around
    /// are corrected as the nearest ones with them.
    fn raised(&self, is_model: bool, area: MapBox) -> Option<Dem> {
        let surface = self.surface();
        let node = |m: f64| (m / NODE_M).floor() as i64;
        let (west, south) = (node(area.west_m), node(area.south_m));
        let (width, height) = ((node(area.east_m) + 2 - west) as usize, (node(area.north_m) + 2 - south) as usize);
        let place = |i: usize| {
            let (col, row) = ((i % width) as i64, (i / width) as i64);
            DVec2::new((west + col) as f64, (south + height as i64 - 1 - row) as f64) * NODE_M
        };
        let off_at = |i: usize| {
            let (off_m, sigma_m) = surface.at(place(i))?;
            Some(GroundCorrection::of(off_m, sigma_m.hypot(BESIDE_M), is_model).off_m)
        };
        let known: Vec<Option<f64>> = (0..width * height).into_par_iter().map(off_at).collect();
        if known.iter().flatten().all(|off_m| *off_m == 0.0) {
            return None;
        }
        let nodes =
            known.iter().enumerate().filter_map(|(i, off_m)| Some(GeomWithData::new(place(i).to_array(), (*off_m)?)));
        let tree: RTree<GeomWithData<[f64; 2], f64>> = RTree::bulk_load(nodes.collect());
        let nearest = |i: usize| tree.nearest_neighbor(&place(i).to_array()).map_or(0.0, |node| node.data);
        let value = |(i, off_m): (usize, &Option<f64>)| off_m.unwrap_or_else(|| nearest(i)) as f32;
        let values = known.par_iter().enumerate().map(value).collect();
        let values = Raster::from_vec(width, height, values)?;
        let corner = place(0) + DVec2::new(-0.5, 0.5) * NODE_M;
        Dem::new(values, corner.x, corner.y, NODE_M, NODE_M).ok()
    }
}

/// Area of a model, map frame, metres.
fn extent_of(dem: &Dem) -> MapBox {
    let ((west_m, north_m), (cell_x_m, cell_y_m)) = (dem.corner_m(), dem.cell_m());
    let (width, height) = (dem.heights_m().width() as f64, dem.heights_m().height() as f64);
    MapBox { west_m, south_m: north_m - height * cell_y_m, east_m: west_m + width * cell_x_m, north_m }
}

/// Correction of the terrain's level under a building.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GroundCorrection {
    /// Added to the terrain's level, metres.
    pub off_m: f64,
    /// Standard deviation of the corrected level, metres.
    pub sigma_m: f64,
}

impl GroundCorrection {
    /// Correction by ground that the photos show `off_m` above the terrain, ± `sigma_m`. A terrain model has an uncertainty of its own;
    /// one height for all has none that is known.
    fn of(off_m: f64, sigma_m: f64, is_model: bool) -> Self {
        if !is_model || off_m.abs() >= CORRECTED_M.max(CORRECTED_SIGMAS * sigma_m) {
            return Self { off_m, sigma_m };
        }
        Self { off_m: 0.0, sigma_m: (sigma_m.powi(-2) + MODEL_SIGMA_M.powi(-2)).powf(-0.5) }
    }

    /// Whether the ground is too uncertain for its building's height to be `measured`.
    pub fn is_unsure(&self) -> bool {
        self.sigma_m >= UNSURE_M
    }
}

/// The median, and whether it is far enough from a level, and surely so.
fn median_off(values: &[f64], from_m: f64) -> Option<(f64, bool)> {
    let median_m = stats::median(values)?;
    let deviations: Vec<f64> = values.iter().map(|v| (v - median_m).abs()).collect();
    let sigma_m = stats::SIGMA_PER_MAD * stats::median(&deviations)?;
    let error_m = OF_MEDIAN * sigma_m / (values.len() as f64).sqrt();
    let off_m = (median_m - from_m).abs();
    Some((median_m, off_m >= REPORTED_M && off_m >= STANDARD_ERRORS * error_m))
}

fn than(off_m: f64) -> String {
    format!("{:.1} m {} than", off_m.abs(), if off_m < 0.0 { "lower" } else { "higher" })
}

fn against(off_m: f64) -> String {
    format!("{:.1} m {}", off_m.abs(), if off_m < 0.0 { "below" } else { "above" })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places 20 m apart over 200 m, each off by what a function says.
    fn issue_of(off_m: impl Fn(f64, f64) -> f64) -> Option<(String, String)> {
        let places = (0..100).map(|i| (f64::from(i % 10) * 20.0, f64::from(i / 10) * 20.0));
        // Matching errs by a decimetre or two, in a pattern without a place.
        let noise = |i: usize| 0.2 * ((i * 7919 % 13) as f64 / 6.0 - 1.0);
        let off_m = places.enumerate().map(|(i, (x, y))| ([x, y], off_m(x, y) + noise(i))).collect();
        PhotoGround { off_m, sigma_m: 0.1 }.issue().map(|issue| (issue.code, issue.message))
    }

    #[test]
    fn of_a_place_that_two_parts_saw_the_closer_one_tells() {
        let core = |west_m: f64| MapBox { west_m, south_m: 0.0, east_m: west_m + 40.0, north_m: 40.0 };
        let part = |off_m: f64| PhotoGround { off_m: vec![([36.0, 12.0], off_m), ([48.0, 12.0], off_m)], sigma_m: 0.1 };
        let both = [(core(0.0), part(1.0)), (core(40.0), part(2.0))];
        let joined = PhotoGround::of_parts(both.clone()).off_m;
        assert_eq!(joined, [([36.0, 12.0], 1.0), ([48.0, 12.0], 2.0)]);
        let [one, other] = both;
        assert_eq!(PhotoGround::of_parts([other, one]).off_m, joined, "in whatever order");
    }

    #[test]
    fn a_terrain_that_fits_is_not_told_of_and_one_that_does_not_is_with_its_place() {
        assert_eq!(issue_of(|_, _| 0.0), None);
        assert_eq!(issue_of(|_, _| 0.4), None, "within what poses are off by");
        let (code, message) = issue_of(|_, _| -2.1).unwrap();
        assert_eq!(code, "terrain_too_high");
        assert!(
            message.starts_with("the ground lies 2.1 m lower than the terrain says, the median of 100"),
            "{message}"
        );
        assert_eq!(issue_of(|_, _| 3.0).unwrap().0, "terrain_too_low");
        let (code, message) = issue_of(|x, y| if x > 130.0 && y > 130.0 { -2.1 } else { 0.0 }).unwrap();
        assert_eq!(code, "terrain_differs");
        assert!(
            message.starts_with("the ground lies ")
                && message.contains(" m lower than the terrain says in the north-east"),
            "{message}"
        );
        let (code, message) = issue_of(|x, _| (x - 90.0) / 10.0).unwrap();
        assert_eq!(code, "terrain_differs", "{message}");
        assert_eq!(
            PhotoGround { off_m: vec![([0.0, 0.0], 5.0); 5], sigma_m: 0.1 }.issue(),
            None,
            "five places are too few"
        );
    }
}
