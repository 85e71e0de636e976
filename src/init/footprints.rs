//! Which layer holds the buildings: polygons in the photographed area, by what they are called, what is said of them, and how
//! large they are.

use std::path::{Path, PathBuf};

use geo::{Area as _, BoundingRect as _};
use geo_types::Geometry;
use serde::Serialize;
use serde_json::Value;

use super::InitError;
use super::folder::{Inventory, name_of};
use super::place::PhotoPlaces;
use sizeup_footprints::{FootprintConfig, is_osm, open_layer};
use sizeup_geo::crs::Crs;
use sizeup_geo::geodata::vector::{Feature, FeatureGeometry, layers_of};
use sizeup_heights::stats::median;

/// So many features show what a layer is.
const N_LOOKED: usize = 3000;
/// Polygons of buildings have a median area in here, m²: garages and sheds to halls.
const HOUSE_AREAS_M2: std::ops::Range<f64> = 15.0..4000.0;
/// Polygons with a median area above are parcels, blocks or areas of interest, m².
const PARCEL_M2: f64 = 20_000.0;
/// Names of layers of buildings, in several languages, lower case.
const BUILDING_WORDS: [&str; 16] = [
    "building",
    "footprint",
    "bldg",
    "house",
    "gebaeude",
    "gebäude",
    "geb_",
    "hausumring",
    "bati",
    "bâti",
    "pand",
    "edifi",
    "budyn",
    "bygning",
    "byggnad",
    "rakennu",
];
/// Names of layers of something else.
const OTHER_WORDS: [&str; 14] = [
    "parcel",
    "flurst",
    "image_footprint",
    "camera",
    "flight",
    "mission",
    "boundary",
    "aoi",
    "street",
    "road",
    "water",
    "tree",
    "landuse",
    "truth",
];
/// Names of attributes of buildings.
const ATTRIBUTES: [&str; 10] =
    ["building", "gfk", "funktion", "function", "storeys", "levels", "roof", "height", "gebnutzbez", "anzahlgs"];
/// Attributes that hold ids, the surest first.
const ID_FIELDS: [&str; 12] = [
    "gml_id",
    "gmlid",
    "building_id",
    "identificatie",
    "egid",
    "inspireid",
    "oi",
    "uuid",
    "id",
    "@id",
    "osm_id",
    "objectid",
];

/// A layer of footprints.
#[derive(Debug, Clone, Serialize)]
pub struct UsableLayer {
    /// Path of the layer's file.
    pub path: PathBuf,
    /// The layer, where the file has several.
    pub layer: Option<String>,
    /// The attribute that holds ids, where one is there.
    pub id_field: Option<String>,
    /// Polygons in the photographed area, as far as was looked.
    pub n_polygons: usize,
    /// Features of the whole layer, where the file tells.
    pub n_features: Option<u64>,
    /// Their median area, m².
    pub median_area_m2: f64,
    /// Why the layer was taken.
    pub why: String,
    /// CRS of the layer; `None` where it names none.
    #[serde(skip)]
    pub crs: Option<Crs>,
    #[serde(skip)]
    score: i32,
}

/// A layer that is not taken.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PassedLayer {
    /// The file, with the layer's name where it has several.
    pub name: String,
    /// Why the layer was not taken.
    pub why: String,
}

/// Outcome of a look at the layers.
#[derive(Debug, Default)]
pub(super) struct LayerChoice {
    pub chosen: Option<UsableLayer>,
    pub passed: Vec<PassedLayer>,
}

/// Chooses among the layers of a folder.
pub(super) fn choose(inventory: &Inventory, place: &PhotoPlaces) -> LayerChoice {
    let mut looked = Vec::new();
    let mut choice = LayerChoice::default();
    for path in &inventory.layers {
        for (name, layer) in layers(path, place) {
            match layer {
                Ok(layer) if layer.score > 0 => looked.push(layer),
                Ok(layer) => choice.passed.push(PassedLayer { name, why: layer.why }),
                Err(why) => choice.passed.push(PassedLayer { name, why }),
            }
        }
    }
    looked.sort_by(|a, b| (b.score, b.n_polygons).cmp(&(a.score, a.n_polygons)).then_with(|| a.path.cmp(&b.path)));
    let mut looked = looked.into_iter();
    choice.chosen = looked.next();
    choice.passed.extend(looked.map(|layer| {
        let name = full_name(&layer.path, layer.layer.as_deref());
        PassedLayer { name, why: format!("{}; the chosen one speaks more for buildings", layer.why) }
    }));
    choice
}

