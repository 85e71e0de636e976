//! Systems of several zones, whose numbers look alike: which zone numbers were written in.

use std::ops::RangeInclusive;

use super::{Crs, Transform};

/// EPSG codes of zones side by side: UTM on WGS 84 north and south, ETRS89 and NAD83, MGA94 and MGA2020, Gauss-Krüger of Germany,
/// CS2000 of Poland.
const FAMILIES: [RangeInclusive<u32>; 8] = [
    32601..=32660,
    32701..=32760,
    25828..=25838,
    26901..=26923,
    28348..=28358,
    7846..=7859,
    31466..=31469,
    2176..=2179,
];

impl Crs {
    /// The other zones of its family, the nearest first; empty for systems without zones.
    pub fn other_zones(&self) -> impl Iterator<Item = Self> + use<> {
        let own = self.horizontal_epsg();
        let family = own.and_then(|own| FAMILIES.iter().find(|family| family.contains(&own)));
        let mut codes: Vec<u32> = family.cloned().into_iter().flatten().filter(|code| Some(*code) != own).collect();
        codes.sort_by_key(|code| own.map(|own| own.abs_diff(*code)));
        codes.into_iter().filter_map(|code| Self::parse(&format!("EPSG:{code}")).ok())
    }

    /// The first of some systems in which numbers are a place that `is_there`, in this system's plane.
    pub fn read_in(
        &self,
        candidates: impl IntoIterator<Item = Self>,
        (x, y): (f64, f64),
        is_there: impl Fn((f64, f64)) -> bool,
    ) -> Option<Self> {
        let fits = |candidate: &Self| {
            let place = Transform::new(candidate, self).ok().and_then(|to_own| to_own.point(x, y).ok());
            place.is_some_and(&is_there)
        };
        candidates.into_iter().find(fits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_the_neighbouring_zone_are_found_in_it() {
        let project = Crs::parse("EPSG:25833").unwrap();
        let zones: Vec<Option<u32>> = project.other_zones().take(3).map(|zone| zone.epsg()).collect();
        assert_eq!(zones, [Some(25832), Some(25834), Some(25831)]);
        // Hamburg, in zone 32; the footprints are there, in the project's zone 33.
        let hamburg = (565_000.0, 5_933_000.0);
        let there =
            Transform::new(&Crs::parse("EPSG:25832").unwrap(), &project).unwrap().point(hamburg.0, hamburg.1).unwrap();
        let is_there = |(x, y): (f64, f64)| (x - there.0).hypot(y - there.1) < 1000.0;
        let found = project.read_in(project.other_zones(), hamburg, is_there).unwrap();
        assert_eq!(found.epsg(), Some(25832));
        assert_eq!(Crs::parse("EPSG:2180").unwrap().other_zones().count(), 0);
    }
}
