//! What the solvers return.

use serde::{Deserialize, Serialize};

use crate::evidence::straighten::PriorShape;
use crate::optimise::layer_shift::{LayerShift, LevelOff};
use crate::roofs::Roof;
use crate::scene::{HeightBounds, HeightReference};
use crate::search::disagreeing::DisagreeingView;
use crate::search::footprint_shift::FootprintShift;
use crate::search::levels::OtherLevel;

/// Why a height is doubtful or unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// No oblique view with a prior sees the building well enough.
    SeenByNoView,
    /// Fewer than three views had a say.
    TooFewViews,
    /// The best height is the least or the greatest allowed, or the score does not fall towards the greatest.
    RangeBound,
    /// All heights explain the priors about equally well.
    FlatScore,
    /// Views disagree with each other, or the photos with the priors: the standard deviation is wide.
    ConflictingViews,
    /// Even the best height explains the priors badly.
    PoorScore,
    /// Over the whole range of heights another one explains the priors better.
    OtherHeight,
    /// Nothing was seen through the space above it: its photos could not be matched there, and it may go on.
    UnseenAbove,
    /// Hardly anything stands there that is not as green as leaves in the photos: trees over the roof, or a green roof.
    Vegetation,
    /// It stands far above all that is around, and the photos have not refined it.
    AboveAllAround,
    /// The photos do not agree on the level of the ground around it.
    GroundDiffers,
    /// Nothing was seen of the building itself: the height is that of others.
    Guessed,
    /// The ground without any building explains the priors as well.
    NothingStandsHere,
    /// The footprint is small in the photos, and the height is that of a larger roof beside it, or many times its own width: the
    /// photos may show another building there.
    RoofOfNeighbour,
    /// With the heights as found its pixels stand in the wrong order: the pairs it is part of cost the margin or more on
    /// average, as if all were at one depth (`paper` only).
    WrongOrder,
}

impl Reason {
    /// Whether photos that agree on a roof refute it: it is about the priors, or about crowns, which are no surface.
    fn is_settled_by_photos(self) -> bool {
        matches!(
            self,
            Self::TooFewViews | Self::FlatScore | Self::ConflictingViews | Self::OtherHeight | Self::Vegetation
        )
    }

    /// The name under which files have it.
    #[must_use]
    pub fn code(self) -> &'static str {
        match self {
            Self::SeenByNoView => "seen_by_no_view",
            Self::TooFewViews => "too_few_views",
            Self::RangeBound => "range_bound",
            Self::FlatScore => "flat_score",
            Self::ConflictingViews => "conflicting_views",
            Self::PoorScore => "poor_score",
            Self::OtherHeight => "other_height",
            Self::UnseenAbove => "unseen_above",
            Self::Vegetation => "vegetation",
            Self::AboveAllAround => "above_all_around",
            Self::GroundDiffers => "ground_differs",
            Self::Guessed => "guessed",
            Self::NothingStandsHere => "nothing_stands_here",
            Self::RoofOfNeighbour => "roof_of_neighbour",
            Self::WrongOrder => "wrong_order",
        }
    }
}

/// Errors that a height can have, each as one standard deviation in metres; 0 where nothing is known.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Doubts {
    /// Between views: by how much the height moves when single views are left out (jackknife).
    pub views_m: f64,
    /// A pixel of the working image on the building.
    pub pixel_m: f64,
    /// Between forms of the roof that the views do not tell apart.
    pub form_m: f64,
    /// Share of the priors' relief around the building that its height does not explain, as a standard deviation: √(1 − score²), 0
    /// to 1. Errors that all views share leave it, and the views agree nevertheless.
    #[serde(default)]
    pub unexplained: f64,
    /// Edge bleeding that was corrected, on the building: what is left of it is common to all views.
    #[serde(default)]
    pub bleeding_m: f64,
    /// Height of the building: flattened relief, poses and lenses move a high roof farther than a low one, in all views alike.
    #[serde(default)]
    pub height_m: f64,
    /// Whether the priors are in metres, by photos matched with each other: these agree with heights that are off by a pixel.
    #[serde(default)]
    pub is_in_metres: bool,
}

