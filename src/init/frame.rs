//! Which CRS a project gets: the one that is asked for, that of the poses, that of the footprints or the terrain, else a grid in
//! metres on the datum of one of these where they count feet, else the UTM zone of the photos.

use super::InitError;
use super::place::PhotoPlaces;
use super::poses::PoseSource;
use glam::DVec3;
use sizeup_geo::crs::{Crs, CrsError, Transform};
use sizeup_survey::{PoseWorld, WorldGuess};

/// Numbers that a zone gives for where the photos are differ from the poses' by less, metres: satellite positions.
const SAME_PLACE_M: f64 = 500.0;
/// Zones in which ETRS89 is used.
const ETRS89_ZONES: std::ops::RangeInclusive<i64> = 28..=38;

/// A CRS that the project may have.
#[derive(Debug, Clone)]
pub(super) struct CrsCandidate {
    /// CRS that the project may have.
    pub crs: Crs,
    /// As it is written in the configuration.
    pub definition: String,
    /// Where the CRS comes from, in words.
    pub why: String,
}

impl CrsCandidate {
    fn new(crs: Crs, why: impl Into<String>) -> Self {
        let definition = short(&crs);
        Self { crs, definition, why: why.into() }
    }
}

/// A file whose CRS may be the project's.
pub(super) struct NeighbourFile<'a> {
    /// Name of the file, in words.
    pub name: String,
    /// CRS of the file.
    pub crs: &'a Crs,
}

/// A CRS as a person would write it.
pub(super) fn short(crs: &Crs) -> String {
    match (crs.epsg(), crs.horizontal_epsg(), crs.vertical_epsg()) {
        (Some(code), ..) => format!("EPSG:{code}"),
        (None, Some(plane), Some(heights)) => format!("EPSG:{plane}+{heights}"),
        _ => crs.definition().to_owned(),
    }
}

/// A CRS by its code where it has one, else by its name.
fn short_name(crs: &Crs) -> String {
    crs.horizontal_epsg().map_or_else(|| crs.name().to_owned(), |code| format!("EPSG:{code}"))
}

/// The CRS that is asked for.
pub(super) fn asked(definition: &str, place: &PhotoPlaces) -> Result<CrsCandidate, InitError> {
    let crs = Crs::parse(definition)?;
    let better = |error| match (error, place.middle_deg()) {
        (CrsError::NotProjectedInMetres { definition, found, .. }, Some((lon, lat))) => {
            let hint = if crs.is_metric() {
                let zone = utm(lon, lat).map_or_else(|| Crs::utm_zone(lon, lat), |crs| short(&crs));
                format!(
                    "the photos lie at {lon:.3}°, {lat:.3}° (longitude, latitude): use {zone} (UTM), the national grid, or leave --crs \
                     out"
                )
            } else {
                format!("{}, or leave --crs out", crs.advice_at("photos lie", lon, lat))
            };
            CrsError::NotProjectedInMetres { definition, found, hint }
        }
        (error, _) => error,
    };
    crs.require_projected_metres().map_err(better)?;
    crs.require_heights_in_metres()?;
    let definition = definition.trim().to_owned();
    Ok(CrsCandidate { crs, definition, why: "as asked for by --crs".to_owned() })
}

