//! The town as nadir photos show it, laid on the ground: what lies under the map of the report.
//!
//! ```text
//! colour(x, y) = photo_v(project_v(x, y, z(x, y)))     z: the ground
//! v(x, y)      = the view that sees (x, y) whose camera stands closest to above it: there roofs lean least
//! ```
//! Few photos are read: those that together see most of the town.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};
use std::path::Path;

use geo::BoundingRect as _;
use glam::{DVec2, DVec3};
use image::imageops::thumbnail;
use image::{GrayImage, Luma, Rgb, RgbImage};
use rayon::prelude::*;

use sizeup_geo::files::is_virtual;
use sizeup_geo::terrain::{MapBox, Terrain};
use sizeup_heights::ids::ViewId;
use sizeup_results::output::BuildingRecord;
use sizeup_results::output::picture::photo_of;
use sizeup_results::report::Backdrop;
use sizeup_survey::{View, ViewKind};

/// Photos that are in memory at a time.
const PHOTOS_AT_A_TIME: usize = 4;

/// How many photos are worth reading: each takes about half a second.
#[derive(Debug, Clone, Copy)]
pub(in crate::pipeline) struct Effort {
    /// Photos that are read, at most.
    most_photos: usize,
    /// Places along the longer side of the town at which it is counted what a photo adds.
    n_places: usize,
    /// A photo that adds a smaller share of the town than this is not read.
    least_gain: f64,
}

/// For what one run computes.
pub(in crate::pipeline) const TOWN: Effort = Effort { most_photos: 16, n_places: 48, least_gain: 0.01 };
/// For a city of tiles, of which a photo shows little: a minute of two cores at most.
pub(in crate::pipeline) const CITY: Effort = Effort { most_photos: 256, n_places: 128, least_gain: 0.001 };

/// Whether nothing stands between an eye and a place, both in the map frame.
pub(in crate::pipeline) type Sight<'a> = &'a (dyn Fn(DVec3, DVec3) -> bool + Sync);

/// Side of the blocks of pixels that one photo shows, where it is asked what it sees: a ray for each pixel would take most of the time.
const BLOCK_PX: u32 = 4;

/// Ground shown around the footprints, share of their longer side, and at least, metres.
const MARGIN_SHARE: f64 = 0.04;
const LEAST_MARGIN_M: f64 = 15.0;
/// Finer pixels than this show no more of a town, metres.
const LEAST_PX_M: f64 = 0.05;

/// The views whose photos may be laid there.
pub(in crate::pipeline) fn at_hand(views: &[View]) -> impl Iterator<Item = &View> {
    at_hand_of(views, ViewKind::Nadir)
}

fn at_hand_of(views: &[View], kind: ViewKind) -> impl Iterator<Item = &View> {
    let is_there = |path: &Path| is_virtual(path) || path.is_file();
    let of_kind = views.iter().filter(move |view| view.kind() == kind);
    of_kind.filter(move |view| view.image.as_deref().is_some_and(is_there))
}

/// Lays photos under the footprints, the longer side of the picture at most `longest_px`; `None` where no nadir photo is at
/// hand that shows any of it.
pub(in crate::pipeline) fn lay(
    views: &[View],
    records: &[BuildingRecord],
    terrain: &Terrain,
    longest_px: u32,
    effort: Effort,
) -> Option<Backdrop> {
    let sheet = BackdropSheet::over(town_of(records)?, (terrain, level_of(records)), (LEAST_PX_M, longest_px))?;
    let at_hand: Vec<&View> = at_hand(views).collect();
    let chosen = choose(&at_hand, &sheet, effort, &|_, _| true, &mut sheet.nowhere(effort));
    sheet.lay(&chosen)
}

/// Lays photos on an area with pixels of this size, metres, only where buildings do not hide the ground from them: nadir photos, and
/// oblique ones where those do not reach. `None` where no photo at hand shows any of it.
pub(in crate::pipeline) fn lay_where_seen(
    views: &[View],
    (area, mean_m): (MapBox, f64),
    terrain: &Terrain,
    size: (f64, u32),
    sight: Sight<'_>,
) -> Option<Backdrop> {
    let sheet = BackdropSheet::over(area, (terrain, mean_m), size)?;
    let mut unread = BTreeSet::new();
    loop {
        let mut is_covered = sheet.nowhere(CITY);
        let mut chosen: Vec<&View> = Vec::new();
        for kind in [ViewKind::Nadir, ViewKind::Oblique] {
            let at_hand: Vec<&View> = at_hand_of(views, kind).filter(|view| !unread.contains(&view.id)).collect();
            chosen.extend(choose(&at_hand, &sheet, CITY, sight, &mut is_covered));
        }
        // In the order of the survey.
        chosen.sort_by(|a, b| a.id.cmp(&b.id));
        match sheet.lay_blocks(&chosen, sight) {
            Ok(backdrop) => return backdrop,
            // What they were chosen for is for others.
            Err(these) => unread.extend(these),
        }
    }
}

