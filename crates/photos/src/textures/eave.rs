//! The upper edge of walls: where a wall is modelled too high, photos show the roof there.
//!
//! ```text
//! per column, from below:  a texel of the strip is the wall's where its neighbourhood is within a limit of the mean below the strip
//! ```
//!
//! From the first texel that is not, all above it are unknown. So a wall whose photos show it to its edge keeps them, however uncertain the level
//! of its roof is: half-metre texels would else lose a fifth of a village's walls.

use image::RgbImage;

use super::chart::Chart;
use super::paint::AGREES_WITHIN;

/// Texels on each side of a column that are compared with it: single texels are noisy.
const BESIDE_PX: u32 = 1;
/// Fewest texels below the strip that a column is compared with; a first choice.
const LEAST_BELOW_PX: u32 = 2;

/// Takes out the texels that may show the roof: `eave_px` below the wall's upper edge, at most.
pub(super) fn clear(chart: &Chart, picture: &RgbImage, known: &mut [bool], eave_px: u32) {
    let shown = known.to_vec();
    for x in 0..chart.size.x {
        let mut top = 0;
        while let Some(first) = (top..chart.size.y).find(|&y| chart.is_inside(x, y)) {
            let end = (first..chart.size.y).find(|&y| !chart.is_inside(x, y)).unwrap_or(chart.size.y);
            let strip = first..(first + eave_px).min(end);
            let below = strip.end..(strip.end + eave_px.max(LEAST_BELOW_PX)).min(end);
            let below = mean(chart, picture, &shown, x, below);
            let is_wall = |y: u32| {
                let own = mean(chart, picture, &shown, x, y..y + 1);
                own.zip(below).is_some_and(|(a, b)| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= AGREES_WITHIN))
            };
            if let Some(lowest) = strip.clone().rev().find(|&y| !is_wall(y)) {
                (strip.start..=lowest).for_each(|y| known[(y * chart.size.x + x) as usize] = false);
            }
            top = end;
        }
    }
}

/// Mean of the known texels in some rows of a column and of those beside it; `None` without any.
fn mean(chart: &Chart, picture: &RgbImage, known: &[bool], x: u32, rows: std::ops::Range<u32>) -> Option<[f32; 3]> {
    let columns = x.saturating_sub(BESIDE_PX)..(x + BESIDE_PX + 1).min(chart.size.x);
    let (mut n, mut sum) = (0.0_f32, [0.0_f32; 3]);
    for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
        if known[(y * chart.size.x + x) as usize] {
            n += 1.0;
            picture.get_pixel(x, y).0.iter().zip(&mut sum).for_each(|(v, sum)| *sum += f32::from(*v));
        }
    }
    (n > 0.0).then(|| sum.map(|v| v / n))
}

#[cfg(test)]
mod tests {
    use glam::UVec2;
    use image::Rgb;

    use super::*;

    /// Rows that stay known of a wall of 5 × 10 texels whose uppermost `n_roof` rows show a roof, where the edge is uncertain by 4.
    fn known_rows(n_roof: u32) -> Vec<u32> {
        let chart = Chart::filled(UVec2::new(5, 10));
        let colour = |_, y| if y < n_roof { Rgb([150, 60, 50]) } else { Rgb([200, 200, 190]) };
        let picture = RgbImage::from_fn(5, 10, colour);
        let mut known = vec![true; 50];
        clear(&chart, &picture, &mut known, 4);
        (0..10).filter(|y| (0..5).all(|x| known[y * 5 + x])).map(|y| y as u32).collect()
    }

    #[test]
    fn a_wall_that_shows_itself_to_its_edge_is_kept_and_the_roof_on_it_is_taken_out() {
        assert_eq!(known_rows(0), (0..10).collect::<Vec<_>>());
        assert_eq!(known_rows(2), (2..10).collect::<Vec<_>>());
        assert_eq!(known_rows(3), (3..10).collect::<Vec<_>>());
    }
}
