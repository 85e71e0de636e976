//! A window of a DTM on a north-up grid in the project's CRS.

use std::path::Path;

use super::Dem;
use super::load::{BAND, TerrainConfig, TerrainError};
use super::voids::{HeightCells, Voids};
use crate::crs::{Crs, CrsError, Transform};
use crate::geodata::raster::{CellWindow, Grid, RasterFile, Resampling};
use crate::issue::Issue;
use sizeup_heights::raster::Raster;

/// An axis-aligned area in the map frame, metres.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MapBox {
    /// Easting of the western edge, metres.
    pub west_m: f64,
    /// Northing of the southern edge, metres.
    pub south_m: f64,
    /// Easting of the eastern edge, metres.
    pub east_m: f64,
    /// Northing of the northern edge, metres.
    pub north_m: f64,
}

impl MapBox {
    /// The smallest one around positions; `None` without any.
    #[must_use]
    pub fn around(positions: impl IntoIterator<Item = (f64, f64)>) -> Option<Self> {
        let point = |(x, y)| Self { west_m: x, south_m: y, east_m: x, north_m: y };
        positions.into_iter().map(point).reduce(|a, b| Self {
            west_m: a.west_m.min(b.west_m),
            south_m: a.south_m.min(b.south_m),
            east_m: a.east_m.max(b.east_m),
            north_m: a.north_m.max(b.north_m),
        })
    }

    /// Larger by a margin on all sides.
    #[must_use]
    pub fn grown(&self, margin_m: f64) -> Self {
        Self {
            west_m: self.west_m - margin_m,
            south_m: self.south_m - margin_m,
            east_m: self.east_m + margin_m,
            north_m: self.north_m + margin_m,
        }
    }

    /// The part that it shares with another; of no size where they share nothing.
    #[must_use]
    pub fn shared_with(&self, other: &Self) -> Self {
        let (west_m, south_m) = (self.west_m.max(other.west_m), self.south_m.max(other.south_m));
        let (east_m, north_m) = (self.east_m.min(other.east_m), self.north_m.min(other.north_m));
        Self { west_m, south_m, east_m: east_m.max(west_m), north_m: north_m.max(south_m) }
    }

    /// Whether a position lies in it; western and southern edge belong to it, the others do not, so that boxes side by
    /// side share no position.
    #[must_use]
    pub fn holds(&self, (x, y): (f64, f64)) -> bool {
        x >= self.west_m && x < self.east_m && y >= self.south_m && y < self.north_m
    }

    /// Distance of a position from it, metres; 0 inside.
    #[must_use]
    pub fn distance_m(&self, (x, y): (f64, f64)) -> f64 {
        let beyond = |v: f64, low: f64, high: f64| (low - v).max(v - high).max(0.0);
        beyond(x, self.west_m, self.east_m).hypot(beyond(y, self.south_m, self.north_m))
    }

    /// Distance to another, metres; 0 where they share something.
    #[must_use]
    pub fn gap_m(&self, other: &Self) -> f64 {
        let across = (other.west_m - self.east_m).max(self.west_m - other.east_m).max(0.0);
        let along = (other.south_m - self.north_m).max(self.south_m - other.north_m).max(0.0);
        across.hypot(along)
    }

    /// Points along the edges, `n` per side, and the middle: where a box goes under a transformation.
    pub fn border(&self, n: usize) -> impl Iterator<Item = (f64, f64)> + use<> {
        let Self { west_m, south_m, east_m, north_m } = *self;
        let along = move |i: usize| {
            let t = i as f64 / n as f64;
            let (x, y) = (west_m + t * (east_m - west_m), south_m + t * (north_m - south_m));
            [(x, south_m), (x, north_m), (west_m, y), (east_m, y)]
        };
        (0..=n).flat_map(along).chain([(f64::midpoint(west_m, east_m), f64::midpoint(south_m, north_m))])
    }
}

impl std::fmt::Display for MapBox {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.0}..{:.0}, {:.0}..{:.0}", self.west_m, self.east_m, self.south_m, self.north_m)
    }
}

/// Easting and northing, or longitude and latitude.
type Position = (f64, f64);

/// A DTM and how to read it.
pub(super) struct DtmSource<'a> {
    pub file: &'a RasterFile,
    pub path: &'a Path,
    pub crs: &'a Crs,
    pub config: &'a TerrainConfig,
    /// Metres per unit of its heights.
    pub unit_m: f64,
}

