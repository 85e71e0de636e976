//! What became of a building between two results, why, and the figures behind it.

use std::fmt::Write as _;

use geo_types::MultiPolygon;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The change of a building, or of several that stand for each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// It stands in the new result only, or was flat before.
    New,
    /// It stands in the old result only, or is flat now.
    Gone,
    /// The roof is higher.
    Raised,
    /// The roof is lower.
    Lowered,
    /// The roof is where it was, or nothing is known of it, and the footprint is another.
    FootprintChanged,
    /// Nothing has changed that is worth telling.
    Same,
    /// The two results do not tell.
    Unsure,
    /// The other result did not look there.
    Outside,
}

impl Class {
    /// All of them, in the order in which they are reported.
    pub const ALL: [Self; 8] = [
        Self::New,
        Self::Gone,
        Self::Raised,
        Self::Lowered,
        Self::FootprintChanged,
        Self::Same,
        Self::Unsure,
        Self::Outside,
    ];

    /// The name under which files have it.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::New => "new",
            Self::Gone => "gone",
            Self::Raised => "raised",
            Self::Lowered => "lowered",
            Self::FootprintChanged => "footprint_changed",
            Self::Same => "same",
            Self::Unsure => "unsure",
            Self::Outside => "outside",
        }
    }

    /// Whether it tells of a change.
    #[must_use]
    pub fn is_change(self) -> bool {
        matches!(self, Self::New | Self::Gone | Self::Raised | Self::Lowered | Self::FootprintChanged)
    }
}

/// Why a building is of its class.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ChangeReason {
    /// No building of the old result stands there.
    NotInOld,
    /// No building of the new result stands there.
    NotInNew,
    /// The old result has its footprint, and a height that is that of no building.
    FlatBefore,
    /// The new result has its footprint, and a height that is that of no building.
    FlatNow,
    /// A building of the other result stands there, and is another one.
    Replaced,
    /// The levels of the two roofs differ by more than both sigmas explain.
    RoofMoved,
    /// One of its parts differs by more than both sigmas explain, the others less.
    PartMoved,
    /// Any difference is surely less than the least that is worth telling.
    WithinLeast,
    /// The two sigmas are too wide to tell.
    SigmasTooWide,
    /// The ground differs between the two results, and the height above it with it; the roof is where it was.
    GroundDiffers,
    /// Ground and roof have moved together, or apart: no building does that.
    GroundMoved,
    /// The footprint reaches further than it did.
    FootprintGrew,
    /// The footprint reaches less far than it did.
    FootprintShrank,
    /// One building of the old result is several of the new.
    Split,
    /// Several buildings of the old result are one of the new.
    Merged,
    /// The old height was marked as doubtful.
    OldDoubtful,
    /// The new height was marked as doubtful.
    NewDoubtful,
    /// The old height is a fallback.
    OldNotMeasured,
    /// The new height is a fallback.
    NewNotMeasured,
    /// The old result has no height.
    OldHeightUnknown,
    /// The new result has no height.
    NewHeightUnknown,
    /// The old height states no sigma.
    OldSigmaUnknown,
    /// The new height states no sigma.
    NewSigmaUnknown,
    /// It has no footprint, and so no place.
    NoFootprint,
    /// It lies beyond the area of the old result.
    OutsideOld,
    /// It lies beyond the area of the new result.
    OutsideNew,
}

impl ChangeReason {
    /// The name under which files have it.
    #[must_use]
    pub fn code(self) -> &'static str {
        match self {
            Self::NotInOld => "not_in_old",
            Self::NotInNew => "not_in_new",
            Self::FlatBefore => "flat_before",
            Self::FlatNow => "flat_now",
            Self::Replaced => "replaced",
            Self::RoofMoved => "roof_moved",
            Self::PartMoved => "part_moved",
            Self::WithinLeast => "within_least",
            Self::SigmasTooWide => "sigmas_too_wide",
            Self::GroundDiffers => "ground_differs",
            Self::GroundMoved => "ground_moved",
            Self::FootprintGrew => "footprint_grew",
            Self::FootprintShrank => "footprint_shrank",
            Self::Split => "split",
            Self::Merged => "merged",
            Self::OldDoubtful => "old_doubtful",
            Self::NewDoubtful => "new_doubtful",
            Self::OldNotMeasured => "old_not_measured",
            Self::NewNotMeasured => "new_not_measured",
            Self::OldHeightUnknown => "old_height_unknown",
            Self::NewHeightUnknown => "new_height_unknown",
            Self::OldSigmaUnknown => "old_sigma_unknown",
            Self::NewSigmaUnknown => "new_sigma_unknown",
            Self::NoFootprint => "no_footprint",
            Self::OutsideOld => "outside_old",
            Self::OutsideNew => "outside_new",
        }
    }

    /// Text, as a part of a sentence.
    fn words(self) -> &'static str {
        match self {
            Self::NotInOld => "no building of the old result stands here",
            Self::NotInNew => "no building of the new result stands here",
            Self::FlatBefore => "the old result has its footprint, and hardly any height",
            Self::FlatNow => "the new result has its footprint, and hardly any height",
            Self::Replaced => "another building of the other result stands here",
            Self::RoofMoved => "the roof is elsewhere",
            Self::PartMoved => "one of its parts is at another level",
            Self::WithinLeast => "any difference is less than is worth telling",
            Self::SigmasTooWide => "the two sigmas are too wide to tell",
            Self::GroundDiffers => "the ground differs between the results, the roof is where it was",
            Self::GroundMoved => "ground and roof do not move like those of a building",
            Self::FootprintGrew => "the footprint reaches further",
            Self::FootprintShrank => "the footprint reaches less far",
            Self::Split => "one building before, several now",
            Self::Merged => "several buildings before, fewer now",
            Self::OldDoubtful => "the old height is doubtful",
            Self::NewDoubtful => "the new height is doubtful",
            Self::OldNotMeasured => "the old height is a fallback",
            Self::NewNotMeasured => "the new height is a fallback",
            Self::OldHeightUnknown => "the old height is not known",
            Self::NewHeightUnknown => "the new height is not known",
            Self::OldSigmaUnknown => "the old height states no sigma",
            Self::NewSigmaUnknown => "the new height states no sigma",
            Self::NoFootprint => "it has no footprint",
            Self::OutsideOld => "it lies beyond the area of the old result",
            Self::OutsideNew => "it lies beyond the area of the new result",
        }
    }
}

