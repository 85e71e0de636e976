//! Reduced photos that many askers share: each is read once, and those asked for last are kept.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::PriorError;
use super::stereo::Picture;
use crate::ids::ViewId;
use crate::survey::View;

/// Room for one picture.
type Slot = Arc<Mutex<Option<Arc<Picture>>>>;

/// The pictures used last, at one size.
#[derive(Debug)]
pub(crate) struct Album {
    long_side_px: u32,
    max_pictures: usize,
    pictures: Mutex<Pictures>,
}

#[derive(Debug, Default)]
struct Pictures {
    /// When each was asked for last, and the picture.
    slots: HashMap<ViewId, (u64, Slot)>,
    clock: u64,
}

impl Album {
    /// An empty one: longer side of its pictures, pixels, and the most memory they may take (but for those in use), bytes.
    pub fn new(long_side_px: u32, max_bytes: usize) -> Self {
        let max_pictures = (max_bytes / Self::bytes_of_one(long_side_px).max(1)).max(1);
        Self { long_side_px, max_pictures, pictures: Mutex::default() }
    }

    /// Memory of one picture, bytes.
    pub fn bytes_of_one(long_side_px: u32) -> usize {
        // Photos are hardly ever narrower than 3 : 2.
        (long_side_px as usize).pow(2) * 2 / 3 * size_of::<f32>()
    }

    /// The reduced photo of a view; one that several threads ask for at once is read by one of them.
    pub fn picture(&self, view: &View) -> Result<Arc<Picture>, PriorError> {
        // Pictures are whole or absent, so a panic elsewhere leaves nothing half-done here.
        let slot = self.pictures.lock().unwrap_or_else(PoisonError::into_inner).slot(&view.id, self.max_pictures);
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(picture) = &*slot {
            return Ok(Arc::clone(picture));
        }
        let picture = Arc::new(Picture::load(view, self.long_side_px)?);
        *slot = Some(Arc::clone(&picture));
        Ok(picture)
    }
}

impl Pictures {
    fn slot(&mut self, id: &ViewId, max_pictures: usize) -> Slot {
        self.clock += 1;
        if self.slots.len() >= max_pictures && !self.slots.contains_key(id) {
            let oldest = self.slots.iter().min_by_key(|(_, (used, _))| *used).map(|(id, _)| id.clone());
            oldest.map(|id| self.slots.remove(&id));
        }
        let (used, slot) = self.slots.entry(id.clone()).or_default();
        *used = self.clock;
        Arc::clone(slot)
    }
}
