//! The grid in metres to work in, for a CRS that cannot carry a project: the same grid counted in metres, or the UTM zone on the
//! same datum.

use super::{Crs, CrsError, TrueNorth, grids};

/// Most that a metre of a project's grid may differ from one on the ground: heights are off by as much. The worst of national
/// grids reach 0.4 % at their edges.
const MOST_SCALE_ERROR: f64 = 0.01;

impl Crs {
    /// A projected CRS in metres on the same geodetic datum that is meant for a place: the same grid in metres where this one
    /// counts feet, else the UTM zone. `None` where EPSG has neither.
    #[must_use]
    pub fn in_metres_at(&self, lon_deg: f64, lat_deg: f64) -> Option<Self> {
        let name = self.horizontal_json()["name"].as_str()?;
        // EPSG names grids by their units: "NAD83 / New York Long Island (ftUS)" and "NAD83 / New York Long Island", "… Wood (ftUS)"
        // and "… Wood (m)".
        let own = name.split_once(" (ft").map(|(name, _)| [name.to_owned(), format!("{name} (m)")]);
        let hemisphere = if lat_deg < 0.0 { 'S' } else { 'N' };
        let base = self.geographic_base().ok()?;
        // A definition of one's own has no name, and its datum has.
        let by_datum = self.datum()["name"].as_str().map(grids::systems_on_datum).unwrap_or_default();
        let utm = std::iter::once(base.name().to_owned()).chain(by_datum);
        let utm = utm.map(|base| format!("{base} / UTM zone {}{hemisphere}", Self::utm_zone_number(lon_deg)));
        own.into_iter().flatten().chain(utm).find_map(|name| {
            let code = *grids::codes_of_name(&name)?.first()?;
            let crs = Self::parse(&format!("EPSG:{code}")).ok()?;
            let is_fit = crs.require_projected_metres().is_ok() && crs.has_datum_of(self);
            (is_fit && crs.is_meant_for(lon_deg, lat_deg)).then_some(crs)
        })
    }

    /// Whether a place lies in its area of use.
    #[must_use]
    pub fn is_meant_for(&self, lon_deg: f64, lat_deg: f64) -> bool {
        self.area_of_use_deg().is_some_and(|[west, south, east, north]| {
            (west..=east).contains(&lon_deg) && (south..=north).contains(&lat_deg)
        })
    }

    /// Advice on a CRS that can carry a project whose `what` (photos, survey) lies at a place.
    #[must_use]
    pub fn advice_at(&self, what: &str, lon_deg: f64, lat_deg: f64) -> String {
        let use_it = self.in_metres_at(lon_deg, lat_deg).map_or_else(
            || format!("{} (UTM)", Self::utm_zone(lon_deg, lat_deg)),
            |crs| format!("{crs} ({})", crs.name()),
        );
        format!("the {what} at {lon_deg:.3}°, {lat_deg:.3}° (longitude, latitude): use {use_it}, or the national grid")
    }

    /// Checks that its heights, where it has any, are counted in metres, as a project's are.
    ///
    /// # Errors
    /// [`CrsError::NotProjectedInMetres`] with the vertical system in metres on the same datum.
    pub fn require_heights_in_metres(&self) -> Result<(), CrsError> {
        if self.height_unit_m().is_none_or(|unit_m| unit_m == 1.0) {
            return Ok(());
        }
        let name = self.vertical_name().unwrap_or_else(|| self.name());
        // "NAVD88 height (ftUS)" and "NAVD88 height", "NGVD29 height (ftUS)" and "NGVD29 height (m)".
        let plain = name.split_once(" (ft").map_or(name, |(plain, _)| plain);
        let twin = [plain.to_owned(), format!("{plain} (m)")].into_iter().find_map(|name| {
            let code = *grids::codes_of_name(&name)?.first()?;
            Self::parse(&format!("EPSG:{code}")).ok().filter(|vertical| vertical.has_heights_of(self))?.vertical_epsg()
        });
        let hint = match (self.horizontal_epsg(), twin) {
            (Some(plane), Some(heights)) => {
                format!("use EPSG:{plane}+{heights}: files in feet are converted where they state it")
            }
            _ => "name a vertical part that counts metres, or none".to_owned(),
        };
        let found = format!("heights in another unit ({name})");
        Err(CrsError::NotProjectedInMetres { definition: self.definition().to_owned(), found, hint })
    }

