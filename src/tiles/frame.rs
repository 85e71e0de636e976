//! What is settled once for a city, from all of its input, and stays when it is planned again: local origin, range of
//! heights, halo and the grid of the tiles.
//!
//! Each of these is taken in round numbers, so that a house or a photo more leaves it where it is, and a plan from nothing
//! comes to the same. Where a change carries one past a round number after all, what was settled before is kept as long as
//! it is nearly as good: else every tile would be run again for a house at the rim.

use serde::{Deserialize, Serialize};

/// How far the settled origin may lie from the one that would be chosen now: easting, northing, height; metres. Single
/// precision then still holds half a millimetre at the rim of a city of 8 km.
const ORIGIN_LEEWAY_M: [f64; 3] = [2000.0, 2000.0, 300.0];
/// How much smaller or larger the settled halo and greatest height may be than those that would be chosen now: the greatest
/// height that is chosen is 0.8 of the lowest flight, and a quarter more just reaches it.
const LEEWAY: f64 = 1.25;
/// The same for the side of the grid's largest squares, one step, and for the places where the photos are searched for ground.
const SIDE_LEEWAY: f64 = 2.0;

/// Frame settled for a city.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CityFrame {
    /// Settings that it was settled for: other settings settle it anew.
    pub asked: serde_json::Value,
    /// Origin of the local frame, map frame, metres.
    pub origin_m: [f64; 3],
    /// Least and greatest height that is looked for, metres.
    pub heights_m: [f32; 2],
    /// Width of the halo, metres.
    pub halo_m: f64,
    /// Distance around a core within which views are taken in, metres.
    pub view_margin_m: f64,
    /// Side of the grid's largest squares, metres.
    pub side_m: f64,
    /// Distance between the places where the photos are searched for ground, metres.
    pub ground_spacing_m: f64,
}

impl CityFrame {
    /// Earlier frame, where it still serves; else this one.
    #[must_use]
    pub fn or_kept(self, before: Option<Self>) -> Self {
        before.filter(|before| self.is_served_by(before)).unwrap_or(self)
    }

    fn is_served_by(&self, before: &Self) -> bool {
        let near = |now: f64, then: f64, factor: f64| then <= now * factor && now <= then * factor;
        let origins = self.origin_m.iter().zip(&before.origin_m).zip(&ORIGIN_LEEWAY_M);
        self.asked == before.asked
            && origins.into_iter().all(|((now, then), leeway)| (now - then).abs() <= *leeway)
            && self.heights_m[0] == before.heights_m[0]
            && near(f64::from(self.heights_m[1]), f64::from(before.heights_m[1]), LEEWAY)
            && near(self.halo_m, before.halo_m, LEEWAY)
            && near(self.side_m, before.side_m, SIDE_LEEWAY)
            && near(self.ground_spacing_m, before.ground_spacing_m, SIDE_LEEWAY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> CityFrame {
        CityFrame {
            asked: serde_json::json!({ "halo_m": null }),
            origin_m: [565_000.0, 5_932_000.0, 300.0],
            heights_m: [2.0, 150.0],
            halo_m: 700.0,
            view_margin_m: 234.0,
            side_m: 8000.0,
            ground_spacing_m: 40.0,
        }
    }

    #[test]
    fn what_was_settled_stays_where_it_still_serves() {
        let before = frame();
        let now = CityFrame { origin_m: [566_000.0, 5_932_000.0, 200.0], halo_m: 750.0, side_m: 4000.0, ..frame() };
        assert_eq!(now.or_kept(Some(before.clone())), before);
        assert_eq!(before.clone().or_kept(None), before);
    }

    #[test]
    fn what_no_longer_serves_or_was_not_asked_for_is_settled_anew() {
        let asked = serde_json::json!({ "halo_m": 100.0 });
        let far = CityFrame { origin_m: [569_000.0, 5_932_000.0, 300.0], ..frame() };
        let low = CityFrame { heights_m: [2.0, 80.0], ..frame() };
        let wide = CityFrame { halo_m: 2000.0, ..frame() };
        let other = CityFrame { asked, ..frame() };
        for now in [far, low, wide, other] {
            assert_eq!(now.clone().or_kept(Some(frame())), now);
        }
    }
}
