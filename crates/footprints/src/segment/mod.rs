//! Buildings from a segmentation network that the user brings as ONNX files.
//!
//! What the network wants is a [`profile::SegmenterProfile`]: data, not code. Photos are cut into tiles, each brought to the
//! network's square; what the tiles say is put together again at the photo's own pixels.

pub mod apart;
mod config;
pub mod geometry;
pub mod holes;
pub mod profile;
pub mod roofs;
mod run;
mod small;
mod tiles;
mod turned;
pub mod valleys;

use std::path::PathBuf;

pub use self::config::SegmenterConfig;
pub use self::run::{OpenDepth, Segmenter};
pub use self::small::{SMALL, SmallNetwork};

use self::apart::{Apart, split};
use self::profile::Gives;
use self::roofs::{Maps, footprints, possible_rise};
use self::small::{BY_COLOURS, BY_COLOURS_AND_DEPTH, Calibration};
use self::tiles::{Joiner, Mosaic, at_photo_size};
use self::turned::TurnedOver;
use super::contours::{ContourFineness, ContourSource, ViewContours, ViewFault};
use super::vectorise::{Contour, Instances, MaskFault, Vectorising, contours, contours_at_level};
use sizeup_geo::geodata::raster::RasterFile;
use sizeup_heights::raster::Raster;
use sizeup_survey::View;

/// Least score of an instance, 0..1.
const MIN_SCORE: f32 = 0.5;
/// Share of a tile that overlaps the next one.
const OVERLAP: f64 = 0.2;
/// Least part of a map that is a building beside another one, as a share of the least building that is looked for.
const PART_SHARE: f64 = 0.25;

impl ContourSource for Segmenter {
    fn contours(&self, view: &View, look: ContourFineness) -> Result<ViewContours, ViewFault> {
        let path = view.image.as_deref().ok_or_else(|| ViewFault::Photo { reason: "it is not known".to_owned() })?;
        let photo = RasterFile::open(path).map_err(|e| ViewFault::Photo { reason: e.to_string() })?;
        let size = photo.size();
        if size != (view.camera.width_px as usize, view.camera.height_px as usize) {
            return Err(ViewFault::Size {
                path: path.to_owned(),
                mask: size,
                photo: (view.camera.width_px, view.camera.height_px),
            });
        }
        let mut geometry = self.geometry_of(view)?;
        let without_depth = geometry.without_depth.take();
        let tile_px = self.tile_px(size, look.pixel_m);
        let windows = tiles::tiles(size, tile_px, (OVERLAP * tile_px as f64) as usize);
        let how = Vectorising {
            instances: Instances::ByLabel,
            min_area_px2: look.min_area_px2,
            tolerance_px: look.tolerance_px,
        };
        let in_photo = |fault: MaskFault| ViewFault::Mask { path: path.to_owned(), fault };
        let contours = match self.profile.gives {
            Gives::Semantic | Gives::Roofs => {
                let n_maps = if self.profile.gives == Gives::Roofs { 5 } else { 2 };
                let mut mosaics: Vec<Mosaic> = Vec::new();
                let turns = self.turns();
                for (tile, &turned) in
                    windows.into_iter().flat_map(|tile| turns.iter().map(move |turned| (tile, turned)))
                {
                    let (masks, _, _) = self.look(&photo, &geometry, tile, turned)?;
                    // Of more channels, the first are what the profile speaks of.
                    for (i, map) in self.maps(&masks)?.into_iter().take(n_maps).enumerate() {
                        if mosaics.len() == i {
                            mosaics.push(Mosaic::new(size.0, size.1));
                        }
                        mosaics[i].add(tile, &at_photo_size(&turned.map(map), tile));
                    }
                }
                let maps: Vec<Raster<f32>> = mosaics.into_iter().map(Mosaic::finish).collect();
                let own_dip = if maps.len() == 5 { self.profile.valley } else { self.profile.dip };
                let apart = Apart {
                    above: self.config.above,
                    dip: own_dip,
                    least_px: (PART_SHARE * look.min_area_px2).ceil() as usize,
                };
                let fit = if without_depth.is_none() { BY_COLOURS_AND_DEPTH } else { BY_COLOURS };
                let calibration = self.is_built_in().then_some(fit);
                match <[Raster<f32>; 5]>::try_from(maps) {
                    Ok([ground, roof, middle, rise, seam]) => {
                        let rise = possible_rise(&rise, look.pixel_m * geometry.lean.focal_px);
                        let maps = Maps { ground, roof, middle, rise, seam };
                        let labels = footprints(&maps, geometry.lean.nadir_px.into(), apart);
                        let found = contours(&labels, how).map_err(in_photo)?;
                        scored(found, &labels, &maps.ground, calibration)
                    }
                    Err(maps) => match &maps[..] {
                        [] => Vec::new(),
                        [buildings] => contours_at_level(buildings, self.config.above, how).map_err(in_photo)?,
                        [buildings, middles, ..] => {
                            let labels = split(buildings, middles, apart);
                            let found = contours(&labels, how).map_err(in_photo)?;
                            scored(found, &labels, buildings, calibration)
                        }
                    },
                }
            }
            Gives::Instances => {
                let mut joiner = Joiner::new(size.0, size.1);
                for tile in windows {
                    let (masks, scores, presence) = self.look(&photo, &geometry, tile, TurnedOver::default())?;
                    let maps = self.maps(&masks)?;
                    let scored = maps.into_iter().enumerate().map(|(i, map)| {
                        let score = presence * scores.as_ref().map_or(1.0, |s| s.get(i).copied().unwrap_or(0.0));
                        (map, score)
                    });
                    let kept = scored.filter(|(_, score)| *score >= MIN_SCORE);
                    joiner.add(tile, kept.map(|(map, score)| (at_photo_size(&map, tile), score)).collect());
                }
                let (labels, scores) = joiner.finish();
                let mut found = contours(&labels, how).map_err(in_photo)?;
                for contour in &mut found {
                    contour.score = scores[contour.label as usize].clamp(0.0, 1.0);
                }
                found
            }
        };
        Ok(ViewContours { contours, without_depth })
    }

    fn file_of(&self, view: &View) -> Option<PathBuf> {
        view.image.clone()
    }
}

/// Contours of labels with their scores: the mean probability of their pixels, calibrated where a fit is known.
fn scored(
    mut found: Vec<Contour>,
    labels: &Raster<u32>,
    probability: &Raster<f32>,
    calibration: Option<Calibration>,
) -> Vec<Contour> {
    let n = labels.data().iter().copied().max().unwrap_or(0) as usize;
    let mut sums = vec![(0.0_f64, 0_usize); n + 1];
    for (label, p) in labels.data().iter().zip(probability.data()) {
        let (sum, count) = &mut sums[*label as usize];
        (*sum, *count) = (*sum + f64::from(*p), *count + 1);
    }
    for contour in &mut found {
        let (sum, count) = sums[contour.label as usize];
        let mean = sum / count.max(1) as f64;
        contour.score = calibration.map_or(mean, |calibration| calibration.probability(mean)) as f32;
    }
    found
}
