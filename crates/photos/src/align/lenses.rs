//! Cameras that are not calibrated: focal length and radial distortion, found with the poses.
//!
//! A camera whose rays `m` are `m' = m (1 + a + b |m|²)` in truth has, with `s = m' / (1 + a)` and `β = b / (1 + a)`,
//!
//! ```text
//! m  = s (1 − β s² + 3 β² s⁴ − …)
//! f' = f / (1 + a)      k₁' = (k₁ − β) / (1 + a)²      k₂' = (k₂ + 3 β² − 3 β k₁) / (1 + a)⁴
//! ```

use std::sync::Arc;

use super::bundle::{Bundle, LensCorrection};
use sizeup_heights::camera::{Camera, Distortion};
use sizeup_survey::View;

/// The lens of each view, by index, and the lenses; views with equal cameras share one. Only pinholes, with Brown's distortion or
/// without, may change.
pub(super) fn of(views: &[View]) -> (Vec<usize>, Vec<LensCorrection>) {
    let mut cameras: Vec<&Camera> = Vec::new();
    let lens_of = views
        .iter()
        .map(|view| {
            cameras.iter().position(|camera| **camera == *view.camera).unwrap_or_else(|| {
                cameras.push(&view.camera);
                cameras.len() - 1
            })
        })
        .collect();
    let lens = |camera: &&Camera| LensCorrection {
        is_free: matches!(camera.distortion, Distortion::None | Distortion::Brown { .. }),
        ..LensCorrection::default()
    };
    (lens_of, cameras.iter().map(lens).collect())
}

/// Takes what was found of the lenses into cameras and sightings.
pub(super) fn apply(views: &mut [View], bundle: &mut Bundle) {
    if bundle.lenses.iter().all(|lens| (lens.scale, lens.radial) == (0.0, 0.0)) {
        return;
    }
    let mut changed: Vec<Option<Arc<Camera>>> = vec![None; bundle.lenses.len()];
    for (view, station) in views.iter_mut().zip(&bundle.stations) {
        let lens = &bundle.lenses[station.lens];
        let camera = changed[station.lens].get_or_insert_with(|| Arc::new(corrected(&view.camera, lens)));
        view.camera = Arc::clone(camera);
    }
    bundle.apply_lenses();
}

/// Gives sightings back the rays that they had under the given cameras.
pub(super) fn take_back(bundle: &mut Bundle) {
    for lens in &mut bundle.lenses {
        let [scale, radial] = lens.applied;
        // The inverse of a small change, as above.
        (lens.scale, lens.radial) = (1.0 / (1.0 + scale) - 1.0, -radial / (1.0 + scale).powi(4));
    }
    bundle.apply_lenses();
    bundle.lenses.iter_mut().for_each(|lens| lens.applied = [0.0; 2]);
    bundle.sigmas.lens = None;
}

fn corrected(camera: &Camera, lens: &LensCorrection) -> Camera {
    if !lens.is_free {
        return camera.clone();
    }
    let longer = 1.0 + lens.scale;
    let beta = lens.radial / longer;
    let [k1, k2, k3, p1, p2] = match camera.distortion {
        Distortion::Brown { k1, k2, k3, p1, p2 } => [k1, k2, k3, p1, p2],
        _ => [0.0; 5],
    };
    let distortion = Distortion::Brown {
        k1: (k1 - beta) / longer.powi(2),
        k2: (k2 + 3.0 * beta * beta - 3.0 * beta * k1) / longer.powi(4),
        k3: k3 / longer.powi(6),
        p1: p1 / longer,
        p2: p2 / longer,
    };
    let is_ideal = camera.distortion == Distortion::None && lens.radial == 0.0;
    Camera {
        fx_px: camera.fx_px / longer,
        fy_px: camera.fy_px / longer,
        distortion: if is_ideal { Distortion::None } else { distortion },
        ..camera.clone()
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;

    #[test]
    fn a_corrected_camera_sees_the_rays_that_the_lens_has() {
        let ideal = Camera::pinhole(1200, 900, 1000.0);
        let bent = Distortion::Brown { k1: -0.08, k2: 0.01, k3: 0.002, p1: 5e-4, p2: -3e-4 };
        for given in [ideal.clone(), Camera { distortion: bent, ..ideal }] {
            let lens = LensCorrection { scale: 0.02, radial: -0.03, is_free: true, ..LensCorrection::default() };
            let camera = corrected(&given, &lens);
            for pixel in [DVec2::new(600.0, 450.0), DVec2::new(100.0, 80.0), DVec2::new(1150.0, 300.0)] {
                let ray = given.unproject(pixel).unwrap().truncate();
                let seen = camera.project(lens.ray(ray).extend(1.0)).unwrap();
                assert!(seen.distance(pixel) < 0.05, "{pixel} {seen}");
            }
        }
    }
}