/// So many cells of a file are read at a time where they are averaged.
const CELLS_AT_A_TIME: usize = 1 << 25;
/// More cells, which only the map of a whole city has, are averaged by GDAL, with the file's overviews.
const MOST_CELLS: usize = 1 << 29;

impl DtmSource<'_> {
    fn crs_error(&self, source: CrsError) -> TerrainError {
        TerrainError::Crs { path: self.path.to_owned(), source }
    }

    fn dem(&self, heights: Raster<f32>, corner: Position, cell: (f64, f64)) -> Result<Dem, TerrainError> {
        Dem::new(heights, corner.0, corner.1, cell.0, cell.1)
            .map_err(|source| TerrainError::Dem { path: self.path.to_owned(), source })
    }

    /// A part of the raster in its own CRS, with cells of at least `min_cell` of its own units; heights are metres.
    fn window(
        &self,
        grid: Grid,
        wanted: MapBox,
        own_units_per_m: f64,
    ) -> Result<Option<(Dem, Vec<Issue>)>, TerrainError> {
        let min_cell = self.config.min_cell_m * own_units_per_m;
        let (width, height) = self.file.size();
        // Two cells more on every side, for the bilinear neighbourhood of positions at the edge.
        let span = |from: f64, to: f64, n: usize| -> Option<(usize, usize)> {
            let first = (from.floor() - 2.0).max(0.0);
            let last = (to.ceil() + 2.0).min(n as f64);
            (first < last).then_some((first as usize, (last - first) as usize))
        };
        let columns = span((wanted.west_m - grid.west) / grid.cell_x, (wanted.east_m - grid.west) / grid.cell_x, width);
        let rows =
            span((grid.north - wanted.north_m) / grid.cell_y, (grid.north - wanted.south_m) / grid.cell_y, height);
        let (Some((col, width)), Some((row, height))) = (columns, rows) else { return Ok(None) };
        let reduced = |n: usize, cell: f64| ((n as f64 * cell / cell.max(min_cell)).round() as usize).max(1);
        let size = (reduced(width, grid.cell_x), reduced(height, grid.cell_y));
        let window = CellWindow { col, row, width, height };
        let cell_m = grid.cell_x.max(grid.cell_y) / own_units_per_m;
        let counted = HeightCells { unit_m: self.unit_m, cell_m };
        let (mut heights, voids) = self.without_voids(window, size, counted)?;
        let (unit_m, offset_m) = (self.unit_m, self.config.vertical_offset_m.unwrap_or(0.0));
        if unit_m != 1.0 {
            heights.data_mut().iter_mut().for_each(|z| *z = (f64::from(*z) * unit_m) as f32);
        }
        heights.data_mut().iter_mut().for_each(|z| *z += offset_m as f32);
        let (west, north) = (grid.west + col as f64 * grid.cell_x, grid.north - row as f64 * grid.cell_y);
        let (cell_x, cell_y) =
            (grid.cell_x * width as f64 / size.0 as f64, grid.cell_y * height as f64 / size.1 as f64);
        let dem = self.dem(heights, (west, north), (cell_x, cell_y))?;
        Ok(Some((dem, voids.issues(self.path, counted))))
    }

    /// Heights of a window at another size, in the file's unit: voids have to go before cells are averaged.
    fn without_voids(
        &self,
        window: CellWindow,
        size: (usize, usize),
        counted: HeightCells,
    ) -> Result<(Raster<f32>, Voids), TerrainError> {
        let mut voids = Voids::default();
        let CellWindow { width, height, .. } = window;
        let is_whole = size == (width, height);
        if is_whole || width.saturating_mul(height) > MOST_CELLS {
            let resampling = if is_whole { Resampling::Nearest } else { Resampling::Average };
            let mut heights = self.file.read_window(BAND, window, size, resampling)?;
            voids.blank(&mut heights, counted);
            return Ok((heights, voids));
        }
        self.file.check_window(BAND, window, size)?;
        let rows_per_row = height as f64 / size.1 as f64;
        let rows_at_a_time = ((CELLS_AT_A_TIME as f64 / (width as f64 * rows_per_row)) as usize).max(1);
        let mut averaged = Vec::with_capacity(size.0 * size.1);
        for first in (0..size.1).step_by(rows_at_a_time) {
            let last = (first + rows_at_a_time).min(size.1);
            let from = ((first as f64 * rows_per_row) as usize).min(height - 1);
            let to = ((last as f64 * rows_per_row).ceil() as usize).clamp(from + 1, height);
            let part = CellWindow { row: window.row + from, height: to - from, ..window };
            let mut cells = self.file.read_window(BAND, part, (width, to - from), Resampling::Nearest)?;
            voids.blank(&mut cells, counted);
            let top = first as f64 * rows_per_row - from as f64;
            averaged.extend(averages(&cells, size.0, last - first, top, rows_per_row));
        }
        Ok((Raster::from_vec(size.0, size.1, averaged).expect("one value per cell"), voids))
    }
}

