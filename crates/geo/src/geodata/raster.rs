//! Reading rasters: one band, whole or a window of it, at full or reduced size.

use std::path::{Path, PathBuf};

use gdal::Dataset;
use gdal::errors::GdalError;
use gdal::raster::{GdalDataType, RasterBand, ResampleAlg};

use super::open::{self, DatasetKind, OpenError, Refusal};
use crate::crs::{Crs, CrsError};
use crate::gdal_log;
use crate::limits::{self, Excess};
use sizeup_heights::raster::Raster;

/// Formats whose cells are all in the one file: its length tells how many there can be.
const SELF_CONTAINED: [&str; 9] = ["tif", "tiff", "dng", "png", "jpg", "jpeg", "webp", "jp2", "j2k"];

/// Why a raster cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RasterError {
    /// GDAL cannot open it.
    #[error("cannot open raster {}\nhint: `gdalinfo {}` shows what GDAL makes of it", path.display(), path.display())]
    Open {
        /// Path of the raster's file.
        path: PathBuf,
        /// Error that GDAL reported.
        #[source]
        source: GdalError,
    },
    /// It is not given to GDAL at all.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// It claims more cells than it can hold, or than may be read.
    #[error("raster {}: {excess}", path.display())]
    Excess {
        /// Path of the raster's file.
        path: PathBuf,
        /// Size that the file claims, against what is allowed.
        excess: Excess,
    },
    /// Pixels that are partly made up: the file is cut off or garbled.
    #[error("{} is damaged: {words}\nhint: copy or export it again", path.display())]
    Damaged {
        /// Path of the raster's file.
        path: PathBuf,
        /// The decoder's own words.
        words: String,
    },
    /// There is no such file.
    #[error("raster {} does not exist\nhint: is the path right? It counts from the folder of the configuration", path.display())]
    Absent {
        /// The raster's path.
        path: PathBuf,
    },
    /// It opened, and its values cannot be read.
    #[error("cannot read band {band} of {}", path.display())]
    Read {
        /// Path of the raster's file.
        path: PathBuf,
        /// Which band, from 1.
        band: usize,
        /// Error that GDAL reported.
        #[source]
        source: GdalError,
    },
    /// A window outside the raster, or without cells.
    #[error("window {window:?} at {size:?} cells of {}, which has {width} × {height}: {reason}", path.display())]
    Window {
        /// Path of the raster's file.
        path: PathBuf,
        /// Window that was asked for.
        window: CellWindow,
        /// Columns and rows wanted of it.
        size: (usize, usize),
        /// Columns of the raster.
        width: usize,
        /// Rows of the raster.
        height: usize,
        /// Why the window cannot be read.
        reason: &'static str,
    },
    /// No position, or one that is not a plain north-up grid.
    #[error("{} cannot be placed on a map: {reason}\nhint: {hint}", path.display())]
    Grid {
        /// Path of the raster's file.
        path: PathBuf,
        /// Fault of its geotransform.
        reason: String,
        /// Advice to the user: what to change or to look at.
        hint: &'static str,
    },
    /// It has a CRS that PROJ does not understand.
    #[error("the CRS of {} cannot be used", path.display())]
    Crs {
        /// Path of the raster's file.
        path: PathBuf,
        /// Why PROJ cannot use the CRS.
        #[source]
        source: CrsError,
    },
}

/// A block of cells: first column and row, and how many of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CellWindow {
    /// First column, counted from 0 at the left.
    pub col: usize,
    /// First row, counted from 0 at the top.
    pub row: usize,
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
}

/// Place of a north-up raster, in the units of its own CRS (x before y, whatever the authority says).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Western edge of the first column.
    pub west: f64,
    /// Northern edge of the first row.
    pub north: f64,
    /// Width of a cell, positive.
    pub cell_x: f64,
    /// Height of a cell, positive; row 0 is the northernmost.
    pub cell_y: f64,
}

/// Number type of a band's cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SampleType {
    /// Bits per cell and band.
    pub bits: u8,
    /// Floating point, as against integer.
    pub is_float: bool,
}

/// Combination of cells when a window is read at another size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resampling {
    /// Value of the nearest cell.
    Nearest,
    /// Mean of the cells that fall together, nodata left out.
    Average,
}

/// An open raster file.
#[derive(Debug)]
pub struct RasterFile {
    dataset: Dataset,
    path: PathBuf,
    /// Length of the file, bytes, where all cells are in it.
    stored: Option<u64>,
}

