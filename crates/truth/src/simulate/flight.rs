//! Where photos are taken: a grid with five directions per station, or one free path.
//!
//! Azimuth: degrees clockwise from north. Tilt: degrees from the downward vertical.

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};

use sizeup_heights::camera::{Camera, Distortion};
use sizeup_heights::frames::{Cam, Map, Rigid};
use sizeup_heights::ids::ViewId;
use sizeup_heights::seed;
use sizeup_survey::View;

use super::chance::{between, happens, normal};
use super::config::{FlightConfig, FlightPattern, SimulateConfig, SimulatedCamera};
use super::town::SimulatedTown;

/// An oblique view of a grid flight is taken if its axis meets the ground this near to the buildings, in flying
/// heights.
const AIM_MARGIN: f64 = 0.3;
/// Views of a free flight without `n_views`.
const FREE_VIEWS: usize = 100;
/// Range of the tilt of a free flight's oblique views, degrees.
const FREE_TILT_DEG: (f64, f64) = (20.0, 60.0);
/// Share of nadir views in a free flight.
const FREE_NADIR_SHARE: f64 = 0.2;
/// Steps of bisection that find the spacing for a number of views.
const SPACING_STEPS: usize = 40;

/// The camera that the configuration describes, principal point in the middle.
pub(super) fn camera(config: &SimulatedCamera) -> Camera {
    let mut camera =
        Camera::pinhole(config.width_px, config.height_px, config.focal_ratio * f64::from(config.width_px));
    if let Some([k1, k2, k3, p1, p2]) = config.brown {
        camera.distortion = Distortion::Brown { k1, k2, k3, p1, p2 };
    }
    camera
}

/// `camera_from_map` for a position and a direction of view; the image's top points along the azimuth.
#[must_use]
pub fn pose(centre: DVec3, azimuth_rad: f64, tilt_rad: f64) -> Rigid<Cam, Map> {
    let level = DVec3::new(azimuth_rad.sin(), azimuth_rad.cos(), 0.0);
    let forward = tilt_rad.sin() * level - tilt_rad.cos() * DVec3::Z;
    let right = DVec3::new(level.y, -level.x, 0.0);
    let down = forward.cross(right);
    let camera_from_map = DMat3::from_cols(right, down, forward).transpose();
    Rigid::from_rotation_and_centre(camera_from_map, centre)
}

/// Position over the map, azimuth and tilt of one photo.
#[derive(Debug, Clone, Copy)]
struct PlannedShot {
    place: DVec2,
    azimuth_rad: f64,
    tilt_rad: f64,
}

/// All views of the configured flight, in the order they are taken.
#[must_use]
pub fn plan(config: &SimulateConfig, world: &SimulatedTown) -> Vec<View> {
    let flight = &config.flight;
    let shots = match (flight.pattern, flight.n_views) {
        (FlightPattern::Free, n) => free(flight, world, n.unwrap_or(FREE_VIEWS), config.seed),
        (FlightPattern::Grid, None) => grid(flight, world, flight.spacing_m),
        (FlightPattern::Grid, Some(n)) => grid_of(flight, world, n),
    };
    views(config, world, &shots)
}

/// Views of a grid flight that goes on in the same way over the next town: nadir and four oblique views per station, stations evenly
/// spread over one period. `n_views` is rounded to whole rows of stations.
#[must_use]
pub(super) fn periodic(config: &SimulateConfig, world: &SimulatedTown, period_m: DVec2) -> Vec<View> {
    let flight = &config.flight;
    let aims = aims(flight);
    let spacing_m = match flight.n_views {
        Some(n) => (period_m.x * period_m.y * aims.len() as f64 / n.max(1) as f64).sqrt(),
        None => flight.spacing_m,
    };
    let [columns, rows] = [period_m.x, period_m.y].map(|length_m| (length_m / spacing_m).round().max(1.0) as usize);
    let corner = world.extent.centre() - 0.5 * period_m;
    let step = period_m / DVec2::new(columns as f64, rows as f64);
    let places = (0..rows).flat_map(|row| (0..columns).map(move |column| [column, row]));
    let shots: Vec<PlannedShot> = places
        .map(|[column, row]| corner + step * DVec2::new(column as f64 + 0.5, row as f64 + 0.5))
        .flat_map(|place| aims.map(|(azimuth_rad, tilt_rad)| PlannedShot { place, azimuth_rad, tilt_rad }))
        .collect();
    views(config, world, &shots)
}