/// The footprints with a margin around them; `None` without any.
pub(super) fn town_of(records: &[BuildingRecord]) -> Option<MapBox> {
    let boxes = records.iter().filter_map(|record| record.footprint.as_ref()?.bounding_rect());
    let town = MapBox::around(boxes.flat_map(|b| [(b.min().x, b.min().y), (b.max().x, b.max().y)]))?;
    Some(town.grown((MARGIN_SHARE * longest_m(&town)).max(LEAST_MARGIN_M)))
}

/// Median level of the ground under buildings, metres; 0 without any.
pub(super) fn level_of(records: &[BuildingRecord]) -> f64 {
    let levels: Vec<f64> = records.iter().filter_map(|record| record.ground_z_m).collect();
    sizeup_heights::stats::median(&levels).unwrap_or(0.0)
}

fn sides_m(area: &MapBox) -> [f64; 2] {
    [area.east_m - area.west_m, area.north_m - area.south_m]
}

fn longest_m(area: &MapBox) -> f64 {
    sides_m(area)[0].max(sides_m(area)[1])
}

/// Place of the picture on the map.
struct BackdropSheet<'a> {
    terrain: &'a Terrain,
    /// Ground level where the terrain has none, metres.
    mean_m: f64,
    west_m: f64,
    north_m: f64,
    px_m: f64,
    size_px: [u32; 2],
}

