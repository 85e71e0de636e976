//! From what a survey's heights are counted from to the project's vertical reference.
//!
//! Where the file and the configuration leave it open, heights are taken as the project's. Where they are known to be
//! ellipsoidal, or of no known reference, taking them as they are must be said: a geoid lies up to 107 m off. A height
//! beside a longitude and latitude is of no known reference where its CRS has no third axis.
//!
//! The unit of heights is what the file states, else that of the heights' CRS, else that of the plane where the format has
//! one scale for all three. In a plane that is counted in feet nothing else states it, and it has to be stated.

use glam::DVec3;

use super::SurveyError;
use super::config::{HeightConfig, VerticalDatum};
use super::poses::FileHeights;
use sizeup_geo::crs::{
    Accuracy, Crs, CrsError, EllipsoidalHeight, GeoidHeight, HeightAboveGround, HeightAboveTakeoff, OrthometricHeight,
    Transform, Transform3d,
};

/// Units of positions as a file states them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct FileUnits {
    /// Metres per unit of eastings and northings.
    pub plane_m: Option<f64>,
    /// Unit of heights.
    pub heights: HeightUnit,
}

/// Unit of heights as a file states it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) enum HeightUnit {
    /// Not at all: it is that of the CRS.
    #[default]
    Unsaid,
    /// That of eastings and northings: rotations and image points only fit a world of one scale.
    OfPlane,
    /// Metres per unit.
    Metres(f64),
}

impl FileUnits {
    /// Units of a format with one scale in all directions.
    pub(crate) const ONE_SCALE: Self = Self { plane_m: None, heights: HeightUnit::OfPlane };

    /// Refuses other units than metres, for frames that have no others.
    pub(crate) fn require_metres(self) -> Result<(), SurveyError> {
        let of_heights = if let HeightUnit::Metres(unit_m) = self.heights { Some(unit_m) } else { None };
        match self.plane_m.into_iter().chain(of_heights).find(|unit_m| *unit_m != 1.0) {
            None => Ok(()),
            Some(unit_m) => Err(SurveyError::config(
                format!("the file counts in units of {unit_m} m, and an earth-centred or local frame in metres"),
                "name the CRS of the poses: `survey.crs`",
            )),
        }
    }

    /// Metres per unit of heights in a world.
    ///
    /// # Errors
    /// [`SurveyError::Config`] where the file counts positions in another unit than the world, or nothing states the unit of
    /// heights.
    pub(crate) fn height_unit_m(self, config: &HeightConfig, world: &Crs) -> Result<f64, SurveyError> {
        let of_plane = world.plane_unit_m();
        if let Some(stated) = self.plane_m.filter(|stated| of_plane.is_none_or(|unit| !is_same(*stated, unit))) {
            let counts = of_plane.map_or("degrees".to_owned(), |unit| format!("units of {unit} m"));
            let message = format!("the file counts positions in units of {stated} m, and {world} in {counts}");
            return Err(SurveyError::config(message, "name the CRS of the poses: `survey.crs`"));
        }
        let of_vertical = match (&config.crs, config.reference) {
            (Some(vertical), Some(VerticalDatum::Orthometric)) => vertical_unit_m(vertical)?,
            _ => None,
        };
        let of_crs = of_vertical.or(world.height_unit_m());
        match (self.heights, of_crs) {
            (HeightUnit::Metres(stated), Some(of_crs)) if is_same(stated, of_crs) => Ok(of_crs),
            (HeightUnit::Metres(stated), _) => Ok(stated),
            (_, Some(of_crs)) => Ok(of_crs),
            (HeightUnit::OfPlane, None) => Ok(of_plane.unwrap_or(1.0)),
            (HeightUnit::Unsaid, None) if world.is_metric() => Ok(1.0),
            (HeightUnit::Unsaid, None) => {
                let message =
                    format!("{world} counts positions in feet, and nothing states in what heights are counted");
                Err(SurveyError::config(message, HEIGHT_UNIT_CHOICES))
            }
        }
    }
}

