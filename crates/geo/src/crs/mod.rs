//! Coordinate reference systems and transforms, through the system's PROJ.
//!
//! The only door to PROJ. Axis order is always easting, northing or longitude, latitude, whatever the authority says.
//! Ballpark transformations (PROJ's word for "the datum shift is unknown, so it is left out") are refused.

mod accuracy;
mod convergence;
mod grids;
mod levels;
mod spatial;
mod transform;
mod twin;
mod vertical;
mod zones;

pub use accuracy::{Accuracy, Better};
pub use convergence::{GridNorth, TrueNorth};
pub use grids::{GridFile, data_folders, grids_present, of_heights as height_grids, proj_version};
pub use levels::{LevelTransform, VerticalReference};
pub use spatial::{Geocentric, Transform3d, enu_from_geocentric};
pub use transform::Transform;
pub use vertical::{EllipsoidalHeight, GeoidHeight, HeightAboveGround, HeightAboveTakeoff, OrthometricHeight};

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::kept::Kept;

/// Why a CRS or a transformation cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CrsError {
    /// PROJ does not know the definition.
    #[error("unknown CRS {definition:?}: {reason}\nhint: write it as \"EPSG:25832\", as WKT or as a PROJ string")]
    Unknown {
        /// Text that the user wrote.
        definition: String,
        /// Reason in PROJ's words.
        reason: String,
    },
    /// The project's CRS must be projected, in metres.
    #[error(
        "{definition} cannot be the project's CRS: expected a projected CRS in metres, found {found}\nhint: {hint}"
    )]
    NotProjectedInMetres {
        /// Text that the user wrote.
        definition: String,
        /// Kind of the CRS that was given, in words.
        found: String,
        /// Text to write in its place.
        hint: String,
    },
    /// No accurate operation is known between two systems.
    #[error(
        "no accurate transformation from {from} to {to}: {reason}\n\
         hint: a datum grid may be missing (`projinfo -s {from} -t {to}` lists the operations and their grids); \
         or, where positions come from a base station in the datum of {to}, declare its geographic system: {base}"
    )]
    NoTransformation {
        /// Definition of the source CRS.
        from: String,
        /// Definition of the target CRS.
        to: String,
        /// Reason in PROJ's words.
        reason: String,
        /// Geographic system of the target.
        base: String,
    },
    /// The grid file that a height transformation needs is not installed.
    #[error(
        "heights cannot be moved from {from} to {to}: the grid file is not installed: {grids}\n\
         hint: put it into a folder named by PROJ_DATA (`projsync --file NAME` fetches it), or state the shift: \
         `geoid_offset` (or `keep_ellipsoidal`) for poses, --geoid-height for 3D Tiles, --level-shift for a reference"
    )]
    MissingGrid {
        /// Definition of the source CRS.
        from: String,
        /// Definition of the target CRS.
        to: String,
        /// The files and where to get them.
        grids: String,
    },
    /// One point lies outside the transformation's domain.
    #[error("cannot transform ({x}, {y}) from {from} to {to}: {reason}")]
    Point {
        /// Easting or longitude of the point.
        x: f64,
        /// Northing or latitude of the point.
        y: f64,
        /// Definition of the source CRS.
        from: String,
        /// Definition of the target CRS.
        to: String,
        /// Reason in PROJ's words.
        reason: String,
    },
}

/// A coordinate reference system that PROJ knows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Crs {
    definition: String,
    /// PROJ's own description of the definition (PROJJSON).
    json: Value,
}

impl TryFrom<String> for Crs {
    type Error = CrsError;

    fn try_from(definition: String) -> Result<Self, CrsError> {
        Self::parse(&definition)
    }
}

impl From<Crs> for String {
    fn from(crs: Crs) -> Self {
        crs.definition
    }
}

impl std::fmt::Display for Crs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.epsg() {
            Some(code) => write!(f, "EPSG:{code}"),
            None => f.write_str(self.name()),
        }
    }
}

