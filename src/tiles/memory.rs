//! How much memory a tile needs, from what the plan can count.
//!
//! ```text
//! rays       views · blocks of the working image
//! crossings  rays · footprints met per ray          met: footprints · mean breadth / area · way below the tallest roof
//! bytes      base + rays · 40 + crossings · 24 + threads · (prior + view) + terrain + photos
//! ```

use sizeup_heights::optimise::OptimiseConfig;

/// The program, its libraries and buffers, bytes.
const BASE: f64 = 70e6;
/// Per ray: its profile (20), two priors (8), its block (4), the sums of a sweep.
const PER_RAY: f64 = 40.0;
/// Per crossing: its profile (12), the index of its building (4), where it stops its ray (4).
const PER_CROSSING: f64 = 24.0;
/// Per building: footprint, attributes, records, results being written.
const PER_BUILDING: f64 = 12e3;
/// Per view: pose, name, its share of what is read.
const PER_VIEW: f64 = 4e3;
/// Per cell of the terrain, in the map's and in the local frame.
const PER_CELL: f64 = 12.0;
/// Per pixel of a prior while it is read.
const PER_PRIOR_PIXEL: f64 = 16.0;
/// Breadth of a typical footprint as rays meet it, metres.
const BREADTH_M: f64 = 20.0;
/// Pixels of the prior that is assumed where none can be read.
const PRIOR_PIXELS: f64 = 1024.0 * 1024.0;
/// Factor of the estimate: engines kill a process that needs more than it reserved.
const SAFETY: f64 = 1.3;

/// Content of a tile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileCounts {
    /// Number of views.
    pub n_views: usize,
    /// Buildings of core and halo.
    pub n_buildings: usize,
    /// Area of core and halo, m².
    pub area_m2: f64,
    /// Greatest height that is looked for, metres.
    pub tallest_m: f64,
    /// Width over height of the photos.
    pub aspect: f64,
    /// Mean of horizontal over vertical way of the views' rays.
    pub slope: f64,
    /// Cell of the terrain, metres; `None` for a constant.
    pub cell_m: Option<f64>,
    /// Threads that read priors at the same time.
    pub n_threads: usize,
    /// Memory of reduced photos, bytes.
    pub photo_bytes: usize,
}

/// Megabytes that a tile needs at most.
#[must_use]
pub fn estimate_mb(counts: &TileCounts, optimise: &OptimiseConfig) -> u64 {
    let width = f64::from(optimise.working_px);
    let stride = optimise.stride_px.max(1) as f64;
    let (n_views, n_buildings) = (counts.n_views as f64, counts.n_buildings as f64);
    let rays = n_views * (width / stride).ceil() * (width / counts.aspect.max(1.0) / stride).ceil();
    let per_m = n_buildings * BREADTH_M / counts.area_m2.max(1.0);
    let crossings = rays * per_m * counts.tallest_m * counts.slope;
    let cells = counts.cell_m.map_or(0.0, |cell_m| counts.area_m2 / (cell_m * cell_m));
    let bytes = BASE
        + rays * PER_RAY
        + crossings * PER_CROSSING
        + n_buildings * PER_BUILDING
        + n_views * PER_VIEW
        + cells * PER_CELL
        + counts.n_threads as f64 * PRIOR_PIXELS * PER_PRIOR_PIXEL
        + counts.photo_bytes as f64;
    (SAFETY * bytes / 1e6).ceil() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_estimate_grows_with_views_and_buildings() {
        let counts = TileCounts {
            n_views: 100,
            n_buildings: 500,
            area_m2: 1e6,
            tallest_m: 100.0,
            aspect: 4.0 / 3.0,
            slope: 1.0,
            cell_m: None,
            n_threads: 2,
            photo_bytes: 0,
        };
        let mb = |counts: TileCounts| estimate_mb(&counts, &OptimiseConfig::default());
        let more_views = mb(TileCounts { n_views: 1000, ..counts });
        let more_buildings = mb(TileCounts { n_buildings: 5000, ..counts });
        assert!(mb(counts) < more_views && mb(counts) < more_buildings);
        // 1,000 views of 112 × 84 rays, each with 32 bytes of its own at least.
        assert!(more_views > 300, "{more_views}");
    }
}