/// Azimuth and tilt of the views of one station, radians.
fn aims(flight: &FlightConfig) -> [(f64, f64); 5] {
    let (heading_rad, tilt_rad) = (flight.heading_deg.to_radians(), flight.tilt_deg.to_radians());
    [(0.0, 0.0), (0.0, tilt_rad), (90.0, tilt_rad), (180.0, tilt_rad), (270.0, tilt_rad)]
        .map(|(turn_deg, tilt_rad)| (heading_rad + f64::to_radians(turn_deg), tilt_rad))
}

fn views(config: &SimulateConfig, world: &SimulatedTown, shots: &[PlannedShot]) -> Vec<View> {
    let flight = &config.flight;
    let camera = Arc::new(camera(&config.camera));
    let middle = world.extent.centre();
    let ground_z_m = world.terrain.height_at(middle.x, middle.y).unwrap_or(0.0);
    let mean_ground_z_m =
        world.buildings.iter().map(|b| b.ground_z_m).sum::<f64>() / world.buildings.len().max(1) as f64;
    let level = if world.buildings.is_empty() { ground_z_m } else { mean_ground_z_m } + flight.height_m;
    let digits = shots.len().to_string().len().max(3);
    let view = |(i, shot): (usize, &PlannedShot)| {
        let mut rng = seed::stream(config.seed, "wobble", &[i as u64]);
        let mut wobble = |sd: f64| sd * normal(&mut rng);
        let shake = DVec3::new(wobble(flight.wobble_m), wobble(flight.wobble_m), wobble(flight.wobble_m));
        let (yaw, lean) = (wobble(flight.wobble_deg).to_radians(), wobble(flight.wobble_deg).to_radians());
        let kind = if shot.tilt_rad == 0.0 { "nadir" } else { "oblique" };
        View {
            id: ViewId(format!("{:0digits$}_{kind}.jpg", i + 1)),
            camera: Arc::clone(&camera),
            camera_from_map: pose(shot.place.extend(level) + shake, shot.azimuth_rad + yaw, shot.tilt_rad + lean),
            image: None,
        }
    };
    shots.iter().enumerate().map(view).collect()
}

/// Stations on a grid turned by the heading; nadir everywhere over the buildings, and every oblique view whose axis
/// meets the ground near them.
fn grid(flight: &FlightConfig, world: &SimulatedTown, spacing_m: f64) -> Vec<PlannedShot> {
    let heading_rad = flight.heading_deg.to_radians();
    let tilt_rad = flight.tilt_deg.to_radians();
    let target = world.extent.grown(AIM_MARGIN * flight.height_m);
    let middle = target.centre();
    let reach = 0.5 * target.size().length() + flight.height_m * tilt_rad.tan();
    let n = (reach / spacing_m).ceil() as i64;
    let mut shots = Vec::new();
    for line in -n..=n {
        for k in -n..=n {
            // Lines are flown to and fro.
            let along = if line.rem_euclid(2) == 0 { k } else { -k };
            let step = DVec2::new(line as f64 + 0.5, along as f64 + 0.5) * spacing_m;
            let place = middle + DVec2::from_angle(-heading_rad).rotate(step);
            for (azimuth_rad, tilt_rad) in aims(flight) {
                let ahead = DVec2::new(azimuth_rad.sin(), azimuth_rad.cos()) * flight.height_m * tilt_rad.tan();
                if target.contains(place + ahead) {
                    shots.push(PlannedShot { place, azimuth_rad, tilt_rad });
                }
            }
        }
    }
    shots
}

