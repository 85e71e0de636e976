//! A city of equal towns side by side, for trials of scale: each photo of one town is rendered once, and its prior is shared by all.
//!
//! ```text
//!  town ─ copies all around ─> scene ─> priors of the first town   priors/t000_000_*.npy
//!                                          └─ hard links            priors/t012_031_*.npy
//!  poses, footprints, truth: written for every town, each moved by whole periods
//! ```
//!
//! Every town stands on the same level ground among its neighbours, so that what a photo sees over the rim is true wherever its
//! town lies. Only beyond the rim of the city photos show buildings that no layer has.

use std::path::Path;

use geo::Translate;
use geo_types::Polygon;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use sizeup_geo::crs::Crs;
use sizeup_geo::files::FileError;
use sizeup_geo::terrain::Terrain;
use sizeup_heights::ids::{BuildingId, ViewId};
use sizeup_survey::{ColmapModel, View};

use super::building::{SimulatedBuilding, by_roof_level};
use super::clutter::{self, ClutterTriangle};
use super::config::{FlightPattern, FootprintsOf, MosaicConfig, SimulateConfig};
use super::run::{SimulationSummary, map_offset, stem, summary, write_prior};
use super::scene::TracedScene;
use super::town::{self, SimulatedTown};
use super::{SimulateError, disturb, files, flight};

/// Width of the open strip between two towns, metres.
const STRIP_M: f64 = 12.0;
/// Towns are this far apart in whole steps, metres: coordinates of copies are exact.
const STEP_M: f64 = 1.0;

/// One town of a city, and where the others stand.
struct TownLattice {
    columns: usize,
    rows: usize,
    period_m: DVec2,
}

impl TownLattice {
    fn of(mosaic: &MosaicConfig, world: &SimulatedTown) -> Self {
        let up = |v: f64| ((v + STRIP_M) / STEP_M).ceil() * STEP_M;
        let size = world.extent.size();
        Self { columns: mosaic.columns, rows: mosaic.rows, period_m: DVec2::new(up(size.x), up(size.y)) }
    }

    /// Place of every town as column and row, the first one at (0, 0).
    fn cells(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let columns = self.columns;
        (0..self.rows).flat_map(move |row| (0..columns).map(move |column| [column, row]))
    }

    fn shift_m(&self, [column, row]: [usize; 2]) -> DVec2 {
        self.period_m * DVec2::new(column as f64, row as f64)
    }
}

fn name([column, row]: [usize; 2], of: &str) -> String {
    format!("t{column:03}_{row:03}_{of}")
}

/// Checks that a city of equal towns can be made as configured.
pub(super) fn check(config: &SimulateConfig, mosaic: &MosaicConfig) -> Result<(), SimulateError> {
    let level = "a city of equal towns has level ground: 0";
    let priors_only = "false: a city of equal towns has priors only";
    for (is_good, setting, found, expected) in [
        ((1..=999).contains(&mosaic.columns), "mosaic.columns", mosaic.columns.to_string(), "1 to 999"),
        ((1..=999).contains(&mosaic.rows), "mosaic.rows", mosaic.rows.to_string(), "1 to 999"),
        (config.terrain.relief_m == 0.0, "terrain.relief_m", config.terrain.relief_m.to_string(), level),
        (!config.images.enabled, "images.enabled", config.images.enabled.to_string(), priors_only),
        (!config.masks.enabled, "masks.enabled", config.masks.enabled.to_string(), priors_only),
        (
            !config.prior.write_true_depth,
            "prior.write_true_depth",
            config.prior.write_true_depth.to_string(),
            priors_only,
        ),
        (config.points.per_view == 0, "points.per_view", config.points.per_view.to_string(), "0 with a mosaic"),
        (config.cityjson.is_none(), "cityjson", "set".to_owned(), "a procedural town with a mosaic"),
        (
            config.flight.pattern == FlightPattern::Grid,
            "flight.pattern",
            "free".to_owned(),
            "grid: a mosaic is flown over evenly",
        ),
    ] {
        if !is_good {
            return Err(SimulateError::Setting { setting, found, expected });
        }
    }
    Ok(())
}

/// Simulates the city; see [`super::simulate`].
pub(super) fn simulate(
    config: &SimulateConfig,
    mosaic: &MosaicConfig,
    out: &Path,
    progress: &dyn Fn(usize, usize),
) -> Result<SimulationSummary, SimulateError> {
    let town = SimulatedTown { terrain: Terrain::Constant(config.terrain.base_z_m), ..town::build(config)? };
    let lattice = TownLattice::of(mosaic, &town);
    let crs = Crs::parse(&town.crs)?;
    crs.require_projected_metres()?;
    let views = flight::periodic(config, &town, lattice.period_m);
    if views.is_empty() {
        return Err(SimulateError::NoViews);
    }
    let scene = surrounded(config, &town, &lattice);
    write_priors(config, &scene, &views, &lattice, out, progress)?;
    write_poses(config, &town, &views, &lattice, out)?;
    let drawn = match config.town.footprints {
        FootprintsOf::Buildings => town.buildings.clone(),
        FootprintsOf::RoofLevels => by_roof_level(&town.buildings, &town.terrain),
    };
    write_layers(config, &drawn, &lattice, &crs, out)?;
    let offset = map_offset(&town);
    files::write_georef(&out.join("georef.json"), &crs, offset)?;
    files::write_run_config(&out.join("sizeup.toml"), config, &crs, offset, false)?;
    let n_towns = lattice.columns * lattice.rows;
    let of_one = summary(&town, &views, &scene, out);
    Ok(SimulationSummary {
        n_buildings: of_one.n_buildings * n_towns,
        n_views: of_one.n_views * n_towns,
        n_nadir: of_one.n_nadir * n_towns,
        ..of_one
    })
}

