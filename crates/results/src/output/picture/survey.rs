//! A plan of a survey: cameras with a line to the ground they look at, nadir and oblique in two colours, over the
//! footprints of their photos on the ground.

use geo_types::{LineString, Polygon};
use glam::DVec2;
use image::RgbImage;

use super::SHEET_PX;
use super::canvas::{Align, Pen};
use super::colour::{GREY, INK, Rgb, WHITE};
use super::plan::{MapSheet, ShownRegion};
use sizeup_geo::crs::Crs;
use sizeup_geo::issue::Severity;
use sizeup_geo::terrain::Terrain;
use sizeup_survey::{Survey, View, ViewKind, ground};

const FOOTPRINT: Rgb = [130, 134, 140];
/// Blue and vermilion of the Okabe-Ito palette: told apart by colour-blind readers, and in print.
const NADIR: Rgb = [0, 114, 178];
const OBLIQUE: Rgb = [213, 94, 0];
/// Bluish green of the same palette: photos that were refused.
const REFUSED: Rgb = [0, 158, 115];
/// Free margin around what is shown, share of the larger side.
const MARGIN_SHARE: f64 = 0.03;
/// Footprints of more photos than this would only fill the map: every n-th is drawn.
const MAX_FOOTPRINTS: usize = 400;
/// Radius of an oblique camera's mark at the reference width, pixels; the smaller where there are many.
const MARK_PX: f32 = 3.6;
const SMALL_MARK_PX: f32 = 2.2;
/// Radius of a nadir camera's mark, in radii of an oblique one's.
const NADIR_RADII: f32 = 1.8;
/// More cameras than this get smaller marks.
const CROWD: usize = 200;

/// A view as it is drawn.
struct DrawnView {
    camera: DVec2,
    looks_at: Option<DVec2>,
    colour: Rgb,
}

/// Draws the survey; image footprints lie on `ground`, at 0 m where none is given. North is up.
#[must_use]
pub fn survey_map(survey: &Survey, ground: Option<&Terrain>, crs: &Crs) -> RgbImage {
    let terrain = ground.unwrap_or(&Terrain::Constant(0.0));
    let step = survey.views.len().div_ceil(MAX_FOOTPRINTS).max(1);
    let footprints = footprints(survey, terrain, step);
    let views = drawn(survey, terrain);
    let cameras = views.iter().flat_map(|view| [Some(view.camera), view.looks_at]).flatten();
    let corners = footprints.iter().flatten().copied();
    let refused = refused(survey);
    let region =
        ShownRegion::around(corners.chain(cameras).chain(refused.iter().copied()).map(|p| [p.x, p.y]), MARGIN_SHARE);
    let mut sheet = MapSheet::new(&region, SHEET_PX);
    draw(&mut sheet, &footprints, &views);
    draw_refused(&mut sheet, &refused);
    sheet.furnish();
    let n_refused = survey.issues.iter().filter(|issue| issue.severity == Severity::Refused).count();
    let height = match ground {
        Some(_) => "image footprints on the ground",
        None => "image footprints on a ground of 0 m",
    };
    let below = format!("{} usable poses, {n_refused} refused items · {height}", survey.views.len());
    sheet.headings("Cameras and what they look at", &below, crs);
    legend(&mut sheet, survey, refused.len(), step);
    sheet.canvas.into_image()
}

/// Places of photos that cannot be used.
fn refused(survey: &Survey) -> Vec<DVec2> {
    let of_views = survey.issues.iter().filter(|issue| issue.severity == Severity::Refused);
    of_views.filter_map(|issue| issue.place.map(DVec2::from)).collect()
}

fn draw_refused(sheet: &mut MapSheet, places: &[DVec2]) {
    let MapSheet { canvas, to_px, unit, .. } = sheet;
    for place in places {
        canvas.disc(to_px.at(place.x, place.y), MARK_PX * *unit, REFUSED, Pen::new(WHITE, 0.8 * *unit));
    }
}

fn footprints(survey: &Survey, terrain: &Terrain, step: usize) -> Vec<Vec<DVec2>> {
    let fallback_m = terrain.range().map_or(0.0, |(low_m, high_m)| 0.5 * (low_m + high_m));
    let footprint = |view: &View| {
        let centre = view.centre();
        ground::footprint(view, terrain.height_at(centre.x, centre.y).unwrap_or(fallback_m))
    };
    survey.views.iter().step_by(step).map(footprint).collect()
}