const HEIGHT_UNIT_CHOICES: &str = "name the CRS of the poses with its heights: `crs = \"EPSG:2263+6360\"` (NAVD88 in US \
                                   survey feet) or `\"EPSG:2263+5703\"` (NAVD88 in metres) state both; so does a table's \
                                   header, as `z [ft]` or `z [m]`";

/// Feet of both kinds are told apart, their rounding is not.
fn is_same(unit_m: f64, other_m: f64) -> bool {
    const ROUNDING: f64 = 1e-7;
    (unit_m / other_m - 1.0).abs() < ROUNDING
}

/// Metres per unit of a vertical CRS.
fn vertical_unit_m(vertical: &Crs) -> Result<Option<f64>, CrsError> {
    match vertical.vertical_epsg() {
        Some(code) => Ok(Crs::parse(&format!("EPSG:4326+{code}"))?.height_unit_m()),
        None => Ok(None),
    }
}

/// Way of heights to the project's reference.
pub(crate) enum HeightConversion {
    /// They are in it, or nobody says otherwise.
    AsTheyAre,
    /// In a vertical system that the project, which names none, takes over.
    TakenOver(String),
    /// Ellipsoidal, and the whole project is.
    KeptEllipsoidal,
    /// Ellipsoidal, minus a stated geoid height.
    Geoid(GeoidHeight),
    /// Above a stated height of the ground.
    AboveGround(OrthometricHeight),
    /// Above a stated height of the take-off.
    AboveTakeoff(OrthometricHeight),
    /// Through PROJ and its grids, from longitude and latitude on the way.
    Transformed(Box<Transformed>),
}

/// A transformation of heights from one vertical reference to the project's.
pub(crate) struct Transformed {
    lonlat_from_world: Transform,
    operation: Transform3d,
    /// Metres per unit of either reference.
    units_m: [f64; 2],
    from: String,
    to: String,
}

const CHOICES: &str = "set [survey.height]: `reference = \"project\"` if they are in the project's reference, \
                       `geoid_offset` (metres), `keep_ellipsoidal = true`, or a project CRS with a vertical part, \
                       such as \"EPSG:25832+7837\"";

const CHOICES_OF_UNSAID: &str = "name the poses' CRS with its heights, such as \"EPSG:4979\" (ellipsoidal) or \
                                 \"EPSG:4326+5773\" (EGM96); or set `height.reference` to ellipsoidal or project";

impl HeightConversion {
    /// Decides by what is declared, then by what the file and the CRSs say.
    pub(crate) fn decide(
        config: &HeightConfig,
        file: FileHeights,
        world: &Crs,
        project_crs: &Crs,
    ) -> Result<Self, SurveyError> {
        let reference = match (config.reference, file) {
            (Some(declared), _) => declared,
            (None, _) if config.geoid_offset.is_some() || config.keep_ellipsoidal => VerticalDatum::Ellipsoidal,
            (None, FileHeights::Unreliable) if world.height_unit_m().is_none() => {
                let message = "the photos' heights have no known reference (no RTK: barometric, up to 100 m off)";
                return Err(SurveyError::config(
                    message,
                    "set `height.reference` to ellipsoidal, above_takeoff (with `height.base`) or project",
                ));
            }
            (None, FileHeights::Ellipsoidal) => VerticalDatum::Ellipsoidal,
            (None, _) if world.vertical_epsg().is_some() => VerticalDatum::Orthometric,
            (None, _) if world.is_ellipsoidal_3d() => VerticalDatum::Ellipsoidal,
            (None, _) if world.is_geographic() && project_crs.height_unit_m().is_some() => {
                let message = format!("{world} says nothing of heights, and the project's do count: {project_crs}");
                return Err(SurveyError::config(message, CHOICES_OF_UNSAID));
            }
            (None, _) => VerticalDatum::Project,
        };
        let base = |what: &str| match config.base {
            Some(base_m) if base_m.is_finite() => Ok(OrthometricHeight(base_m)),
            _ => Err(SurveyError::config(
                format!("heights above {what} need `height.base`"),
                format!("state the height of {what} in the project's reference, metres"),
            )),
        };
        match reference {
            VerticalDatum::Project => Ok(Self::AsTheyAre),
            VerticalDatum::AboveGround => base("the ground").map(Self::AboveGround),
            VerticalDatum::AboveTakeoff => base("the take-off").map(Self::AboveTakeoff),
            VerticalDatum::Ellipsoidal => Self::from_ellipsoid(config, world, project_crs),
            VerticalDatum::Orthometric => Self::from_vertical(config, world, project_crs),
        }
    }

