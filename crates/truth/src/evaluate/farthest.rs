//! The buildings that are farthest off, over the photos that they were measured in: most causes can be seen there.

use std::collections::HashMap;
use std::path::Path;

use geo_types::{LineString, MultiPolygon, Polygon};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::TruthBuilding;
use super::heights::{BuildingError, HeightEvaluation};
use sizeup_heights::views::from_all_sides;
use sizeup_results::output::grid::OutputGrid;
use sizeup_results::output::picture::colour::{ROOF, Rgb, WALL};
use sizeup_results::output::picture::{
    PhotoCrop, Polyline, SHEET_PHOTO_PX, SHEET_PHOTOS, SheetBuilding, SheetPhoto, contact_sheet, photo_of, write_png,
};
use sizeup_results::output::prism::{FaceKind, GridFace, SnappedPrism};
use sizeup_results::output::roof_solid::{self, Detail};
use sizeup_results::output::{BuildingRecord, OutputError};
use sizeup_survey::View;

/// Buildings on the sheet.
const N_BUILDINGS: usize = 20;
/// Reasons of a doubt that fit into a caption.
const MOST_REASONS: usize = 3;
/// Step of the grid that solids are made on, metres, and least thickness of one.
const GRID_M: f64 = 0.001;
const LEAST_THICKNESS_M: f64 = 0.01;

const REFERENCE: Rgb = [255, 70, 220];

/// Writes `farthest.png`: the buildings with the largest errors, each in up to three photos it was measured in, as the result and
/// the reference (a block as high as its height) have it. Nothing is written where no photo shows any of them. Returns why photos
/// are not there that cannot be read.
///
/// # Errors
/// [`OutputError`]: a picture that cannot be written.
pub(super) fn write(
    folder: &Path,
    evaluation: &HeightEvaluation,
    results: &[BuildingRecord],
    truth: &[TruthBuilding],
    views: &[View],
) -> Result<Option<String>, OutputError> {
    let view_of: HashMap<&str, &View> =
        views.iter().filter(|view| view.image.is_some()).map(|view| (view.id.0.as_str(), view)).collect();
    let truth_of: HashMap<&str, &TruthBuilding> = truth.iter().map(|t| (t.id.as_str(), t)).collect();
    let shown = farthest(&evaluation.buildings);
    let pictured = |(rank, error): (usize, &&BuildingError)| {
        let parts: Vec<&BuildingRecord> = parts_of(results, &error.result_id).collect();
        let edges = Edges::of(&parts, truth_of.get(error.truth_id.as_str()).copied(), error.truth_m);
        let named: Vec<&View> =
            parts.iter().flat_map(|part| &part.views).filter_map(|v| view_of.get(&**v).copied()).collect();
        let photos = choose(&named, &edges).into_iter().map(|(view, crop)| {
            let picture = crop.cut_out(&photo_of(view)?, view, SHEET_PHOTO_PX);
            Ok(SheetPhoto { picture, lines: edges.lines(view, crop), name: view.id.0.clone() })
        });
        let (read, unread): (Vec<_>, Vec<_>) = photos.partition(Result::is_ok);
        let photos = read.into_iter().flatten().collect();
        (SheetBuilding { caption: caption(rank, error, &parts), photos }, unread)
    };
    let (buildings, unread): (Vec<SheetBuilding>, Vec<Vec<Result<SheetPhoto, OutputError>>>) =
        shown.par_iter().enumerate().map(pictured).unzip();
    let mut unread = unread.into_iter().flatten().filter_map(Result::err);
    let why = unread.next().map(|why| format!("{} photos of farthest.png: {why}", 1 + unread.count()));
    if buildings.iter().all(|building| building.photos.is_empty()) {
        return Ok(why);
    }
    let title = format!("Farthest from the reference: {} of {}", buildings.len(), evaluation.buildings.len());
    let key = [("roof", ROOF), ("wall, ground", WALL), ("the reference's roof", REFERENCE)];
    let path = folder.join("farthest.png");
    write_png(&path, &contact_sheet(&title, &key, &buildings))?;
    Ok(why)
}

/// The largest errors, the largest first; ties in the reference's order.
fn farthest(buildings: &[BuildingError]) -> Vec<&BuildingError> {
    let mut ranked: Vec<&BuildingError> = buildings.iter().collect();
    ranked.sort_by(|a, b| b.signed_error_m.abs().total_cmp(&a.signed_error_m.abs()));
    ranked.truncate(N_BUILDINGS);
    ranked
}

/// The building of an id, or its parts.
fn parts_of<'a>(results: &'a [BuildingRecord], id: &'a str) -> impl Iterator<Item = &'a BuildingRecord> {
    let is_whole = results.iter().any(|record| record.id == id);
    results.iter().filter(move |r| if is_whole { r.id == id } else { r.part_of.as_deref() == Some(id) })
}

