//! The priors of a run, and what is green in its photos: what was computed is kept, so that solving again, correcting edge bleeding
//! and the pictures at the end do not ask the network, the matcher or the decoder a second time.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use sizeup_geo::kept::Kept;
use sizeup_heights::raster::Raster;
use sizeup_photos::prior::{DepthPrior, PriorError, PriorSource as _, Priors};
use sizeup_photos::vegetation;
use sizeup_survey::{Survey, View};

use super::PipelineError;
use super::scene::SceneStage;
use super::settings::HeightSettings;

/// Memory that a run keeps computed priors in, bytes: some 350 of 518 × 350 pixels.
const KEPT_BYTES: usize = 256 << 20;

/// Memory for what is green in photos, bytes: some 450 at the usual working size.
const GREEN_BYTES: usize = 64 << 20;

/// A source of priors that remembers.
pub(super) struct PriorStore {
    source: Priors,
    /// The views as the survey has them: priors are theirs, wherever heights are measured from.
    views: Vec<View>,
    /// By the view's position, weighed in bytes.
    kept: Kept<usize, DepthPrior>,
    /// Longer side of the photos that vegetation is detected in; `None` where it is not masked.
    green_px: Option<u32>,
    green: Kept<usize, Option<Arc<Raster<bool>>>>,
    /// By the view's position: why its photo cannot be read.
    unread: Mutex<BTreeMap<usize, String>>,
}

impl PriorStore {
    /// Priors of a run.
    pub fn open(settings: &HeightSettings<'_>, survey: &Survey, stage: &SceneStage) -> Result<Self, PipelineError> {
        let source = settings.prior.open(&survey.views, &stage.terrain, stage.scene.bounds.max_m)?;
        Ok(Self::new(settings, source, survey, KEPT_BYTES))
    }

    /// One that forgets, where memory is counted.
    pub fn forgetful(settings: &HeightSettings<'_>, source: Priors, survey: &Survey) -> Self {
        Self::new(settings, source, survey, 0)
    }

    fn new(settings: &HeightSettings<'_>, source: Priors, survey: &Survey, kept_bytes: usize) -> Self {
        let optimise = &settings.method.optimise;
        let green_px = optimise.leaves_out_vegetation().then_some(optimise.working_px);
        let bytes_of_one = green_px.map_or(1, |side| (side as usize).pow(2) * 2 / 3).max(1);
        Self {
            source,
            views: survey.views.clone(),
            kept: Kept::up_to(kept_bytes),
            green_px,
            green: Kept::up_to(GREEN_BYTES / bytes_of_one),
            unread: Mutex::default(),
        }
    }

    /// Source that the priors come from.
    pub fn source(&self) -> &Priors {
        &self.source
    }

    /// Whether a view's prior can be had without computing it.
    pub fn is_at_hand(&self, view: usize) -> bool {
        self.source.are_at_hand() || self.kept.find(&view).is_some()
    }

    /// Why a view has no prior, as far as that is known without reading or computing one.
    pub fn absence(&self, view: usize) -> Option<String> {
        self.source.absence(&self.views[view]).map(|e| e.to_string())
    }

    /// The prior of a view by its position, along the optical axis.
    pub fn load(&self, view: usize) -> Result<DepthPrior, PriorError> {
        if let Some(prior) = self.kept.find(&view) {
            return Ok(prior.as_ref().clone());
        }
        let of = &self.views[view];
        let prior = self.source.load(of)?.to_z_depth(&of.camera);
        if !matches!(self.source, Priors::Files(_)) {
            self.kept.add(view, prior.clone(), size_of_val(prior.values.data()));
        }
        Ok(prior)
    }

    /// Pixels of a view's photo that are as green as leaves, by its position; `None` where vegetation is not masked, or the photo cannot be read.
    pub fn green(&self, view: usize) -> Option<Arc<Raster<bool>>> {
        let (of, long_side_px) = (&self.views[view], self.green_px?);
        let look = || vegetation::green(of, long_side_px).map(|green| green.map(Arc::new));
        let found = self.green.get(&view, look);
        match found {
            Ok(green) => green.as_ref().clone(),
            Err(why) => {
                self.unread.lock().unwrap_or_else(PoisonError::into_inner).insert(view, why.to_string());
                None
            }
        }
    }

    /// The views whose photos could not be read, by their positions, and why.
    pub fn unread_photos(&self) -> Vec<(usize, String)> {
        self.unread.lock().unwrap_or_else(PoisonError::into_inner).clone().into_iter().collect()
    }
}