impl<'a> BackdropSheet<'a> {
    /// A sheet over an area: pixels of a size, metres, or larger ones where its longer side would have more than `most_px`.
    fn over(area: MapBox, (terrain, mean_m): (&'a Terrain, f64), (px_m, most_px): (f64, u32)) -> Option<Self> {
        // A square is covered to its edges.
        let px_m = longest_m(&area) / (longest_m(&area) / px_m.max(LEAST_PX_M)).ceil().min(f64::from(most_px));
        let size_px = sides_m(&area).map(|metres| (metres / px_m).round() as u32);
        let sheet = Self { terrain, mean_m, west_m: area.west_m, north_m: area.north_m, px_m, size_px };
        (most_px > 0 && size_px.iter().all(|&n| n > 0)).then_some(sheet)
    }

    /// The ground under the middle of a pixel.
    fn place(&self, x: u32, y: u32) -> DVec3 {
        let [x_m, y_m] = [f64::from(x) + 0.5, f64::from(y) + 0.5].map(|at| at * self.px_m);
        let (x_m, y_m) = (self.west_m + x_m, self.north_m - y_m);
        DVec3::new(x_m, y_m, self.terrain.height_at(x_m, y_m).unwrap_or(self.mean_m))
    }

    /// Places over the whole sheet, evenly.
    fn places(&self, n: usize) -> Vec<DVec3> {
        let step = self.size_px[0].max(self.size_px[1]).div_ceil(n as u32).max(1) as usize;
        let [columns, rows] = self.size_px.map(|n| (step as u32 / 2..n).step_by(step));
        rows.flat_map(|y| columns.clone().map(move |x| (x, y))).map(|(x, y)| self.place(x, y)).collect()
    }

    /// Reads some photos and lays them there.
    fn lay(&self, chosen: &[&View]) -> Option<Backdrop> {
        let mut photos: Vec<Photo<'_>> = Vec::new();
        for some in chosen.chunks(PHOTOS_AT_A_TIME) {
            photos.par_extend(some.par_iter().filter_map(|view| Photo::read(view, self)));
        }
        // Photos come in the order of the survey, whoever was read first.
        photos.sort_by(|a, b| a.view.id.cmp(&b.view.id));
        let [width, height] = self.size_px;
        let row = |y: u32| -> Vec<Option<[u8; 3]>> { (0..width).map(|x| colour(&photos, self.place(x, y))).collect() };
        let rows: Vec<Vec<Option<[u8; 3]>>> = (0..height).into_par_iter().map(row).collect();
        let at = |x: u32, y: u32| rows[y as usize][x as usize];
        let picture = RgbImage::from_fn(width, height, |x, y| Rgb(at(x, y).unwrap_or([0; 3])));
        let shown = GrayImage::from_fn(width, height, |x, y| Luma([if at(x, y).is_some() { u8::MAX } else { 0 }]));
        self.backdrop(picture, shown, photos.iter().map(|photo| photo.view.id.0.clone()).collect())
    }

    /// Lays each photo on the blocks of pixels that it shows best; [`PHOTOS_AT_A_TIME`] are in memory.
    ///
    /// # Errors
    /// The photos that cannot be read.
    fn lay_blocks<'v>(&self, chosen: &[&'v View], sight: Sight<'_>) -> Result<Option<Backdrop>, Vec<&'v ViewId>> {
        let [width, height] = self.size_px;
        let (mut picture, mut shown) = (RgbImage::new(width, height), GrayImage::new(width, height));
        let (mut used, mut unread) = (Vec::new(), Vec::new());
        let blocks = 0..self.n_blocks()[0] * self.n_blocks()[1];
        let best = |block: u32| Some((self.photo_of_block(block, chosen, sight)?, block));
        let found: Vec<(usize, u32)> = blocks.into_par_iter().filter_map(best).collect();
        let mut blocks_of: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
        found.into_iter().for_each(|(k, block)| blocks_of.entry(k).or_default().push(block));
        for some in blocks_of.into_iter().collect::<Vec<_>>().chunks(PHOTOS_AT_A_TIME) {
            let painted = |(k, blocks): &(usize, Vec<u32>)| {
                let photo = Photo::read(chosen[*k], self)?;
                Some(blocks.iter().map(|&block| self.colours_of(block, &photo)).collect::<Vec<_>>())
            };
            let painted: Vec<Option<Vec<_>>> = some.par_iter().map(painted).collect();
            for ((k, blocks), painted) in some.iter().zip(painted) {
                let id = &chosen[*k].id;
                let Some(painted) = painted else {
                    unread.push(id);
                    continue;
                };
                used.push(id.0.clone());
                let pixels = blocks.iter().flat_map(|&block| self.pixels_of(block));
                for ((x, y), colour) in pixels.zip(painted.into_iter().flatten()) {
                    let Some(colour) = colour else { continue };
                    picture.put_pixel(x, y, Rgb(colour));
                    shown.put_pixel(x, y, Luma([u8::MAX]));
                }
            }
        }
        if unread.is_empty() { Ok(self.backdrop(picture, shown, used)) } else { Err(unread) }
    }

    fn backdrop(&self, picture: RgbImage, shown: GrayImage, photos: Vec<String>) -> Option<Backdrop> {
        let [width, height] = self.size_px;
        let n_shown = shown.pixels().filter(|pixel| pixel[0] > 0).count();
        let [east_m, south_m] =
            [self.west_m + f64::from(width) * self.px_m, self.north_m - f64::from(height) * self.px_m];
        (n_shown > 0).then(|| Backdrop {
            picture,
            shown: (n_shown < (width * height) as usize).then_some(shown),
            bounds_m: [self.west_m, south_m, east_m, self.north_m],
            photos,
        })
    }

    /// For each place that is counted whether a photo shows it: none does.
    fn nowhere(&self, effort: Effort) -> Vec<bool> {
        vec![false; self.places(effort.n_places).len()]
    }

    /// Columns and rows of blocks.
    fn n_blocks(&self) -> [u32; 2] {
        self.size_px.map(|n| n.div_ceil(BLOCK_PX))
    }

    /// Position of the photo for a block of pixels: of those that see its middle the one closest to above it.
    fn photo_of_block(&self, block: u32, views: &[&View], sight: Sight<'_>) -> Option<usize> {
        let [columns, _] = self.n_blocks();
        let [x, y] = [block % columns, block / columns].map(|at| at * BLOCK_PX + BLOCK_PX / 2);
        let place = self.place(x, y);
        let aside = |k: usize| (views[k].centre() - place).truncate().length_squared();
        // Squares are not negative, so their bits are in their order.
        let mut open: BinaryHeap<_> = (0..views.len()).map(|k| Reverse((aside(k).to_bits(), k))).collect();
        // One of the first few sees it nearly everywhere: sorting all of them takes longer.
        std::iter::from_fn(|| open.pop())
            .map(|Reverse((_, k))| k)
            .find(|&k| views[k].pixel_of(place).is_some() && sight(views[k].centre(), place))
    }

