//! The textured city of a run: its solids, its ground and its photos brought together.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use glam::DVec3;
use image::GrayImage;
use serde::Serialize;

use super::super::checks::check_settings;
use super::super::scene::SceneStage;
use super::super::settings::OutputSettings;
use super::super::{FootprintStage, PipelineError, RunSettings, Stage};
use super::backdrop;
use super::records::{records, reviews_of};
use crate::config::{FootprintPlace, OutputConfig};
use sizeup_geo::files::FileError;
use sizeup_geo::issue::Issue;
use sizeup_geo::terrain::{MapBox, Terrain};
use sizeup_heights::frames::LocalOrigin;
use sizeup_heights::scene::LocalGround;
use sizeup_photos::textures::{
    Choice, Page, Surface, SurfaceKind, SurfaceScene, TextureTask, TexturedArea, Textures, bake, fill_unknown,
};
use sizeup_results::output::cityjson::CityJsonConfig;
use sizeup_results::output::picture::photo_of;
use sizeup_results::output::textured::{self, CitySurfaces, PaintedCity, TexturedCity, TexturedGround};
use sizeup_results::output::{BuildingRecord, CityModel, Lineage, OutputError};
use sizeup_results::report;
use sizeup_survey::{Survey, View};

/// Longer side of the picture of the ground, pixels, at most: what every graphics card takes.
const GROUND_PX: u32 = 4096;
/// Cells along the longer side of the ground's mesh, at most: 130,000 triangles.
const MOST_CELLS: f64 = 256.0;
/// The same of level ground, whose mesh only has to follow the edge of what photos show; a first choice.
const LEVEL_CELLS: f64 = 32.0;
/// Ground is looked at from so far above it, metres: between its nodes the mesh that rays meet is another one.
const LIFT_M: f64 = 0.5;

/// Everything that a run's city is textured from.
pub struct TextureScene {
    /// Every building of the result.
    pub records: Vec<BuildingRecord>,
    /// The photos, moved onto the footprints where the whole layer was.
    pub survey: Survey,
    /// Surfaces of the solids as they are written.
    pub city: CitySurfaces,
    /// The same where the photos show them: a footprint that is known to be off is painted from there.
    pub surfaces: Vec<Surface>,
    /// Surfaces of buildings beside them, which have no textures here.
    pub occluders: Vec<Surface>,
    /// The ground in the local frame.
    pub ground: LocalGround,
    /// The same in the map.
    pub terrain: Terrain,
    /// Part of the map whose ground is shown; `None` without buildings.
    pub area: Option<MapBox>,
    /// Origin of the local frame.
    pub origin: LocalOrigin,
}

impl TextureScene {
    /// The scene of the records of a run.
    pub(in crate::pipeline) fn new(
        output: &OutputConfig,
        records: &[BuildingRecord],
        survey: &Survey,
        stage: &SceneStage,
    ) -> Result<Self, PipelineError> {
        Self::beside(output, (records, &[]), backdrop::town_of(records), survey, stage)
    }

    /// As [`Self::new`], of some buildings beside others, with the ground of an area.
    pub(in crate::pipeline) fn beside(
        output: &OutputConfig,
        (records, others): (&[BuildingRecord], &[BuildingRecord]),
        area: Option<MapBox>,
        survey: &Survey,
        stage: &SceneStage,
    ) -> Result<Self, PipelineError> {
        let city = CitySurfaces::of(records)?;
        let surfaces = where_shown(output, records, city.surfaces.clone());
        let mut occluders = where_shown(output, others, CitySurfaces::of(others)?.surfaces);
        occluders.iter_mut().for_each(|surface| surface.building += records.len());
        Ok(Self {
            records: records.to_vec(),
            survey: survey.clone(),
            city,
            surfaces,
            occluders,
            ground: stage.scene.ground.clone(),
            terrain: stage.terrain.clone(),
            area,
            origin: stage.scene.origin,
        })
    }

    /// The scene of a result, from what its stages left behind.
    ///
    /// # Errors
    /// [`PipelineError`]: no run in the output folder, or one made from other input or settings.
    pub fn of_result(settings: &RunSettings<'_>) -> Result<Self, PipelineError> {
        check_settings(&settings.output, &settings.heights)?;
        let artefacts = &settings.artefacts;
        let survey = artefacts.read_survey()?;
        let mut footprints: FootprintStage = artefacts.read(Stage::Footprints, &survey)?;
        let heights = artefacts.read_heights(&survey, &footprints)?;
        let (heights, stage) = SceneStage::of_heights(&settings.heights.scene, &survey, &mut footprints, heights)?;
        let reviews = reviews_of(settings.reviews)?;
        let records = records((&settings.records, stage.scene.bounds), &survey, &footprints, &heights, &reviews);
        Self::new(settings.output.config, &records, &heights.moved(&survey), &stage)
    }