/// Candidates for the CRS where none is asked for, the best first.
pub(super) fn candidates(
    source: &PoseSource,
    neighbours: &[NeighbourFile<'_>],
    photos_at: &PhotoPlaces,
) -> Vec<CrsCandidate> {
    let is_fit = |crs: &Crs| crs.require_projected_metres().is_ok() && crs.require_heights_in_metres().is_ok();
    let own = match &source.look.world {
        PoseWorld::Named(crs) if is_fit(crs) => {
            let by = source.placed_by.as_ref().map_or_else(String::new, |by| format!(", by {by}"));
            Some(CrsCandidate::new(crs.clone(), format!("the CRS of the poses{by}")))
        }
        _ => None,
    };
    let coded = |near: &&NeighbourFile<'_>| is_fit(near.crs) && near.crs.horizontal_epsg().is_some();
    let near = neighbours.iter().filter(coded);
    let near = near.map(|near| CrsCandidate::new(near.crs.clone(), format!("the CRS of {}", near.name)));
    let place = PhotoPlaces::of(&source.look);
    let of_poses = match &source.look.world {
        PoseWorld::Named(crs) => Some(("the poses", crs)),
        PoseWorld::Local | PoseWorld::Unsaid(_) => None,
    };
    let named = of_poses.into_iter().chain(neighbours.iter().map(|near| (near.name.as_str(), near.crs)));
    let in_feet = named.filter(|(_, crs)| !crs.is_metric());
    let mut twins: Vec<CrsCandidate> = in_feet
        .filter_map(|(name, crs)| {
            let (lon, lat) = place.middle_deg()?;
            let why = format!("in metres, on the datum of {name}, which count feet in {}", short_name(crs));
            Some(CrsCandidate::new(crs.in_metres_at(lon, lat)?, why))
        })
        .collect();
    twins.dedup_by(|a, b| a.definition == b.definition);
    let zone = place.middle_deg().and_then(|(lon, lat)| {
        let why = format!("the UTM zone of the photos, at {lon:.4}°, {lat:.4}° (longitude, latitude)");
        Some(CrsCandidate::new(utm(lon, lat)?, why))
    });
    let confirmed = confirmed(source, photos_at);
    own.into_iter().chain(near).chain(twins).chain(zone).chain(confirmed).collect()
}

/// The zone in which the photos' own positions are where poses of an unnamed grid are.
fn confirmed(source: &PoseSource, photos_at: &PhotoPlaces) -> Option<CrsCandidate> {
    if source.look.world != PoseWorld::Unsaid(WorldGuess::Projected) {
        return None;
    }
    let (lon, lat) = photos_at.middle_deg()?;
    let n = source.look.positions.len().max(1) as f64;
    let middle = source.look.positions.iter().sum::<DVec3>() / n;
    let crs = utm(lon, lat)?;
    let (x, y) = Transform::new(&Crs::parse("EPSG:4326").ok()?, &crs).ok()?.point(lon, lat).ok()?;
    let is_there = (middle.x - x).hypot(middle.y - y) < SAME_PLACE_M;
    is_there.then(|| CrsCandidate::new(crs, "the UTM zone in which the photos' own positions and the poses agree"))
}

/// The UTM zone of a place: on ETRS89 where that grid is meant for it, else on WGS 84.
fn utm(lon_deg: f64, lat_deg: f64) -> Option<Crs> {
    let zone = (((lon_deg + 180.0) / 6.0).floor() as i64).rem_euclid(60) + 1;
    let european = ETRS89_ZONES.contains(&zone).then(|| Crs::parse(&format!("EPSG:258{zone}")).ok()).flatten();
    european
        .filter(|crs| crs.is_meant_for(lon_deg, lat_deg))
        .or_else(|| Crs::parse(&Crs::utm_zone(lon_deg, lat_deg)).ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zones_are_european_where_that_grid_is_meant_for() {
        let zone = |lon, lat| short(&utm(lon, lat).unwrap());
        assert_eq!(zone(9.18, 48.78), "EPSG:25832");
        assert_eq!(zone(18.07, 59.33), "EPSG:25834");
        assert_eq!(zone(-87.63, 41.88), "EPSG:32616");
        assert_eq!(zone(-70.67, -33.44), "EPSG:32719");
        assert_eq!(zone(139.7, 35.7), "EPSG:32654");
    }

    #[test]
    fn compound_systems_are_written_by_their_codes() {
        assert_eq!(short(&Crs::parse("EPSG:25832+7837").unwrap()), "EPSG:25832+7837");
        assert_eq!(short(&Crs::parse("EPSG:7415").unwrap()), "EPSG:7415");
    }
}