/// Means over larger cells, weighted by how much of each smaller one lies in them; cells without a value are left out. `top` is
/// where the first row begins, in rows of the smaller cells.
fn averages(cells: &Raster<f32>, n_cols: usize, n_rows: usize, top: f64, rows_per_row: f64) -> Vec<f32> {
    let cols_per_col = cells.width() as f64 / n_cols as f64;
    let mean = |col: usize, row: usize| {
        let (left, upper) = (col as f64 * cols_per_col, top + row as f64 * rows_per_row);
        let (mut sum, mut weights) = (0.0, 0.0);
        for (j, wy) in shares(upper, rows_per_row, cells.height()) {
            for (i, wx) in shares(left, cols_per_col, cells.width()) {
                let z = cells.data()[j * cells.width() + i];
                if !z.is_nan() {
                    sum += wx * wy * f64::from(z);
                    weights += wx * wy;
                }
            }
        }
        if weights > 0.0 { (sum / weights) as f32 } else { f32::NAN }
    };
    (0..n_rows).flat_map(|row| (0..n_cols).map(move |col| (col, row))).map(|(col, row)| mean(col, row)).collect()
}

/// The cells of a row or column that a stretch meets, and how much of each.
fn shares(from: f64, length: f64, n: usize) -> impl Iterator<Item = (usize, f64)> {
    /// Rounding of the ends of a stretch.
    const NOTHING: f64 = 1e-6;
    let to = (from + length).min(n as f64);
    (from as usize..(to.ceil() as usize).min(n))
        .map(move |i| (i, (i as f64 + 1.0).min(to) - (i as f64).max(from)))
        .filter(|(_, share)| *share > NOTHING)
}

/// The DTM around `area` in the project's CRS: the file's own cells where it is in that CRS already.
pub(super) fn read(source: &DtmSource<'_>, project_crs: &Crs, area: MapBox) -> Result<(Dem, Vec<Issue>), TerrainError> {
    let grid = source.file.grid()?;
    let (width, height) = source.file.size();
    let extent = MapBox {
        west_m: grid.west,
        south_m: grid.north - height as f64 * grid.cell_y,
        east_m: grid.west + width as f64 * grid.cell_x,
        north_m: grid.north,
    };
    let to_dtm = Transform::new(project_crs, source.crs).map_err(|e| source.crs_error(e))?;
    let in_dtm: Vec<(Position, Position)> =
        area.border(8).filter_map(|p| Some((p, to_dtm.point(p.0, p.1).ok()?))).collect();
    let elsewhere = || {
        let covers = Transform::new(source.crs, project_crs)
            .ok()
            .and_then(|t| MapBox::around(extent.border(8).filter_map(|(x, y)| t.point(x, y).ok())));
        let gap_m = covers.map(|covers| covers.gap_m(&area));
        TerrainError::Elsewhere {
            path: source.path.to_owned(),
            distance: gap_m.map_or_else(String::new, |gap_m| format!(", {:.0} km away", gap_m / 1000.0)),
            hint: hint_at_zone(project_crs, area, covers, gap_m),
            found: covers.map_or_else(|| format!("{extent} in {}", source.crs), |b| b.to_string()),
            expected: area.to_string(),
            crs: project_crs.to_string(),
        }
    };
    let wanted = MapBox::around(in_dtm.iter().map(|(_, p)| *p)).ok_or_else(elsewhere)?;

    let is_same_plane = in_dtm.iter().all(|(p, q)| (p.0 - q.0).abs() < 1e-3 && (p.1 - q.1).abs() < 1e-3);
    let own_cells_per_m = own_units_per_metre(&in_dtm, area);
    let (dem, issues) = source.window(grid, wanted, own_cells_per_m)?.ok_or_else(elsewhere)?;
    if is_same_plane {
        return Ok((dem, issues));
    }
    let cell_m = dem.cell_m().0.min(dem.cell_m().1) / own_cells_per_m;
    let heights = resample(&dem, &to_dtm, area, cell_m).map_err(|e| source.crs_error(e))?;
    source.dem(heights, (area.west_m, area.north_m), (cell_m, cell_m)).map(|dem| (dem, issues))
}

