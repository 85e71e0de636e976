//! Boxes and lengths as a tileset has them: whole millimetres, outwards.

use glam::DVec3;

/// Half a millimetre: rounding to single precision must not put a vertex outside its box.
const BOX_MARGIN_M: f64 = 5e-4;
/// Boxes begin and end at whole millimetres, so that one within another stays so, and numbers are short.
const STEPS_A_METRE: f64 = 1000.0;

/// Length, rounded up.
pub fn rounded_up(metres: f64) -> f64 {
    (metres * STEPS_A_METRE).ceil() / STEPS_A_METRE
}

/// Centre and half axes in the tileset's axes (z up), from a box in glTF's (y up).
pub fn bounding_box([low, high]: [DVec3; 2]) -> [f64; 12] {
    let enu_from_gltf = |p: DVec3| DVec3::new(p.x, -p.z, p.y);
    let (a, b) = (enu_from_gltf(low), enu_from_gltf(high));
    let low = ((a.min(b) - BOX_MARGIN_M) * STEPS_A_METRE).floor();
    let high = ((a.max(b) + BOX_MARGIN_M) * STEPS_A_METRE).ceil();
    let (centre, half) = ((low + high) / (2.0 * STEPS_A_METRE), (high - low) / (2.0 * STEPS_A_METRE));
    [centre.x, centre.y, centre.z, half.x, 0.0, 0.0, 0.0, half.y, 0.0, 0.0, 0.0, half.z]
}