    /// Checks that a metre of this projected CRS is a metre on the ground at a place of it: maps of the world and of continents
    /// stretch lengths.
    ///
    /// # Errors
    /// [`CrsError::NotProjectedInMetres`] with the scale and the UTM zone to use.
    pub fn require_true_scale_at(&self, easting: f64, northing: f64) -> Result<(), CrsError> {
        // A place outside the projection's domain is for others to tell.
        let Ok((scale, (lon_deg, lat_deg))) = TrueNorth::of(self).and_then(|north| north.scale_at(easting, northing))
        else {
            return Ok(());
        };
        let worst = scale.into_iter().max_by(|a, b| (a - 1.0).abs().total_cmp(&(b - 1.0).abs())).unwrap_or(1.0);
        if worst.is_nan() || (worst - 1.0).abs() <= MOST_SCALE_ERROR {
            return Ok(());
        }
        Err(CrsError::NotProjectedInMetres {
            definition: self.definition().to_owned(),
            found: format!("{}, in which a metre on the ground is {worst:.3} m long", self.name()),
            hint: self.advice_at("survey lies", lon_deg, lat_deg),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crs::Transform;

    fn twin(definition: &str, lon: f64, lat: f64) -> Option<u32> {
        Crs::parse(definition).unwrap().in_metres_at(lon, lat)?.epsg()
    }

    #[test]
    fn a_grid_in_feet_has_a_twin_in_metres_on_its_own_datum() {
        assert_eq!(twin("EPSG:2263", -74.0, 40.75), Some(32118));
        assert_eq!(twin("EPSG:2263+6360", -74.0, 40.75), Some(32118));
        assert_eq!(twin("EPSG:6539", -74.0, 40.75), Some(6538), "NAD83(2011)");
        assert_eq!(twin("EPSG:2222", -110.5, 34.0), Some(26948), "international feet");
        assert_eq!(twin("EPSG:7645", -90.1, 44.5), Some(7586), "a county's grid");
        // As ArcGIS writes it.
        let esri = r#"PROJCS["NAD_1983_StatePlane_California_III_FIPS_0403_Feet",GEOGCS["GCS_North_American_1983",DATUM["D_North_American_1983",SPHEROID["GRS_1980",6378137.0,298.257222101]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Lambert_Conformal_Conic"],PARAMETER["False_Easting",6561666.666666666],PARAMETER["False_Northing",1640416.666666667],PARAMETER["Central_Meridian",-120.5],PARAMETER["Standard_Parallel_1",37.06666666666667],PARAMETER["Standard_Parallel_2",38.43333333333333],PARAMETER["Latitude_Of_Origin",36.5],UNIT["Foot_US",0.3048006096012192]]"#;
        assert_eq!(twin(esri, -122.0, 37.5), Some(26943));
    }

    #[test]
    fn without_a_twin_it_is_the_utm_zone_of_the_datum() {
        assert_eq!(twin("EPSG:32066", -87.0, 28.0), Some(26716), "NAD27 / BLM 16N (ftUS)");
        let own = "+proj=lcc +lat_1=41 +lat_2=40.6 +lat_0=40 +lon_0=-74 +datum=NAD83 +units=us-ft";
        assert_eq!(twin(own, -74.0, 40.75), Some(26918));
        assert_eq!(twin("EPSG:3857", 9.98, 53.54), Some(32632));
        // A place that the grid is not meant for.
        assert_eq!(twin("EPSG:2263", 9.98, 53.54), None);
    }

    #[test]
    fn a_project_counts_heights_in_metres() {
        let refused = |text: &str| Crs::parse(text).unwrap().require_heights_in_metres().err().map(|e| e.to_string());
        assert!(refused("EPSG:32118+6360").unwrap().contains("use EPSG:32118+5703"));
        assert!(refused("EPSG:32118+5702").unwrap().contains("use EPSG:32118+7968"));
        for fine in ["EPSG:32118", "EPSG:32118+5703", "EPSG:7415", "EPSG:25832+7837"] {
            assert_eq!(refused(fine), None, "{fine}");
        }
    }

    #[test]
    fn maps_of_the_world_are_no_project_frame_and_national_grids_are() {
        let at = |definition: &str, lon: f64, lat: f64| {
            let crs = Crs::parse(definition).unwrap();
            let (e, n) = Transform::new(&Crs::parse("EPSG:4326").unwrap(), &crs).unwrap().point(lon, lat).unwrap();
            crs.require_true_scale_at(e, n)
        };
        let refused = at("EPSG:3395", 9.98, 53.54).unwrap_err().to_string();
        assert!(refused.contains("is 1.679 m long") && refused.contains("EPSG:32632"), "{refused}");
        // Corners of grids that are stretched most.
        for (definition, lon, lat) in [
            ("EPSG:2154", 9.4, 41.4),
            ("EPSG:25833", 31.0, 70.4),
            ("EPSG:3006", 24.1, 65.8),
            ("EPSG:3067", 31.5, 62.9),
            ("EPSG:2180", 24.1, 50.5),
            ("EPSG:27700", 1.7, 52.5),
            ("EPSG:28992", 7.2, 53.2),
            ("EPSG:3079", -83.0, 42.3),
        ] {
            assert!(at(definition, lon, lat).is_ok(), "{definition}: {:?}", at(definition, lon, lat));
        }
    }
}
