//! From how many places cameras see something: photos from one place, however often the camera is turned, show no depth.
//!
//! ```text
//! apart   two cameras are in different places, seen from p, where the angle between their rays to p is LEAST_ANGLE or more
//! ```

use glam::DVec3;

use super::View;

/// Below this angle between two rays an error of a pixel becomes an error in height of dozens, radians: 2°.
const LEAST_ANGLE_RAD: f64 = 0.035;

/// Cameras that see a place, and the places that they see it from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Viewpoints {
    /// Number of the views that see it.
    pub n_views: usize,
    /// Number of the places that they were taken from, up to [`Self::ENOUGH`].
    pub n_places: usize,
}

impl Viewpoints {
    /// So many places are not told apart from more.
    pub const ENOUGH: usize = 3;

    /// Those of some views that see a place of the map.
    pub fn of<'a>(views: impl IntoIterator<Item = &'a View>, place: DVec3) -> Self {
        let mut rays: Vec<DVec3> = Vec::with_capacity(Self::ENOUGH);
        let mut n_views = 0;
        for view in views.into_iter().filter(|view| view.pixel_of(place).is_some()) {
            n_views += 1;
            let ray = view.centre() - place;
            let is_apart = |known: &DVec3| known.angle_between(ray) >= LEAST_ANGLE_RAD;
            if rays.len() < Self::ENOUGH && rays.iter().all(is_apart) {
                rays.push(ray);
            }
        }
        Self { n_views, n_places: rays.len() }
    }

    /// Whether several views see it, and all of them from one place.
    #[must_use]
    pub fn lack_baseline(self) -> bool {
        self.n_views > 1 && self.n_places == 1
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DMat3;

    use super::*;
    use sizeup_heights::camera::Camera;
    use sizeup_heights::frames::Rigid;

    /// Straight down from 100 m above ground, this far east.
    fn view(east_m: f64) -> View {
        let rotation = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        View {
            id: "a".into(),
            camera: Arc::new(Camera::pinhole(400, 300, 300.0)),
            camera_from_map: Rigid::from_rotation_and_centre(rotation, DVec3::new(east_m, 0.0, 100.0)),
            image: None,
        }
    }

    #[test]
    fn a_drone_that_hovers_and_sways_is_in_one_place() {
        let of = |easts: &[f64]| Viewpoints::of(&easts.iter().copied().map(view).collect::<Vec<_>>(), DVec3::ZERO);
        assert!(of(&[0.0, 0.8, -1.1]).lack_baseline());
        assert_eq!(of(&[0.0, 0.8, 20.0]), Viewpoints { n_views: 3, n_places: 2 });
        assert_eq!(of(&[0.0, 10.0, 20.0, 30.0]).n_places, Viewpoints::ENOUGH);
        assert!(!of(&[0.0]).lack_baseline(), "one photo says nothing of the flight");
        assert_eq!(of(&[500.0]), Viewpoints::default(), "it does not see the place");
    }
}
