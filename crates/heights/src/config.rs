//! Settings of the height optimisation: two presets. Fields that no configuration sets are for studies and tests.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::scene::{HeightReference, RoofForm};
use crate::views::{ViewsConfig, ViewsSettings};

/// Which height solver runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// The publication: dynamic view selection, ordinal hinge, gradient descent. What its text leaves open is listed in
    /// `docs/concepts.md`, and a setting each.
    Paper,
    /// Ours: local search over an affine-blind correlation per building, then its roof's form.
    #[default]
    Robust,
}

/// Settings of the height optimisation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(extend("x-expert" = true))]
pub struct OptimiseConfig {
    /// Which solver; each reads its own table below and the views' defaults that go with it.
    #[schemars(extend("x-expert" = false))]
    pub preset: Preset,
    /// Which height of a pitched roof the result states (`robust` only: `paper` knows flat roofs alone).
    pub height_reference: HeightReference,
    /// Longer side of the images that rays are sampled in, pixels (priors of another size are interpolated).
    #[schemars(extend("x-expert" = false))]
    pub working_px: u32,
    /// One ray per block of this many pixels squared (4: 9,400 rays in a 448 × 336 view).
    pub stride_px: usize,
    /// View selection; what is absent is the preset's own.
    #[serde(skip)]
    pub views: ViewsSettings,
    /// The ordinal optimiser (`preset = "paper"`).
    #[serde(skip)]
    pub ordinal: OrdinalConfig,
    /// The local search (`preset = "robust"`).
    pub search: SearchConfig,
}

impl Default for OptimiseConfig {
    fn default() -> Self {
        Self {
            preset: Preset::Robust,
            height_reference: HeightReference::Mean,
            working_px: 448,
            stride_px: 4,
            views: ViewsSettings::default(),
            ordinal: OrdinalConfig::default(),
            search: SearchConfig::default(),
        }
    }
}

impl OptimiseConfig {
    /// Whether photos are asked what is green.
    #[must_use]
    pub fn leaves_out_vegetation(&self) -> bool {
        self.preset == Preset::Robust && self.search.leave_out_vegetation
    }

    /// The view selection in force.
    #[must_use]
    pub fn views_in_force(&self) -> ViewsConfig {
        self.views.over(&match self.preset {
            Preset::Paper => ViewsConfig::paper(),
            Preset::Robust => ViewsConfig::robust(),
        })
    }
}

/// Which part of the loss's derivative is followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Gradient {
    /// Roofs get nearer as they rise; which pixels are roof is held fixed (what automatic differentiation sees).
    #[default]
    Interior,
    /// Exact central difference of each pair's cost, silhouettes included.
    CentralDifference,
    /// The interior part, and what roof edges pass as they move, sampled along the edges: the derivative of the expected
    /// loss. A reference to judge the others by; each step loads the view's prior again.
    EdgeSampled,
}

/// Whether the derivative knows that the scale of a view's depths (their median absolute deviation) depends on the heights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MadGradient {
    /// The scale is held fixed.
    #[default]
    Detached,
    /// It is differentiated, for pixels that stay the same. It rests on two pixels of the view (of an even count the lower
    /// middle is the median) and flips its sign from step to step: for tests and comparisons.
    Exact,
}

/// Pixels of a view that are compared in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Region {
    /// Pixels on buildings (the paper's Ω).
    #[default]
    Buildings,
    /// Pixels on buildings and on the ground that a building of greatest height would hide.
    BuildingsAndGround,
}

/// Loss over the pixels of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Loss {
    /// The hinge over pairs of pixels (the paper's).
    #[default]
    Ordinal,
    /// Absolute differences of normalised inverse depth: a yardstick that differs by nothing but this.
    L1,
    /// Squared differences of normalised inverse depth: the same.
    L2,
}

/// After how much of the loss a step is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepOn {
    /// The loss of one view, in a random order: as many steps per epoch as there are selected views.
    #[default]
    View,
    /// The sum over all selected views, as the paper's `L = Σ_k L^k` reads: `steps_per_epoch` steps per epoch.
    AllViews,
}