    fn from_ellipsoid(config: &HeightConfig, world: &Crs, project_crs: &Crs) -> Result<Self, SurveyError> {
        match (config.geoid_offset, config.keep_ellipsoidal) {
            (Some(_), true) => {
                Err(SurveyError::config("`geoid_offset` and `keep_ellipsoidal` are both set", "keep one of them"))
            }
            (Some(offset_m), false) => Ok(Self::Geoid(GeoidHeight(offset_m))),
            (None, true) => Ok(Self::KeptEllipsoidal),
            (None, false) if project_crs.vertical_epsg().is_some() => {
                Self::transformed("EPSG:4979", world, project_crs)
            }
            (None, false) => Err(SurveyError::config(
                format!("the poses' heights are ellipsoidal, and {project_crs} has no vertical reference"),
                CHOICES,
            )),
        }
    }

    fn from_vertical(config: &HeightConfig, world: &Crs, project_crs: &Crs) -> Result<Self, SurveyError> {
        let from = match (&config.crs, world.vertical_epsg()) {
            (Some(crs), _) => crs.vertical_epsg(),
            (None, from) => from,
        };
        let Some(from) = from else {
            let hint = "set `height.crs`, such as \"EPSG:5773\", or a compound `crs`";
            return Err(SurveyError::config("orthometric heights of no named vertical system", hint));
        };
        match project_crs.vertical_epsg() {
            Some(to) if to != from => Self::transformed(&format!("EPSG:4326+{from}"), world, project_crs),
            Some(_) => Ok(Self::AsTheyAre),
            None => Self::taken_over(config.crs.as_ref().unwrap_or(world), world, project_crs),
        }
    }

    /// A national grid without heights goes with its own country's: the poses' are the project's. From another datum it
    /// has to be said.
    fn taken_over(vertical: &Crs, world: &Crs, project_crs: &Crs) -> Result<Self, SurveyError> {
        let name = vertical.vertical_name().unwrap_or_else(|| vertical.name()).to_owned();
        if world.has_datum_of(project_crs) {
            return Ok(Self::TakenOver(name));
        }
        let message = format!("the poses' heights are {name}, and {project_crs} has no vertical reference");
        Err(SurveyError::config(message, CHOICES))
    }

    fn transformed(from: &str, world: &Crs, project_crs: &Crs) -> Result<Self, SurveyError> {
        let from = Crs::parse(from)?;
        let to = project_crs.vertical_name().unwrap_or_default().to_owned();
        Ok(Self::Transformed(Box::new(Transformed {
            // The poses' own datum will do: a geoid does not change over the metres between two datums.
            lonlat_from_world: Transform::new(world, &world.geographic_base()?)?,
            operation: Transform3d::new(&from, project_crs)?,
            units_m: [&from, project_crs].map(|crs| crs.height_unit_m().unwrap_or(1.0)),
            from: from.vertical_name().unwrap_or("ellipsoid").to_owned(),
            to,
        })))
    }

    /// The height in the project, metres, of a position in the world of the poses whose height is in metres.
    pub(crate) fn in_project(&self, at: DVec3) -> Result<f64, CrsError> {
        Ok(match self {
            Self::AsTheyAre | Self::TakenOver(_) | Self::KeptEllipsoidal => at.z,
            Self::Geoid(geoid) => EllipsoidalHeight(at.z).above_geoid(*geoid).0,
            Self::AboveGround(ground) => HeightAboveGround(at.z).over(*ground).0,
            Self::AboveTakeoff(takeoff) => HeightAboveTakeoff(at.z).from_takeoff(*takeoff).0,
            Self::Transformed(t) => {
                let (lon_deg, lat_deg) = t.lonlat_from_world.point(at.x, at.y)?;
                let [from_m, to_m] = t.units_m;
                t.operation.point(DVec3::new(lon_deg, lat_deg, at.z / from_m))?.z * to_m
            }
        })
    }