/// A run has to do with a handful of systems: so many are kept once PROJ and GDAL have told of them, which takes milliseconds.
const MOST_KEPT: usize = 64;
/// Longer definitions, bytes, are read each time: PROJ's own have some kilobytes.
const LONGEST_KEPT: usize = 1 << 16;

impl Crs {
    /// Reads `EPSG:n`, `EPSG:h+v`, WKT, PROJJSON or a PROJ string.
    ///
    /// # Errors
    /// [`CrsError::Unknown`] when PROJ cannot read it.
    pub fn parse(definition: &str) -> Result<Self, CrsError> {
        static PARSED: LazyLock<Kept<String, Crs>> = LazyLock::new(|| Kept::up_to(MOST_KEPT));
        let definition = with_type(definition.trim());
        if definition.len() > LONGEST_KEPT {
            return Self::parse_anew(&definition);
        }
        PARSED.get(&definition, || Self::parse_anew(&definition)).map(|crs| crs.as_ref().clone())
    }

    fn parse_anew(definition: &str) -> Result<Self, CrsError> {
        // PROJ would print its own line about a definition that it does not know; GDAL keeps its messages to itself.
        if !spatial::is_known(definition) {
            let reason = "it is not in PROJ's database, or is no CRS".to_owned();
            return Err(CrsError::Unknown { definition: definition.to_owned(), reason });
        }
        Self::known(definition)
    }

    /// A definition that PROJ knows, such as a name that PROJ itself gave.
    fn known(definition: &str) -> Result<Self, CrsError> {
        let unknown = |reason: String| CrsError::Unknown { definition: definition.to_owned(), reason };
        let crs = proj::Proj::new(definition).map_err(|e| unknown(e.to_string()))?;
        let json = crs.to_projjson(None, None, None).map_err(|_| unknown("not a CRS".to_owned()))?;
        let json: Value = serde_json::from_str(&json).map_err(|e| unknown(e.to_string()))?;
        let is_crs = json["type"].as_str().is_some_and(|t| t.ends_with("CRS"));
        if !is_crs {
            return Err(unknown(format!("it is a {}, not a CRS", json["type"].as_str().unwrap_or("definition"))));
        }
        Ok(Self { definition: definition.to_owned(), json })
    }

    /// As the user wrote it.
    #[must_use]
    pub fn definition(&self) -> &str {
        &self.definition
    }

    /// PROJ's name of it, such as `ETRS89 / UTM zone 32N`.
    #[must_use]
    pub fn name(&self) -> &str {
        self.json["name"].as_str().unwrap_or(&self.definition)
    }

    /// The same by its own code, where it is written as two codes and EPSG has one for both: other programs know it by that.
    #[must_use]
    pub fn registered(self) -> Self {
        let code = if self.epsg().is_none() { Self::epsg_of_name(self.name()) } else { None };
        let own = code.and_then(|code| Self::parse(&format!("EPSG:{code}")).ok());
        let parts = |crs: &Self| (crs.horizontal_epsg(), crs.vertical_epsg());
        own.filter(|own| parts(own) == parts(&self)).unwrap_or(self)
    }

    /// EPSG code (a compound's own code, where one exists).
    #[must_use]
    pub fn epsg(&self) -> Option<u32> {
        epsg_of(&self.json)
    }

    /// The horizontal part: itself, or the first part of a compound.
    fn horizontal_json(&self) -> &Value {
        let crs = if self.json["type"] == "CompoundCRS" { &self.json["components"][0] } else { &self.json };
        if crs["type"] == "BoundCRS" { &crs["source_crs"] } else { crs }
    }