/// A building of either result, or several that stand for each other. Heights in metres; positions in the map frame of the
/// new result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Change {
    /// Class of the change.
    pub class: Class,
    /// Why, the decisive one first.
    pub reasons: Vec<ChangeReason>,
    /// The same in words, with the figures.
    pub explanation: String,
    /// Ids in the new result, which are kept.
    pub new_ids: Vec<String>,
    /// Ids in the old result.
    pub old_ids: Vec<String>,
    /// New height above ground minus the old one, without what is common to all buildings, metres.
    pub d_height_m: Option<f64>,
    /// New level of the roof minus the old one, without what is common to all buildings, metres; where levels are compared.
    pub d_roof_z_m: Option<f64>,
    /// New level of the ground minus the old one, as the results have them, metres; where levels are compared.
    pub d_ground_z_m: Option<f64>,
    /// One standard deviation of either difference, metres.
    pub sigma_m: Option<f64>,
    /// The difference that decided (of roofs, else of heights) in sigmas.
    pub z: Option<f64>,
    /// Height above ground in the old result, mean over the area, metres.
    pub old_height_m: Option<f64>,
    /// Height above ground in the new result, mean over the area, metres.
    pub new_height_m: Option<f64>,
    /// Area of the footprint in the old result, m².
    pub old_area_m2: Option<f64>,
    /// Area of the footprint in the new result, m².
    pub new_area_m2: Option<f64>,
    /// Intersection over union of the two footprints.
    pub iou: Option<f64>,
    /// Area that the footprint has won beyond the footprints' own accuracy, m².
    pub gained_m2: Option<f64>,
    /// Area that the footprint has lost beyond the footprints' own accuracy, m².
    pub lost_m2: Option<f64>,
    /// The new footprint; of what is gone, the old one where the common shift puts it.
    #[serde(skip, default = "nowhere")]
    #[schemars(skip)]
    pub footprint: MultiPolygon<f64>,
}

fn nowhere() -> MultiPolygon<f64> {
    MultiPolygon::new(Vec::new())
}

impl Change {
    /// Sets class and reasons, and says them in words with the figures that are there.
    pub(super) fn conclude(&mut self, class: Class, reasons: Vec<ChangeReason>) {
        self.class = class;
        self.explanation = reasons.iter().map(|reason| reason.words()).collect::<Vec<_>>().join("; ");
        self.reasons = reasons;
        // Writing to a String does not fail.
        if let (Some(d_m), Some(sigma_m)) = (self.d_roof_z_m.or(self.d_height_m), self.sigma_m) {
            let what = if self.d_roof_z_m.is_some() { "roof level" } else { "height" };
            let _ = write!(self.explanation, "; {what} {d_m:+.2} m, sigma {sigma_m:.2} m");
        }
        if let (Some(gained_m2), Some(lost_m2)) = (self.gained_m2, self.lost_m2)
            && gained_m2 + lost_m2 > 0.0
        {
            let _ = write!(self.explanation, "; footprint +{gained_m2:.1} m2, -{lost_m2:.1} m2");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_in_files_are_those_of_the_schema() {
        for class in Class::ALL {
            assert_eq!(serde_json::to_value(class).unwrap(), class.as_str());
        }
        for reason in
            [ChangeReason::NotInOld, ChangeReason::PartMoved, ChangeReason::OldSigmaUnknown, ChangeReason::OutsideNew]
        {
            assert_eq!(serde_json::to_value(reason).unwrap(), reason.code());
        }
    }
}