fn drawn(survey: &Survey, terrain: &Terrain) -> Vec<DrawnView> {
    let view = |view: &View| DrawnView {
        camera: view.centre().truncate(),
        looks_at: ground::centre_on_ground(view, terrain),
        colour: if view.kind() == ViewKind::Nadir { NADIR } else { OBLIQUE },
    };
    survey.views.iter().map(view).collect()
}

fn draw(sheet: &mut MapSheet, footprints: &[Vec<DVec2>], views: &[DrawnView]) {
    let MapSheet { canvas, to_px, unit, .. } = sheet;
    let unit = *unit;
    let radius = unit * if views.len() > CROWD { SMALL_MARK_PX } else { MARK_PX };
    for footprint in footprints {
        let ring: LineString = footprint.iter().map(|p| (p.x, p.y)).collect();
        let pen = Pen { colour: FOOTPRINT, opacity: 0.7, width_px: 1.1 * unit };
        canvas.stroke_rings(&to_px.rings(&Polygon::new(ring, Vec::new())), pen);
    }
    for view in views {
        if let Some(end) = view.looks_at {
            let line = [to_px.at(view.camera.x, view.camera.y), to_px.at(end.x, end.y)];
            canvas.line(&line, Pen { colour: view.colour, opacity: 0.8, width_px: 1.3 * unit });
        }
    }
    // Rigs take nadir and oblique photos from one place: the wider nadir marks stay visible below.
    let (nadir, oblique): (Vec<&DrawnView>, Vec<&DrawnView>) = views.iter().partition(|view| view.colour == NADIR);
    for (views, radius) in [(nadir, NADIR_RADII * radius), (oblique, radius)] {
        for view in views {
            let at = to_px.at(view.camera.x, view.camera.y);
            canvas.disc(at, radius, view.colour, Pen::new(WHITE, 0.8 * unit));
        }
    }
}

fn legend(sheet: &mut MapSheet, survey: &Survey, n_refused: usize, step: usize) {
    let (left, unit) = (sheet.legend_left(), sheet.unit);
    let MapSheet { canvas, frame, .. } = sheet;
    let n_nadir = survey.views.iter().filter(|view| view.kind() == ViewKind::Nadir).count();
    let mut y = frame.top + 18.0 * unit;
    let mut kinds = vec![
        (NADIR, NADIR_RADII, format!("nadir: {n_nadir}")),
        (OBLIQUE, 1.0, format!("oblique: {}", survey.views.len() - n_nadir)),
    ];
    if n_refused > 0 {
        kinds.push((REFUSED, 1.0, format!("refused: {n_refused}")));
    }
    for (colour, radii, label) in kinds {
        canvas.line(&[[left, y], [left + 26.0 * unit, y]], Pen { colour, opacity: 0.8, width_px: 1.3 * unit });
        canvas.disc([left + 5.0 * unit, y], radii * MARK_PX * unit, colour, Pen::new(WHITE, 0.8 * unit));
        canvas.text(&label, [left + 36.0 * unit, y + 5.0 * unit], 15.0 * unit, INK, Align::Left);
        y += 30.0 * unit;
    }
    let corners = [[0.0, -9.0], [26.0, -9.0], [26.0, 9.0], [0.0, 9.0]];
    let swatch = corners.map(|[x, dy]| [left + x * unit, y + dy * unit]).to_vec();
    canvas.stroke_rings(&[swatch], Pen { colour: FOOTPRINT, opacity: 0.8, width_px: 1.0 * unit });
    canvas.text("image footprint", [left + 36.0 * unit, y + 5.0 * unit], 15.0 * unit, INK, Align::Left);
    let mut notes = vec!["dot: camera".to_owned(), "line: to where its".to_owned(), "image centre looks".to_owned()];
    if step > 1 {
        notes.push(format!("footprints of 1 photo in {step}"));
    }
    for note in notes {
        y += 26.0 * unit;
        canvas.text(&note, [left, y + 5.0 * unit], 14.0 * unit, GREY, Align::Left);
    }
}
