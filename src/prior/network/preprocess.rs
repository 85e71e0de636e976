//! From a photo to the numbers a network was trained on.

use super::profile::{Fit, Profile};
use super::resize::{self, Rgb};
use crate::onnx::Tensor;
use crate::raster::Raster;

/// Rows and columns at which a photo of this size enters the network.
#[must_use]
pub fn size(profile: &Profile, width: usize, height: usize) -> (usize, usize) {
    let (width, height) = match profile.fit {
        Fit::LongestSide => {
            let (width, height) = longest_side(profile, width, height);
            (nearest_multiple(width, profile.multiple_of), nearest_multiple(height, profile.multiple_of))
        }
        Fit::ShortestSide => {
            let scale = profile.side_px as f64 / width.min(height) as f64;
            (lower_bound(profile, scale * width as f64), lower_bound(profile, scale * height as f64))
        }
    };
    (height, width)
}

fn longest_side(profile: &Profile, width: usize, height: usize) -> (usize, usize) {
    let scale = profile.side_px as f64 / width.max(height) as f64;
    // Python rounds half to even.
    let scaled = |n: usize| ((n as f64 * scale).round_ties_even() as usize).max(1);
    (scaled(width), scaled(height))
}

/// Ties go up.
fn nearest_multiple(n: usize, of: usize) -> usize {
    let down = n / of * of;
    let up = down + of;
    (if up - n <= n - down { up } else { down }).max(1)
}

/// Rounded to a multiple, but not below the wanted side.
fn lower_bound(profile: &Profile, n: f64) -> usize {
    let of = profile.multiple_of as f64;
    let rounded = (n / of).round_ties_even() * of;
    let n = if rounded < profile.side_px as f64 { (n / of).ceil() * of } else { rounded };
    n as usize
}

/// The photo as `1 × 3 × rows × columns` (with `rank = 5`: `1 × 1 × 3 × …`), normalised. `fixed_size` (rows, columns)
/// replaces the profile's own size where the graph allows no other.
#[must_use]
pub fn tensor(profile: &Profile, photo: &Raster<Rgb>, fixed_size: Option<(usize, usize)>, rank: usize) -> Tensor {
    let (rows, columns) = fixed_size.unwrap_or_else(|| size(profile, photo.width(), photo.height()));
    let fractions = match profile.fit {
        Fit::LongestSide => {
            let (width, height) = longest_side(profile, photo.width(), photo.height());
            let first = resize_bytes(photo, width, height);
            resize_bytes(&first, columns, rows).map(|pixel| pixel.map(|v| f32::from(v) / 255.0))
        }
        Fit::ShortestSide => {
            let fractions = photo.map(|pixel| pixel.map(|v| (f64::from(v) / 255.0) as f32));
            resize::cubic_fractions(&fractions, columns, rows)
        }
    };
    let channel = |c: usize| fractions.data().iter().map(move |pixel| (pixel[c] - profile.mean[c]) / profile.std[c]);
    let values = (0..3).flat_map(channel).collect();
    let mut shape = vec![1; rank - 3];
    shape.extend([3, rows, columns]);
    Tensor { shape, values }
}

/// Area mean unless a side grows, as Depth Anything 3 does in both of its steps.
fn resize_bytes(photo: &Raster<Rgb>, width: usize, height: usize) -> Raster<Rgb> {
    if (width, height) == (photo.width(), photo.height()) {
        photo.clone()
    } else if width > photo.width() || height > photo.height() {
        resize::cubic(photo, width, height)
    } else {
        resize::area(photo, width, height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::network::profile::by_name;

    #[test]
    fn sizes_are_those_of_the_original_code() {
        let da3 = by_name("da3").unwrap();
        // process_res = 504: 6000 × 4000 → 504 × 336; 1920 × 1080 → 504 × 284 → 504 × 280; 4000 × 2250 alike.
        assert_eq!(size(&da3, 6000, 4000), (336, 504));
        assert_eq!(size(&da3, 1920, 1080), (280, 504));
        assert_eq!(size(&da3, 1000, 750), (378, 504));
        let v2 = by_name("depth-anything-v2").unwrap();
        // input_size = 518, lower bound: 640 × 480 → 690.67 × 518 → 686 × 518.
        assert_eq!(size(&v2, 640, 480), (518, 686));
        assert_eq!(size(&v2, 1000, 1000), (518, 518));
    }

    #[test]
    fn channels_are_planes_and_normalised() {
        let v2 = by_name("depth-anything-v2").unwrap();
        let grey = Raster::filled(20, 20, [255_u8, 0, 128]);
        let tensor = tensor(&v2, &grey, Some((14, 28)), 5);
        assert_eq!(tensor.shape, [1, 1, 3, 14, 28]);
        let first = |c: usize| tensor.values[c * 14 * 28];
        assert!((first(0) - (1.0 - 0.485) / 0.229).abs() < 1e-5);
        assert!((first(1) - (0.0 - 0.456) / 0.224).abs() < 1e-5);
        assert!((first(2) - (128.0 / 255.0 - 0.406) / 0.225).abs() < 1e-5);
    }
}
