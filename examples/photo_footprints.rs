//! Where each photo of a survey looks: the corners of its image on the ground, as well-known text.
//!
//! `cargo run --release --example photo_footprints -- sizeup.toml 112.5`: a configuration whose `[survey]` names the poses, in
//! any of the formats that `sizeup survey formats` lists, and the height of the ground in metres.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "an example prints what it found")]

use glam::{DVec2, DVec3};
use sizeup::config::RunConfig;
use sizeup::survey::{self, View};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [path, ground_m] = args.as_slice() else {
        return Err("expected a configuration and the height of the ground, such as `sizeup.toml 112.5`".into());
    };
    let config = RunConfig::load_without_prior(path.as_ref(), &[])?;
    let ground_m = ground_m.parse()?;
    let survey = survey::read(&config.survey, &config.project.crs)?;
    for view in &survey.views {
        let corners: Vec<String> =
            corners_on_ground(view, ground_m).iter().map(|c| format!("{:.2} {:.2}", c.x, c.y)).collect();
        println!("{}\t{:.1}° off nadir\tPOLYGON(({}))", view.id, view.off_nadir_deg(), corners.join(", "));
    }
    survey.issues.iter().for_each(|issue| eprintln!("{}", issue.message));
    Ok(())
}

/// The image's corners on a level, closed; without those that look at the sky.
fn corners_on_ground(view: &View, ground_m: f64) -> Vec<DVec3> {
    let (width, height) = (f64::from(view.camera.width_px), f64::from(view.camera.height_px));
    let pixels = [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height), (0.0, 0.0)];
    let map_from_camera = view.camera_from_map.inverse();
    let on_ground = |(x, y)| {
        let ray = map_from_camera.vector(view.camera.unproject(DVec2::new(x, y))?);
        (ray.z < 0.0).then(|| view.centre() + ray * ((ground_m - view.centre().z) / ray.z))
    };
    pixels.into_iter().filter_map(on_ground).collect()
}
