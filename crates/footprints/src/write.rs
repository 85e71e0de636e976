//! Footprints found in photos as a `GeoPackage`: the buildings, what single views show, and what is gone, each with its
//! style for QGIS.

use std::path::Path;

use geo_types::{Geometry, LineString, MultiPolygon, Polygon};
use serde_json::{Map as JsonMap, Value};

use super::Detection;
use super::cadastre::CadastreChange;
use sizeup_geo::crs::Crs;
use sizeup_geo::files::{FileError, write_whole_by_name};
use sizeup_geo::geodata::features::{Column, ColumnKind, GeometryKind, LayerSpec, Row, free_title};
use sizeup_geo::geodata::gpkg::{self, GpkgError};
use sizeup_survey::View;

/// The format wants a time; a fixed one keeps equal results equal on disk.
pub(super) const TIME_STAMP: &str = "2000-01-01T00:00:00.000Z";

/// Default styles by layer, exported from QGIS by `tests/qgis/styles.py`; those drawn first come first.
const STYLES: [(&str, &str); 3] = [
    ("footprints", include_str!("styles/footprints.qml")),
    ("candidates", include_str!("styles/candidates.qml")),
    ("vanished", include_str!("styles/vanished.qml")),
];

/// Why the file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteFootprintsError {
    /// GDAL cannot write the GeoPackage.
    #[error(transparent)]
    Gpkg(#[from] GpkgError),
    /// The file system did not let the file be read or written.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Writes `footprints`, `candidates` and, where there are any, `vanished`; all or nothing.
///
/// # Errors
/// [`WriteFootprintsError`].
pub fn write(path: &Path, detection: &Detection, views: &[View], crs: &Crs) -> Result<(), WriteFootprintsError> {
    write_whole_by_name(path, |temporary| {
        gpkg::create(temporary, crs.definition(), TIME_STAMP, |writer| {
            writer.create_data_columns()?;
            let columns = footprint_columns(detection);
            writer.layer::<WriteFootprintsError>(
                &LayerSpec {
                    name: "footprints",
                    description: "Buildings found in the nadir photos",
                    geometry: GeometryKind::Polygon,
                    columns: &columns,
                },
                |push| footprint_rows(detection, &columns).try_for_each(push),
            )?;
            writer.layer::<WriteFootprintsError>(
                &LayerSpec {
                    name: "candidates",
                    description: "Buildings as single photos show them",
                    geometry: GeometryKind::MultiPolygon,
                    columns: &candidate_columns(),
                },
                |push| candidate_rows(detection, views).try_for_each(push),
            )?;
            if !detection.vanished.is_empty() {
                let columns = vec![Column::new("id", "Building", ColumnKind::Text, "Id in the existing layer")];
                let mut rows = detection.vanished.iter().map(|old| Row {
                    wkb: Some(wkb(&old.polygon.clone().into())),
                    values: vec![old.id.0.clone().into()],
                });
                writer.layer::<WriteFootprintsError>(
                    &LayerSpec {
                        name: "vanished",
                        description: "Buildings of the existing layer that the photos do not show",
                        geometry: GeometryKind::Polygon,
                        columns: &columns,
                    },
                    |push| rows.try_for_each(push),
                )?;
            }
            let has_layer = |name: &str| name != "vanished" || !detection.vanished.is_empty();
            let styles: Vec<_> = STYLES.into_iter().filter(|(name, _)| has_layer(name)).collect();
            Ok::<(), WriteFootprintsError>(writer.styles(&styles, TIME_STAMP)?)
        })
    })
}

const OWN: [&str; 9] = [
    "id",
    "n_views",
    "n_seen",
    "agreement",
    "footprint_confidence",
    "sigma_m",
    "corner_sigma_m",
    "assembled",
    "cadastre",
];

fn footprint_columns(detection: &Detection) -> Vec<Column> {
    let mut columns = vec![
        Column::new("id", "Building", ColumnKind::Text, "Id from the building's place, or of the existing layer"),
        Column::new("n_views", "Photos", ColumnKind::Integer, "Nadir photos that show it"),
        Column::new("n_seen", "Photos that see the place", ColumnKind::Integer, "Nadir photos that see its place"),
        Column::new(
            "agreement",
            "Agreement",
            ColumnKind::Real,
            "Mean intersection over union of the photos' footprints with this one",
        ),
        Column::new(
            "footprint_confidence",
            "Confidence",
            ColumnKind::Real,
            "Share of photos that show it times agreement, 0 to 1; not calibrated",
        ),
        Column::new(
            "sigma_m",
            "Sigma (m)",
            ColumnKind::Real,
            "Standard deviation of its corners, root mean square, metres",
        ),
        Column::new(
            "corner_sigma_m",
            "Sigma of each corner (m)",
            ColumnKind::Text,
            "Standard deviation of each corner in the order of the rings, metres",
        ),
        Column::new("assembled", "Assembled", ColumnKind::Integer, "1 if no single photo shows it whole"),
        Column::new(
            "cadastre",
            "Against the layer",
            ColumnKind::Text,
            "Against the existing layer: matched, changed_footprint, new or unseen",
        ),
    ];
    // The existing layer's own attributes follow.
    let mut names: Vec<&String> = Vec::new();
    for footprint in &detection.layer.footprints {
        for name in footprint.attributes.keys() {
            let is_ours = OWN.iter().any(|own| own.eq_ignore_ascii_case(name)) || name.starts_with("footprint_");
            let is_reserved = ["fid", "geom"].iter().any(|r| r.eq_ignore_ascii_case(name));
            if !is_ours && !is_reserved && !names.iter().any(|n| n.eq_ignore_ascii_case(name)) {
                names.push(name);
            }
        }
    }
    let kind = |name: &str| {
        let values = detection.layer.footprints.iter().filter_map(|f| f.attributes.get(name)).filter(|v| !v.is_null());
        let (mut is_integer, mut is_number) = (true, true);
        for value in values {
            is_integer &= value.is_i64();
            is_number &= value.is_number();
        }
        if is_integer {
            ColumnKind::Integer
        } else if is_number {
            ColumnKind::Real
        } else {
            ColumnKind::Text
        }
    };
    for name in names {
        let title = free_title(name, &columns);
        columns.push(Column::carried(name.clone(), title, kind(name)));
    }
    columns
}

fn footprint_rows<'a>(detection: &'a Detection, columns: &'a [Column]) -> impl Iterator<Item = Row> + 'a {
    detection.layer.footprints.iter().zip(&detection.sightings).map(move |(footprint, sighting)| {
        let sigmas = &sighting.corner_sigma_m;
        let mean_square = sigmas.iter().map(|s| s * s).sum::<f64>() / sigmas.len().max(1) as f64;
        let listed: Vec<String> = sigmas.iter().map(|s| format!("{s:.3}")).collect();
        // A building of the existing layer that no photo shows has nothing of all this.
        let known = |value: Value| if sighting.n_views > 0 { value } else { Value::Null };
        let own: JsonMap<String, Value> = [
            ("id", footprint.id.0.clone().into()),
            ("n_views", sighting.n_views.into()),
            ("n_seen", sighting.n_seen.into()),
            ("agreement", known(rounded(sighting.agreement))),
            ("footprint_confidence", known(rounded(sighting.confidence))),
            ("sigma_m", known(rounded(mean_square.sqrt()))),
            ("corner_sigma_m", known(format!("[{}]", listed.join(",")).into())),
            ("assembled", u8::from(sighting.is_assembled).into()),
            ("cadastre", sighting.change.map_or(Value::Null, |c: CadastreChange| c.as_str().into())),
        ]
        .into_iter()
        .map(|(name, value)| (name.to_owned(), value))
        .collect();
        let value = |column: &Column| {
            own.get(&*column.name).or_else(|| footprint.attributes.get(&*column.name)).cloned().unwrap_or(Value::Null)
        };
        Row { wkb: Some(wkb(&footprint.polygon.clone().into())), values: columns.iter().map(value).collect() }
    })
}

fn candidate_columns() -> Vec<Column> {
    vec![
        Column::new("view", "Photo", ColumnKind::Text, "The photo"),
        Column::new(
            "building",
            "Building",
            ColumnKind::Text,
            "Id of the building it is part of; none where it was left out",
        ),
        Column::new("score", "Score", ColumnKind::Real, "What the segmenter gives it, 0 to 1"),
        Column::new("cut", "Cut off", ColumnKind::Integer, "1 if the photo's border cuts it off"),
        Column::new("sigma_m", "Sigma (m)", ColumnKind::Real, "Standard deviation of its footprint, metres"),
    ]
}

fn candidate_rows<'a>(detection: &'a Detection, views: &'a [View]) -> impl Iterator<Item = Row> + 'a {
    detection.candidates.iter().map(|candidate| {
        let building = candidate.building.and_then(|i| detection.layer.footprints.get(i));
        Row {
            wkb: Some(wkb(&candidate.shape.clone().into())),
            values: vec![
                views[candidate.view].id.0.clone().into(),
                building.map_or(Value::Null, |f| f.id.0.clone().into()),
                rounded(f64::from(candidate.score)),
                u8::from(candidate.is_cut).into(),
                rounded(candidate.sigma_m),
            ],
        }
    })
}

fn rounded(value: f64) -> Value {
    Value::from((value * 1e3).round() / 1e3)
}

/// ISO well-known binary, little-endian.
pub(super) fn wkb(geometry: &Geometry<f64>) -> Vec<u8> {
    let mut bytes = Vec::new();
    match geometry {
        Geometry::MultiPolygon(MultiPolygon(parts)) => {
            header(&mut bytes, 6);
            count(&mut bytes, parts.len());
            for part in parts {
                polygon(&mut bytes, part);
            }
        }
        Geometry::Polygon(part) => polygon(&mut bytes, part),
        other => unreachable!("only polygons are written here, not {other:?}"),
    }
    bytes
}

fn header(bytes: &mut Vec<u8>, kind: u32) {
    bytes.push(1);
    bytes.extend(kind.to_le_bytes());
}

fn count(bytes: &mut Vec<u8>, n: usize) {
    bytes.extend((n as u32).to_le_bytes());
}

fn polygon(bytes: &mut Vec<u8>, polygon: &Polygon<f64>) {
    header(bytes, 3);
    count(bytes, 1 + polygon.interiors().len());
    let rings: Vec<&LineString<f64>> = std::iter::once(polygon.exterior()).chain(polygon.interiors()).collect();
    for ring in rings {
        count(bytes, ring.0.len());
        for c in &ring.0 {
            bytes.extend(c.x.to_le_bytes());
            bytes.extend(c.y.to_le_bytes());
        }
    }
}