    /// EPSG code of the horizontal part; a vertical system has none.
    #[must_use]
    pub fn horizontal_epsg(&self) -> Option<u32> {
        let horizontal = Some(self.horizontal_json()).filter(|crs| crs["type"] != "VerticalCRS")?;
        // PROJ leaves the parts of a compound that has a code of its own without theirs: look the name up.
        epsg_of(horizontal).or_else(|| Self::epsg_of_name(horizontal["name"].as_str()?))
    }

    fn epsg_of_name(name: &str) -> Option<u32> {
        match grids::codes_of_name(name) {
            Some(codes) => codes.first().copied(),
            None => Self::known(name).ok()?.epsg(),
        }
    }

    /// The vertical part of a compound, or a vertical CRS itself; null for the others.
    fn vertical_json(&self) -> &Value {
        let crs = if self.json["type"] == "CompoundCRS" { &self.json["components"][1] } else { &self.json };
        let crs = if crs["type"] == "BoundCRS" { &crs["source_crs"] } else { crs };
        if crs["type"] == "VerticalCRS" { crs } else { &Value::Null }
    }

    /// Whether both count heights upwards from one vertical datum. Their units may differ: NAVD88 in metres and in feet is one
    /// datum under two codes and two names.
    #[must_use]
    pub fn has_heights_of(&self, other: &Self) -> bool {
        let zero = |crs: &Self| -> Option<String> {
            let vertical = crs.vertical_json();
            let datum = if vertical["datum"].is_null() { &vertical["datum_ensemble"] } else { &vertical["datum"] };
            let is_up = vertical["coordinate_system"]["axis"][0]["direction"] == "up";
            // Esri writes underscores for blanks.
            let name: String = datum["name"].as_str()?.chars().filter(|c| c.is_alphanumeric()).collect();
            is_up.then(|| name.to_lowercase())
        };
        zero(self).is_some_and(|own| Some(own) == zero(other))
    }

    /// The vertical part of a compound CRS by name, such as `NAP height`.
    #[must_use]
    pub fn vertical_name(&self) -> Option<&str> {
        self.json["components"][1]["name"].as_str()
    }

    /// Metres per unit of its heights: of the vertical part of a compound, or of a third axis; `None` where it has no heights.
    #[must_use]
    pub fn height_unit_m(&self) -> Option<f64> {
        let vertical = &self.json["components"][1]["coordinate_system"]["axis"][0];
        let axis = if vertical.is_null() { self.axes().get(2)? } else { vertical };
        if axis["unit"] == "metre" { Some(1.0) } else { axis["unit"]["conversion_factor"].as_f64() }
    }

    /// Metres per unit of eastings and northings; `None` where positions are angles.
    #[must_use]
    pub fn plane_unit_m(&self) -> Option<f64> {
        let axis = self.axes().first().filter(|_| !self.is_geographic())?;
        if axis["unit"] == "metre" { Some(1.0) } else { axis["unit"]["conversion_factor"].as_f64() }
    }

    /// Whether it is a system of heights alone, in which nothing has a position.
    #[must_use]
    pub fn is_vertical(&self) -> bool {
        self.json["type"] == "VerticalCRS"
    }

    /// EPSG code of the vertical part of a compound CRS, or of a vertical CRS itself.
    #[must_use]
    pub fn vertical_epsg(&self) -> Option<u32> {
        let vertical = match self.json["type"].as_str()? {
            "CompoundCRS" => &self.json["components"][1],
            "VerticalCRS" => &self.json,
            _ => return None,
        };
        epsg_of(vertical).or_else(|| Self::epsg_of_name(vertical["name"].as_str()?))
    }

    /// With the heights of `stated`, where it says nothing of heights itself and both have the same plane: many a file says
    /// where its positions are, and not what its levels are.
    #[must_use]
    pub fn with_heights_of(self, stated: Option<&Self>) -> Self {
        let adds = |stated: &&Self| {
            self.height_unit_m().is_none() && stated.height_unit_m().is_some() && self.has_plane_of(stated)
        };
        stated.filter(adds).cloned().unwrap_or(self)
    }

