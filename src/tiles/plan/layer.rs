//! What a plan reads of the footprints and of the ground under them, without holding them.

use std::collections::BTreeMap;

use geo_types::Rect;
use rayon::prelude::*;

use crate::pipeline::{FootprintSettings, PipelineError, check_fallback, check_lengths, footprints_around, layer_of};
use crate::tiles::TilesError;
use crate::tiles::grid::Core;
use sizeup_footprints::{FootprintSource, LayerParts, RefusedFootprint};
use sizeup_geo::issue::Issue;
use sizeup_geo::terrain::MapBox;
use sizeup_results::output::fallback::FallbackConfig;

/// The layer, gone through once.
pub(super) struct CityFootprints {
    /// Middle of each footprint; map frame, metres.
    pub middles: Vec<(f64, f64)>,
    /// Around all of them.
    pub extent: MapBox,
    /// Features whose ids are not what their attribute says ([`LayerParts::visit`]).
    pub renamed: BTreeMap<u64, String>,
    /// Buildings without a usable footprint.
    pub refused: Vec<RefusedFootprint>,
    /// Repairs and refusals of single footprints.
    pub issues: Vec<Issue>,
}

impl CityFootprints {
    /// Reads the layer once.
    ///
    /// # Errors
    /// [`TilesError`] where it cannot be read, none of its footprints can be used, or one is longer than a building can be.
    pub(super) fn read(settings: &FootprintSettings<'_>, heights: &FallbackConfig) -> Result<Self, TilesError> {
        use geo::BoundingRect as _;
        let (mut middles, mut refused, mut issues) = (Vec::new(), Vec::new(), Vec::new());
        let mut extent: Option<MapBox> = None;
        // Holds as soon as one footprint has what heights fall back on.
        let mut fallback = None;
        let mut lengths = Ok(());
        let renamed = LayerParts::open(&layer_of(settings), settings.ground.crs)?.visit(&mut |found| {
            if !matches!(fallback, Some(Ok(()))) {
                fallback = Some(check_fallback(heights, found.footprints.iter().map(|f| &f.attributes)));
            }
            if lengths.is_ok() {
                lengths = check_lengths(&found);
            }
            for footprint in &found.footprints {
                middles.extend(footprint.middle());
                let corners = footprint.polygon.bounding_rect().map(|r: Rect<f64>| [r.min().x_y(), r.max().x_y()]);
                let known = extent.map(|e| [(e.west_m, e.south_m), (e.east_m, e.north_m)]);
                extent = MapBox::around(corners.into_iter().chain(known).flatten());
            }
            refused.extend(found.refused);
            issues.extend(found.issues);
        })?;
        lengths?;
        let Some(extent) = extent else {
            return Err(TilesError::Pipeline(PipelineError::Mismatch {
                message: "none of the input's buildings has a usable footprint".to_owned(),
                hint: "`sizeup run --until footprints` tells why, building by building",
            }));
        };
        // Of footprints found in photos the stage that found them has checked it.
        if matches!(settings.source, FootprintSource::Layer(_)) {
            fallback.transpose()?;
        }
        Ok(Self { middles, extent, renamed, refused, issues })
    }
}

/// Lowest and highest ground of some squares' buildings.
pub(super) fn grounds_of(
    settings: &FootprintSettings<'_>,
    cores: &[Core],
    renamed: &BTreeMap<u64, String>,
) -> Result<Vec<Option<[f64; 2]>>, TilesError> {
    cores.par_iter().map(|core| ground_of(settings, core, renamed)).collect()
}

/// Lowest and highest ground of several areas, metres.
pub(super) fn range(grounds: &[Option<[f64; 2]>]) -> Option<[f64; 2]> {
    grounds.iter().flatten().copied().reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// Lowest and highest ground of a core's buildings.
fn ground_of(
    settings: &FootprintSettings<'_>,
    core: &Core,
    renamed: &BTreeMap<u64, String>,
) -> Result<Option<[f64; 2]>, TilesError> {
    let terrain = &settings.ground.terrain;
    if let Some(z_m) = terrain.constant_m.filter(|_| terrain.dtm.is_none()) {
        return Ok(Some([z_m, z_m]));
    }
    let levels = footprints_around(settings, core.area(), renamed)?.ground;
    let levels = levels.into_iter().flatten().map(|level| level.reference_m);
    Ok(levels.fold(None, |range: Option<[f64; 2]>, z| range.map_or(Some([z, z]), |[a, b]| Some([a.min(z), b.max(z)]))))
}