    /// Pixels of a block, row by row.
    fn pixels_of(&self, block: u32) -> impl Iterator<Item = (u32, u32)> + use<> {
        let [columns, _] = self.n_blocks();
        let [x, y] = [block % columns, block / columns].map(|at| at * BLOCK_PX);
        let [right, below] = [(x + BLOCK_PX).min(self.size_px[0]), (y + BLOCK_PX).min(self.size_px[1])];
        (y..below).flat_map(move |y| (x..right).map(move |x| (x, y)))
    }

    /// Colours of the pixels of a block, where a photo shows them.
    fn colours_of(&self, block: u32, photo: &Photo<'_>) -> Vec<Option<[u8; 3]>> {
        let colour = |(x, y)| Some(photo.colour(photo.view.pixel_of(self.place(x, y))?));
        self.pixels_of(block).map(colour).collect()
    }
}

/// The views that together see most, the one that sees most first.
fn choose<'a>(
    views: &[&'a View],
    sheet: &BackdropSheet<'_>,
    effort: Effort,
    sight: Sight<'_>,
    is_covered: &mut [bool],
) -> Vec<&'a View> {
    let places = sheet.places(effort.n_places);
    let seen_by = |view: &&View| -> Vec<usize> {
        let is_seen = |place: DVec3| view.pixel_of(place).is_some() && sight(view.centre(), place);
        (0..places.len()).filter(|&at| is_seen(places[at])).collect()
    };
    let sees: Vec<Vec<usize>> = views.par_iter().map(seen_by).collect();
    let least = (effort.least_gain * places.len() as f64).max(1.0);
    let mut chosen: Vec<usize> = Vec::new();
    while chosen.len() < effort.most_photos {
        let gain = |v: &usize| sees[*v].iter().filter(|place| !is_covered[**place]).count();
        let gains = (0..views.len()).filter(|v| !chosen.contains(v)).map(|v| (gain(&v), v));
        // Among equals the first.
        let Some((gain, best)) = gains.max_by_key(|&(gain, v)| (gain, Reverse(v))) else { break };
        if (gain as f64) < least {
            break;
        }
        chosen.push(best);
        sees[best].iter().for_each(|place| is_covered[*place] = true);
    }
    chosen.into_iter().map(|v| views[v]).collect()
}

/// A photo, reduced to about the picture's own pixels.
struct Photo<'a> {
    view: &'a View,
    pixels: RgbImage,
}

impl<'a> Photo<'a> {
    /// `None` for one that cannot be read: the survey reports bad photos.
    fn read(view: &'a View, sheet: &BackdropSheet<'_>) -> Option<Self> {
        let stored = photo_of(view).ok()?;
        let above_m = view.centre().z - sheet.mean_m;
        let focal_px = view.camera.fx_px * f64::from(stored.width()) / f64::from(view.camera.width_px);
        let share = (above_m / focal_px / sheet.px_m).clamp(0.0, 1.0);
        let [width, height] = [stored.width(), stored.height()].map(|n| ((f64::from(n) * share).round() as u32).max(1));
        let pixels = if share < 1.0 { thumbnail(&stored, width, height) } else { stored };
        Some(Self { view, pixels })
    }

    /// The colour at a pixel of the camera, between the pixels' middles.
    fn colour(&self, pixel: DVec2) -> [u8; 3] {
        let camera = DVec2::new(f64::from(self.view.camera.width_px), f64::from(self.view.camera.height_px));
        let last = DVec2::new(f64::from(self.pixels.width() - 1), f64::from(self.pixels.height() - 1));
        let at = (pixel / camera * (last + 1.0) - 0.5).clamp(DVec2::ZERO, last);
        let [x, y] = [at.x as u32, at.y as u32];
        let [right, below] = [(x + 1).min(last.x as u32), (y + 1).min(last.y as u32)];
        let share = at - at.floor();
        std::array::from_fn(|c| {
            let value = |x: u32, y: u32| f64::from(self.pixels.get_pixel(x, y)[c]);
            let along = |y: u32| value(x, y) + (value(right, y) - value(x, y)) * share.x;
            (along(y) + (along(below) - along(y)) * share.y).round() as u8
        })
    }
}