/// The town among its copies, as far as its photos see.
fn surrounded(config: &SimulateConfig, town: &SimulatedTown, lattice: &TownLattice) -> TracedScene {
    let clutter = clutter::scatter(town, clutter::Amounts::of(config, town), config.seed);
    let reach = |period_m: f64| (config.terrain.margin_m / period_m).ceil() as i64;
    let [across, along] = [reach(lattice.period_m.x), reach(lattice.period_m.y)];
    let (mut buildings, mut pieces) = (Vec::new(), Vec::new());
    let n_owners = clutter.iter().map(|p| p.owner + 1).max().unwrap_or(0);
    for (i, (column, row)) in (-across..=across).flat_map(|c| (-along..=along).map(move |r| (c, r))).enumerate() {
        let shift = (lattice.period_m * DVec2::new(column as f64, row as f64)).extend(0.0);
        buildings.extend(town.buildings.iter().map(|b| {
            let mut copy = b.clone();
            copy.triangles.iter_mut().for_each(|t| t.corners = t.corners.map(|p| p + shift));
            copy
        }));
        let moved = |p: &ClutterTriangle| ClutterTriangle {
            corners: p.corners.map(|c| c + shift),
            owner: p.owner + i as u32 * n_owners,
            ..*p
        };
        pieces.extend(clutter.iter().map(moved));
    }
    TracedScene::new(&SimulatedTown { buildings, ..town.clone() }, &pieces)
}

/// The priors of the first town, and links to them for the others.
fn write_priors(
    config: &SimulateConfig,
    scene: &TracedScene,
    views: &[View],
    lattice: &TownLattice,
    out: &Path,
    progress: &dyn Fn(usize, usize),
) -> Result<(), SimulateError> {
    let n = views.len() * lattice.columns * lattice.rows;
    let path = |cell, view: &View| out.join("priors").join(format!("{}.npy", name(cell, &stem(view))));
    progress(0, n);
    views
        .par_iter()
        .enumerate()
        .try_for_each(|(i, view)| write_prior(config, scene, view, i, &path([0, 0], view)).map(|_| ()))?;
    for (i, cell) in lattice.cells().enumerate() {
        if i > 0 {
            views.par_iter().try_for_each(|view| link(&path([0, 0], view), &path(cell, view)))?;
        }
        progress((i + 1) * views.len(), n);
    }
    Ok(())
}

/// A second name for a file; what had the name before gives way.
fn link(from: &Path, to: &Path) -> Result<(), FileError> {
    match std::fs::remove_file(to) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(FileError::on("cannot replace", to)(e)),
        _ => {}
    }
    std::fs::hard_link(from, to).map_err(FileError::on("cannot link", to))
}

fn write_poses(
    config: &SimulateConfig,
    town: &SimulatedTown,
    views: &[View],
    lattice: &TownLattice,
    out: &Path,
) -> Result<(), SimulateError> {
    let of_town = |cell: [usize; 2]| {
        let shift = lattice.shift_m(cell).extend(0.0);
        views.iter().map(move |view| {
            let camera_from_map = view.camera_from_map.moved(shift);
            View { id: ViewId(name(cell, &view.id.0)), camera_from_map, ..view.clone() }
        })
    };
    let all: Vec<View> = lattice.cells().flat_map(of_town).collect();
    let given = disturb::poses(&all, &config.errors, config.seed);
    let offset: DVec3 = map_offset(town);
    let model = ColmapModel { views: &given, points: &[], offset };
    if let Some(issue) = model.write(&out.join("sparse"))?.into_iter().next() {
        let expected = "a lens that COLMAP can express";
        return Err(SimulateError::Setting { setting: "camera", found: issue.message, expected });
    }
    Ok(())
}