/// A grid with the widest spacing that gives at least `n` views, thinned evenly to exactly `n`.
fn grid_of(flight: &FlightConfig, world: &SimulatedTown, n: usize) -> Vec<PlannedShot> {
    let (mut narrow, mut wide) = (0.5, 4.0 * flight.height_m + world.extent.size().length());
    for _ in 0..SPACING_STEPS {
        let middle = (narrow * wide).sqrt();
        if grid(flight, world, middle).len() >= n {
            narrow = middle;
        } else {
            wide = middle;
        }
        if wide / narrow < 1.0005 {
            break;
        }
    }
    let shots = grid(flight, world, narrow);
    (0..n.min(shots.len())).map(|i| shots[i * shots.len() / n]).collect()
}

/// One smooth path around and over the buildings: slowly changing waves in position, azimuth and tilt.
fn free(flight: &FlightConfig, world: &SimulatedTown, n: usize, root_seed: u64) -> Vec<PlannedShot> {
    let mut rng = seed::stream(root_seed, "flight", &[]);
    let middle = world.extent.centre();
    let half = 0.5 * world.extent.size() + DVec2::splat(0.5 * flight.height_m);
    // Frequencies without a common measure: the path fills the area and never repeats.
    let [fx, fy] = [between(&mut rng, 5.0, 6.5), between(&mut rng, 7.5, 9.5)];
    let [px, py, pt] = [(); 3].map(|()| between(&mut rng, 0.0, std::f64::consts::TAU));
    let turns = between(&mut rng, 9.0, 13.0);
    (0..n)
        .map(|i| {
            let s = (i as f64 + 0.5) / n as f64 * std::f64::consts::TAU;
            let place = middle + half * DVec2::new((fx * s + px).sin(), (fy * s + py).sin());
            let wave = 0.5 + 0.5 * (turns * s + pt).sin();
            let tilt_deg = FREE_TILT_DEG.0 + (FREE_TILT_DEG.1 - FREE_TILT_DEG.0) * wave;
            // Looks at a place between the middle and somewhere else, so that the azimuth wanders.
            let aim = middle + 0.6 * half * DVec2::new(between(&mut rng, -1.0, 1.0), between(&mut rng, -1.0, 1.0));
            let to = aim - place;
            let is_nadir = happens(&mut rng, FREE_NADIR_SHARE);
            PlannedShot {
                place,
                azimuth_rad: to.x.atan2(to.y),
                tilt_rad: if is_nadir { 0.0 } else { tilt_deg.to_radians() },
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::world;
    use sizeup_survey::ViewKind;

    #[test]
    fn a_pose_looks_where_it_is_told() {
        let view = |azimuth_deg: f64, tilt_deg: f64| View {
            id: "a.jpg".into(),
            camera: Arc::new(Camera::pinhole(100, 80, 90.0)),
            camera_from_map: pose(DVec3::new(5.0, 6.0, 7.0), azimuth_deg.to_radians(), tilt_deg.to_radians()),
            image: None,
        };
        let east = view(90.0, 45.0);
        assert!((east.axis_in_map() - DVec3::new(1.0, 0.0, -1.0).normalize()).length() < 1e-12);
        assert!((east.camera_from_map.rotation.determinant() - 1.0).abs() < 1e-12);
        assert!((east.camera_from_map.centre() - DVec3::new(5.0, 6.0, 7.0)).length() < 1e-12);
        // Nadir with azimuth north: north is up in the image, east on the right.
        let nadir = view(0.0, 0.0);
        assert!((nadir.camera_from_map.vector(DVec3::Y) - DVec3::NEG_Y).length() < 1e-12);
        assert!((nadir.camera_from_map.vector(DVec3::X) - DVec3::X).length() < 1e-12);
    }

    #[test]
    fn flights_have_as_many_views_as_asked_for() {
        let mut config = SimulateConfig::default();
        config.town.n_buildings = 20;
        let world = world(&config).unwrap();
        for (pattern, n) in [(FlightPattern::Grid, 57), (FlightPattern::Free, 83)] {
            config.flight.pattern = pattern;
            config.flight.n_views = Some(n);
            let views = plan(&config, &world);
            assert_eq!(views.len(), n, "{pattern:?}");
            let n_nadir = views.iter().filter(|v| v.kind() == ViewKind::Nadir).count();
            assert!(n_nadir > n / 10 && n_nadir < n / 2, "{pattern:?} {n_nadir}");
            assert!(views.iter().all(|v| v.off_nadir_rad().to_degrees() < 66.0));
        }
    }
}
