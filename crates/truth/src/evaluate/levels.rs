//! Levels of a reference brought to what those of the result count from. Never compared raw: they are stated to be the same,
//! transformed by PROJ, or shifted by what the user says.

use std::fmt;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::solid::Solid;
use sizeup_geo::crs::{Crs, CrsError, LevelTransform, VerticalReference};

/// Why levels of two files cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum LevelError {
    /// A file does not say what its levels count from.
    #[error(
        "{file} does not say what its levels count from\n\
         hint: state it with {flag}, or declare that both count from the same zero with --same-vertical"
    )]
    Unstated {
        /// The file whose levels are not placed.
        file: String,
        /// The option that states its CRS.
        flag: &'static str,
    },
    /// PROJ knows no way from one to the other.
    #[error("levels of the reference count from {from}, those of the result from {to}")]
    NoWay {
        /// Zero of the reference.
        from: VerticalReference,
        /// Zero of the result.
        to: VerticalReference,
        /// Why PROJ has no way between the two.
        #[source]
        source: CrsError,
    },
}

/// Way in which levels were brought together, for the report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LevelAgreement {
    /// Source of that knowledge.
    pub how: DatumMatch,
    /// Zero of the reference's levels, where it says so.
    pub reference: Option<String>,
    /// Zero of the result's levels, where it says so.
    pub result: Option<String>,
    /// Smallest and largest metres that were added to levels of the reference.
    pub shift_m: [f64; 2],
}

/// Ground on which levels may be compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DatumMatch {
    /// Both files say the same.
    Stated,
    /// The user says by how much they differ.
    Declared,
    /// They differ, and PROJ knows the way.
    Transformed,
}

/// The way from the reference's levels to the result's.
pub(super) enum LevelConversion {
    Shift(f64),
    Proj(Box<LevelTransform>),
}

/// A way and what is to be said of it.
pub(super) struct LevelAlignment {
    way: LevelConversion,
    agreement: LevelAgreement,
}

/// Zeros of both sides, as far as known, and the user's declaration.
pub(super) struct Stated<'a> {
    pub result: Option<&'a VerticalReference>,
    pub reference: Option<&'a VerticalReference>,
    /// Metres to add to levels of the reference.
    pub shift_m: Option<f64>,
    /// Names of the files, for messages.
    pub files: [String; 2],
}

impl LevelAlignment {
    /// Decides by what is declared, then by what the files say. `plane` is the CRS in which positions are compared.
    pub(super) fn of(stated: &Stated<'_>, plane: &Crs) -> Result<Self, LevelError> {
        let unstated = |i: usize, flag| LevelError::Unstated { file: stated.files[i].clone(), flag };
        let (how, way) = match (stated.shift_m, stated.result, stated.reference) {
            (Some(shift_m), ..) => (DatumMatch::Declared, LevelConversion::Shift(shift_m)),
            (None, None, _) => return Err(unstated(0, "--crs")),
            (None, _, None) => return Err(unstated(1, "--truth-crs")),
            (None, Some(to), Some(from)) if to == from => (DatumMatch::Stated, LevelConversion::Shift(0.0)),
            (None, Some(to), Some(from)) => {
                let transform = LevelTransform::new(plane, from, to).map_err(|source| no_way(from, to, source))?;
                (DatumMatch::Transformed, LevelConversion::Proj(Box::new(transform)))
            }
        };
        let name = |reference: Option<&VerticalReference>| reference.map(ToString::to_string);
        let (reference, result) = (name(stated.reference), name(stated.result));
        let none_yet = [f64::INFINITY, f64::NEG_INFINITY];
        Ok(Self { way, agreement: LevelAgreement { how, reference, result, shift_m: none_yet } })
    }

    /// Moves bodies, each by what holds in its middle: over a building, what lies between two references is constant to some
    /// millimetres, and level roofs stay level.
    pub(super) fn move_solids(&mut self, solids: &mut [Solid]) -> Result<(), CrsError> {
        for solid in solids {
            let n = 3 * solid.facets.len();
            let sum: DVec3 = solid.facets.iter().flat_map(|facet| facet.corners).sum();
            let shift_m = self.shift_at(sum / n.max(1) as f64)?;
            solid.facets.iter_mut().flat_map(|facet| &mut facet.corners).for_each(|corner| corner.z += shift_m);
            solid.prisms.iter_mut().flat_map(|prism| &mut prism.levels_m).for_each(|level_m| *level_m += shift_m);
        }
        Ok(())
    }