impl RasterFile {
    /// Opens a file as what its extension says; `/vsizip/…` and the like work as well.
    ///
    /// # Errors
    /// [`RasterError::Open`]; [`RasterError::Refused`] for what is on a server, or has no extension that names a format.
    pub fn open(path: &Path) -> Result<Self, RasterError> {
        if !crate::files::is_virtual(path) && !path.exists() {
            return Err(RasterError::Absent { path: path.to_owned() });
        }
        let dataset = open::open(path, DatasetKind::Raster).map_err(|fault| match fault {
            OpenError::Refused(refusal) => refusal.into(),
            OpenError::Gdal(source) => RasterError::Open { path: path.to_owned(), source },
        })?;
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let is_whole = SELF_CONTAINED.contains(&extension.as_str());
        let stored = std::fs::metadata(path).ok().filter(|_| is_whole).map(|found| found.len());
        Ok(Self { dataset, path: path.to_owned(), stored })
    }

    /// Numbers of columns and rows.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        self.dataset.raster_size()
    }

    /// Number of bands.
    #[must_use]
    pub fn n_bands(&self) -> usize {
        self.dataset.raster_count()
    }

    /// Number type of the cells of a band (from 1).
    ///
    /// # Errors
    /// [`RasterError::Read`] without such a band.
    pub fn sample_type(&self, band: usize) -> Result<SampleType, RasterError> {
        let kind = self.band(band)?.band_type();
        Ok(SampleType { bits: kind.bits(), is_float: matches!(kind, GdalDataType::Float32 | GdalDataType::Float64) })
    }

    /// Unit of a band's values, as in `m` or `ft`; `None` where the file does not say.
    ///
    /// # Errors
    /// [`RasterError::Read`] without such a band.
    pub fn unit(&self, band: usize) -> Result<Option<String>, RasterError> {
        let unit = self.band(band)?.unit();
        Ok((!unit.is_empty()).then_some(unit))
    }

    /// CRS, `None` where the file has none.
    ///
    /// # Errors
    /// [`RasterError::Crs`] where it has one that PROJ does not understand.
    pub fn crs(&self) -> Result<Option<Crs>, RasterError> {
        let Ok(spatial_ref) = self.dataset.spatial_ref() else { return Ok(None) };
        super::crs_of(&spatial_ref).map_err(|source| RasterError::Crs { path: self.path.clone(), source })
    }

    /// Place.
    ///
    /// # Errors
    /// [`RasterError::Grid`] without a geotransform, and for rotated or south-up grids.
    pub fn grid(&self) -> Result<Grid, RasterError> {
        const MAKE_NORTH_UP: &str = "`gdalwarp INPUT OUTPUT` writes a north-up copy";
        let refuse = |reason: String, hint| RasterError::Grid { path: self.path.clone(), reason, hint };
        let [west, cell_x, row_shear, north, column_shear, minus_cell_y] =
            self.dataset.geo_transform().map_err(|_| {
                refuse(
                    "it has no geotransform".to_owned(),
                    "`gdal_translate -a_ullr WEST NORTH EAST SOUTH INPUT OUTPUT` sets one",
                )
            })?;
        if row_shear != 0.0 || column_shear != 0.0 {
            return Err(refuse("its grid is rotated; expected a north-up one".to_owned(), MAKE_NORTH_UP));
        }
        let is_north_up = cell_x > 0.0 && minus_cell_y < 0.0;
        if !(is_north_up && [west, north, cell_x, minus_cell_y].iter().all(|v| v.is_finite())) {
            let found = format!("cells of {cell_x} × {minus_cell_y}; expected a positive width and a negative height");
            return Err(refuse(found, MAKE_NORTH_UP));
        }
        Ok(Grid { west, north, cell_x, cell_y: -minus_cell_y })
    }

    /// A whole band (from 1); nodata, masked and non-finite cells become `NaN`.
    ///
    /// # Errors
    /// [`RasterError::Read`] without such a band or with a damaged file, [`RasterError::Excess`] for one too large.
    pub fn read(&self, band: usize) -> Result<Raster<f32>, RasterError> {
        let (width, height) = self.size();
        self.read_window(band, CellWindow { col: 0, row: 0, width, height }, (width, height), Resampling::Nearest)
    }

    /// A window of a band (from 1), resampled to `size` (columns, rows). Values have the file's scale and offset
    /// applied; nodata, masked and non-finite cells become `NaN`.
    ///
    /// # Errors
    /// [`RasterError::Window`] for a window that is empty or leaves the raster; [`RasterError::Excess`] for more cells than
    /// the limits allow or the file can hold; [`RasterError::Read`] without such a band or with a damaged file;
    /// [`RasterError::Damaged`] for a photo whose pixels are partly made up by the decoder.
    ///
    /// # Panics
    /// Never: GDAL fills the buffer it is given.
    pub fn read_window(
        &self,
        band: usize,
        window: CellWindow,
        size: (usize, usize),
        resampling: Resampling,
    ) -> Result<Raster<f32>, RasterError> {
        self.check_place(window, size)?;
        let failed = |source| RasterError::Read { path: self.path.clone(), band, source };
        let from = (window.col.cast_signed(), window.row.cast_signed());
        let extent = (window.width, window.height);
        let algorithm = match resampling {
            Resampling::Nearest => ResampleAlg::NearestNeighbour,
            Resampling::Average => ResampleAlg::Average,
        };
        let source = self.band(band)?;
        self.check_claims(&source, window, size)?;
        gdal_log::take_damage();
        let (_, mut values) =
            source.read_as::<f32>(from, extent, size, Some(algorithm)).map_err(failed)?.into_shape_and_vec();
        if let Some(words) = gdal_log::take_damage() {
            return Err(RasterError::Damaged { path: self.path.clone(), words });
        }
        blank_nodata(&source, &mut values);
        let flags = source.mask_flags().map_err(failed)?;
        if flags.is_per_dataset() || flags.is_alpha() {
            let mask = source.open_mask_band().map_err(failed)?;
            let mask = mask.read_as::<u8>(from, extent, size, Some(ResampleAlg::NearestNeighbour)).map_err(failed)?;
            for (value, _) in values.iter_mut().zip(mask.data()).filter(|(_, valid)| **valid == 0) {
                *value = f32::NAN;
            }
        }
        let (scale, offset) = (source.scale().unwrap_or(1.0), source.offset().unwrap_or(0.0));
        if (scale, offset) != (1.0, 0.0) {
            for value in &mut values {
                *value = (f64::from(*value) * scale + offset) as f32;
            }
        }
        Ok(Raster::from_vec(size.0, size.1, values).expect("GDAL fills the buffer it was given"))
    }

    /// Checks that a window can be read at a size, for those who read it in parts.
    ///
    /// # Errors
    /// As [`Self::read_window`], without reading.
    pub fn check_window(&self, band: usize, window: CellWindow, size: (usize, usize)) -> Result<(), RasterError> {
        self.check_place(window, size)?;
        self.check_claims(&self.band(band)?, window, size)
    }

    fn check_place(&self, window: CellWindow, size: (usize, usize)) -> Result<(), RasterError> {
        let (width, height) = self.size();
        let fits = |from: usize, n: usize, total: usize| n > 0 && from.checked_add(n).is_some_and(|end| end <= total);
        let is_inside = fits(window.col, window.width, width) && fits(window.row, window.height, height);
        let is_sane = size.0 > 0 && size.1 > 0;
        let reason = match (is_inside, is_sane) {
            (true, true) => return Ok(()),
            (false, _) => "it leaves the raster",
            (true, false) => "it is empty",
        };
        Err(RasterError::Window { path: self.path.clone(), window, size, width, height, reason })
    }

    /// Holds what a read takes (the cells, their mask, and a block of the file at a time) against the limits, and the cells
    /// of the file that it goes through against the file's length.
    fn check_claims(&self, band: &RasterBand<'_>, window: CellWindow, size: (usize, usize)) -> Result<(), RasterError> {
        const CELL_AND_MASK: u64 = 5;
        let bytes = |(width, height): (usize, usize), each: u64| {
            (width as u64).saturating_mul(height as u64).saturating_mul(each)
        };
        let sample = u64::from(band.band_type().bits().div_ceil(8));
        let block = bytes(band.block_size(), sample);
        let taken = bytes(size, CELL_AND_MASK).saturating_add(block);
        let content = bytes((window.width, window.height), sample).max(block);
        // What is not there at all says more than that it is too large.
        let content = self.stored.map_or(Ok(()), |stored| limits::check_content(content, stored));
        let checked = content.and_then(|()| limits::check(taken, None));
        checked.map_err(|excess| RasterError::Excess { path: self.path.clone(), excess })
    }

    fn band(&self, band: usize) -> Result<RasterBand<'_>, RasterError> {
        self.dataset.rasterband(band).map_err(|source| RasterError::Read { path: self.path.clone(), band, source })
    }
}

/// Nodata as the file declares it. GDAL holds it as `f64` whatever the cells are, so compare in the cells' `f32`.
fn blank_nodata(band: &RasterBand<'_>, values: &mut [f32]) {
    let nodata = band.no_data_value().map(|v| v.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32);
    for value in values {
        if !value.is_finite() || Some(*value) == nodata {
            *value = f32::NAN;
        }
    }
}
