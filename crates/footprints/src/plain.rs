//! Found footprints as a layer that tiles read by window: what comes back is what was found, to the bit.
//!
//! `footprints.gpkg` is for people: it shows how a building was seen, not which attributes it has in the city. Here every
//! building has its id, the building it is part of, and all its attributes as one JSON text.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::write::{TIME_STAMP, WriteFootprintsError, wkb};
use super::{Footprint, FootprintConfig, FootprintLayer};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::write_whole_by_name;
use sizeup_geo::geodata::features::{Column, ColumnKind, GeometryKind, LayerSpec, Row};
use sizeup_geo::geodata::gpkg;
use sizeup_heights::ids::BuildingId;

const LAYER: &str = "footprints";
const ID: &str = "id";
const PART_OF: &str = "part_of";
const ATTRIBUTES: &str = "attributes";
/// Finer than any grid that footprints are drawn on, metres: what was clean stays as it is.
const GRID_M: f64 = 1e-6;

/// Writes a layer; all or nothing.
///
/// # Errors
/// [`WriteFootprintsError`].
pub fn write_plain(path: &Path, layer: &FootprintLayer, crs: &Crs) -> Result<(), WriteFootprintsError> {
    let columns = [
        Column::new(ID, "Building", ColumnKind::Text, "Id of the building"),
        Column::new(PART_OF, "Part of", ColumnKind::Text, "Id of the building that it is part of"),
        Column::new(ATTRIBUTES, "Attributes", ColumnKind::Text, "Its attributes, JSON"),
    ];
    let row = |footprint: &Footprint| Row {
        wkb: Some(wkb(&footprint.polygon.clone().into())),
        values: vec![
            footprint.id.0.clone().into(),
            footprint.part_of.as_ref().map_or(Value::Null, |whole| whole.0.clone().into()),
            Value::Object(footprint.attributes.clone()).to_string().into(),
        ],
    };
    write_whole_by_name(path, |temporary| {
        gpkg::create(temporary, crs.definition(), TIME_STAMP, |writer| {
            writer.create_data_columns()?;
            let spec = LayerSpec {
                name: LAYER,
                description: "Footprints that tiles are made from",
                geometry: GeometryKind::Polygon,
                columns: &columns,
            };
            writer.layer::<WriteFootprintsError>(&spec, |push| layer.footprints.iter().map(row).try_for_each(push))
        })
    })
}

/// Settings for reading such a layer.
#[must_use]
pub fn plain_config(path: PathBuf) -> FootprintConfig {
    FootprintConfig {
        layer: Some(LAYER.to_owned()),
        id_field: Some(ID.to_owned()),
        min_area_m2: 0.0,
        grid_m: GRID_M,
        overlap_warning_m2: f64::MAX,
        ..FootprintConfig::new(path)
    }
}

/// Gives footprints that were read from such a layer what its columns hold.
pub fn unpack(footprints: &mut [Footprint]) {
    for footprint in footprints {
        let text_of = |name: &str| footprint.attributes.get(name).and_then(Value::as_str);
        let part_of = text_of(PART_OF).map(|id| BuildingId(id.to_owned()));
        let attributes = text_of(ATTRIBUTES).and_then(|text| serde_json::from_str(text).ok()).unwrap_or_default();
        (footprint.part_of, footprint.attributes) = (part_of, attributes);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use geo_types::polygon;
    use serde_json::json;

    use super::*;
    use crate::LayerParts;
    use sizeup_geo::terrain::MapBox;

    #[test]
    fn what_was_found_comes_back_to_the_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("footprints.gpkg");
        let crs: Crs = "EPSG:25832".to_owned().try_into().unwrap();
        // As all footprints are: whole millimetres.
        let on_grid = |x: f64| (x * 1000.0).round() / 1000.0;
        let house = |x: f64, id: &str| Footprint {
            id: BuildingId(id.to_owned()),
            part_of: id.split_once('#').map(|(whole, _)| BuildingId(whole.to_owned())),
            polygon: polygon![
                (x: x, y: 5_932_000.123),
                (x: on_grid(x + 10.001), y: 5_932_000.457),
                (x: on_grid(x + 3.1), y: 5_932_020.009),
            ],
            attributes: json!({ "id": "another", "storeys": 3, "share": 0.1, "none": null })
                .as_object()
                .unwrap()
                .clone(),
        };
        let footprints = vec![house(565_000.001, "E565003N5932006"), house(565_100.3, "b#2")];
        let layer = FootprintLayer { footprints, ..FootprintLayer::default() };
        write_plain(&path, &layer, &crs).unwrap();
        let config = plain_config(path);
        let area = MapBox { west_m: 564_000.0, south_m: 5_931_000.0, east_m: 566_000.0, north_m: 5_933_000.0 };
        let mut read = LayerParts::open(&config, &crs).unwrap().around(area, &BTreeMap::new()).unwrap();
        unpack(&mut read.footprints);
        assert_eq!(read.footprints, layer.footprints);
    }
}