    /// The ground with the photos laid on it; `None` where none shows it.
    fn ground_picture(&self, texel_m: f64) -> Option<TexturedGround> {
        let surfaces: Vec<Surface> = self.surfaces.iter().chain(&self.occluders).cloned().collect();
        let scene = SurfaceScene::new(&surfaces, self.ground.clone(), self.origin);
        let local = |place: DVec3| (place - self.origin.0).as_vec3();
        let sees = |eye: DVec3, place: DVec3| scene.is_seen(local(eye), local(place + LIFT_M * DVec3::Z));
        let (size, mean_m) = ((texel_m, GROUND_PX), backdrop::level_of(&self.records));
        let laid = backdrop::lay_where_seen(&self.survey.views, (self.area?, mean_m), &self.terrain, size, &sees)?;
        let [west_m, south_m, east_m, north_m] = laid.bounds_m;
        let (width_m, depth_m) = (east_m - west_m, north_m - south_m);
        let longest_m = width_m.max(depth_m);
        let cell_m = match &self.terrain {
            Terrain::Constant(_) => longest_m / LEVEL_CELLS,
            Terrain::Grid(dem) => dem.cell_m().0.max(longest_m / MOST_CELLS),
        };
        let n_nodes = [width_m, depth_m].map(|length_m| ((length_m / cell_m).ceil() as usize + 1).max(2));
        let height_m = |i: usize| {
            let share = |at: usize, n: usize| at as f64 / (n - 1) as f64;
            let (x, y) = (share(i % n_nodes[0], n_nodes[0]), share(i / n_nodes[0], n_nodes[1]));
            self.terrain.height_at(west_m + x * width_m, north_m - y * depth_m).unwrap_or(mean_m)
        };
        let heights_m = (0..n_nodes[0] * n_nodes[1]).map(height_m).collect();
        let mut picture = laid.picture;
        let mut hidden_cells = Vec::new();
        if let Some(shown) = &laid.shown {
            hidden_cells = cells_without(shown, n_nodes);
            fill_unknown(&mut picture, &shown.pixels().map(|pixel| pixel[0] > 0).collect::<Vec<_>>());
        }
        Some(TexturedGround { picture, bounds_m: laid.bounds_m, n_nodes, heights_m, hidden_cells, photos: laid.photos })
    }

    /// Textures from some of the photos; `scratch` is a folder for unnamed files.
    ///
    /// # Errors
    /// [`FileError`]: no file can be written there.
    pub fn bake(
        &self,
        views: &[View],
        texel_m: Option<f64>,
        choice: Choice,
        scratch: &Path,
    ) -> Result<Textures, FileError> {
        let decode = |view: &View| photo_of(view).map_err(|e| e.to_string());
        bake(&TextureTask {
            surfaces: &self.surfaces,
            occluders: &self.occluders,
            ground: self.ground.clone(),
            origin: self.origin,
            views,
            decode: &decode,
            texel_m,
            choice,
            groups: &self.city.tile_of,
            scratch,
        })
    }
}

/// Cells between nodes that no photo shows a pixel of, from the edges inwards: small ones between houses are filled.
fn cells_without(shown: &GrayImage, n_nodes: [usize; 2]) -> Vec<usize> {
    let size = [shown.width(), shown.height()];
    let n_cells = n_nodes.map(|n| n - 1);
    let pixels = |axis: usize, cell: usize| {
        let edge = |node: usize| node as f64 * f64::from(size[axis]) / n_cells[axis] as f64;
        edge(cell) as u32..(edge(cell + 1).ceil() as u32).min(size[axis])
    };
    let is_hidden = |cell: &usize| -> bool {
        let mut rows = pixels(1, cell / n_cells[0]);
        rows.all(|y| pixels(0, cell % n_cells[0]).all(|x| shown.get_pixel(x, y)[0] == 0))
    };
    let mut is_open: Vec<bool> = (0..n_cells[0] * n_cells[1]).map(|cell| is_hidden(&cell)).collect();
    let is_at_edge = |cell: usize| {
        let [col, row] = [cell % n_cells[0], cell / n_cells[0]];
        col == 0 || row == 0 || col + 1 == n_cells[0] || row + 1 == n_cells[1]
    };
    let mut next: Vec<usize> = (0..is_open.len()).filter(|&cell| is_at_edge(cell)).collect();
    let mut outside = BTreeSet::new();
    while let Some(cell) = next.pop() {
        if !std::mem::take(&mut is_open[cell]) {
            continue;
        }
        outside.insert(cell);
        let [col, row] = [cell % n_cells[0], cell / n_cells[0]];
        next.extend((col > 0).then(|| cell - 1));
        next.extend((col + 1 < n_cells[0]).then(|| cell + 1));
        next.extend((row > 0).then(|| cell - n_cells[0]));
        next.extend((row + 1 < n_cells[1]).then(|| cell + n_cells[0]));
    }
    outside.into_iter().collect()
}

