//! COLMAP's camera models by number and name, and which of ours each is.

use std::sync::Arc;

use sizeup_heights::camera::{Camera, Distortion};

/// COLMAP's models in the order of their numbers: name, number of parameters.
const MODELS: [(&str, usize); 18] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
];

/// Name and number of parameters of a model number.
pub(super) fn by_number(number: i32) -> Option<(&'static str, usize)> {
    usize::try_from(number).ok().and_then(|i| MODELS.get(i)).copied()
}

/// Our camera of a COLMAP model, or why there is none.
pub(super) fn camera(name: &str, width_px: u64, height_px: u64, params: &[f64]) -> Result<Arc<Camera>, String> {
    let Some((_, n_params)) = MODELS.iter().find(|(known, _)| *known == name) else {
        return Err(format!("unknown camera model {name}: expected one of COLMAP's, such as PINHOLE or OPENCV"));
    };
    if params.len() != *n_params {
        return Err(format!("camera model {name} with {} parameters: expected {n_params}", params.len()));
    }
    let size = |n: u64| u32::try_from(n).map_err(|_| format!("image side of {n} px: expected at most 4294967295"));
    let p = |i: usize| params[i];
    // One focal length before the principal point, or two.
    let has_one_focal = matches!(
        name,
        "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" | "SIMPLE_FISHEYE"
    );
    let (fx_px, fy_px, rest) = if has_one_focal { (p(0), p(0), 1) } else { (p(0), p(1), 2) };
    let brown = |k1, k2, p1, p2| Distortion::Brown { k1, k2, k3: 0.0, p1, p2 };
    let fisheye = |k1, k2, k3, k4| Distortion::Fisheye { k1, k2, k3, k4 };
    let distortion = match name {
        "SIMPLE_PINHOLE" | "PINHOLE" => Distortion::None,
        "SIMPLE_RADIAL" => brown(p(3), 0.0, 0.0, 0.0),
        "RADIAL" => brown(p(3), p(4), 0.0, 0.0),
        "OPENCV" => brown(p(4), p(5), p(6), p(7)),
        "FULL_OPENCV" if params[9..].iter().all(|&k| k == 0.0) => {
            Distortion::Brown { k1: p(4), k2: p(5), k3: p(8), p1: p(6), p2: p(7) }
        }
        "FULL_OPENCV" => {
            Distortion::Rational { k1: p(4), k2: p(5), p1: p(6), p2: p(7), k3: p(8), k4: p(9), k5: p(10), k6: p(11) }
        }
        "OPENCV_FISHEYE" => fisheye(p(4), p(5), p(6), p(7)),
        "SIMPLE_RADIAL_FISHEYE" => fisheye(p(3), 0.0, 0.0, 0.0),
        "RADIAL_FISHEYE" => fisheye(p(3), p(4), 0.0, 0.0),
        "SIMPLE_FISHEYE" | "FISHEYE" => fisheye(0.0, 0.0, 0.0, 0.0),
        _ => {
            return Err(format!(
                "camera model {name} is not supported: undistort the photos with COLMAP's image_undistorter first"
            ));
        }
    };
    let camera = Camera {
        width_px: size(width_px)?,
        height_px: size(height_px)?,
        fx_px,
        fy_px,
        cx_px: p(rest),
        cy_px: p(rest + 1),
        distortion,
    };
    camera.validate().map_err(|e| e.to_string())?;
    Ok(Arc::new(camera))
}