/// Advice where a model lies elsewhere than the project: far away it is the CRS that is wrong, not the tile.
fn hint_at_zone(project_crs: &Crs, area: MapBox, covers: Option<MapBox>, gap_m: Option<f64>) -> String {
    let middle = (f64::midpoint(area.west_m, area.east_m), f64::midpoint(area.south_m, area.north_m));
    let is_there = |place| covers.is_some_and(|covers| covers.distance_m(place) < FAR_M);
    let zone = || project_crs.read_in(project_crs.other_zones(), middle, is_there);
    match gap_m {
        Some(gap_m) if gap_m > FAR_M => match zone() {
            Some(zone) => format!(
                "a wrong CRS is the likely cause, not the model: the project's numbers fit {zone} ({}), so try project.crs = \"{zone}\"",
                zone.name()
            ),
            None => "a wrong CRS is the likely cause: is project.crs right (its zone, too), and the CRS of the model?"
                .to_owned(),
        },
        _ => "is it the right tile, is its CRS right?".to_owned(),
    }
}

/// Further apart than this, two inputs of a project have different ideas of its place, metres.
const FAR_M: f64 = 20_000.0;

/// Length of a metre of the map in the other CRS (1e-5 for degrees), by the larger of its two directions.
fn own_units_per_metre(pairs: &[(Position, Position)], area: MapBox) -> f64 {
    let Some(there) = MapBox::around(pairs.iter().map(|(_, p)| *p)) else { return 1.0 };
    let ratio = |there: f64, here: f64| if here > 0.0 { there / here } else { 0.0 };
    let largest = ratio(there.east_m - there.west_m, area.east_m - area.west_m)
        .max(ratio(there.north_m - there.south_m, area.north_m - area.south_m));
    if largest > 0.0 { largest } else { 1.0 }
}

/// Bilinear values at cell centres of a grid over `area`. Positions are transformed exactly at every 32nd cell and
/// interpolated between: over tens of metres a map projection bends by less than a millimetre.
fn resample(dem: &Dem, to_dtm: &Transform, area: MapBox, cell_m: f64) -> Result<Raster<f32>, CrsError> {
    const STEP: usize = 32;
    let count = |extent_m: f64| ((extent_m / cell_m).ceil() as usize).max(1);
    let (width, height) = (count(area.east_m - area.west_m), count(area.north_m - area.south_m));
    let node = |i: usize, j: usize| {
        let (col, row) = ((i * STEP) as f64 + 0.5, (j * STEP) as f64 + 0.5);
        to_dtm.point(area.west_m + col * cell_m, area.north_m - row * cell_m)
    };
    let (n_x, n_y) = (width.div_ceil(STEP) + 1, height.div_ceil(STEP) + 1);
    let nodes = (0..n_y).flat_map(|j| (0..n_x).map(move |i| (i, j))).map(|(i, j)| node(i, j));
    let nodes: Vec<(f64, f64)> = nodes.collect::<Result<_, _>>()?;

    let position = |col: usize, row: usize| {
        let (i, j) = (col / STEP, row / STEP);
        let (fx, fy) = ((col % STEP) as f64 / STEP as f64, (row % STEP) as f64 / STEP as f64);
        let mix = |a: (f64, f64), b: (f64, f64), t: f64| (a.0 + (b.0 - a.0) * t, a.1 + (b.1 - a.1) * t);
        let at = |i: usize, j: usize| nodes[j * n_x + i];
        mix(mix(at(i, j), at(i + 1, j), fx), mix(at(i, j + 1), at(i + 1, j + 1), fx), fy)
    };
    let heights = (0..height).flat_map(|row| (0..width).map(move |col| (col, row))).map(|(col, row)| {
        let (x, y) = position(col, row);
        dem.height_at(x, y).map_or(f32::NAN, |z| z as f32)
    });
    Ok(Raster::from_vec(width, height, heights.collect()).expect("one value per cell"))
}