/// Surfaces where the photos show them.
fn where_shown(output: &OutputConfig, records: &[BuildingRecord], mut surfaces: Vec<Surface>) -> Vec<Surface> {
    if output.footprints == FootprintPlace::AsGiven {
        for surface in &mut surfaces {
            let Some(shift) = records[surface.building].footprint_shift else { continue };
            surface.rings.iter_mut().flatten().for_each(|corner| *corner += shift.way().extend(0.0));
        }
    }
    surfaces
}

/// Numbers of a textured city.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TextureSummary {
    /// Side of a texel, metres.
    pub texel_m: f64,
    /// Pictures that the textures are on.
    pub n_pages: usize,
    /// Bytes of the pictures.
    pub n_bytes: usize,
    /// Roofs by where their colours come from.
    pub roofs: TexturedArea,
    /// Walls by where their colours come from.
    pub walls: TexturedArea,
    /// The same of each building, and the photos that paint its surfaces, most first.
    pub buildings: BTreeMap<String, BuildingTexture>,
}

/// Textures of one building.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct BuildingTexture {
    /// Roofs and walls by where their colours come from.
    pub areas: TexturedArea,
    /// Names of the photos that paint most of a surface, the one of most surfaces first.
    pub photos: Vec<String>,
    /// Tile of it in 3D Tiles that are made of the folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tile: Option<String>,
}

impl TextureSummary {
    /// Summary of the textures of a scene.
    #[must_use]
    pub fn of(scene: &TextureScene, textures: &Textures) -> Self {
        let mut buildings: BTreeMap<String, BuildingTexture> = BTreeMap::new();
        let mut photos: BTreeMap<&str, BTreeMap<usize, usize>> = BTreeMap::new();
        for (surface, texture) in scene.surfaces.iter().zip(&textures.surfaces) {
            let id = scene.records[surface.building].id.as_str();
            let building = buildings.entry(id.to_owned()).or_default();
            building.areas.add(&texture.areas);
            building.tile = scene.city.tile(surface.building).map(str::to_owned);
            if let Some(photo) = texture.photo {
                *photos.entry(id).or_default().entry(photo).or_default() += 1;
            }
        }
        for (id, counts) in photos {
            let mut counts: Vec<(usize, usize)> = counts.into_iter().collect();
            counts.sort_by_key(|&(view, n)| (std::cmp::Reverse(n), view));
            let names = counts.into_iter().map(|(view, _)| scene.survey.views[view].id.0.clone());
            if let Some(building) = buildings.get_mut(id) {
                building.photos = names.collect();
            }
        }
        Self {
            texel_m: textures.texel_m,
            n_pages: textures.pages.len(),
            n_bytes: textures.pages.iter().map(Page::n_bytes).sum(),
            roofs: textures.areas(&scene.surfaces, SurfaceKind::Roof),
            walls: textures.areas(&scene.surfaces, SurfaceKind::Wall),
            buildings,
        }
    }
}

/// Textures of a run's city, where they are asked for.
pub(in crate::pipeline) fn of_run(
    output: &OutputSettings<'_>,
    records: &[BuildingRecord],
    survey: &Survey,
    stage: &SceneStage,
) -> Result<Option<(TextureScene, Textures)>, PipelineError> {
    let config = output.config;
    if !config.textures.enabled {
        return Ok(None);
    }
    let scene = TextureScene::new(config, records, survey, stage)?;
    let textures = scene.bake(&survey.views, config.textures.texel_m, Choice::Agreeing, output.folder.path())?;
    Ok(Some((scene, textures)))
}

/// The textured buildings of a tile.
pub struct PaintedTile {
    scene: TextureScene,
    textures: Textures,
}

impl PaintedTile {
    /// Textures of a tile's own buildings and of the ground in its core; the others hide what is behind them.
    pub(in crate::pipeline) fn new(
        output: &OutputConfig,
        records: (&[BuildingRecord], &[BuildingRecord]),
        core: &MapBox,
        survey: &Survey,
        stage: &SceneStage,
        scratch: &Path,
    ) -> Result<Self, PipelineError> {
        let scene = TextureScene::beside(output, records, Some(*core), survey, stage)?;
        let textures = scene.bake(&survey.views, output.textures.texel_m, Choice::Agreeing, scratch)?;
        Ok(Self { scene, textures })
    }

