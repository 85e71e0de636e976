//! Found buildings against an existing layer: its ids and attributes are kept, and what changed is told.
//!
//! Pairs are made one to one, the largest intersection over union first. With `IoU` of a pair:
//!
//! ```text
//! IoU ≥ same_iou                matched            the layer's id, attributes and (by default) footprint
//! min_iou ≤ IoU < same_iou      changed_footprint  the layer's id and attributes, the footprint found
//! found, without a pair         new
//! in the layer, without a pair, seen by photos     vanished     (an issue, and a layer of its own)
//! in the layer, seen by no photo                   kept as it is, `unseen`
//! ```

use std::collections::HashSet;
use std::path::PathBuf;

use geo::{Area as _, BooleanOps as _, BoundingRect as _, Contains as _, InteriorPoint as _};
use geo_types::Polygon;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::candidate::SeenGround;
use super::layer::{FootprintConfig, FootprintError};
use super::{Footprint, layer};
use sizeup_geo::crs::Crs;
use sizeup_geo::issue::{Issue, Severity, Subject};
use sizeup_geo::paths::PathVisitor;

/// Which footprint a matched building gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FootprintFrom {
    /// The layer's, which was surveyed.
    #[default]
    Layer,
    /// The one found in the photos.
    Photos,
}

/// An existing layer and how it is compared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CadastreConfig {
    /// File of the layer.
    pub path: PathBuf,
    /// Layer in the file; may be left out where it is the only one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layer: Option<String>,
    /// Attribute that identifies a building.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id_field: Option<String>,
    /// CRS of the layer, where its file does not state one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub crs: Option<Crs>,
    /// Which footprint matched buildings get: "layer" or "photos".
    #[serde(default)]
    pub footprint_from: FootprintFrom,
}

/// Least intersection over union of a building and its counterpart.
const MIN_IOU: f64 = 0.3;
/// Intersection over union from which on a footprint counts as the same.
const SAME_IOU: f64 = 0.75;

impl CadastreConfig {
    /// Hands every path of these settings to `visit`, which may change it.
    pub(super) fn visit_paths(&mut self, visit: PathVisitor<'_>) {
        visit(&mut self.path);
    }

    fn footprints(&self) -> FootprintConfig {
        let Self { layer, id_field, crs, .. } = self.clone();
        FootprintConfig { layer, id_field, crs, ..FootprintConfig::new(&self.path) }
    }
}

/// Change of a building against the layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CadastreChange {
    /// In both, with the same footprint.
    Matched,
    /// In both, with another footprint.
    ChangedFootprint,
    /// Found in the photos, and not in the layer.
    New,
    /// In the layer only, where photos see nothing of it.
    Vanished,
    /// In the layer only, where no photo looks.
    Unseen,
}

impl CadastreChange {
    /// The name under which files have it.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Matched => "matched",
            Self::ChangedFootprint => "changed_footprint",
            Self::New => "new",
            Self::Vanished => "vanished",
            Self::Unseen => "unseen",
        }
    }
}

/// The layer against what was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Conflation {
    /// Per found building, in order: what became of it, and its overlap with its counterpart.
    pub found: Vec<(CadastreChange, Option<f64>)>,
    /// Buildings of the layer that are gone.
    pub vanished: Vec<Footprint>,
    /// Buildings of the layer that no photo shows: they stay.
    pub unseen: Vec<Footprint>,
    /// Issues of the layer, and of how the two were brought together.
    pub issues: Vec<Issue>,
}