fn caption(rank: usize, error: &BuildingError, parts: &[&BuildingRecord]) -> String {
    let sigma = error.sigma_m.map_or(String::new(), |sigma| format!(" ± {sigma:.2}"));
    let mut reasons: Vec<&str> = parts.iter().flat_map(|part| &part.reasons).map(String::as_str).collect();
    reasons.sort_unstable();
    reasons.dedup();
    reasons.truncate(MOST_REASONS);
    let split = if parts.len() > 1 { format!(", {} parts", parts.len()) } else { String::new() };
    let form = parts.first().filter(|_| parts.len() == 1).and_then(|part| part.roof).map(|roof| roof.form);
    let form = form.map_or(String::new(), |form| format!(", {}", form.as_str()));
    let why = if reasons.is_empty() { String::new() } else { format!(" ({})", reasons.join(", ")) };
    format!(
        "{}. {}: {:+.2} m; {:.2}{sigma} for {:.2} m{split}{form}, {}{why}",
        rank + 1,
        error.result_id,
        error.signed_error_m,
        error.height_m,
        error.truth_m,
        error.status.as_str(),
    )
}

/// Edges of a building in the map frame, metres.
struct Edges {
    lines: Vec<(Vec<DVec3>, Rgb)>,
}

impl Edges {
    fn of(parts: &[&BuildingRecord], truth: Option<&TruthBuilding>, truth_m: f64) -> Self {
        let mut lines = Vec::new();
        for part in parts {
            let Ok((grid, _)) = OutputGrid::over(&[(*part).clone()], GRID_M) else { continue };
            let Ok(block) = SnappedPrism::of(part, &grid, LEAST_THICKNESS_M) else { continue };
            let faces =
                roof_solid::faces(part, &block, &grid, Detail::Slopes).unwrap_or_else(|| SnappedPrism::faces(&block));
            for GridFace { surface, rings, .. } in faces {
                let colour = if surface == FaceKind::Roof { ROOF } else { WALL };
                let at = |point: &[i64; 3]| DVec3::from(grid.metres(*point));
                lines.extend(rings.iter().map(|ring| (ring.iter().chain(ring.first()).map(at).collect(), colour)));
            }
        }
        let ground_z_m = parts.iter().filter_map(|part| part.ground_z_m).reduce(f64::min);
        if let (Some(footprint), Some(ground_z_m)) = (truth.and_then(|t| t.footprint.as_ref()), ground_z_m) {
            let at =
                |ring: &LineString<f64>| ring.coords().map(|c| DVec3::new(c.x, c.y, ground_z_m + truth_m)).collect();
            lines.extend(rings_of(footprint).map(|ring| (at(ring), REFERENCE)));
        }
        // Roofs over walls, the reference over both.
        lines.sort_by_key(|(_, colour)| [WALL, ROOF, REFERENCE].iter().position(|c| c == colour));
        Self { lines }
    }

    fn points(&self) -> impl Iterator<Item = DVec3> {
        self.lines.iter().flat_map(|(points, _)| points.iter().copied())
    }

    fn middle(&self) -> Option<DVec3> {
        let (low, high) = (self.points().reduce(DVec3::min)?, self.points().reduce(DVec3::max)?);
        Some(0.5 * (low + high))
    }

    /// The edges in a picture of a part of a photo.
    fn lines(&self, view: &View, crop: PhotoCrop) -> Vec<Polyline> {
        let size = DVec2::new(f64::from(SHEET_PHOTO_PX[0]), f64::from(SHEET_PHOTO_PX[1]));
        let line = |(points, colour): &(Vec<DVec3>, Rgb)| {
            let points_px: Option<Vec<[f64; 2]>> =
                points.iter().map(|p| Some((crop.share_of(project(view, *p)?) * size).to_array())).collect();
            Some(Polyline { points_px: points_px?, colour: *colour })
        };
        self.lines.iter().filter_map(line).collect()
    }
}

fn rings_of(footprint: &MultiPolygon<f64>) -> impl Iterator<Item = &LineString<f64>> {
    footprint.iter().flat_map(|polygon: &Polygon<f64>| std::iter::once(polygon.exterior()).chain(polygon.interiors()))
}

/// Where a view has a place, also beside its photo.
fn project(view: &View, place: DVec3) -> Option<DVec2> {
    view.camera.project(view.camera_from_map.point(place))
}