/// Footprints and truth of all towns; errors of footprints are those of the first one everywhere.
fn write_layers(
    config: &SimulateConfig,
    drawn: &[SimulatedBuilding],
    lattice: &TownLattice,
    crs: &Crs,
    out: &Path,
) -> Result<(), SimulateError> {
    let copies = || {
        let of_town = |cell: [usize; 2]| {
            let by = lattice.shift_m(cell);
            drawn.iter().map(move |b| SimulatedBuilding {
                id: BuildingId(name(cell, &b.id.0)),
                footprint: b.footprint.translate(by.x, by.y),
                triangles: Vec::new(),
                levels: Vec::new(),
                ..*b
            })
        };
        lattice.cells().flat_map(of_town)
    };
    let first = disturb::footprints(drawn, &config.errors, config.seed);
    let polygons: Vec<Polygon<f64>> = lattice
        .cells()
        .flat_map(|cell| {
            let by = lattice.shift_m(cell);
            first.iter().map(move |p| p.translate(by.x, by.y))
        })
        .collect();
    files::write_footprints(&out.join("footprints.gpkg"), crs, copies(), &polygons)?;
    Ok(files::write_truth(&out.join("truth.geojson"), crs, copies())?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::config::TownKind;
    use crate::simulate::{MapRect, trace};

    fn config() -> SimulateConfig {
        let mut config = SimulateConfig { mosaic: Some(MosaicConfig { columns: 2, rows: 2 }), ..Default::default() };
        (config.town.kind, config.town.n_buildings, config.town.cars_per_building) = (TownKind::District, 30, 0.0);
        (config.terrain.relief_m, config.terrain.margin_m) = (0.0, 400.0);
        (config.images.enabled, config.masks.enabled) = (false, false);
        (config.flight.n_views, config.prior.longest_px) = (Some(40), 96);
        config
    }

    #[test]
    fn a_shared_prior_is_what_any_town_sees_of_its_city() {
        let config = config();
        let town =
            SimulatedTown { terrain: Terrain::Constant(config.terrain.base_z_m), ..town::build(&config).unwrap() };
        let lattice = TownLattice::of(&config.mosaic.unwrap(), &town);
        let shared = surrounded(&config, &town, &lattice);
        // The city of four as one world of its own, without what lies beyond its rim.
        let clutter = clutter::scatter(&town, clutter::Amounts::of(&config, &town), config.seed);
        let (mut buildings, mut pieces) = (Vec::new(), Vec::new());
        for cell in lattice.cells() {
            let shift = lattice.shift_m(cell).extend(0.0);
            buildings.extend(town.buildings.iter().cloned().map(|mut b| {
                b.triangles.iter_mut().for_each(|t| t.corners = t.corners.map(|p| p + shift));
                b
            }));
            pieces.extend(clutter.iter().map(|p| ClutterTriangle { corners: p.corners.map(|c| c + shift), ..*p }));
        }
        let city = TracedScene::new(&SimulatedTown { buildings, ..town.clone() }, &pieces);
        let shift = lattice.shift_m([1, 0]).extend(0.0);
        let size = lattice.period_m * 2.0;
        let corner = town.extent.centre() - 0.5 * lattice.period_m;
        let inside = MapRect::around(corner + 0.5 * size, 0.5 * size.x, 0.5 * size.y).grown(-60.0);
        let (mut n_all, mut n_same) = (0, 0);
        for view in flight::periodic(&config, &town, lattice.period_m) {
            let camera = view.camera.reduced_to(config.prior.longest_px);
            let there = View { camera_from_map: view.camera_from_map.moved(shift), ..view.clone() };
            let map_from_camera = there.camera_from_map.inverse();
            let of_first = trace::true_depth(&shared, &view, &camera);
            let of_second = trace::true_depth(&city, &there, &camera);
            for (i, (&a, &b)) in of_first.depth_m.data().iter().zip(of_second.depth_m.data()).enumerate() {
                let width = camera.width_px as usize;
                let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
                let ray = camera.unproject(pixel).unwrap();
                let ground = map_from_camera.point(ray * f64::from(of_second.ground_m.data()[i]));
                if inside.contains(ground.truncate()) && inside.contains(there.centre().truncate()) {
                    n_all += 1;
                    n_same += usize::from((a - b).abs() < 0.02);
                }
            }
        }
        assert!(n_all > 20_000, "{n_all} pixels look at the city from over it");
        assert!(n_same as f64 > 0.999 * f64::from(n_all), "{n_same} of {n_all}");
    }

    #[test]
    fn a_city_has_every_town_with_priors_that_take_no_room() {
        use std::os::unix::fs::MetadataExt;
        let folder = tempfile::tempdir().unwrap();
        let mut config = config();
        config.town.n_buildings = 6;
        let summary = crate::simulate::simulate(&config, folder.path(), &|_, _| {}).unwrap();
        assert_eq!(summary.n_buildings, 24);
        assert_eq!(summary.n_views % 20, 0, "four towns, five views per station");
        let priors: Vec<_> = std::fs::read_dir(folder.path().join("priors")).unwrap().map(|e| e.unwrap()).collect();
        assert_eq!(priors.len(), summary.n_views);
        let inodes: std::collections::BTreeSet<u64> = priors.iter().map(|e| e.metadata().unwrap().ino()).collect();
        assert_eq!(inodes.len() * 4, summary.n_views);
        config.terrain.relief_m = 3.0;
        let refused = config.validate().unwrap_err().to_string();
        assert!(refused.starts_with("terrain.relief_m is 3: expected"), "{refused}");
    }
}
