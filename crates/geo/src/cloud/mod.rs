//! Point clouds: reading them, and telling which points belong to which footprint.
//!
//! | file | instances | classes |
//! |---|---|---|
//! | LAS, LAZ | extra dimension `instance`, `instance_id`, `building` or `building_id`; 0 is none | as stored: 2 ground, 6 building |
//! | text: `x y z [instance]`, split by spaces, tabs, commas or semicolons | fourth column; 0 is none | none |

mod claims;
mod contained;
mod instances;
mod read;
mod segment;

use glam::DVec3;

pub use read::{CloudError, is_cloud, read, write_text};
pub use segment::{ground_near, points_in};

/// Class of ground in LAS.
pub const GROUND: u8 = 2;
/// Class of buildings in LAS.
pub const BUILDING: u8 = 6;

/// Points in a map frame, metres.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cloud {
    /// Positions of the points, map frame, metres.
    pub points: Vec<DVec3>,
    /// LAS class of each point; empty where the file has none.
    pub classes: Vec<u8>,
    /// Which building each point is of, `None` for a point of none; empty where the file does not say.
    pub instances: Vec<Option<u32>>,
    /// The CRS that the file states, as EPSG code or WKT.
    pub crs: Option<String>,
}

impl Cloud {
    /// Positions of the points of a class; none where points are not classified.
    pub fn of_class(&self, class: u8) -> impl Iterator<Item = DVec3> + '_ {
        self.points.iter().zip(&self.classes).filter(move |(_, c)| **c == class).map(|(p, _)| *p)
    }

    /// The points of buildings: class 6 where there is one, else all that are not ground.
    #[must_use]
    pub fn of_buildings(&self) -> Vec<DVec3> {
        if self.classes.contains(&BUILDING) {
            return self.of_class(BUILDING).collect();
        }
        let is_ground = |i: usize| self.classes.get(i) == Some(&GROUND);
        self.points.iter().enumerate().filter(|(i, _)| !is_ground(*i)).map(|(_, p)| *p).collect()
    }
}