/// Settings of the ordinal optimiser (`SiZeUp`, "Objective function"). Defaults are the paper's where it states them (epochs,
/// pairs, contrast, margin, refresh); what it leaves open says so.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OrdinalConfig {
    /// Passes over the selected views.
    pub epochs: usize,
    /// Loss: `ordinal`, or `l1` and `l2` to compare with.
    pub loss: Loss,
    /// Whether a step follows one view's loss (`view`) or the sum over all selected ones (`all_views`). Left open.
    pub step_on: StepOn,
    /// Steps per epoch (`step_on = "all_views"`). Left open.
    pub steps_per_epoch: usize,
    /// Mean of the normal distribution that heights start from, as a share of the range of heights: 0 the least, 1 the
    /// greatest. Left open.
    pub start_mean_share: f32,
    /// Standard deviation of that distribution, as a share of the range of heights. Left open.
    pub start_sigma_share: f32,
    /// Pixel pairs per view and step.
    pub n_pairs: usize,
    /// Least prior contrast of a pair that has a vote, in median absolute deviations (the paper's `τ_d`).
    pub min_contrast: f32,
    /// Margin of the hinge, in median absolute deviations (the paper's m).
    pub margin: f32,
    /// Pixels of a view that are compared in order.
    pub region: Region,
    /// Which part of the derivative is followed. Left open.
    pub gradient: Gradient,
    /// Whether the scale of a view's rendered depths is differentiated too: `detached` (no) or `exact`. Left open.
    pub mad_gradient: MadGradient,
    /// Points sampled along each roof edge (`gradient = "edge_sampled"`).
    pub edge_points: usize,
    /// Pixels that each of these points is compared with (`gradient = "edge_sampled"`).
    pub edge_partners: usize,
    /// Half width of the central difference at the first and last step, metres (annealed geometrically).
    pub difference_m: [f32; 2],
    /// Adam's step at the first and last step, metres (annealed geometrically over the run). Left open.
    pub step_m: [f32; 2],
    /// Views are selected again every so many epochs.
    pub reselect_every: usize,
}

impl Default for OrdinalConfig {
    fn default() -> Self {
        Self {
            epochs: 20,
            loss: Loss::Ordinal,
            step_on: StepOn::View,
            steps_per_epoch: 20,
            start_mean_share: 0.1,
            start_sigma_share: 0.05,
            n_pairs: 2048,
            min_contrast: 0.05,
            margin: 0.5,
            region: Region::Buildings,
            gradient: Gradient::Interior,
            mad_gradient: MadGradient::Detached,
            edge_points: 16,
            edge_partners: 256,
            difference_m: [10.0, 0.5],
            step_m: [6.0, 0.3],
            reselect_every: 3,
        }
    }
}

/// Which rays bring a view's prior to metres.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CalibrationRays {
    /// All: buildings as they stand, and the ground.
    #[default]
    All,
    /// Those that would meet the ground if every building had the height that searches start from: a height depends on
    /// those of its neighbours alone, not on all others that its photos show.
    Ground,
    /// None: priors are depths in metres as they are. What they show above the ground outside of all footprints is then known
    /// to be something that the scene does not have. A run sets it for stereo.
    None,
}

/// Height that every building starts from, metres. Low: a tall start hides what stands behind it.
pub(crate) const START_HEIGHT_M: f32 = 6.0;
/// Log-spaced heights tried in a full sweep.
pub(crate) const N_COARSE: usize = 48;
/// Evenly spaced heights tried around the best one.
pub(crate) const N_FINE: usize = 17;
/// Half width of the first local sweep: a fixed part, metres.
pub(crate) const LOCAL_HALF_WIDTH_M: f32 = 6.0;
/// Half width of the first local sweep: a part of the height.
pub(crate) const LOCAL_HALF_WIDTH_SHARE: f32 = 0.3;
/// Ground around a building's pixels that is compared with them, pixels of the working image.
pub(crate) const DILATE_PX: usize = 12;
/// The same in the local sweeps and for roof forms.
pub(crate) const LOCAL_DILATE_PX: usize = 8;
/// The same there for priors in metres (`calibrate_on = "none"`), whose relief is exact: more.
pub(crate) const METRIC_AGREEMENT_WEIGHT: f32 = 0.4;
/// Greatest number of views a building is measured in.
pub(crate) const MAX_VIEWS_PER_BUILDING: usize = 24;