/// The photos that show most of a building, from each sector of azimuth in turn, with the part that shows it.
fn choose<'a>(views: &[&'a View], edges: &Edges) -> Vec<(&'a View, PhotoCrop)> {
    let Some(middle) = edges.middle() else { return Vec::new() };
    let mut seen: Vec<(f64, &View, PhotoCrop)> = Vec::new();
    for &view in views {
        if seen.iter().any(|(_, other, _)| other.id == view.id) {
            continue;
        }
        let view_px = DVec2::new(f64::from(view.camera.width_px), f64::from(view.camera.height_px));
        let Some(points) = edges.points().map(|p| project(view, p)).collect::<Option<Vec<DVec2>>>() else { continue };
        let Some(crop) = PhotoCrop::around(&points, view_px) else { continue };
        let (low, high) = points.iter().fold((points[0], points[0]), |(l, h), p| (l.min(*p), h.max(*p)));
        let shown = (high.min(view_px) - low.max(DVec2::ZERO)).max(DVec2::ZERO);
        let (area, whole) = (shown.x * shown.y, (high.x - low.x) * (high.y - low.y));
        // A building that is cut by the border says less than a small one.
        seen.push((area * (area / whole.max(1.0)).powi(2), view, crop));
    }
    seen.sort_by(|a, b| b.0.total_cmp(&a.0).then_with(|| a.1.id.0.cmp(&b.1.id.0)));
    let from = seen.iter().map(|(_, view, _)| (view.centre() - middle).truncate());
    from_all_sides(from, SHEET_PHOTOS).into_iter().map(|rank| (seen[rank].1, seen[rank].2)).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use geo::{Rect, coord};
    use glam::DMat3;

    use super::*;
    use sizeup_heights::camera::Camera;
    use sizeup_heights::frames::Rigid;
    use sizeup_heights::ids::ViewId;
    use sizeup_results::output::Status;

    /// Looks straight down from (x, y, 100), north up in the photo.
    fn from_above(name: &str, x: f64, y: f64) -> View {
        let rotation = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
        View {
            id: ViewId(name.to_owned()),
            camera: Arc::new(Camera::pinhole(1000, 800, 900.0)),
            camera_from_map: Rigid::new(rotation, -(rotation * DVec3::new(x, y, 100.0))),
            image: None,
        }
    }

    fn block() -> (BuildingRecord, TruthBuilding) {
        let footprint = Rect::new(coord! { x: -5.0, y: -5.0 }, coord! { x: 5.0, y: 5.0 }).to_polygon();
        let truth = TruthBuilding {
            id: "b".to_owned(),
            footprint: Some(MultiPolygon::new(vec![footprint.clone()])),
            height_m: Some(20.0),
            group: None,
        };
        (BuildingRecord::measured("b", footprint, 0.0, 10.0), truth)
    }

    #[test]
    fn roofs_of_result_and_reference_lie_where_the_camera_sees_them() {
        let (record, truth) = block();
        let edges = Edges::of(&[&record], Some(&truth), 20.0);
        let view = from_above("above", 0.0, 0.0);
        let [(_, crop)] = choose(&[&view], &edges)[..] else { panic!("it is in the photo") };
        let size = DVec2::new(f64::from(SHEET_PHOTO_PX[0]), f64::from(SHEET_PHOTO_PX[1]));
        let farthest = |colour: Rgb| {
            let lines = edges.lines(&view, crop);
            let points = lines.iter().filter(|line| line.colour == colour).flat_map(|line| line.points_px.clone());
            points.map(|p| (DVec2::from(p) / size * crop.size + crop.corner).x - 500.0).fold(0.0, f64::max)
        };
        // 900 px · 5 m over 90 m and 80 m of distance.
        assert!((farthest(ROOF) - 50.0).abs() < 0.01, "{}", farthest(ROOF));
        assert!((farthest(REFERENCE) - 56.25).abs() < 0.01, "{}", farthest(REFERENCE));
    }

    #[test]
    fn photos_that_show_the_whole_of_it_come_first_and_from_all_around() {
        let (record, _) = block();
        let edges = Edges::of(&[&record], None, 0.0);
        let views = [
            from_above("cut", 55.0, 0.1),
            from_above("north east", 20.0, 20.0),
            // More of the walls is seen from there.
            from_above("farther north east", 21.0, 21.0),
            from_above("south west", -22.0, -22.0),
            from_above("beside", 400.0, 0.0),
        ];
        let chosen = choose(&views.iter().collect::<Vec<_>>(), &edges);
        let names: Vec<&str> = chosen.iter().map(|(view, _)| view.id.0.as_str()).collect();
        assert_eq!(names, ["south west", "farther north east", "north east"], "one of each side before two of one");
    }

    #[test]
    fn the_largest_errors_come_first_too_low_or_too_high() {
        let error = |id: &str, signed_error_m: f64| BuildingError {
            truth_id: id.to_owned(),
            result_id: id.to_owned(),
            height_m: 10.0 + signed_error_m,
            truth_m: 10.0,
            signed_error_m,
            sigma_m: Some(0.4),
            status: Status::Measured,
            group: None,
            overlap_share: None,
            area_m2: None,
        };
        let all: Vec<BuildingError> =
            (0..30).map(|i| error(&i.to_string(), f64::from(i) * if i % 2 == 0 { 0.1 } else { -0.1 })).collect();
        let shown = farthest(&all);
        assert_eq!(shown.iter().map(|b| &*b.result_id).collect::<Vec<_>>()[..3], ["29", "28", "27"]);
        assert_eq!(shown.len(), N_BUILDINGS);
        let (record, _) = block();
        assert_eq!(caption(0, shown[0], &[&record]), "1. 29: -2.90 m; 7.10 ± 0.40 for 10.00 m, measured");
    }
}
