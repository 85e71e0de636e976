//! COCO files with instances as uncompressed run lengths (cocodataset.org, "Data format"): counts down the columns, of 0 first.

use serde::{Deserialize, Serialize};
use sizeup_heights::raster::Raster;

use super::labels::Instance;

/// All photos and instances of a split.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct CocoSet {
    /// Photos of the set.
    pub images: Vec<CocoImage>,
    /// Buildings, one entry per photo that shows one.
    pub annotations: Vec<CocoInstance>,
    /// Categories: `building` alone.
    pub categories: Vec<CocoCategory>,
}

/// A kind of thing.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CocoCategory {
    /// Id of the category.
    pub id: u32,
    /// Name of the category.
    pub name: String,
}

/// A photo, with what a network may be told of it beside its colours.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CocoImage {
    /// Id of the photo.
    pub id: usize,
    /// Its file, relative to the set.
    pub file_name: String,
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// Name of the photo's scene.
    pub scene: String,
    /// Angle between the optical axis and the downward vertical, degrees.
    pub off_nadir_deg: f64,
    /// The pixel that looks straight down.
    pub nadir_px: [f64; 2],
    /// Focal length of the camera, pixels.
    pub focal_px: f64,
    /// Size of a pixel on the ground under the camera, metres.
    pub ground_sample_m: f64,
    /// 16-bit labels, relative to the set.
    pub ground: String,
    /// 16-bit labels of roofs.
    pub roof: String,
    /// 16-bit labels of what is visible.
    pub visible: String,
    /// Depth, where there is any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<CocoPrior>,
}

/// Depth of a photo.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CocoPrior {
    /// Its file, relative to the set.
    pub file: String,
    /// What its numbers are: "depth" or `inverse_depth`.
    pub kind: sizeup_photos::prior::PriorKind,
}

/// A building in a photo.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CocoInstance {
    /// Id of the annotation.
    pub id: usize,
    /// Id of the photo.
    pub image_id: usize,
    /// Always that of a building.
    pub category_id: u32,
    /// Where its walls meet the ground, hidden or not.
    pub segmentation: CocoRle,
    /// Left, top, width, height, pixels.
    pub bbox: [usize; 4],
    /// Area of the mask, pixels.
    pub area: usize,
    /// Always 0: a single thing.
    pub iscrowd: u8,
    /// Its label in the masks.
    pub label: u16,
    /// Its id in the scene.
    pub building: String,
    /// Share of its area that nothing else hides, 0 to 1.
    pub visible_share: f64,
    /// Whether something hides a part of it.
    pub occluded: bool,
    /// Whether the photo's border cuts it off.
    pub truncated: bool,
}

/// A mask as run lengths.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CocoRle {
    /// Rows and columns of the mask.
    pub size: [usize; 2],
    /// Lengths of runs down the columns: of 0, of 1, and so on.
    pub counts: Vec<usize>,
}

/// The run lengths of one label.
#[must_use]
pub fn run_lengths(labels: &Raster<u16>, instance: &Instance) -> CocoRle {
    let (width, height) = (labels.width(), labels.height());
    let [left, top, right, bottom] = instance.bounds;
    let mut counts = Vec::new();
    // Where the current run began.
    let (mut start, mut is_inside) = (0, false);
    for col in left..right {
        for row in top..=bottom {
            let here = row < bottom && labels[(col, row)] == instance.label;
            if here != is_inside {
                let at = col * height + row;
                counts.push(at - start);
                (start, is_inside) = (at, here);
            }
        }
    }
    counts.push(width * height - start);
    CocoRle { size: [height, width], counts }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn run_lengths_give_back_the_mask() {
        for (label, bounds) in [(5, [2, 1, 5, 4]), (6, [0, 0, 6, 4])] {
            let inside = |col: usize, row: usize| {
                if label == 5 {
                    (2..5).contains(&col) && (1..4).contains(&row) && (col, row) != (3, 2)
                } else {
                    col != 3
                }
            };
            let value = |i: usize| if inside(i % 6, i / 6) { label } else { 0 };
            let labels = Raster::from_vec(6, 4, (0..24).map(value).collect()).unwrap();
            let instance = Instance { label, area_px: 8, visible_share: 1.0, bounds, is_cut: false };
            let rle = run_lengths(&labels, &instance);
            let flat: Vec<bool> = rle.counts.iter().enumerate().flat_map(|(i, n)| vec![i % 2 == 1; *n]).collect();
            let expected: Vec<bool> = (0..24).map(|i| inside(i / 4, i % 4)).collect();
            assert_eq!(flat, expected);
        }
    }
}