/// Settings of the local search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[expect(clippy::struct_excessive_bools, reason = "each switches a step of the search, whatever the others do")]
pub struct SearchConfig {
    /// Sweeps over the full range of heights.
    #[serde(skip)]
    pub full_sweeps: usize,
    /// Sweeps close to the present height, after the full ones.
    #[serde(skip)]
    pub local_sweeps: usize,
    /// Whether depth edges that lie beside the walls they belong to are moved back, after the full sweeps.
    #[serde(skip)]
    pub correct_edge_bleeding: bool,
    /// Whether it is measured how far the footprint layer as a whole, and single footprints, lie from where the photos show their
    /// buildings; where a layer is off by 0.75 m or more, and where a footprint is, heights are measured where the photos show them.
    pub measure_shift: bool,
    /// The same of single footprints, at the end.
    #[serde(skip)]
    pub measure_footprints: bool,
    /// Whether trees over roofs are left out of what is compared, by the green of the photos, where these can be read.
    pub leave_out_vegetation: bool,
    /// Whether footprints that hold two roof levels (a tower on its podium) are split, after the full sweeps.
    pub split_levels: bool,
    /// Forms of roofs that are tried after the sweeps, besides the flat one. None: all are flat.
    #[serde(skip)]
    pub roof_forms: Vec<RoofForm>,
    /// Weight of the agreement of roof pixels with the calibrated prior, against the correlation's 1. 0 = ordering only.
    #[serde(skip)]
    pub agreement_weight: f32,
    /// The same in the local sweeps and for roof forms: less, as a prior's relief is less exact than its edges.
    #[serde(skip)]
    pub local_agreement_weight: f32,
    /// Weight of the agreement added for surroundings that look wholly at what the scene does not have (buildings without
    /// a footprint): edges there are not to be trusted.
    #[serde(skip)]
    pub unmodelled_agreement_weight: f32,
    /// Which rays bring a view's prior to metres: `all`, `ground`, or `none` for priors that are in metres, as stereo's are.
    pub calibrate_on: CalibrationRays,
    /// Views are selected again after so many full sweeps.
    #[serde(skip)]
    pub reselect_every: usize,
}

impl OptimiseConfig {
    /// Whether priors of the wrong shape are straightened along the ground: not by `paper`, which needs their order alone, nor where
    /// they are in metres.
    pub(crate) fn may_straighten(&self) -> bool {
        self.preset == Preset::Robust && self.search.calibrate_on != CalibrationRays::None
    }
}

impl SearchConfig {
    /// Weight of the agreement in local sweeps and for roof forms.
    pub(crate) fn local_agreement(&self) -> f32 {
        match self.calibrate_on {
            CalibrationRays::None => METRIC_AGREEMENT_WEIGHT,
            CalibrationRays::All | CalibrationRays::Ground => self.local_agreement_weight,
        }
    }
}

impl Default for SearchConfig {
    fn default() -> Self {
        Self {
            full_sweeps: 5,
            local_sweeps: 3,
            correct_edge_bleeding: true,
            measure_shift: true,
            measure_footprints: true,
            leave_out_vegetation: true,
            split_levels: true,
            roof_forms: vec![RoofForm::Gable, RoofForm::Hip, RoofForm::Stepped],
            agreement_weight: 0.1,
            local_agreement_weight: 0.03,
            unmodelled_agreement_weight: 0.3,
            calibrate_on: CalibrationRays::default(),
            reselect_every: 3,
        }
    }
}
