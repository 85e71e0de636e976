//! The rays of a problem's views, each view's traced when first asked for, and the priors along them: both are kept while footprints change.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::evidence::SampledPrior;
use crate::optimise::solve::{Problem, ViewInput};
use crate::render::profile::{CappedScene, ProfileRay, Profiles, Sampling};

/// Ray profiles by view, of one scene and one survey.
pub struct Rays {
    stride_px: usize,
    capped: OnceLock<CappedScene>,
    views: Vec<ViewRays>,
}

#[derive(Default)]
struct ViewRays {
    profiles: OnceLock<Profiles>,
    /// Places where the rays meet the ground, from a scene with other footprints; taken when they are traced.
    on_ground: Mutex<Option<Vec<ProfileRay>>>,
    /// The view's prior, once loaded.
    prior: OnceLock<Arc<SampledPrior>>,
}

impl Rays {
    /// None traced yet; one in `stride_px × stride_px` pixels of each of `n_views` views.
    #[must_use]
    pub fn new(n_views: usize, stride_px: usize) -> Self {
        let views = (0..n_views).map(|_| ViewRays::default()).collect();
        Self { stride_px, capped: OnceLock::new(), views }
    }

    /// The same rays for a scene whose footprints lie within those of this one, over the same ground in the same frame:
    /// what they meet of the ground is kept.
    #[must_use]
    pub fn of_other_footprints(self) -> Self {
        let keep = |view: ViewRays| {
            let known = view.profiles.into_inner().map(|profiles| profiles.rays);
            ViewRays { profiles: OnceLock::new(), on_ground: Mutex::new(known), prior: view.prior }
        };
        Self { capped: OnceLock::new(), views: self.views.into_iter().map(keep).collect(), ..self }
    }

    /// The same rays for a scene in which single footprints lie elsewhere, over the same ground in the same frame: what they meet of the
    /// ground is known, and so are priors.
    #[must_use]
    pub fn of_moved_footprints(&self) -> Self {
        let keep = |view: &ViewRays| {
            let known = view.profiles.get().map(|profiles| profiles.rays.clone());
            ViewRays { profiles: OnceLock::new(), on_ground: Mutex::new(known), prior: view.prior.clone() }
        };
        Self { stride_px: self.stride_px, capped: OnceLock::new(), views: self.views.iter().map(keep).collect() }
    }

    /// The prior of a view, by its position, where it has been loaded.
    pub(super) fn prior(&self, view: usize) -> Option<&Arc<SampledPrior>> {
        self.views[view].prior.get()
    }

    /// Keeps the prior of a view. Returns the one that is kept.
    pub(super) fn keep_prior(&self, view: usize, prior: SampledPrior) -> &Arc<SampledPrior> {
        self.views[view].prior.get_or_init(|| Arc::new(prior))
    }

    /// The profiles of a view of their problem, by its position.
    pub(super) fn of(&self, problem: &Problem<'_>, view: usize) -> &Profiles {
        let ViewRays { profiles, on_ground, .. } = &self.views[view];
        profiles.get_or_init(|| {
            let Problem { scene, seed, .. } = *problem;
            let capped = self.capped.get_or_init(|| CappedScene::new(scene));
            let ViewInput { placed, key, .. } = &problem.views[view];
            let known = on_ground.lock().unwrap_or_else(PoisonError::into_inner).take();
            match known {
                Some(rays) => Profiles::over(scene, capped, placed, &rays),
                None => {
                    let sampling = Sampling { stride_px: self.stride_px, seed, view: *key };
                    Profiles::trace(scene, capped, placed, sampling)
                }
            }
        })
    }
}