    /// Whether positions in both are the same numbers: one code, or one definition under two names.
    #[must_use]
    pub fn has_plane_of(&self, other: &Self) -> bool {
        let codes = (self.horizontal_epsg(), other.horizontal_epsg());
        match codes {
            (Some(own), Some(theirs)) => own == theirs,
            _ => {
                codes == (None, None) && self.horizontal_json() == other.horizontal_json()
                    || spatial::is_same(&self.horizontal_json().to_string(), &other.horizontal_json().to_string())
            }
        }
    }

    /// Whether it has a third axis of ellipsoidal heights.
    #[must_use]
    pub fn is_ellipsoidal_3d(&self) -> bool {
        self.is_geocentric() || self.axes().len() == 3
    }

    /// Area in which the horizontal part is meant to be used: west, south, east, north, degrees; `None` where PROJ does not say,
    /// or across the date line.
    #[must_use]
    pub fn area_of_use_deg(&self) -> Option<[f64; 4]> {
        let crs = self.horizontal_json();
        let boxes = [&crs["bbox"], &crs["usages"][0]["bbox"], &self.json["bbox"]];
        let bounds = boxes.into_iter().find(|bounds| !bounds.is_null())?;
        let side = |name: &str| bounds[name].as_f64();
        let (west, east) = (side("west_longitude")?, side("east_longitude")?);
        (west < east).then_some([west, side("south_latitude")?, east, side("north_latitude")?])
    }

    /// The UTM zone of a place on WGS 84, as `EPSG:326zz` or `EPSG:327zz`.
    #[must_use]
    pub fn utm_zone(lon_deg: f64, lat_deg: f64) -> String {
        let zone = Self::utm_zone_number(lon_deg);
        let hemisphere = if lat_deg < 0.0 { 327 } else { 326 };
        format!("EPSG:{hemisphere}{zone:02}")
    }

    /// The number of the UTM zone of a longitude, from 1.
    fn utm_zone_number(lon_deg: f64) -> i64 {
        (((lon_deg + 180.0) / 6.0).floor() as i64).rem_euclid(60) + 1
    }

    /// The geodetic datum (or ensemble of datums) of the horizontal part.
    fn datum(&self) -> &Value {
        let crs = self.horizontal_json();
        let geodetic = if crs["base_crs"].is_null() { crs } else { &crs["base_crs"] };
        if geodetic["datum"].is_null() { &geodetic["datum_ensemble"] } else { &geodetic["datum"] }
    }

    /// Whether both count from one geodetic datum, so that only a projection lies between their planes.
    #[must_use]
    pub fn has_datum_of(&self, other: &Self) -> bool {
        let is_unnamed = |name: &str| name.to_ascii_lowercase().starts_with("unknown");
        let (own, theirs) = (self.datum()["name"].as_str(), other.datum()["name"].as_str());
        own.is_some_and(|name| !is_unnamed(name)) && own == theirs
    }

    /// Name of the ellipsoid, such as `WGS 84`.
    fn ellipsoid_name(&self) -> Option<&str> {
        self.datum()["ellipsoid"]["name"].as_str()
    }

    /// Whether the horizontal part is projected.
    #[must_use]
    pub fn is_projected(&self) -> bool {
        self.horizontal_json()["type"] == "ProjectedCRS"
    }

    /// Whether the horizontal part is geographic (longitude, latitude in degrees).
    #[must_use]
    pub fn is_geographic(&self) -> bool {
        self.horizontal_json()["type"].as_str().is_some_and(|t| t.starts_with("Geographic"))
    }

    /// Whether positions in it are counted in metres or degrees, and not in feet.
    #[must_use]
    pub fn is_metric(&self) -> bool {
        !self.is_projected() || self.axes().iter().take(2).all(|axis| axis["unit"] == "metre")
    }