    /// Notes on photos and surfaces.
    #[must_use]
    pub fn issues(&self) -> &[Issue] {
        &self.textures.issues
    }

    /// Writes the folder of the textured tile.
    ///
    /// # Errors
    /// [`OutputError`]: the file system.
    pub fn write(&self, folder: &Path, model: &CityModel<'_>, config: &CityJsonConfig) -> Result<(), OutputError> {
        write_scene(folder, model, config, &self.scene, &self.textures).map(drop)
    }
}

/// Writes the textured city beside the results, or removes that of an earlier run.
pub(in crate::pipeline) fn write_or_remove(
    output: &OutputSettings<'_>,
    model: &CityModel<'_>,
    painted: Option<&(TextureScene, Textures)>,
) -> Result<(), PipelineError> {
    match painted {
        Some((scene, textures)) => {
            let folder = output.folder.path().join(textured::FOLDER);
            Ok(write_scene(&folder, model, &CityJsonConfig::default(), scene, textures).map(drop)?)
        }
        None => Ok(textured::remove(&output.folder.path().join(textured::FOLDER))?),
    }
}

/// Writes the folder of a textured city.
fn write_scene(
    folder: &Path,
    model: &CityModel<'_>,
    config: &CityJsonConfig,
    scene: &TextureScene,
    textures: &Textures,
) -> Result<TextureSummary, OutputError> {
    let summary = TextureSummary::of(scene, textures);
    let ground = scene.ground_picture(textures.texel_m);
    let painted = PaintedCity { city: &scene.city, textures, ground: ground.as_ref() };
    textured::write(folder, model, config, &painted, &summary)?;
    Ok(summary)
}

/// Result of texturing a finished result.
#[derive(Debug)]
pub struct Texturing {
    /// Numbers of the textured city, as in its `textures.json`.
    pub summary: TextureSummary,
    /// Notes on photos and surfaces.
    pub issues: Vec<Issue>,
    /// The folder of the textured city and the report, where there is one: all that was written.
    pub written: Vec<PathBuf>,
}

/// Textures a finished result from its photos: writes `textured/` beside it, and the textures into its report.
///
/// # Errors
/// [`PipelineError`]: no finished run in the output folder, one made from other input or settings, or the file system.
pub fn texture(settings: &RunSettings<'_>) -> Result<Texturing, PipelineError> {
    let (output, scene) = (&settings.output, TextureScene::of_result(settings)?);
    let path = output.folder.path().join("lineage.json");
    let text = fs::read(&path).map_err(FileError::on("cannot read", &path))?;
    let lineage: Lineage = serde_json::from_slice(&text).map_err(|e| PipelineError::Artefact {
        path,
        message: e.to_string(),
        stage: Stage::Output.name(),
    })?;
    let texel_m = output.config.textures.texel_m;
    let textures = scene.bake(&scene.survey.views, texel_m, Choice::Agreeing, output.folder.path())?;
    let model = CityModel {
        records: scene.records.as_slice(),
        crs: settings.survey.crs,
        lineage: &lineage,
        issues: &[],
        survey: &scene.survey,
    };
    let folder = output.folder.path().join(textured::FOLDER);
    let summary = write_scene(&folder, &model, &CityJsonConfig::default(), &scene, &textures)?;
    let mut written = vec![folder];
    let page = output.folder.join("report.html");
    if report::retexture(&page, model.records, TexturedCity::of_result(output.folder.path())?.as_ref())? {
        written.push(page);
    }
    Ok(Texturing { summary, issues: textures.issues, written })
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;

    #[test]
    fn ground_that_no_photo_shows_is_left_out_at_the_edge_and_filled_between_houses() {
        // Cells of two pixels: those of the western column, one beside it and one in the middle are hidden.
        let is_hidden = |x: u32, y: u32| x < 2 || (x < 4 && y < 2) || ((6..8).contains(&x) && (4..6).contains(&y));
        let shown = GrayImage::from_fn(10, 10, |x, y| Luma([if is_hidden(x, y) { 0 } else { 255 }]));
        assert_eq!(cells_without(&shown, [6, 6]), [0, 1, 5, 10, 15, 20]);
        // A pixel of a cell is enough.
        let one = GrayImage::from_fn(10, 10, |x, y| Luma([if is_hidden(x, y) && (x, y) != (1, 9) { 0 } else { 255 }]));
        assert_eq!(cells_without(&one, [6, 6]), [0, 1, 5, 10, 15]);
    }
}