    /// Moves points to the levels that are compared.
    pub(super) fn move_points(&mut self, points: &mut [DVec3]) -> Result<(), CrsError> {
        for point in points {
            point.z += self.shift_at(*point)?;
        }
        Ok(())
    }

    fn shift_at(&mut self, at: DVec3) -> Result<f64, CrsError> {
        let shift_m = match &self.way {
            LevelConversion::Shift(shift_m) => *shift_m,
            LevelConversion::Proj(transform) => transform.level_m(at)? - at.z,
        };
        let [low, high] = self.agreement.shift_m;
        self.agreement.shift_m = [low.min(shift_m), high.max(shift_m)];
        Ok(shift_m)
    }

    /// Statement on the levels, once everything is moved.
    pub(super) fn agreement(self) -> LevelAgreement {
        self.agreement
    }
}

pub(super) fn no_way(from: &VerticalReference, to: &VerticalReference, source: CrsError) -> LevelError {
    LevelError::NoWay { from: from.clone(), to: to.clone(), source }
}

impl fmt::Display for LevelAgreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |side: &Option<String>| side.clone().unwrap_or_else(|| "an unstated zero".to_owned());
        let [low, high] = self.shift_m;
        let (from, to) = (name(&self.reference), name(&self.result));
        match self.how {
            DatumMatch::Stated => write!(f, "levels of both count from {to}, as both files say"),
            DatumMatch::Declared if low == 0.0 && high == 0.0 => {
                write!(f, "levels of both are declared to count from the same zero (reference: {from}; result: {to})")
            }
            DatumMatch::Declared => write!(f, "{low:+.2} m added to levels of the reference, as declared"),
            DatumMatch::Transformed => {
                write!(f, "levels of the reference moved from {from} to {to} by PROJ: {low:+.3} to {high:+.3} m")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::solid::tests::block;
    use super::*;

    fn stated<'a>(result: Option<&'a VerticalReference>, reference: Option<&'a VerticalReference>) -> Stated<'a> {
        Stated { result, reference, shift_m: None, files: ["a".to_owned(), "b".to_owned()] }
    }

    #[test]
    fn bodies_are_moved_as_a_whole_and_stay_level() {
        // EPSG:5419: NGF IGN69 to EVRF2000, -0.486 m everywhere.
        let plane = Crs::parse("EPSG:2154").unwrap();
        let [from, to] =
            ["EPSG:5698", "EPSG:2154+5730"].map(|crs| VerticalReference::of(&Crs::parse(crs).unwrap()).unwrap());
        let mut alignment = LevelAlignment::of(&stated(Some(&to), Some(&from)), &plane).unwrap();
        let mut solids = [block("a", [652_000.0, 6_862_000.0, 35.0], [10.0, 8.0, 6.0])];
        alignment.move_solids(&mut solids).unwrap();
        let [low, high] = solids[0].prisms[0].levels_m;
        assert!((low - 34.514).abs() < 1e-6 && (high - 40.514).abs() < 1e-6, "{low} {high}");
        assert!(solids[0].facets.iter().flat_map(|f| f.corners).all(|p| p.z == low || p.z == high));
        let agreement = alignment.agreement();
        assert_eq!(agreement.how, DatumMatch::Transformed);
        assert!(agreement.shift_m.iter().all(|shift_m| (shift_m + 0.486).abs() < 1e-6), "{agreement}");
    }

    #[test]
    fn silence_is_no_agreement() {
        let plane = Crs::parse("EPSG:2154").unwrap();
        let known = VerticalReference::of(&Crs::parse("EPSG:5698").unwrap()).unwrap();
        for (result, reference) in [(None, Some(&known)), (Some(&known), None), (None, None)] {
            assert!(matches!(LevelAlignment::of(&stated(result, reference), &plane), Err(LevelError::Unstated { .. })));
        }
        let declared = Stated { shift_m: Some(1.5), ..stated(None, None) };
        let mut points = [DVec3::ZERO];
        LevelAlignment::of(&declared, &plane).unwrap().move_points(&mut points).unwrap();
        assert_eq!(points[0].z, 1.5);
    }
}