    /// Two turns of longitude and the poles in the unit of a geographic system; `None` for the others.
    fn angular_limits(&self) -> Option<(f64, f64)> {
        const DEGREES: (f64, f64) = (360.0, 90.0);
        const GONS: (f64, f64) = (400.0, 100.0);
        let is_degrees = self.axes().iter().take(2).all(|axis| axis["unit"] == "degree");
        self.is_geographic().then_some(if is_degrees { DEGREES } else { GONS })
    }

    /// Whether it is geocentric (earth-centred x, y, z in metres).
    #[must_use]
    pub fn is_geocentric(&self) -> bool {
        let json = self.horizontal_json();
        json["type"] == "GeodeticCRS" && json["coordinate_system"]["subtype"] == "Cartesian"
    }

    /// The geographic system a projected one is made of; itself where it is geographic.
    ///
    /// # Errors
    /// [`CrsError::Unknown`] for systems without one, such as local engineering grids.
    pub fn geographic_base(&self) -> Result<Self, CrsError> {
        if self.is_geographic() {
            return Ok(self.clone());
        }
        let base = &self.horizontal_json()["base_crs"];
        if base.is_null() {
            let reason = "it has no geographic base".to_owned();
            return Err(CrsError::Unknown { definition: self.definition.clone(), reason });
        }
        // PROJJSON leaves the type of a base out where it is plain.
        let mut base = base.clone();
        if base["type"].is_null() {
            base["type"] = "GeographicCRS".into();
        }
        Self::known(&base.to_string())
    }

    /// Checks that it can be the frame of a project: projected, in metres, and no web map.
    ///
    /// # Errors
    /// [`CrsError::NotProjectedInMetres`], with a suggestion.
    pub fn require_projected_metres(&self) -> Result<(), CrsError> {
        let refuse = |found: &str, hint: &str| CrsError::NotProjectedInMetres {
            definition: self.definition.clone(),
            found: found.to_owned(),
            hint: hint.to_owned(),
        };
        let use_utm = "use the national grid, or the UTM zone of the area: EPSG:326xx north and EPSG:327xx south of \
                       the equator, with zone xx = floor((longitude + 180) / 6) + 1";
        if !self.is_projected() {
            return Err(refuse(&format!("{} ({})", self.name(), self.horizontal_json()["type"]), use_utm));
        }
        if self.name().contains("Pseudo-Mercator") {
            return Err(refuse("Web Mercator, whose metres are stretched by 1/cos(latitude)", use_utm));
        }
        let units_are_metres = self.axes().iter().all(|axis| axis["unit"] == "metre");
        if !units_are_metres {
            return Err(refuse("axes in feet or degrees", use_utm));
        }
        Ok(())
    }

    fn axes(&self) -> &[Value] {
        self.horizontal_json()["coordinate_system"]["axis"].as_array().map_or(&[], Vec::as_slice)
    }

    /// Whether the authority lists northing or latitude first.
    fn is_north_first(&self) -> bool {
        self.axes().first().is_some_and(|axis| axis["direction"] == "north" || axis["direction"] == "south")
    }
}

/// PROJ strings of older tools (ODM's own) lack `+type=crs`, without which they are operations. A pipeline is one anyway.
fn with_type(definition: &str) -> String {
    let is_pipeline = definition.starts_with("+proj=pipeline");
    let lacks_type = definition.starts_with("+proj") && !is_pipeline && !definition.contains("+type=crs");
    if lacks_type { format!("{definition} +type=crs") } else { definition.to_owned() }
}

