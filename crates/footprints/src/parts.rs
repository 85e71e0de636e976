//! A layer too large to hold: feature by feature, or the surroundings of one place.

use std::collections::BTreeMap;

use super::features::FeatureReader;
use super::layer::{check_config, settle_crs};
use super::overlap::refuse_duplicates;
use super::{FootprintConfig, FootprintError, FootprintLayer, osm, overlaps};
use sizeup_geo::crs::{Crs, Transform};
use sizeup_geo::geodata::vector::{Feature, VectorLayer};
use sizeup_geo::terrain::MapBox;

/// Kept around a window for what the way between two CRSs bends, metres.
const WINDOW_MARGIN_M: f64 = 1.0;
/// Features that show the CRS of a layer that states degrees over metres.
const N_HEAD: usize = 1000;

/// A layer read in parts: one feature after the other, or the surroundings of a place. Ids are the same as in
/// [`crate::read`].
#[derive(Debug)]
pub struct LayerParts<'a> {
    config: &'a FootprintConfig,
    source: VectorLayer,
    crs: Crs,
    project_crs: &'a Crs,
}

impl<'a> LayerParts<'a> {
    /// Opens the layer and settles its CRS; its features are not read yet.
    ///
    /// # Errors
    /// As [`crate::read`].
    pub fn open(config: &'a FootprintConfig, project_crs: &'a Crs) -> Result<Self, FootprintError> {
        check_config(config)?;
        let mut source = osm::open_layer(config)?;
        if let Some(field) = config.id_field.as_ref().filter(|wanted| !source.field_names().any(|f| f == *wanted)) {
            let present = source.field_names().map(str::to_owned).collect();
            return Err(FootprintError::NoIdField { path: config.path.clone(), field: field.clone(), present });
        }
        let declared = source.crs()?;
        let head: Vec<Feature> = source.features().take(N_HEAD).collect();
        if head.is_empty() {
            return Err(FootprintError::Empty { path: config.path.clone(), layer: source.name() });
        }
        let crs = settle_crs(config, declared, &head, project_crs)?;
        Ok(Self { config, source, crs, project_crs })
    }

    fn reader(&self) -> Result<FeatureReader<'a>, FootprintError> {
        let to_project = self.transform(&self.crs, self.project_crs)?;
        Ok(FeatureReader::new(self.config, to_project))
    }

    fn transform(&self, from: &Crs, to: &Crs) -> Result<Transform, FootprintError> {
        Transform::new(from, to).map_err(|source| FootprintError::Crs { path: self.config.path.clone(), source })
    }

    /// Goes through all features without holding them; returns those whose ids are not what their attribute says, by
    /// the layer's own number for them.
    ///
    /// # Errors
    /// As [`crate::read`].
    pub fn visit(mut self, visit: &mut dyn FnMut(FootprintLayer)) -> Result<BTreeMap<u64, String>, FootprintError> {
        let mut reader = self.reader()?;
        for (i, feature) in self.source.features().enumerate() {
            reader.add(i, &feature);
            visit(reader.take());
        }
        Ok(reader.into_renamed())
    }

    /// The footprints whose middle lies in a box (project CRS, metres), in the layer's order. `renamed` is what
    /// [`Self::visit`] returned for the whole layer. What `visit` refuses is left out: it may have no place.
    ///
    /// # Errors
    /// As [`crate::read`].
    pub fn around(mut self, area: MapBox, renamed: &BTreeMap<u64, String>) -> Result<FootprintLayer, FootprintError> {
        let to_layer = self.transform(self.project_crs, &self.crs)?;
        let [east_m, north_m] = self.config.shift_m;
        let border = area.grown(WINDOW_MARGIN_M).border(8);
        let corners = border.filter_map(|(x, y)| to_layer.point(x - east_m, y - north_m).ok());
        if let Some(window) = MapBox::around(corners) {
            self.source.look_at([window.west_m, window.south_m, window.east_m, window.north_m]);
        }
        let mut features: Vec<Feature> = self.source.features().collect();
        // An index may hand them out in an order of its own.
        features.sort_by_key(|feature| feature.fid);
        let mut reader = self.reader()?.with_ids(renamed);
        for (i, feature) in features.iter().enumerate() {
            reader.add(i, feature);
        }
        let mut layer = reader.finish();
        layer.footprints.retain(|f| f.middle().is_some_and(|middle| area.holds(middle)));
        layer.refused.clear();
        layer.issues.clear();
        refuse_duplicates(&mut layer);
        layer.issues.extend(overlaps(&layer.footprints, self.config.overlap_warning_m2));
        Ok(layer)
    }
}
