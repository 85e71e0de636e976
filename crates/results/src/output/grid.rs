//! The output grid: coordinates as whole numbers of quanta above an origin.
//!
//! ```text
//! i = round((x − o) / s),    x = o + s · i
//! ```
//!
//! `s`: quantum, metres. `o`: origin, the floor of the scene's minimum in whole metres (map frame). Geometry is snapped
//! to the grid *first* and cleaned *after*, so that no step after cleaning moves a vertex: see [`super::footprint`].

use geo_types::Coord;

use super::{BuildingRecord, OutputError};

/// Quantum of coordinates in results, metres: a millimetre, by custom of `CityJSON`.
pub const SCALE_M: f64 = 0.001;

/// Furthest grid index: far from where products of differences overflow an `i64`, and a JSON reader's 32-bit integer
/// holds it. At 1 mm it is 1,000 km.
pub const INDEX_LIMIT: i64 = 1_000_000_000;

/// Integer positions on a map-frame lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutputGrid {
    /// Quantum in all three axes, metres.
    pub scale_m: f64,
    /// Map position of index (0, 0, 0): whole metres.
    pub origin_m: [f64; 3],
}

impl OutputGrid {
    /// The grid that holds all footprints and levels of `records`, and how far they reach.
    ///
    /// # Errors
    /// [`OutputError::TooFarApart`] if the scene does not fit between 0 and [`INDEX_LIMIT`];
    /// [`OutputError::NotFinite`] for a coordinate or level that is not a number.
    pub fn over(records: &[BuildingRecord], scale_m: f64) -> Result<(Self, Option<Extent>), OutputError> {
        let mut extent: Option<Extent> = None;
        for record in records {
            let Some(part) = Extent::of(record)? else { continue };
            extent = Some(extent.map_or(part, |whole| whole.union(&part)));
        }
        Ok((Self::around(extent.as_ref(), scale_m)?, extent))
    }

    /// The grid that holds a box; with any origin where there is none.
    ///
    /// # Errors
    /// [`OutputError::TooFarApart`] if the box does not fit between 0 and [`INDEX_LIMIT`].
    pub fn around(extent: Option<&Extent>, scale_m: f64) -> Result<Self, OutputError> {
        let Some(reach) = extent else { return Ok(Self { scale_m, origin_m: [0.0; 3] }) };
        let origin_m = reach.min_m.map(f64::floor);
        let span_m = (0..3).map(|axis| reach.max_m[axis] - origin_m[axis]).fold(0.0, f64::max);
        if span_m / scale_m > INDEX_LIMIT as f64 {
            return Err(OutputError::TooFarApart { span_m, limit_m: INDEX_LIMIT as f64 * scale_m, scale_m });
        }
        Ok(Self { scale_m, origin_m })
    }

    /// The nearest lattice point to a map position (easting, northing; metres).
    #[must_use]
    pub fn snap(&self, position_m: Coord<f64>) -> [i64; 2] {
        [self.index(position_m.x, 0), self.index(position_m.y, 1)]
    }

    /// The nearest lattice level to a height, metres.
    #[must_use]
    pub fn level(&self, z_m: f64) -> i64 {
        self.index(z_m, 2)
    }

    /// The map position of a lattice point, metres.
    #[must_use]
    pub fn metres(&self, point: [i64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| self.origin_m[axis] + self.scale_m * point[axis] as f64)
    }

    fn index(&self, value_m: f64, axis: usize) -> i64 {
        ((value_m - self.origin_m[axis]) / self.scale_m).round() as i64
    }
}

/// A box in the map frame, metres: easting, northing, up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Western, southern and lowest side, metres.
    pub min_m: [f64; 3],
    /// Eastern, northern and highest side, metres.
    pub max_m: [f64; 3],
}

impl Extent {
    /// The box of a building's footprint between base and roof or ridge; flat at the ground (or 0) where a level is unknown.
    /// `None` without a footprint.
    ///
    /// # Errors
    /// [`OutputError::NotFinite`] for a coordinate or level that is not a number.
    pub fn of(record: &BuildingRecord) -> Result<Option<Self>, OutputError> {
        let Some(footprint) = &record.footprint else { return Ok(None) };
        let known = record.base_z_m.or(record.ground_z_m).unwrap_or(0.0);
        let ridge_m = record.roof.zip(record.ground_z_m).map(|(roof, ground_z_m)| ground_z_m + roof.ridge_height_m);
        let (low, high) = (known, record.roof_z_m().into_iter().chain(ridge_m).reduce(f64::max).unwrap_or(known));
        let mut extent = Self { min_m: [f64::INFINITY, f64::INFINITY, low], max_m: [f64::NEG_INFINITY; 3] };
        extent.max_m[2] = high.max(low);
        for point in
            footprint.exterior().coords().chain(footprint.interiors().iter().flat_map(geo_types::LineString::coords))
        {
            if !(point.x.is_finite() && point.y.is_finite() && low.is_finite() && high.is_finite()) {
                return Err(OutputError::NotFinite { id: record.id.clone() });
            }
            for (axis, value) in [(0, point.x), (1, point.y)] {
                extent.min_m[axis] = extent.min_m[axis].min(value);
                extent.max_m[axis] = extent.max_m[axis].max(value);
            }
        }
        Ok((!footprint.exterior().0.is_empty()).then_some(extent))
    }

    /// The smallest box around both.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self {
            min_m: std::array::from_fn(|axis| self.min_m[axis].min(other.min_m[axis])),
            max_m: std::array::from_fn(|axis| self.max_m[axis].max(other.max_m[axis])),
        }
    }
}