/// The layer that somebody named: it has to be readable and to lie where the photos are.
pub(super) fn named(path: &Path, place: &PhotoPlaces) -> Result<UsableLayer, InitError> {
    let refuse = |reason| InitError::Named { option: "--footprints", path: path.to_owned(), reason };
    let looked = layers(path, place);
    let (good, bad): (Vec<_>, Vec<_>) = looked.into_iter().partition(|(_, layer)| layer.is_ok());
    let best = good.into_iter().filter_map(|(_, layer)| layer.ok()).max_by_key(|layer| (layer.score, layer.n_polygons));
    best.ok_or_else(|| {
        let reason = bad.into_iter().find_map(|(_, layer)| layer.err()).unwrap_or_else(|| "it has no layer".to_owned());
        refuse(format!(
            "{reason}\nhint: expected polygons of buildings where the photos are; `ogrinfo` shows what a file holds"
        ))
    })
}

type TriedLayer = (String, Result<UsableLayer, String>);

/// The layers of a file that may hold polygons.
fn layers(path: &Path, place: &PhotoPlaces) -> Vec<TriedLayer> {
    if is_osm(path) {
        return vec![(name_of(path), look(path, None, place))];
    }
    let all = match layers_of(path) {
        Ok(all) => all,
        Err(error) => return vec![(name_of(path), Err(first_line(&error)))],
    };
    let n = all.len();
    let polygonal = all.into_iter().filter(|layer| layer.may_hold_polygons);
    polygonal
        .map(|layer| {
            let name = (n > 1).then_some(layer.name.as_str());
            (full_name(path, name), look(path, name, place))
        })
        .collect()
}

fn full_name(path: &Path, layer: Option<&str>) -> String {
    layer.map_or_else(|| name_of(path), |layer| format!("{} (layer {layer})", name_of(path)))
}

fn first_line(error: &dyn std::error::Error) -> String {
    let text = error.source().map_or_else(|| error.to_string(), |cause| format!("{error}: {cause}"));
    text.split("\nhint:").next().unwrap_or_default().replace('\n', " ")
}

fn look(path: &Path, layer: Option<&str>, place: &PhotoPlaces) -> Result<UsableLayer, String> {
    let config = FootprintConfig { layer: layer.map(str::to_owned), ..FootprintConfig::new(path) };
    let mut source = open_layer(&config).map_err(|e| first_line(&e))?;
    let crs = source.crs().map_err(|e| first_line(&e))?.ok_or("it has no CRS")?;
    let n_features = if is_osm(path) { None } else { source.n_features() };
    if let Some(area) = place.bounds_in(&crs) {
        source.look_at([area.west_m, area.south_m, area.east_m, area.north_m]);
    } else if !matches!(place, PhotoPlaces::Nowhere) {
        return Err(format!("{} cannot be held against where the photos are", crs.name()));
    }
    let features: Vec<Feature> = source.features().take(N_LOOKED).collect();
    if features.is_empty() {
        return Err(format!("nothing of it lies where the photos are{}", distance(&config, &crs, place)));
    }
    let areas: Vec<f64> = features.iter().filter_map(|feature| area_m2(feature, &crs)).collect();
    let median_area_m2 = median(&areas).ok_or("it holds no polygons")?;
    let evidence = LayerEvidence { n_polygons: areas.len(), median_area_m2, features: &features };
    let (score, why) = evidence.judge(path, layer);
    let id_field = if is_osm(path) { None } else { id_field(&features, source.field_names()) };
    let (path, layer, n_polygons) = (path.to_owned(), layer.map(str::to_owned), areas.len());
    Ok(UsableLayer { path, layer, id_field, n_polygons, n_features, median_area_m2, why, crs: Some(crs), score })
}

