//! Hashed value noise: the same number at the same place, whatever the order of asking.

use glam::Vec2;

/// Amplitude of an octave over that of the one twice as long: rough at every scale, as ground and walls are.
const ROUGHNESS: f32 = 0.72;

/// A hash of a lattice cell (Jenkins-like mixing).
pub(super) fn hash(x: i32, y: i32, key: u32) -> u32 {
    let mut h =
        (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77) ^ key.wrapping_mul(0xc2b2_ae3d);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    h ^ (h >> 15)
}

/// A number in [0, 1) for a lattice cell.
pub(super) fn unit(x: i32, y: i32, key: u32) -> f32 {
    (hash(x, y, key) >> 8) as f32 / 16_777_216.0
}

/// A number in [0, 1) for the unit cell around a position.
pub(super) fn cell(p: Vec2, key: u32) -> f32 {
    unit(p.x.floor() as i32, p.y.floor() as i32, key)
}

/// Smooth noise in [−1, 1], one cell per unit.
fn smooth(p: Vec2, key: u32) -> f32 {
    let base = p.floor();
    let f = p - base;
    let w = f * f * (Vec2::splat(3.0) - 2.0 * f);
    let (x, y) = (base.x as i32, base.y as i32);
    let bottom = unit(x, y, key) * (1.0 - w.x) + unit(x.wrapping_add(1), y, key) * w.x;
    let top = unit(x, y.wrapping_add(1), key) * (1.0 - w.x) + unit(x.wrapping_add(1), y.wrapping_add(1), key) * w.x;
    2.0 * (bottom * (1.0 - w.y) + top * w.y) - 1.0
}

/// Noise of several scales, roughly within [−1, 1]: waves of `longest_m`, half of that and so on down to
/// `shortest_m`, leaving out those too short for a pixel of `pixel_m`.
pub(super) fn fractal(p_m: Vec2, longest_m: f32, shortest_m: f32, pixel_m: f32, key: u32) -> f32 {
    let (mut wave_m, mut amplitude, mut sum, mut total, mut octave) = (longest_m, 1.0, 0.0, 0.0, 0);
    while wave_m >= shortest_m {
        total += amplitude;
        let share = seen_share(wave_m, pixel_m);
        if share > 0.0 {
            sum += amplitude * share * smooth(p_m / wave_m, key.wrapping_add(octave * 0x51));
        }
        amplitude *= ROUGHNESS;
        wave_m *= 0.5;
        octave += 1;
    }
    1.6 * sum / total.max(f32::MIN_POSITIVE)
}

/// How much of a detail of `size_m` survives in a pixel of `pixel_m`: 1 from three pixels on, 0 below one.
pub(super) fn seen_share(size_m: f32, pixel_m: f32) -> f32 {
    (0.5 * (size_m / pixel_m - 1.0)).clamp(0.0, 1.0)
}