fn epsg_of(json: &Value) -> Option<u32> {
    (json["id"]["authority"] == "EPSG").then(|| json["id"]["code"].as_u64())?.and_then(|code| u32::try_from(code).ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_feet_and_web_maps_are_no_project_frame() {
        for definition in ["EPSG:4326", "EPSG:3857", "EPSG:2230", "EPSG:4978"] {
            let refused = Crs::parse(definition).unwrap().require_projected_metres();
            assert!(refused.is_err(), "{definition}");
        }
        for definition in ["EPSG:25832", "EPSG:7415", "EPSG:2180", "EPSG:28992+5709"] {
            Crs::parse(definition).unwrap().require_projected_metres().unwrap();
        }
    }

    #[test]
    fn compound_systems_know_their_parts() {
        let crs = Crs::parse("EPSG:7415").unwrap();
        assert_eq!((crs.epsg(), crs.horizontal_epsg()), (Some(7415), Some(28992)));
        assert_eq!(crs.vertical_name(), Some("NAP height"));
        assert_eq!(crs.height_unit_m(), Some(1.0));
        let levels = Crs::parse("EPSG:5709").unwrap();
        assert_eq!((levels.horizontal_epsg(), levels.vertical_epsg()), (None, Some(5709)));
        assert_eq!(Crs::parse("EPSG:28992+5709").unwrap().registered().epsg(), Some(7415));
        assert_eq!(
            Crs::parse("EPSG:28992+5773").unwrap().registered().definition(),
            "EPSG:28992+5773",
            "without a code"
        );
        // Long Island in US survey feet, heights likewise; without its vertical part nothing is said of heights.
        let feet = Crs::parse("EPSG:2263+6360").unwrap().height_unit_m().unwrap();
        assert!((feet - 1200.0 / 3937.0).abs() < 1e-12, "{feet}");
        assert_eq!(Crs::parse("EPSG:2263").unwrap().height_unit_m(), None);
        // International feet.
        assert_eq!(Crs::parse("EPSG:2868").unwrap().plane_unit_m(), Some(0.3048));
        assert_eq!(Crs::parse("EPSG:2263").unwrap().plane_unit_m(), Some(feet));
        let of = |definition: &str| Crs::parse(definition).unwrap().plane_unit_m();
        assert_eq!((of("EPSG:25832"), of("EPSG:4326"), of("EPSG:4978")), (Some(1.0), None, Some(1.0)));
    }

    #[test]
    fn utm_zones_follow_the_longitude() {
        assert_eq!(Crs::utm_zone(11.9, 52.0), "EPSG:32632");
        assert_eq!(Crs::utm_zone(-70.6, -33.4), "EPSG:32719");
        assert_eq!(Crs::utm_zone(180.0, 10.0), "EPSG:32601");
    }

    #[test]
    fn one_vertical_datum_has_several_codes_and_a_depth_is_none_of_them() {
        let is_one = |a: &str, b: &str| Crs::parse(a).unwrap().has_heights_of(&Crs::parse(b).unwrap());
        for same in ["EPSG:2263+6360", "EPSG:4269+8228", "EPSG:5703"] {
            assert!(is_one(same, "EPSG:32118+5703"), "{same}");
        }
        assert!(is_one("EPSG:2263+5702", "EPSG:32118+7968"), "NGVD29 in feet and in metres");
        for other in ["EPSG:2263+6358", "EPSG:2263+5702", "EPSG:2263", "EPSG:4979"] {
            assert!(!is_one(other, "EPSG:32118+5703"), "{other}");
        }
        let underscores = r#"COMPD_CS["x",GEOGCS["NAD83",DATUM["North_American_Datum_1983",SPHEROID["GRS 1980",6378137,298.257222101]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],VERT_CS["NAVD_1988_Foot_US",VERT_DATUM["North_American_Vertical_Datum_1988",2005],UNIT["US survey foot",0.304800609601219],AXIS["Up",UP]]]"#;
        assert!(is_one(underscores, "EPSG:32118+5703"));
    }

    #[test]
    fn nonsense_is_unknown() {
        assert!(matches!(Crs::parse("EPSG:0"), Err(CrsError::Unknown { .. })));
        assert!(matches!(Crs::parse("+proj=pipeline +step +proj=utm +zone=32"), Err(CrsError::Unknown { .. })));
    }
}