/// Weight of each doubt in the stated standard deviation. Fitted for 68 and 95 % within one and two of them, in each of 20 cells
/// (three kinds of towns, real roofs under real cameras and under a simulated flight; four levels of prior errors; 2,167 buildings),
/// seeds 31 and 32 and the western half of Rotterdam; that of a pixel of priors in metres is older. That of the height was fitted
/// then, with the others as they are, to these and four more downtowns (seeds 33 to 36; 2,871 buildings): without it, of the 116 that
/// are 40 m high and more 64 % lay within two. That of unexplained relief was raised from 0.6 m afterwards: two of them covered 87 % of
/// the roofs of Rotterdam, west, and 71 % of those of a laser surface with trees, then 93 and 87 %; of Rotterdam, east, which was not
/// looked at for it, 89 and then 94 %.
const VIEWS_SHARE: f64 = 0.8;
const PIXEL_SHARE: f64 = 0.1;
const PIXEL_SHARE_IN_METRES: f64 = 0.65;
const FORM_SHARE: f64 = 0.5;
const UNEXPLAINED_M: f64 = 0.9;
/// That of unexplained relief where photos are weighed against the priors: with it the photos' own weights were fitted.
const UNEXPLAINED_BESIDE_PHOTOS_M: f64 = 0.6;
const BLEEDING_SHARE: f64 = 0.15;
const HEIGHT_SHARE: f64 = 0.008;
/// Standard deviation from which a height between what priors and what photos show is doubtful: metres, and a share of the height.
/// With this, and without the reasons that photos settle, 38 of 394 roofs of Rotterdam, west, are doubtful (59 before), nine of the 13 that
/// are more than 1 m off among them (nine before); of 246 in the east, which nothing was fitted to, 18 (42), six of 13 (seven).
const WIDE_M: f64 = 0.7;
const WIDE_SHARE: f64 = 0.02;

impl Doubts {
    /// One standard deviation of the height, metres.
    #[must_use]
    pub fn sigma_m(&self) -> f64 {
        self.of_known_form_m(UNEXPLAINED_M).hypot(FORM_SHARE * self.form_m)
    }

    /// The same where photos are weighed against it, metres.
    #[must_use]
    pub fn sigma_beside_photos_m(&self) -> f64 {
        self.sigma_of_known_form_m().hypot(FORM_SHARE * self.form_m)
    }

    /// The same if the form of the roof were known, metres.
    #[must_use]
    pub fn sigma_of_known_form_m(&self) -> f64 {
        self.of_known_form_m(UNEXPLAINED_BESIDE_PHOTOS_M)
    }

    fn of_known_form_m(&self, unexplained_m: f64) -> f64 {
        [
            VIEWS_SHARE * self.views_m,
            if self.is_in_metres { PIXEL_SHARE_IN_METRES } else { PIXEL_SHARE } * self.pixel_m,
            unexplained_m * self.unexplained,
            BLEEDING_SHARE * self.bleeding_m,
            // Depth in metres has no relief that is flattened.
            if self.is_in_metres { 0.0 } else { HEIGHT_SHARE * self.height_m },
        ]
        .into_iter()
        .fold(0.0, f64::hypot)
    }
}

/// The height of one building.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SolvedHeight {
    /// Metres above the building's ground level; `None` if no view says anything.
    pub height_m: Option<f64>,
    /// The roof that the evidence supports; flat where it supports no other.
    pub roof: Option<Roof>,
    /// One standard deviation, metres, where it can be estimated.
    pub sigma_m: Option<f64>,
    /// Parts that it is made of.
    #[serde(default)]
    pub doubts: Doubts,
    /// Positions of the views that had a say.
    pub views: Vec<usize>,
    /// Mean over views of the score at the height, −1 (opposite) to 1 (the prior as rendered); `robust` only.
    #[serde(default)]
    pub score: Option<f64>,
    /// By how much the photos raised it, metres; `None` where they had no say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub raised_m: Option<f64>,
    /// How certain the form of its roof is, 0 to 1: the share of roofs called so, as clearly, that are. `None` where no form was looked
    /// for, and where the photos took another form.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub form_certainty: Option<f64>,
    /// How far its footprint is off, where that is told; the roof then stands where the photos show the building.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub footprint_shift: Option<FootprintShift>,
    /// Why it is doubtful or unknown, sorted.
    pub reasons: Vec<Reason>,
}