/// The colour of a place in the photo whose camera stands closest to above it.
fn colour(photos: &[Photo<'_>], place: DVec3) -> Option<[u8; 3]> {
    let aside = |photo: &Photo<'_>| (photo.view.centre() - place).truncate().length_squared();
    let seeing = photos.iter().filter_map(|photo| Some((photo, photo.view.pixel_of(place)?)));
    let (photo, pixel) = seeing.min_by(|(a, _), (b, _)| aside(a).total_cmp(&aside(b)))?;
    Some(photo.colour(pixel))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use geo::polygon;
    use glam::DMat3;

    use super::*;
    use sizeup_heights::camera::Camera;
    use sizeup_heights::frames::Rigid;

    /// Where the town lies, and its ground.
    const AT: [f64; 3] = [565_000.0, 5_934_000.0, 20.0];
    const HEIGHT_M: f64 = 100.0;

    /// Red grows by 2 a metre eastwards, green by 2 a metre northwards.
    fn ground_colour(x: f64, y: f64) -> [u8; 3] {
        [120.0 + 2.0 * (x - AT[0]), 120.0 + 2.0 * (y - AT[1]), 40.0]
            .map(|value: f64| value.round().clamp(0.0, 255.0) as u8)
    }

    /// A photo straight down from above a place, stored at half its camera's size: 80 by 60 m.
    fn photo(folder: &Path, name: &str, east_m: f64, north_m: f64) -> View {
        let down = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
        let camera = Arc::new(Camera::pinhole(800, 600, 1000.0));
        let centre = DVec3::new(AT[0] + east_m, AT[1] + north_m, AT[2] + HEIGHT_M);
        let view = View {
            id: name.into(),
            camera,
            camera_from_map: Rigid::from_rotation_and_centre(down, centre),
            image: Some(folder.join(name)),
        };
        let pixel = |x: u32, y: u32| {
            let [x_m, y_m] = [(f64::from(x) + 0.5 - 200.0) * 0.2, (150.0 - f64::from(y) - 0.5) * 0.2];
            Rgb(ground_colour(centre.x + x_m, centre.y + y_m))
        };
        RgbImage::from_fn(400, 300, pixel).save(folder.join(name)).unwrap();
        view
    }

    /// One footprint, `side_m` by 20 m around the middle.
    fn town(side_m: f64) -> Vec<BuildingRecord> {
        let [x, y] = [AT[0], AT[1]];
        let footprint = polygon![(x: x - side_m / 2.0, y: y - 10.0), (x: x + side_m / 2.0, y: y - 10.0),
            (x: x + side_m / 2.0, y: y + 10.0), (x: x - side_m / 2.0, y: y + 10.0)];
        vec![BuildingRecord::measured("a", footprint, AT[2], 9.0)]
    }

    fn check_colours(backdrop: &Backdrop, within: u8) -> usize {
        let [west, _, east, north] = backdrop.bounds_m;
        let px_m = (east - west) / f64::from(backdrop.picture.width());
        let mut n_shown = 0;
        for (x, y, pixel) in backdrop.picture.enumerate_pixels() {
            if backdrop.shown.as_ref().is_some_and(|shown| shown.get_pixel(x, y)[0] == 0) {
                continue;
            }
            let [x_m, y_m] = [west + (f64::from(x) + 0.5) * px_m, north - (f64::from(y) + 0.5) * px_m];
            let expected = ground_colour(x_m, y_m);
            let is_near = pixel.0.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= within);
            assert!(is_near, "{:?} for {expected:?} at {x} {y}", pixel.0);
            n_shown += 1;
        }
        n_shown
    }

    #[test]
    fn photos_lie_where_they_were_taken_and_only_those_that_add_something_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let mut views = vec![
            photo(folder.path(), "c.png", 30.0, 0.0),
            photo(folder.path(), "a.png", -30.0, 0.0),
            photo(folder.path(), "same.png", 30.0, 0.0),
            photo(folder.path(), "elsewhere.png", 900.0, 0.0),
        ];
        let mut gone = photo(folder.path(), "b.png", 0.0, 0.0);
        gone.image = Some(folder.path().join("gone.png"));
        views.push(gone);
        let ground = Terrain::Constant(AT[2]);
        let backdrop = lay(&views, &town(90.0), &ground, 500, TOWN).unwrap();
        assert_eq!(backdrop.photos, ["a.png", "c.png"]);
        assert_eq!(backdrop.picture.width(), 500);
        assert!(backdrop.shown.is_none(), "140 m of photos hold 120 m of town and margin");
        // A pixel of the photo is 0.2 m, of the picture 0.24 m: colours are off by half of that at most, and rounding.
        assert_eq!(check_colours(&backdrop, 2), (backdrop.picture.width() * backdrop.picture.height()) as usize);

        let one = lay(&views[..1], &town(90.0), &ground, 500, TOWN).unwrap();
        let n_shown = check_colours(&one, 2);
        // From 10 m west of the middle to the eastern edge, 60 m east of it.
        let share = n_shown as f64 / f64::from(one.picture.width() * one.picture.height());
        assert!((share - 70.0 / 120.0).abs() < 0.01, "{share}");
        assert_eq!(lay(&views[3..], &town(90.0), &ground, 500, TOWN), None);
        assert_eq!(lay(&views, &town(90.0), &ground, 0, TOWN), None, "it can be left out");
    }

    #[test]
    fn ground_that_is_hidden_from_one_photo_is_taken_from_another_and_neighbours_meet_at_their_edge() {
        let folder = tempfile::tempdir().unwrap();
        let views = [("a.png", 0.0), ("b.png", 5.0), ("c.png", -5.0)]
            .map(|(name, east_m)| photo(folder.path(), name, east_m, 0.0));
        std::fs::write(folder.path().join("a.png"), "no picture").unwrap();
        let ground = Terrain::Constant(AT[2]);
        let area = |west_m: f64| MapBox {
            west_m: AT[0] + west_m,
            south_m: AT[1] - 15.0,
            east_m: AT[0] + west_m + 30.0,
            north_m: AT[1] + 15.0,
        };
        // The photo straight above cannot be read, the eastern one sees nothing north of the middle.
        let sees = |eye: DVec3, place: DVec3| eye.x < AT[0] + 1.0 || place.y < AT[1];
        let lay = |west_m: f64| lay_where_seen(&views, (area(west_m), AT[2]), &ground, (0.23, 4096), &sees).unwrap();
        let on = |n: usize| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(|| lay(0.0));
        assert_eq!(on(1), on(4));
        let (west, east) = (lay(-30.0), lay(0.0));
        assert!((west.bounds_m[2] - east.bounds_m[0]).abs() < 1e-9);
        assert_eq!((west.picture.width(), west.picture.height()), (131, 131), "30 m in pixels of 0.23 m at most");
        assert!(!east.photos.contains(&"a.png".to_owned()) && east.shown.is_none(), "{:?}", east.photos);
        check_colours(&east, 2);
    }

    #[test]
    fn the_picture_is_the_same_on_one_thread_and_on_many() {
        let folder = tempfile::tempdir().unwrap();
        let views: Vec<View> =
            (0..6).map(|i| photo(folder.path(), &format!("{i}.png"), 20.0 * f64::from(i) - 50.0, 0.0)).collect();
        let ground = Terrain::Constant(AT[2]);
        let on = |n: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
            pool.install(|| lay(&views, &town(100.0), &ground, 300, TOWN)).unwrap()
        };
        assert_eq!(on(1), on(5));
    }

    #[test]
    fn photos_follow_a_slope() {
        let folder = tempfile::tempdir().unwrap();
        let view = photo(folder.path(), "a.png", 0.0, 0.0);
        // On ground 20 m higher a photo shows less, and what it shows lies closer to its middle.
        let mut town = town(40.0);
        town[0].ground_z_m = Some(AT[2] + 20.0);
        let backdrop = lay(&[view], &town, &Terrain::Constant(AT[2] + 20.0), 400, TOWN).unwrap();
        let [west, south, east, north] = backdrop.bounds_m;
        assert!((east - west - 70.0).abs() < 0.2 && (north - south - 50.0).abs() < 0.2);
        // 35 m east of the middle there: 43.75 m on the ground that the photo was painted for, which it does not reach.
        assert_eq!(backdrop.shown.as_ref().unwrap().get_pixel(backdrop.picture.width() - 1, 10)[0], 0);
        let (x, y) = (backdrop.picture.width() * 5 / 7, backdrop.picture.height() / 2);
        let expected = ground_colour(AT[0] + 15.0 / 0.8, AT[1]);
        let pixel = backdrop.picture.get_pixel(x, y).0;
        assert!(pixel.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 2), "{pixel:?} for {expected:?}");
    }
}
