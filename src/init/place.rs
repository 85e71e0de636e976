//! Where the photos were taken, as far as their poses tell before there is a project: on the earth, or in numbers of a CRS that
//! nobody names.

use glam::{DVec2, DVec3};

use sizeup_geo::crs::{Crs, Transform};
use sizeup_geo::terrain::MapBox;
use sizeup_heights::stats::median;
use sizeup_survey::{FirstLook, PoseWorld, WorldGuess};

/// Distance from where photos were taken within which anything may be in them, whatever they look at, metres and degrees.
const AROUND_M: f64 = 150.0;
const AROUND_DEG: f64 = 0.0015;
/// Metres of one degree of latitude.
const DEGREE_M: f64 = 111_320.0;
/// Oblique photos see so many flying heights far, at 75° off the vertical: what is farther is too small in them.
const HEIGHTS_FAR: f64 = 3.7;
/// Points along each side of a box that is moved to another CRS.
const PER_SIDE: usize = 8;

/// Places where the photos were taken.
#[derive(Debug, Clone)]
pub(super) enum PhotoPlaces {
    /// Longitudes and latitudes, degrees.
    OnEarth(Vec<(f64, f64)>),
    /// Eastings and northings of a CRS that is not named.
    Numbers(Vec<DVec2>),
    /// Nothing says where.
    Nowhere,
}

impl PhotoPlaces {
    /// Places as the poses tell them.
    pub(super) fn of(look: &FirstLook) -> Self {
        let plane = |positions: &[DVec3]| positions.iter().map(|p| p.truncate()).collect();
        match &look.world {
            _ if !look.places_deg.is_empty() => Self::OnEarth(look.places_deg.clone()),
            PoseWorld::Unsaid(WorldGuess::Degrees) => {
                Self::OnEarth(look.positions.iter().map(|p| (p.x, p.y)).collect())
            }
            PoseWorld::Unsaid(WorldGuess::Projected) => Self::Numbers(plane(&look.positions)),
            _ => Self::Nowhere,
        }
    }

    /// Numbers whose CRS is named after all: poses that do not say are in the project's.
    pub(super) fn read_in(self, crs: Option<&str>) -> Self {
        let Self::Numbers(numbers) = &self else { return self };
        let places_deg = || {
            let crs = Crs::parse(crs?).ok().filter(Crs::is_projected)?;
            let lonlat = Transform::new(&crs, &Crs::parse("EPSG:4326").ok()?).ok()?;
            numbers.iter().map(|p| lonlat.point(p.x, p.y).ok()).collect::<Option<Vec<_>>>()
        };
        match places_deg() {
            Some(places) => Self::OnEarth(places),
            None => self,
        }
    }

    /// With what photos may show that were taken so high above the ground, metres: whereto they look is not known before there is a
    /// project, so all around.
    pub(super) fn seen_from(self, height_m: f64) -> Self {
        let reach_m = (HEIGHTS_FAR * height_m).max(0.0);
        match self {
            Self::OnEarth(places) => Self::OnEarth(
                places
                    .into_iter()
                    .flat_map(|(lon, lat)| {
                        let (north, east) = (reach_m / DEGREE_M, reach_m / DEGREE_M / lat.to_radians().cos().max(0.01));
                        [(lon - east, lat - north), (lon + east, lat + north)]
                    })
                    .collect(),
            ),
            Self::Numbers(numbers) => Self::Numbers(
                numbers.into_iter().flat_map(|at| [at - DVec2::splat(reach_m), at + DVec2::splat(reach_m)]).collect(),
            ),
            Self::Nowhere => Self::Nowhere,
        }
    }

    /// Middle longitude and latitude, degrees.
    pub(super) fn middle_deg(&self) -> Option<(f64, f64)> {
        let Self::OnEarth(places) = self else { return None };
        let (lon, lat): (Vec<f64>, Vec<f64>) = places.iter().copied().unzip();
        median(&lon).zip(median(&lat))
    }

    /// The box around what was photographed, in the units of a CRS; `None` where that is not known.
    pub(super) fn bounds_in(&self, crs: &Crs) -> Option<MapBox> {
        match self {
            Self::OnEarth(places) => {
                let around = MapBox::around(places.iter().copied())?.grown(AROUND_DEG);
                let moved = Transform::new(&Crs::parse("EPSG:4326").ok()?, crs).ok()?;
                MapBox::around(around.border(PER_SIDE).filter_map(|(x, y)| moved.point(x, y).ok()))
            }
            Self::Numbers(numbers) if crs.is_projected() => {
                Some(MapBox::around(numbers.iter().map(|p| (p.x, p.y)))?.grown(AROUND_M))
            }
            Self::Numbers(_) | Self::Nowhere => None,
        }
    }
}