impl SolvedHeight {
    /// Takes the roof that the photos show, with a standard deviation to state from now on, metres; not if it is not within
    /// the range of heights.
    pub fn refine(&mut self, roof: Roof, bounds: HeightBounds, reference: HeightReference, sigma_m: f64) {
        if !roof.is_within(bounds, reference) {
            return;
        }
        self.raised_m = self.roof.map(|before| roof.mean_m - before.mean_m);
        self.height_m = Some(roof.height_m(reference));
        self.form_certainty = self.form_certainty.filter(|_| self.roof.is_some_and(|before| before.form == roof.form));
        self.roof = Some(roof);
        self.sigma_m = Some(sigma_m);
        self.reasons.retain(|reason| !reason.is_settled_by_photos());
    }

    /// Takes a roof between what the priors and what the photos say, with a standard deviation to state from now on, metres; not
    /// if it is not within the range of heights.
    pub fn lean(&mut self, roof: Roof, bounds: HeightBounds, reference: HeightReference, sigma_m: f64) {
        if roof.is_within(bounds, reference) {
            let height_m = roof.height_m(reference);
            (self.height_m, self.roof, self.sigma_m) = (Some(height_m), Some(roof), Some(sigma_m));
            self.reasons.retain(|reason| *reason != Reason::ConflictingViews);
            if sigma_m > WIDE_M.max(WIDE_SHARE * height_m) {
                self.doubt(Reason::ConflictingViews);
            }
        }
    }

    /// Takes a height or a roof that is not within the range back to it, as a flat roof, and says so: whatever found it, no
    /// height outside is stated.
    pub fn keep_within(&mut self, bounds: HeightBounds, reference: HeightReference) {
        let Some(height_m) = self.height_m else { return };
        let is_within = self.roof.map_or_else(|| bounds.hold(height_m), |roof| roof.is_within(bounds, reference));
        if is_within {
            return;
        }
        let nearest_m = bounds.nearest(self.roof.map_or(height_m, |roof| roof.mean_m));
        (self.height_m, self.roof) = (Some(nearest_m), self.roof.map(|_| Roof::flat(nearest_m)));
        self.doubt(Reason::RangeBound);
    }

    /// One more reason to look at it again.
    pub fn doubt(&mut self, reason: Reason) {
        if let Err(at) = self.reasons.binary_search(&reason) {
            self.reasons.insert(at, reason);
        }
    }

    /// A building that no height can be given.
    pub(super) fn unknown(views: Vec<usize>, score: Option<f64>, reason: Reason) -> Self {
        Self {
            height_m: None,
            roof: None,
            sigma_m: None,
            doubts: Doubts::default(),
            views,
            score,
            raised_m: None,
            form_certainty: None,
            footprint_shift: None,
            reasons: vec![reason],
        }
    }
}

/// One pass over all buildings or views.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EpochRecord {
    /// Mean loss (`paper`) or one minus the mean correlation (`robust`).
    pub loss: f64,
    /// Mean relative change of the heights, 0..1 (`SiZeUp`, "Stability").
    pub relative_change: f64,
    /// Views selected in this pass (the paper's #Sel).
    pub n_selected: usize,
    /// Share of ordinal pairs that cost something (`paper` only).
    pub active_pairs: Option<f64>,
    /// Heights after the pass, metres.
    pub heights_m: Vec<f32>,
}

/// Result of a solver.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Solution {
    /// One per building of the scene.
    pub heights: Vec<SolvedHeight>,
    /// Record of each pass, in order.
    pub history: Vec<EpochRecord>,
    /// Distinct views whose prior was used, ascending (the paper's #Used).
    pub used_views: Vec<usize>,
    /// By how many pixels of the working image the priors' near sides were taken to bleed over their edges, median of
    /// the views.
    pub bleeding_px: f64,
    /// The same of each of `used_views`; empty where none was measured.
    #[serde(default)]
    pub bleedings_px: Vec<f64>,
    /// Shape of the priors along the ground, if not a line in inverse depth.
    #[serde(default)]
    pub prior_shape: PriorShape,
    /// Number of views whose prior was straightened.
    #[serde(default)]
    pub n_straightened: usize,
    /// Shift of the footprint layer against the photos, where that was asked for and there is one. The search then ended with it: the heights are
    /// provisional until photos or footprints are moved and the scene is solved again.
    #[serde(default)]
    pub layer_shift: Option<LayerShift>,
    /// Error of the ground's level, where the shift of the layer was asked for and depth has no unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub level_off: Option<LevelOff>,
    /// Buildings with a second roof level, which no single height fits. Where there are any, the search ended with them: the
    /// heights are provisional until these are split and the scene is solved again.
    #[serde(default)]
    pub other_levels: Vec<OtherLevel>,
    /// Views whose prior does not show what the others do, so that it was left out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub disagreeing_views: Vec<DisagreeingView>,
    /// Selected views whose prior could not be loaded, and why.
    pub failed_views: Vec<(usize, String)>,
}

