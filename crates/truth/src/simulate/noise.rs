//! Hashed value noise: the same number at the same place, whatever the order of asking.

use glam::Vec2;

/// Amplitude of an octave over that of the one twice as long: rough at every scale, as ground and walls are.
const ROUGHNESS: f32 = 0.72;

/// Length of an octave over that of the one before.
const LACUNARITY: f32 = 0.45;

/// A hash of a lattice cell (Jenkins-like mixing).
pub(super) fn hash(x: u32, y: u32, key: u32) -> u32 {
    let mut h = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77) ^ key.wrapping_mul(0xc2b2_ae3d);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    h ^ (h >> 15)
}

/// A number in [0, 1) for a lattice cell.
pub(super) fn unit(x: u32, y: u32, key: u32) -> f32 {
    (hash(x, y, key) >> 8) as f32 / 16_777_216.0
}

/// The lattice cell of a position along one axis: the largest whole number not above it, negative ones wrapped
/// around. Faster than a call of `floor`, and right for the sizes of a scene.
pub(super) fn lattice(v: f32) -> u32 {
    floor(v).cast_unsigned()
}

fn floor(v: f32) -> i32 {
    let towards_zero = v as i32;
    towards_zero - i32::from(towards_zero as f32 > v)
}

/// A number in [0, 1) for the unit cell around a position.
pub(super) fn cell(p: Vec2, key: u32) -> f32 {
    unit(lattice(p.x), lattice(p.y), key)
}

/// Smooth noise in [−1, 1], one cell per unit.
fn smooth(p: Vec2, key: u32) -> f32 {
    let (x, y) = (floor(p.x), floor(p.y));
    let f = p - Vec2::new(x as f32, y as f32);
    let (x, y) = (x.cast_unsigned(), y.cast_unsigned());
    let w = f * f * (Vec2::splat(3.0) - 2.0 * f);
    let bottom = unit(x, y, key) * (1.0 - w.x) + unit(x.wrapping_add(1), y, key) * w.x;
    let top = unit(x, y.wrapping_add(1), key) * (1.0 - w.x) + unit(x.wrapping_add(1), y.wrapping_add(1), key) * w.x;
    2.0 * (bottom * (1.0 - w.y) + top * w.y) - 1.0
}

/// Noise of several scales, roughly within [−1, 1]: waves of `longest_m`, 0.45 of that and so on down to
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
        wave_m *= LACUNARITY;
        octave += 1;
    }
    1.6 * sum / total.max(f32::MIN_POSITIVE)
}

/// Share of a detail of `size_m` that survives in a pixel of `pixel_m`: 1 from three pixels on, 0 below one.
pub(super) fn seen_share(size_m: f32, pixel_m: f32) -> f32 {
    (0.5 * (size_m / pixel_m - 1.0)).clamp(0.0, 1.0)
}
