//! Patches of false heights: a surface holds together over as many pixels as are compared at once, and chance does not.

use super::levels::Levels;
use sizeup_heights::raster::Raster;

/// Neighbouring pixels whose heights are so many levels apart belong to one surface.
const SAME_LEVELS: f64 = 1.5;

/// Takes the heights of all surfaces away that have fewer pixels.
pub(super) fn leave_out(heights_m: &mut Raster<f32>, levels: &Levels, least_px: usize) {
    let level: Vec<f32> = heights_m.data().iter().map(|z| levels.level(f64::from(*z)) as f32).collect();
    let mut is_seen: Vec<bool> = heights_m.data().iter().map(|z| z.is_nan()).collect();
    let mut surface = Vec::new();
    for start in 0..level.len() {
        if is_seen[start] {
            continue;
        }
        is_seen[start] = true;
        surface.clear();
        surface.push(start);
        let mut next = 0;
        while let Some(&i) = surface.get(next) {
            next += 1;
            for j in heights_m.beside(i) {
                if !is_seen[j] && f64::from((level[j] - level[i]).abs()) <= SAME_LEVELS {
                    is_seen[j] = true;
                    surface.push(j);
                }
            }
        }
        if surface.len() < least_px {
            surface.iter().for_each(|&i| heights_m.data_mut()[i] = f32::NAN);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_pixels_far_from_all_around_them_go_and_a_sloping_surface_stays() {
        let levels = Levels::every_metre(100.0);
        // Rising by a tenth of a level from pixel to pixel.
        let mut heights = Raster::from_vec(20, 5, (0..100).map(|i| (i % 20) as f32 * 0.1).collect()).unwrap();
        for i in [43, 44, 63, 64] {
            heights.data_mut()[i] = 15.0;
        }
        heights.data_mut()[0] = f32::NAN;
        leave_out(&mut heights, &levels, 5);
        let gone: Vec<usize> = (0..100).filter(|i| heights.data()[*i].is_nan()).collect();
        assert_eq!(gone, [0, 43, 44, 63, 64]);
    }
}