/// Gives found buildings the ids and attributes of an existing layer.
///
/// # Errors
/// [`FootprintError`] where the layer cannot be read or a setting is out of range.
pub fn conflate(
    footprints: &mut [Footprint],
    seen: &[SeenGround],
    config: &CadastreConfig,
    crs: &Crs,
) -> Result<Conflation, FootprintError> {
    let known = layer::read(&config.footprints(), crs)?;
    let pairs = pairs(footprints, &known.footprints, MIN_IOU);
    let mut counterpart = vec![None; footprints.len()];
    let mut is_found = vec![false; known.footprints.len()];
    for &(found, old, iou) in &pairs {
        counterpart[found] = Some((old, iou));
        is_found[old] = true;
    }
    // The layer's ids come first: a found building that happens to be called the same gives way.
    let taken: HashSet<&str> = known.footprints.iter().map(|f| f.id.0.as_str()).collect();
    let mut issues = known.issues;
    let mut outcomes = Vec::with_capacity(footprints.len());
    for (footprint, counterpart) in footprints.iter_mut().zip(counterpart) {
        let Some((old, iou)) = counterpart else {
            while taken.contains(footprint.id.0.as_str()) {
                footprint.id.0.push('n');
            }
            tag(footprint, CadastreChange::New, None);
            outcomes.push((CadastreChange::New, None));
            continue;
        };
        let old = &known.footprints[old];
        let change = if iou >= SAME_IOU { CadastreChange::Matched } else { CadastreChange::ChangedFootprint };
        let found_id = std::mem::replace(&mut footprint.id, old.id.clone());
        let evidence = std::mem::replace(&mut footprint.attributes, old.attributes.clone());
        for (name, value) in evidence {
            footprint.attributes.insert(free_name(&old.attributes, &name), value);
        }
        if change == CadastreChange::Matched && config.footprint_from == FootprintFrom::Layer {
            footprint.polygon = old.polygon.clone();
        }
        tag(footprint, change, Some(iou));
        if change == CadastreChange::ChangedFootprint {
            let message = format!("the footprint found ({found_id}) shares only {:.0} % with the layer's", 100.0 * iou);
            issues.push(place(
                Issue::new(Severity::Note, "cadastre_changed_footprint", Subject::Building(old.id.0.clone()), message),
                &old.polygon,
            ));
        }
        outcomes.push((change, Some(iou)));
    }
    let left = known.footprints.into_iter().zip(is_found).filter(|(_, found)| !found).map(|(old, _)| old);
    let (vanished, unseen): (Vec<Footprint>, Vec<Footprint>) = left.partition(|old| is_seen(&old.polygon, seen));
    for old in &vanished {
        let message = "the layer has a building here, and the photos show none";
        let issue = Issue::new(Severity::Warning, "cadastre_vanished", Subject::Building(old.id.0.clone()), message);
        issues.push(place(issue.hint("pulled down, or missed by the masks: look at the pictures"), &old.polygon));
    }
    let unseen = unseen.into_iter().map(|mut old| {
        tag(&mut old, CadastreChange::Unseen, None);
        old
    });
    Ok(Conflation { found: outcomes, vanished, unseen: unseen.collect(), issues })
}

fn free_name(attributes: &serde_json::Map<String, Value>, name: &str) -> String {
    if attributes.contains_key(name) { format!("photos_{name}") } else { name.to_owned() }
}

fn tag(footprint: &mut Footprint, change: CadastreChange, iou: Option<f64>) {
    footprint.attributes.insert("cadastre".to_owned(), change.as_str().into());
    if let Some(iou) = iou {
        footprint.attributes.insert("cadastre_iou".to_owned(), ((iou * 1e3).round() / 1e3).into());
    }
}

fn place(issue: Issue, polygon: &Polygon<f64>) -> Issue {
    match polygon.bounding_rect() {
        Some(rect) => issue.at(rect.center().x, rect.center().y),
        None => issue,
    }
}

fn is_seen(polygon: &Polygon<f64>, seen: &[SeenGround]) -> bool {
    polygon.interior_point().is_some_and(|at| seen.iter().any(|s| s.area.contains(&at)))
}

/// One-to-one pairs: position among those found, position in the layer, intersection over union; best first.
pub(super) fn pairs(found: &[Footprint], old: &[Footprint], min_iou: f64) -> Vec<(usize, usize, f64)> {
    let entry = |(i, f): (usize, &Footprint)| {
        let rect = f.polygon.bounding_rect()?;
        Some(GeomWithData::new(Rectangle::from_corners(rect.min().into(), rect.max().into()), i))
    };
    let tree: RTree<GeomWithData<Rectangle<[f64; 2]>, usize>> =
        RTree::bulk_load(old.iter().enumerate().filter_map(entry).collect());
    let mut all: Vec<(usize, usize, f64)> = Vec::new();
    for (i, footprint) in found.iter().enumerate() {
        let Some(rect) = footprint.polygon.bounding_rect() else { continue };
        let bounds = AABB::from_corners(rect.min().into(), rect.max().into());
        for j in tree.locate_in_envelope_intersecting(&bounds).map(|e| e.data) {
            let (a, b) = (&footprint.polygon, &old[j].polygon);
            let shared_m2 = a.intersection(b).unsigned_area();
            let iou = shared_m2 / (a.unsigned_area() + b.unsigned_area() - shared_m2);
            if iou >= min_iou {
                all.push((i, j, iou));
            }
        }
    }
    all.sort_by(|x, y| y.2.total_cmp(&x.2).then((x.0, x.1).cmp(&(y.0, y.1))));
    let (mut has_found, mut has_old) = (vec![false; found.len()], vec![false; old.len()]);
    all.retain(|&(i, j, _)| {
        let is_free = !has_found[i] && !has_old[j];
        if is_free {
            (has_found[i], has_old[j]) = (true, true);
        }
        is_free
    });
    all
}
