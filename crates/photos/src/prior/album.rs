//! Reduced photos that many askers share: each is read once, and those asked for last are kept.

use std::sync::Arc;

use super::PriorError;
use super::stereo::load_picture;
use sizeup_geo::kept::Kept;
use sizeup_heights::ids::ViewId;
use sizeup_heights::picture::Picture;
use sizeup_survey::View;

/// The pictures used last, at one size.
#[derive(Debug)]
pub struct Album {
    long_side_px: u32,
    pictures: Kept<ViewId, Picture>,
}

impl Album {
    /// An empty one: longer side of its pictures, pixels, and the most memory they may take (but for those in use), bytes.
    #[must_use]
    pub fn new(long_side_px: u32, max_bytes: usize) -> Self {
        let max_pictures = (max_bytes / Self::bytes_of_one(long_side_px).max(1)).max(1);
        Self { long_side_px, pictures: Kept::up_to(max_pictures) }
    }

    /// Memory of one picture, bytes.
    #[must_use]
    pub fn bytes_of_one(long_side_px: u32) -> usize {
        // Photos are hardly ever narrower than 3 : 2.
        (long_side_px as usize).pow(2) * 2 / 3 * size_of::<f32>()
    }

    /// The reduced photo of a view; one that several threads ask for at once is read by one of them.
    ///
    /// # Errors
    /// [`PriorError`]: a photo that is not there or cannot be read.
    pub fn picture(&self, view: &View) -> Result<Arc<Picture>, PriorError> {
        self.pictures.get(&view.id, || load_picture(view, self.long_side_px))
    }
}