    /// Whether somebody chose or PROJ computed it: worth a line in the output.
    pub(crate) fn is_choice(&self) -> bool {
        !matches!(self, Self::AsTheyAre | Self::TakenOver(_))
    }

    /// Accuracy of the transformation by PROJ at a position in the world of the poses; `None` where there is none.
    pub(crate) fn accuracy_at(&self, at: DVec3) -> Option<Accuracy> {
        let Self::Transformed(t) = self else { return None };
        let (lon_deg, lat_deg) = t.lonlat_from_world.point(at.x, at.y).ok()?;
        Some(t.operation.accuracy_at(lon_deg, lat_deg))
    }
}

impl std::fmt::Display for HeightConversion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::AsTheyAre => f.write_str("as given, taken to be in the project's vertical reference"),
            Self::TakenOver(name) => write!(f, "as given, {name}: the project names no vertical reference"),
            Self::KeptEllipsoidal => f.write_str("ellipsoidal, kept by `keep_ellipsoidal`: the project is ellipsoidal"),
            Self::Geoid(GeoidHeight(n)) => write!(f, "ellipsoidal minus the stated geoid height of {n} m"),
            Self::AboveGround(base) => write!(f, "above ground plus its stated height of {} m", base.0),
            Self::AboveTakeoff(base) => write!(f, "above take-off plus its stated height of {} m", base.0),
            Self::Transformed(t) => write!(f, "transformed from {} to {} by PROJ's grids", t.from, t.to),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const US_FOOT_M: f64 = 1200.0 / 3937.0;

    fn unit_m(units: FileUnits, world: &str, config: &HeightConfig) -> Result<f64, String> {
        units.height_unit_m(config, &Crs::parse(world).unwrap()).map_err(|e| e.to_string())
    }

    #[test]
    fn the_unit_of_heights_is_stated_by_file_crs_or_one_scale_and_asked_for_otherwise() {
        let unsaid = FileUnits::default();
        let said = |unit_m: f64| FileUnits { plane_m: None, heights: HeightUnit::Metres(unit_m) };
        let no_choice = HeightConfig::default();
        for (units, world, expected) in [
            (unsaid, "EPSG:25832", 1.0),
            (unsaid, "EPSG:4326", 1.0),
            (unsaid, "EPSG:4979", 1.0),
            (unsaid, "EPSG:2263+6360", US_FOOT_M),
            (unsaid, "EPSG:2263+5703", 1.0),
            (FileUnits::ONE_SCALE, "EPSG:2263", US_FOOT_M),
            (FileUnits::ONE_SCALE, "EPSG:2868", 0.3048),
            (FileUnits::ONE_SCALE, "EPSG:25832", 1.0),
            (said(0.3048), "EPSG:25832", 0.3048),
            (said(1.0), "EPSG:2263", 1.0),
            (said(1.0), "EPSG:2263+6360", 1.0),
        ] {
            let found = unit_m(units, world, &no_choice).unwrap();
            assert!((found - expected).abs() < 1e-15, "{units:?} {world}: {found}");
        }
        let asked = unit_m(unsaid, "EPSG:2263", &no_choice).unwrap_err();
        assert!(asked.contains("counts positions in feet") && asked.contains("EPSG:2263+5703"), "{asked}");
        let vertical = HeightConfig {
            crs: Some(Crs::parse("EPSG:6360").unwrap()),
            reference: Some(VerticalDatum::Orthometric),
            ..no_choice
        };
        assert!((unit_m(unsaid, "EPSG:2263", &vertical).unwrap() - US_FOOT_M).abs() < 1e-15);
    }
}