impl Solution {
    /// The edge bleeding that was taken back from a view's prior, pixels of the working image.
    #[must_use]
    pub fn bleeding_of(&self, view: usize) -> f64 {
        let at = self.used_views.binary_search(&view).ok();
        at.and_then(|at| self.bleedings_px.get(at).copied()).unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::scene::RoofForm;

    const REFERENCES: [HeightReference; 3] = [HeightReference::Eave, HeightReference::Mean, HeightReference::Ridge];

    /// A roof with its eave, mean and ridge in that order.
    fn roof(mut levels_m: [f64; 3]) -> Roof {
        levels_m.sort_by(f64::total_cmp);
        let [eave_m, mean_m, ridge_m] = levels_m;
        Roof { form: RoofForm::Gable, eave_m, ridge_m, mean_m, terrace: None, ridge_along: None }
    }

    fn solved(roof: Roof, reference: HeightReference) -> SolvedHeight {
        let (height_m, roof) = (Some(roof.height_m(reference)), Some(roof));
        SolvedHeight { height_m, roof, ..SolvedHeight::unknown(Vec::new(), Some(0.9), Reason::FlatScore) }
    }

    proptest! {
        #[test]
        fn no_height_is_stated_outside_the_range_however_it_was_found(
            found in [0.1..200.0_f64, 0.1..200.0, 0.1..200.0],
            refined in [0.1..200.0_f64, 0.1..200.0, 0.1..200.0],
            leant in [0.1..200.0_f64, 0.1..200.0, 0.1..200.0],
            min_m in 1.0..10.0_f32, span_m in 1.0..100.0_f32, reference in 0..3_usize
        ) {
            let (bounds, reference) = (HeightBounds { min_m, max_m: min_m + span_m }, REFERENCES[reference]);
            let mut solved = solved(roof(found), reference);
            let was_within = roof(found).is_within(bounds, reference);
            solved.keep_within(bounds, reference);
            prop_assert_eq!(solved.reasons.contains(&Reason::RangeBound), !was_within, "said where it was taken back");
            solved.refine(roof(refined), bounds, reference, 0.1);
            let stated = solved.roof.expect("it has a roof");
            prop_assert!(bounds.hold(solved.height_m.expect("it has a height")) && stated.is_within(bounds, reference));
            prop_assert_eq!(solved.raised_m.is_some(), roof(refined).is_within(bounds, reference));
            solved.lean(roof(leant), bounds, reference, 0.1);
            let stated = solved.roof.expect("it has a roof");
            prop_assert!(bounds.hold(solved.height_m.expect("it has a height")) && stated.is_within(bounds, reference));
        }
    }

    #[test]
    fn a_high_roof_is_less_certain_than_a_low_one_unless_priors_are_in_metres() {
        let sigma_m = |height_m, is_in_metres| {
            let doubts = Doubts { views_m: 0.2, unexplained: 0.3, height_m, is_in_metres, ..Doubts::default() };
            doubts.sigma_m()
        };
        assert!(sigma_m(10.0, false) < 1.1 * sigma_m(0.0, false), "{}", sigma_m(10.0, false));
        assert!(sigma_m(100.0, false) > 0.8, "{}", sigma_m(100.0, false));
        assert_eq!(sigma_m(100.0, true).to_bits(), sigma_m(0.0, true).to_bits());
    }

    #[test]
    fn a_height_without_a_roof_is_kept_within_too() {
        let bounds = HeightBounds { min_m: 2.0, max_m: 12.0 };
        for (found_m, stated_m) in [(0.54, 2.0), (16.7, 12.0), (5.0, 5.0)] {
            let mut solved =
                SolvedHeight { height_m: Some(found_m), roof: None, ..solved(roof([1.0; 3]), REFERENCES[1]) };
            solved.keep_within(bounds, HeightReference::Mean);
            assert_eq!(solved.height_m, Some(stated_m));
        }
    }
}
