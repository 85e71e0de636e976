//! A roof's height refined by the photos that show it.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{PhotoConsistency, ground_sample_m};
use crate::picture::Picture;
use crate::stats::jackknife_sigma;

/// Fewer places on a roof cannot be compared.
pub const MIN_PLACES: usize = 40;
/// Fewer photos cannot outvote one that is wrong.
pub const MIN_PHOTOS: usize = 4;

/// How roof heights are refined by the photos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(extend("x-expert" = true))]
pub struct RefinementConfig {
    /// Whether they are; absent: where photos are given, except with `preset = "paper"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = false))]
    pub enabled: Option<bool>,
    /// How far from the height that the priors give the photos' own is looked for, metres. Above 0.
    #[serde(skip)]
    pub within_m: f64,
    /// Most photos that a roof is compared in, at least 4.
    #[serde(skip)]
    pub n_photos: usize,
    /// Places on a roof that are compared.
    #[serde(skip)]
    pub n_points: usize,
    /// Places keep this far from the walls, metres. At least 0.
    #[serde(skip)]
    pub clear_m: f64,
    /// Longer side that photos are reduced to, pixels.
    pub long_side_px: u32,
    /// Least mean correlation of the photos at the height, 0..1.
    #[serde(skip)]
    pub min_score: f64,
    /// By how much it has to be better than at any other height.
    #[serde(skip)]
    pub min_lead: f64,
}

impl Default for RefinementConfig {
    fn default() -> Self {
        Self {
            enabled: None,
            within_m: 3.0,
            n_photos: 10,
            n_points: 300,
            clear_m: 0.7,
            long_side_px: 2000,
            min_score: 0.5,
            min_lead: 0.1,
        }
    }
}

impl RefinementConfig {
    /// The first setting out of range, and what it may be.
    #[must_use]
    pub fn fault(&self) -> Option<(&'static str, &'static str)> {
        let is_fine = (64..=20_000).contains(&self.long_side_px);
        (!is_fine).then_some(("long_side_px", "64 to 20000 pixels"))
    }
}

/// Roof by the photos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// By how much the roof has to be raised, metres.
    pub raised_m: f64,
    /// Standard error over the photos (jackknife), metres.
    pub sigma_m: f64,
    /// Mean correlation of the better pairs of photos, −1..1.
    pub score: f64,
    /// By how much that is more than at any other height.
    pub lead: f64,
}

/// Height at which the photos that show a surface (map frame, metres) look alike; `None` if that is at no height within reach.
#[must_use]
pub fn refine(pictures: &[&Picture], surface: &[DVec3], config: &RefinementConfig) -> Option<Refined> {
    let middle = surface.iter().sum::<DVec3>() / surface.len() as f64;
    let consistency = PhotoConsistency::new(pictures, surface, config.within_m, ground_sample_m(pictures, middle));
    let peak = consistency.peak()?;
    let sigma_m = jackknife_sigma(&consistency.peaks_without_one()?)?;
    Some(Refined { raised_m: peak.raised_m, sigma_m, score: peak.score, lead: peak.lead })
}

/// The share of a refined surface's places (map frame, metres) that lie in regions which look clearly better at another
/// height: where it is large, the surface is not one, and no single shift of it is right.
///
/// Regions: the places, halved again and again across their longer side, as long as each half can be compared.
pub fn elsewhere_share(pictures: &[&Picture], surface: &[DVec3], refined: &Refined, config: &RefinementConfig) -> f64 {
    let mut regions = vec![surface.to_vec()];
    let mut finest = Vec::new();
    while let Some(mut region) = regions.pop() {
        if region.len() < 2 * MIN_PLACES {
            finest.push(region);
            continue;
        }
        let (low, high) =
            region.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        let axis = usize::from((high - low).y > (high - low).x);
        region.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
        let rest = region.split_off(region.len() / 2);
        regions.extend([region, rest]);
    }
    let is_elsewhere = |region: &&Vec<DVec3>| {
        let middle = region.iter().sum::<DVec3>() / region.len() as f64;
        let consistency = PhotoConsistency::new(pictures, region, config.within_m, ground_sample_m(pictures, middle));
        consistency.peak().is_some_and(|peak| {
            peak.score >= config.min_score && peak.score - consistency.score_at(refined.raised_m) >= config.min_lead
        })
    };
    let n_elsewhere: usize = finest.iter().filter(is_elsewhere).map(Vec::len).sum();
    n_elsewhere as f64 / surface.len() as f64
}

#[cfg(test)]
mod tests {
    use crate::camera::Camera;
    use crate::frames::Rigid;

    use super::*;

    const ROOF_M: f64 = 12.0;
    /// Half a side of the roof, metres.
    const HALF_M: f64 = 25.0;

    fn texture(centre: DVec3, ray: DVec3) -> f32 {
        let at = centre + ray * ((ROOF_M - centre.z) / ray.z);
        let wave = |f: f64, g: f64| (f * at.x + g * at.y).sin();
        (60.0 * (wave(1.3, 0.6) + wave(-0.7, 1.6) + wave(2.1, -1.5))) as f32
    }

    /// Six photos, each of which shows three quarters of a roof, none all of it.
    #[test]
    fn a_roof_that_no_photo_shows_all_of_is_refined_by_what_they_share() {
        let plan =
            || (0..400).map(|i| DVec3::new(f64::from(i % 20) - 9.5, f64::from(i / 20) - 9.5, 0.0) * (HALF_M / 10.0));
        let eyes = [[40.0, 10.0], [-40.0, 5.0], [0.0, 45.0], [10.0, -40.0], [30.0, 30.0], [-30.0, -25.0]];
        let pictures = eyes.map(|[x, y]| {
            let aim = DVec3::new(x, y, 0.0).normalize() * 18.0 + ROOF_M * DVec3::Z;
            let pose = Rigid::looking_at(DVec3::new(x, y, 80.0), aim);
            Picture::seeing(Camera::pinhole(400, 400, 600.0), pose, texture)
        });
        let shown = |picture: &Picture| plan().filter(|p| picture.shows(*p + ROOF_M * DVec3::Z)).count();
        for picture in &pictures {
            assert!((240..380).contains(&shown(picture)), "{} of 400 places", shown(picture));
        }
        let given: Vec<DVec3> = plan().map(|p| p + (ROOF_M - 1.2) * DVec3::Z).collect();
        let refined = refine(&pictures.each_ref(), &given, &RefinementConfig::default()).expect("they share enough");
        assert!((refined.raised_m - 1.2).abs() < 0.05 && refined.score > 0.9, "{refined:?}");
    }
}
