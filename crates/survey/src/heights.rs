//! From what a survey's heights are counted from to the project's vertical reference.
//!
//! Where the file and the configuration leave it open, heights are taken as the project's. Where they are known to be
//! ellipsoidal, or of no known reference, taking them as they are must be said: a geoid lies up to 107 m off. A height
//! beside a longitude and latitude is of no known reference where its CRS has no third axis.

use glam::DVec3;

use super::SurveyError;
use super::config::{HeightConfig, VerticalDatum};
use super::poses::FileHeights;
use sizeup_geo::crs::{
    Accuracy, Crs, CrsError, EllipsoidalHeight, GeoidHeight, HeightAboveGround, HeightAboveTakeoff, OrthometricHeight,
    Transform, Transform3d,
};

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
            from: from.vertical_name().unwrap_or("ellipsoid").to_owned(),
            to,
        })))
    }

    /// The height in the project of a position in the world of the poses.
    pub(crate) fn in_project(&self, at: DVec3) -> Result<f64, CrsError> {
        Ok(match self {
            Self::AsTheyAre | Self::TakenOver(_) | Self::KeptEllipsoidal => at.z,
            Self::Geoid(geoid) => EllipsoidalHeight(at.z).above_geoid(*geoid).0,
            Self::AboveGround(ground) => HeightAboveGround(at.z).over(*ground).0,
            Self::AboveTakeoff(takeoff) => HeightAboveTakeoff(at.z).from_takeoff(*takeoff).0,
            Self::Transformed(t) => {
                let (lon_deg, lat_deg) = t.lonlat_from_world.point(at.x, at.y)?;
                t.operation.point(DVec3::new(lon_deg, lat_deg, at.z))?.z
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