/// How far a layer is from the photos, in words that follow its refusal.
fn distance(config: &FootprintConfig, crs: &Crs, place: &PhotoPlaces) -> String {
    /// Further away, a place is another one by mistake, kilometres.
    const FAR_KM: f64 = 20.0;
    let nearest_km = || {
        let area = place.bounds_in(crs)?;
        let mut source = open_layer(config).ok()?;
        let corners = source.features().take(N_LOOKED).filter_map(|feature| match feature.geometry {
            FeatureGeometry::Shape(shape) => shape.bounding_rect().map(|rect| rect.min().x_y()),
            _ => None,
        });
        let metres = if crs.is_geographic() { DEGREE_M } else { 1.0 };
        Some(corners.map(|corner| area.distance_m(corner)).reduce(f64::min)? * metres / 1000.0)
    };
    match nearest_km() {
        Some(km) if km > FAR_KM => format!(
            ": it is {km:.0} km away, so a wrong CRS (its zone, too) is the likely cause, of the layer or of the poses"
        ),
        Some(km) => format!(": it is {km:.1} km away"),
        None => String::new(),
    }
}

/// Metres of one degree of latitude.
const DEGREE_M: f64 = 111_320.0;

/// Evidence of a layer's polygons.
struct LayerEvidence<'a> {
    n_polygons: usize,
    median_area_m2: f64,
    features: &'a [Feature],
}

impl LayerEvidence<'_> {
    /// Score for buildings, and its reasons.
    fn judge(&self, path: &Path, layer: Option<&str>) -> (i32, String) {
        let name = format!("{} {}", name_of(path), layer.unwrap_or_default()).to_lowercase();
        let has_word = |words: &[&str]| words.iter().any(|word| name.contains(word));
        let (is_other, is_named) = (has_word(&OTHER_WORDS), has_word(&BUILDING_WORDS) || is_osm(path));
        let is_told = self.says_building();
        let size = if HOUSE_AREAS_M2.contains(&self.median_area_m2) {
            2
        } else if self.median_area_m2 > PARCEL_M2 {
            -4
        } else {
            -1
        };
        let score = size + 3 * i32::from(is_named) + 2 * i32::from(is_told) - 3 * i32::from(is_other);
        let (n, area_m2) = (self.n_polygons, self.median_area_m2);
        let s = if n == 1 { "" } else { "s" };
        let seen = format!("{n} polygon{s} where the photos are, of {area_m2:.0} m² (median)");
        let reasons = [
            (is_named, "named as buildings"),
            (is_told, "attributes of buildings"),
            (is_other, "named as something else"),
        ];
        let reasons = reasons.into_iter().filter(|(holds, _)| *holds).map(|(_, reason)| reason);
        let why = std::iter::once(seen.as_str()).chain(reasons).collect::<Vec<_>>().join(", ");
        (score, why)
    }

    /// Whether some attribute that buildings have holds something.
    fn says_building(&self) -> bool {
        let is_of_building = |name: &String| {
            let name = name.to_lowercase();
            ATTRIBUTES.iter().any(|word| name.contains(word))
        };
        let holds =
            |feature: &Feature| feature.attributes.iter().any(|(name, value)| !value.is_null() && is_of_building(name));
        self.features.iter().any(holds)
    }
}

/// The area of a polygon, m²; `None` for anything else.
fn area_m2(feature: &Feature, crs: &Crs) -> Option<f64> {
    let FeatureGeometry::Shape(shape @ (Geometry::Polygon(_) | Geometry::MultiPolygon(_))) = &feature.geometry else {
        return None;
    };
    let scale = if crs.is_geographic() {
        let lat_deg = shape.bounding_rect()?.center().y;
        DEGREE_M * DEGREE_M * lat_deg.to_radians().cos()
    } else {
        crs.plane_unit_m().unwrap_or(1.0).powi(2)
    };
    Some(shape.unsigned_area() * scale)
}

/// The attribute that holds a value of its own for each feature, if one is called like an id.
fn id_field<'a>(features: &[Feature], fields: impl Iterator<Item = &'a str>) -> Option<String> {
    let fields: Vec<&str> = fields.collect();
    let is_unique = |field: &str| {
        let values: Vec<&Value> = features.iter().filter_map(|feature| feature.attributes.get(field)).collect();
        let of_own: std::collections::BTreeSet<String> =
            values.iter().filter(|value| !value.is_null()).map(ToString::to_string).collect();
        of_own.len() == features.len()
    };
    let called = |name: &&str| fields.iter().find(|field| field.eq_ignore_ascii_case(name)).copied();
    ID_FIELDS.iter().filter_map(called).find(|field| is_unique(field)).map(str::to_owned)
}
