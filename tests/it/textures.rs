//! Textures of a small town of boxes whose colours are known, in photos traced here by code of its own.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::OpenOptions;
use std::path::Path;
use std::sync::Arc;

use geo::polygon;
use glam::{DVec2, DVec3};
use image::imageops::FilterType;
use image::{Rgb, RgbImage};
use serde_json::{Value, json};
use sizeup::camera::Camera;
use sizeup::crs::Crs;
use sizeup::frames::{LocalOrigin, Rigid};
use sizeup::output::cityjson::{self, CityJsonConfig};
use sizeup::output::textured::{self, CitySurfaces, PaintedCity, TexturedCity, TexturedGround};
use sizeup::output::tiles3d::{self, Heights, Precision, Tiles3dConfig};
use sizeup::output::{BuildingRecord, CityModel, Lineage, mesh};
use sizeup::report::{self, Report};
use sizeup::scene::LocalGround;
use sizeup::survey::{Survey, View};
use sizeup::terrain::Terrain;
use sizeup::textures::{Choice, Surface, SurfaceKind, SurfaceTexture, TextureTask, Textures, bake};

use crate::consumers::{is_valid_tileset, triangles_of_valid_gltf};
use crate::outputs::assert_valid_cityjson;
use crate::report::{browse, plain_report};
use crate::tiles3d::Glb;
use crate::tiny_scene::Scene;
use crate::tools::picture;

/// Where the town lies, and its ground.
const AT: DVec3 = DVec3::new(565_000.0, 5_934_000.0, 30.0);
const GROUND: [u8; 3] = [90, 90, 90];
const ROOF: [u8; 3] = [170, 60, 40];
/// Walls to the west, east, south and north.
const WALLS: [[u8; 3]; 4] = [[210, 190, 120], [120, 150, 200], [200, 120, 160], [110, 170, 120]];
const LEAVES: [u8; 3] = [20, 90, 20];

/// Side of a texel.
const TEXEL_M: f64 = 0.2;

/// A box along the axes, relative to `AT`, with the colours of its walls and of its top.
#[derive(Clone, Copy)]
struct Block {
    low: DVec3,
    high: DVec3,
    walls: [[u8; 3]; 4],
    top: [u8; 3],
}

const fn house(west: f64, south: f64, east: f64, north: f64, height: f64) -> Block {
    Block { low: DVec3::new(west, south, 0.0), high: DVec3::new(east, north, height), walls: WALLS, top: ROOF }
}

/// A house, a lower one against its eastern wall, and a tower south of it.
const HOUSE: Block = house(0.0, 0.0, 20.0, 10.0, 12.0);
const ANNEX: Block = house(20.0, 0.0, 30.0, 10.0, 7.0);
const TOWER: Block = house(2.0, -30.0, 18.0, -18.0, 30.0);
const IDS: [&str; 3] = ["house", "annex", "tower"];

/// Colour that a ray meets first.
fn colour(blocks: &[Block], eye: DVec3, direction: DVec3) -> [u8; 3] {
    let ground = (-eye.z / direction.z, GROUND);
    let met = blocks.iter().filter_map(|block| {
        let (a, b) = ((block.low - eye) / direction, (block.high - eye) / direction);
        let (near, far) = (a.min(b), a.max(b));
        let (t, leaves) = (near.max_element(), far.min_element());
        let axis = near.max_position();
        let side = if axis == 2 { block.top } else { block.walls[2 * axis + usize::from(direction[axis] < 0.0)] };
        (t > 0.0 && t < leaves).then_some((t, side))
    });
    met.fold(ground, |nearest, hit| if hit.0 < nearest.0 { hit } else { nearest }).1
}

/// A flight of eight oblique photos around the town and one from above.
fn views() -> Vec<View> {
    let camera = Arc::new(Camera::pinhole(640, 480, 560.0));
    let around = (0..8).map(|i| (f64::from(i) * std::f64::consts::FRAC_PI_4, 75.0)).chain([(0.0, 1.0)]);
    around
        .enumerate()
        .map(|(i, (angle, away_m))| {
            let target = AT + DVec3::new(12.0, -5.0, 5.0);
            let eye = target + DVec3::new(away_m * angle.cos(), away_m * angle.sin(), 75.0);
            View {
                id: format!("{i}.jpg").as_str().into(),
                camera: camera.clone(),
                camera_from_map: Rigid::looking_at(eye, target),
                image: Some(format!("{i}.jpg").into()),
            }
        })
        .collect()
}

fn photo(view: &View, blocks: &[Block]) -> RgbImage {
    let (eye, to_map) = (view.centre() - AT, view.camera_from_map.rotation.transpose());
    RgbImage::from_fn(view.camera.width_px, view.camera.height_px, |x, y| {
        let ray = view.camera.unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
        Rgb(colour(blocks, eye, to_map * ray))
    })
}

fn records() -> Vec<BuildingRecord> {
    let record = |(id, block): (&str, &Block)| {
        let (a, b) = (AT + block.low, AT + block.high);
        let footprint = polygon![(x: a.x, y: a.y), (x: b.x, y: a.y), (x: b.x, y: b.y), (x: a.x, y: b.y)];
        BuildingRecord::measured(id, footprint, AT.z, block.high.z)
    };
    IDS.into_iter().zip(&[HOUSE, ANNEX, TOWER]).map(record).collect()
}

/// A town and its textures.
struct Painted {
    records: Vec<BuildingRecord>,
    city: CitySurfaces,
    textures: Textures,
}

impl Painted {
    /// Bakes the town; `shows` are the blocks in each photo.
    fn new(
        records: Vec<BuildingRecord>,
        shows: &(dyn Fn(&View) -> Result<RgbImage, String> + Sync),
        choice: Choice,
    ) -> Self {
        let city = CitySurfaces::of(&records).unwrap();
        let views = views();
        let ground = Terrain::Constant(AT.z);
        let reach = DVec2::splat(500.0);
        let textures = bake(&TextureTask {
            surfaces: &city.surfaces,
            occluders: &[],
            ground: LocalGround::new(&ground, LocalOrigin(AT), AT.truncate() - reach, AT.truncate() + reach),
            origin: LocalOrigin(AT),
            views: &views,
            decode: shows,
            texel_m: Some(TEXEL_M),
            choice,
            groups: &city.tile_of,
            scratch: &std::env::temp_dir(),
        })
        .unwrap();
        Self { records, city, textures }
    }

    fn plain() -> Self {
        Self::new(records(), &|view| Ok(photo(view, &[HOUSE, ANNEX, TOWER])), Choice::Agreeing)
    }

    /// The wall of a building that looks along a direction.
    fn wall(&self, building: usize, outwards: DVec3) -> (&Surface, &SurfaceTexture) {
        let looks = |s: &Surface| (s.rings[0][1] - s.rings[0][0]).cross(s.rings[0][2] - s.rings[0][1]).normalize();
        let is_it = |s: &Surface| s.building == building && s.kind == SurfaceKind::Wall && looks(s).dot(outwards) > 0.9;
        let i = self.city.surfaces.iter().position(is_it).unwrap();
        (&self.city.surfaces[i], &self.textures.surfaces[i])
    }

    /// Colour of a wall: shares along it (from its left end, seen from outside) and of its height.
    fn colour_at(&self, texture: &SurfaceTexture, along: f64, up: f64) -> [u8; 3] {
        let corners = &texture.uv[0];
        let at = corners[0] + along * (corners[1] - corners[0]) + up * (corners[3] - corners[0]);
        let page = image::load_from_memory(&self.textures.jpeg(texture.page.unwrap()).unwrap()).unwrap().into_rgb8();
        let pixel = at * DVec2::new(f64::from(page.width()), f64::from(page.height()));
        page.get_pixel(pixel.x as u32, pixel.y as u32).0
    }

    fn model<'a>(&'a self, crs: &'a Crs, lineage: &'a Lineage, survey: &'a Survey) -> CityModel<'a> {
        CityModel { records: &self.records, crs, lineage, issues: &[], survey }
    }
}

/// Within what JPEG and a pixel of the photo mix.
fn is_near(a: [u8; 3], b: [u8; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 12)
}

const SIDES: [(DVec3, usize); 4] = [(DVec3::NEG_X, 0), (DVec3::X, 1), (DVec3::NEG_Y, 2), (DVec3::Y, 3)];

#[test]
fn every_wall_has_its_colour_and_a_roof_has_no_wall_in_it() {
    let town = Painted::plain();
    for (building, (side, colour)) in (0..3).flat_map(|b| SIDES.map(|side| (b, side))) {
        let (_, texture) = town.wall(building, side);
        if texture.page.is_none() {
            continue; // against a neighbour: another test
        }
        for (along, up) in [(0.5, 0.9), (0.1, 0.8), (0.9, 0.97), (0.5, 0.7)] {
            let found = town.colour_at(texture, along, up);
            assert!(is_near(found, WALLS[colour]), "{} {side}: {found:?} at {along} {up}", IDS[building]);
        }
    }
    let roofs = town.textures.areas(&town.city.surfaces, SurfaceKind::Roof);
    assert!(roofs.seen_share().unwrap() > 0.98, "{roofs:?}");
    for (surface, texture) in town.city.surfaces.iter().zip(&town.textures.surfaces) {
        if surface.kind == SurfaceKind::Roof {
            for (along, up) in [(0.5, 0.5), (0.05, 0.05), (0.95, 0.9)] {
                assert!(is_near(town.colour_at(texture, along, up), ROOF), "{along} {up}");
            }
        }
    }
}

#[test]
fn a_wall_behind_a_tower_is_painted_from_the_side_and_by_no_photo_that_shows_the_tower() {
    let town = Painted::plain();
    // Photo 6 looks from the south, over the tower: it would be the best one of the southern wall.
    let south = |painted: &Painted| painted.wall(0, DVec3::NEG_Y).1.clone();
    let best = Painted::new(records(), &|view| Ok(photo(view, &[HOUSE, ANNEX, TOWER])), Choice::BestPerSurface);
    assert_eq!(south(&best).photo, Some(6));
    let texture = south(&town);
    assert!(matches!(texture.photo, Some(5 | 7)), "{:?}", texture.photo);
    assert!(is_near(town.colour_at(&texture, 0.5, 0.5), WALLS[2]));
}

#[test]
fn walls_against_a_neighbour_are_bare_and_counted_as_such() {
    let town = Painted::plain();
    let (_, annex) = town.wall(1, DVec3::NEG_X);
    assert_eq!((annex.page, annex.photo), (None, None));
    assert!((annex.areas.party_m2 - 70.0).abs() < 2.0 && annex.areas.plain_m2 == 0.0, "{:?}", annex.areas);
    // The house is 5 m higher than the annex: that part is seen.
    let (_, house) = town.wall(0, DVec3::X);
    assert!((house.areas.party_m2 - 70.0).abs() < 3.0, "{:?}", house.areas);
    assert!(house.page.is_some() && house.areas.seen_m2 > 40.0, "{:?}", house.areas);
    assert!(is_near(town.colour_at(house, 0.5, 0.8), WALLS[1]));
}

#[test]
fn what_stands_in_front_in_one_photo_is_not_painted_on_the_wall() {
    // A lorry north of the house, in the photo that looks straight at its northern wall and in no other.
    let lorry = Block { walls: [LEAVES; 4], top: LEAVES, ..house(8.0, 12.0, 12.0, 13.0, 6.0) };
    let shows = |view: &View| {
        let blocks = [HOUSE, ANNEX, TOWER, lorry];
        Ok(photo(view, if view.id.0 == "2.jpg" { &blocks } else { &blocks[..3] }))
    };
    let at = |town: &Painted| town.colour_at(town.wall(0, DVec3::Y).1, 0.5, 0.25);
    let plain = Painted::new(records(), &shows, Choice::BestPerSurface);
    assert!(is_near(at(&plain), LEAVES), "the plain method paints it: {:?}", at(&plain));
    let town = Painted::new(records(), &shows, Choice::Agreeing);
    assert!(is_near(at(&town), WALLS[3]), "{:?}", at(&town));
}

#[test]
fn a_wall_that_is_modelled_too_high_takes_no_colour_of_the_roof() {
    // 0.6 m too high, and said to be within 0.6 m.
    let mut records = records();
    records[0].height_m = Some(12.6);
    records[0].roof_sigma_m = Some(0.6);
    let shows = |view: &View| Ok(photo(view, &[HOUSE, ANNEX, TOWER]));
    let at = |town: &Painted| town.colour_at(town.wall(0, DVec3::Y).1, 0.5, 0.98);
    let plain = Painted::new(records.clone(), &shows, Choice::BestPerSurface);
    assert!(is_near(at(&plain), ROOF), "the plain method takes it: {:?}", at(&plain));
    let town = Painted::new(records, &shows, Choice::Agreeing);
    assert!(is_near(at(&town), WALLS[3]), "{:?}", at(&town));
}

#[test]
fn a_photo_of_another_exposure_leaves_no_darker_walls() {
    let shows = |view: &View| {
        let mut photo = photo(view, &[HOUSE, ANNEX, TOWER]);
        if view.id.0 == "2.jpg" {
            photo.pixels_mut().for_each(|p| p.0 = p.0.map(|v| (f32::from(v) * 0.7) as u8));
        }
        Ok(photo)
    };
    let town = Painted::new(records(), &shows, Choice::Agreeing);
    // All photos become a little darker together, none much.
    let found = town.colour_at(town.wall(0, DVec3::Y).1, 0.5, 0.8).map(f32::from);
    let share = found.iter().zip(WALLS[3]).map(|(a, b)| a / f32::from(b)).sum::<f32>() / 3.0;
    assert!(share > 0.9 && share < 1.02, "{share}");
}

#[test]
fn a_photo_that_is_missing_is_named_and_others_paint_its_walls() {
    let shows = |view: &View| match view.id.0.as_str() {
        "2.jpg" => Err("2.jpg: no such file".to_owned()),
        _ => Ok(photo(view, &[HOUSE, ANNEX, TOWER])),
    };
    let town = Painted::new(records(), &shows, Choice::Agreeing);
    let issue = town.textures.issues.iter().find(|issue| issue.code == "photo_unreadable").unwrap();
    assert!(issue.subject.name() == "2.jpg" && issue.message.contains("no such file"), "{issue:?}");
    let (_, north) = town.wall(0, DVec3::Y);
    assert!(north.photo.is_some_and(|photo| photo != 2));
    let none = Painted::new(records(), &|_| Err("gone".to_owned()), Choice::Agreeing);
    let issue = none.textures.issues.iter().find(|issue| issue.code == "surfaces_without_photo").unwrap();
    assert!(issue.message.starts_with("no photo shows 14 of 14"), "{issue:?}");
    assert!(none.textures.pages.is_empty());
}

#[test]
fn a_photo_that_was_turned_is_named_and_paints_nothing() {
    // The one that looks straight at the northern walls.
    let shows = |view: &View| {
        let photo = photo(view, &[HOUSE, ANNEX, TOWER]);
        Ok(if view.id.0 == "2.jpg" { image::imageops::rotate180(&photo) } else { photo })
    };
    let town = Painted::new(records(), &shows, Choice::Agreeing);
    let named: Vec<&str> =
        town.textures.issues.iter().filter(|i| i.code == "photo_disagrees").map(|i| i.subject.name()).collect();
    assert_eq!(named, ["2.jpg"]);
    assert!(town.textures.surfaces.iter().all(|texture| texture.photo != Some(2)));
    assert!(is_near(town.colour_at(town.wall(0, DVec3::Y).1, 0.5, 0.5), WALLS[3]));
}

#[test]
fn the_bytes_are_the_same_on_one_thread_and_on_several() {
    let on = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(Painted::plain).textures
    };
    let (one, several) = (on(1), on(3));
    assert_eq!(one.pages, several.pages);
    assert!((0..one.pages.len()).all(|page| one.jpeg(page).unwrap() == several.jpeg(page).unwrap()));
    assert_eq!(one.surfaces, several.surfaces);
}

fn write(folder: &Path, town: &Painted) {
    write_on(folder, town, RgbImage::from_pixel(8, 8, Rgb(GROUND)));
}

/// The same with a picture of the ground; no photo shows the western half of it.
fn write_on(folder: &Path, town: &Painted, picture: RgbImage) {
    let crs = Crs::parse("EPSG:25832").unwrap();
    let lineage = Lineage { crs: "EPSG:25832".to_owned(), ..Lineage::default() };
    let survey = Survey::default();
    let model = town.model(&crs, &lineage, &survey);
    let ground = TexturedGround {
        hidden_cells: if picture.width() > 8 { vec![0] } else { Vec::new() },
        picture,
        bounds_m: [AT.x - 10.0, AT.y - 40.0, AT.x + 40.0, AT.y + 20.0],
        n_nodes: [3, 2],
        heights_m: vec![AT.z; 6],
        photos: vec!["8.jpg".to_owned()],
    };
    let painted = PaintedCity { city: &town.city, textures: &town.textures, ground: Some(&ground) };
    let tile_of = |(i, id): (usize, &&str)| ((*id).to_owned(), json!({ "tile": town.city.tile(i) }));
    let buildings: serde_json::Map<String, Value> = IDS.iter().enumerate().map(tile_of).collect();
    let summary = json!({ "texel_m": TEXEL_M, "buildings": buildings });
    textured::write(folder, &model, &CityJsonConfig::default(), &painted, &summary).unwrap();
}

#[test]
fn the_written_cityjson_is_valid_and_its_textures_are_where_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("textured");
    let town = Painted::plain();
    write(&path, &town);
    assert_valid_cityjson(&path.join("city.city.json"));
    let city: Value = serde_json::from_slice(&std::fs::read(path.join("city.city.json")).unwrap()).unwrap();
    let appearance = &city["appearance"];
    let picture = appearance["textures"][0]["image"].as_str().unwrap();
    let page = image::open(path.join(picture)).unwrap().into_rgb8();
    let geometry = &city["CityObjects"]["house"]["geometry"][0];
    let (faces, textures) = (&geometry["boundaries"][0], &geometry["texture"]["photos"]["values"][0]);
    assert_eq!(faces.as_array().unwrap().len(), textures.as_array().unwrap().len());
    // The northern wall, by its vertices; a place in its middle has its colour in the picture.
    let scale = city["transform"]["scale"][1].as_f64().unwrap();
    let north = |corner: &Value| {
        let vertex = &city["vertices"][corner.as_u64().unwrap() as usize];
        vertex[1].as_f64().unwrap() * scale + city["transform"]["translate"][1].as_f64().unwrap() - AT.y
    };
    let is_northern =
        |face: &Value| face[0].as_array().unwrap().iter().all(|corner| (north(corner) - 10.0).abs() < 0.01);
    let at = faces.as_array().unwrap().iter().position(is_northern).unwrap();
    let ring = textures[at][0].as_array().unwrap();
    assert_eq!((ring.len(), &ring[0]), (5, &0.into()));
    let uv =
        |i: &Value, axis: usize| appearance["vertices-texture"][i.as_u64().unwrap() as usize][axis].as_f64().unwrap();
    let middle = [0, 1].map(|axis| ring[1..].iter().map(|i| uv(i, axis)).sum::<f64>() / 4.0);
    let pixel = page
        .get_pixel((middle[0] * f64::from(page.width())) as u32, ((1.0 - middle[1]) * f64::from(page.height())) as u32);
    assert!(is_near(pixel.0, WALLS[3]), "{pixel:?}");
    // The floor has none.
    assert!(textures[0][0][0].is_null());
}

#[test]
fn the_written_glb_has_a_node_per_building_and_the_validator_finds_nothing_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("textured");
    write(&path, &Painted::plain());
    let bytes = std::fs::read(path.join("city.glb")).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let nodes: BTreeMap<&str, &Value> =
        json["nodes"].as_array().unwrap().iter().map(|node| (node["name"].as_str().unwrap(), node)).collect();
    assert_eq!(nodes.keys().copied().collect::<Vec<_>>(), ["annex", "city", "ground", "house", "tower"]);
    assert_eq!(nodes["house"]["extras"]["height_m"], 12.0);
    assert_eq!(nodes["city"]["extras"]["origin_up_m"], AT.z);
    // y is up: from the ground to the roof.
    let mesh = &json["meshes"][nodes["tower"]["mesh"].as_u64().unwrap() as usize];
    let top = mesh["primitives"].as_array().unwrap().iter().map(|primitive| {
        let position = primitive["attributes"]["POSITION"].as_u64().unwrap() as usize;
        json["accessors"][position]["max"][1].as_f64().unwrap()
    });
    assert_eq!(top.fold(0.0, f64::max), 30.0);
    // Three boxes of twelve triangles, and four of the ground.
    if let Some(n_triangles) = triangles_of_valid_gltf(&[path.join("city.glb")]) {
        assert_eq!(n_triangles, 40);
    }
}

#[test]
fn a_city_without_photos_is_written_in_plain_colours() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("textured");
    write(&path, &Painted::new(records(), &|_| Err("gone".to_owned()), Choice::Agreeing));
    assert_valid_cityjson(&path.join("city.city.json"));
    assert!(!path.join("appearance/atlas-0.jpg").exists());
    let _ = triangles_of_valid_gltf(&[path.join("city.glb")]);
}

/// Writes a textured town and 3D Tiles of it.
fn write_tiles(folder: &Path, town: &Painted, precision: Precision) -> std::path::PathBuf {
    write(&folder.join("textured"), town);
    tiles_of_written(folder, town, precision)
}

fn tiles_of_written(folder: &Path, town: &Painted, precision: Precision) -> std::path::PathBuf {
    let (textured, tiles) = (folder.join("textured"), folder.join("tiles"));
    let city = TexturedCity::of_result(&textured).unwrap().unwrap();
    let crs = Crs::parse("EPSG:25832").unwrap();
    let lineage = Lineage { crs: "EPSG:25832".to_owned(), ..Lineage::default() };
    let survey = Survey::default();
    let config = Tiles3dConfig { precision, heights: Heights::GeoidHeight(40.0), ..Tiles3dConfig::default() };
    tiles3d::write_textured(&tiles, &town.model(&crs, &lineage, &survey), &config, Some(&city)).unwrap();
    tiles
}

/// Colours of a building's faces in a tile, by where they look (glTF's axes), in the middle of each triangle's face.
fn colours_in_tile(glb: &Glb, id: &str) -> Vec<(DVec3, [u8; 3])> {
    let feature = glb.column("id").iter().position(|of| of == id).unwrap() as f64;
    let mut found = Vec::new();
    for primitive in glb.json["meshes"][0]["primitives"].as_array().unwrap() {
        let [features, normals, places] =
            ["_FEATURE_ID_0", "NORMAL", "TEXCOORD_0"].map(|name| glb.accessor(&primitive["attributes"][name]));
        let indices = glb.accessor(&primitive["indices"]);
        let picture = glb.picture(primitive);
        for triangle in indices.chunks_exact(3).map(|t| [t[0][0], t[1][0], t[2][0]].map(|i| i as usize)) {
            if features[triangle[0]][0] == feature {
                let middle = [0, 1].map(|axis| triangle.iter().map(|i| places[*i][axis]).sum::<f64>() / 3.0);
                let [x, y] = [middle[0] * f64::from(picture.width()), middle[1] * f64::from(picture.height())];
                found.push((DVec3::from_slice(&normals[triangle[0]]), picture.get_pixel(x as u32, y as u32).0));
            }
        }
    }
    found
}

#[test]
fn tiles_of_a_textured_city_have_its_colours_its_features_and_its_ground() {
    let town = Painted::plain();
    for precision in [Precision::Float, Precision::Quantised] {
        let folder = tempfile::tempdir().unwrap();
        let tiles = write_tiles(folder.path(), &town, precision);
        let path = tiles.join("tiles/0/0_0.glb");
        let glb = Glb::read(&path);
        assert_eq!(glb.column("id"), IDS);
        assert_eq!(glb.json["nodes"][0]["name"], "0/0_0");
        for id in ["house", "tower"] {
            let colours = colours_in_tile(&glb, id);
            // East, south, north and up in glTF's axes; the projection turns them by less than a degree.
            let sides = [(DVec3::X, WALLS[1]), (DVec3::Z, WALLS[2]), (DVec3::NEG_Z, WALLS[3]), (DVec3::Y, ROOF)];
            for (side, expected) in sides {
                let seen: Vec<[u8; 3]> =
                    colours.iter().filter(|(normal, _)| normal.dot(side) > 0.99).map(|(_, colour)| *colour).collect();
                assert!(seen.len() == 2, "{id} {side}: {seen:?}");
                // The annex hides the lower part of the eastern wall of the house.
                let is_all = seen.iter().all(|colour| is_near(*colour, expected));
                assert!(is_all || (id == "house" && side == DVec3::X), "{id} {side}: {seen:?}");
            }
        }
        let ground = Glb::read(&tiles.join("tiles/ground.glb"));
        assert!(is_near(ground.colour(ground.primitive(), 0), GROUND));
        let _ = triangles_of_valid_gltf(&[path, tiles.join("tiles/ground.glb")]);
        is_valid_tileset(&tiles);
    }
}

#[test]
fn ground_with_a_large_picture_has_a_small_one_for_far_away_and_a_hole_where_no_photo_shows_it() {
    let (folder, town) = (tempfile::tempdir().unwrap(), Painted::plain());
    write_on(&folder.path().join("textured"), &town, RgbImage::from_pixel(1250, 1500, Rgb(GROUND)));
    let tiles = tiles_of_written(folder.path(), &town, Precision::Float);
    is_valid_tileset(&tiles);
    let tileset: Value = serde_json::from_slice(&std::fs::read(tiles.join("tileset.json")).unwrap()).unwrap();
    let far = &tileset["root"]["children"][1];
    assert_eq!((&far["content"]["uri"], &far["refine"]), (&json!("tiles/ground-far.glb"), &json!("REPLACE")));
    assert_eq!(far["children"][0]["content"]["uri"], "tiles/ground.glb");
    // 60 m on 512 pixels: one of them is 0.117 m.
    let error_m = far["geometricError"].as_f64().unwrap();
    assert!((error_m - 8.0 * 60.0 / 512.0).abs() < 0.01, "{error_m}");
    for name in ["ground-far.glb", "ground.glb"] {
        let path = tiles.join("tiles").join(name);
        let glb = Glb::read(&path);
        assert!(is_near(glb.colour(glb.primitive(), 0), GROUND));
        let triangles = triangles_of_valid_gltf(&[path]);
        assert!(triangles.is_none_or(|triangles| triangles == 2), "{name}: one cell of two: {triangles:?}");
    }
    // The viewer shows the near one alone once it is there.
    let server = report::Server::bind(&tiles, &tiles, 0).unwrap();
    let address = server.address();
    std::thread::spawn(move || server.run());
    let out = picture("textures-far");
    std::fs::create_dir_all(&out).unwrap();
    let Some(said) = browse("textures.mjs", &address, &[out.to_str().unwrap()]) else { return };
    assert_eq!((&said["errors"], &said["grounds"]), (&json!([]), &json!([false, true])), "{said:#}");
    // The city fills nine tenths of the picture, one way or the other.
    let reach: [f64; 2] = serde_json::from_value(said["reach"].clone()).unwrap();
    assert!((reach[0].max(reach[1]) - 0.9).abs() < 0.01, "{reach:?}");
}

/// Writes a textured town whose picture is larger than it needs to be, as if its texels were smaller; their side, metres.
fn write_large(folder: &Path, town: &Painted) -> f64 {
    write(folder, town);
    let atlas = folder.join("appearance/atlas-0.jpg");
    let picture = image::open(&atlas).unwrap();
    let scale = 1100_u32.div_ceil(picture.width());
    picture.resize(scale * picture.width(), scale * picture.height(), FilterType::Nearest).save(&atlas).unwrap();
    let summary = folder.join("textures.json");
    let mut numbers: Value = serde_json::from_slice(&std::fs::read(&summary).unwrap()).unwrap();
    numbers["texel_m"] = json!(TEXEL_M / f64::from(scale));
    std::fs::write(&summary, numbers.to_string()).unwrap();
    TEXEL_M / f64::from(scale)
}

#[test]
fn buildings_with_large_pictures_have_small_ones_for_far_away_which_the_viewer_replaces_as_it_comes_closer() {
    let (folder, town) = (tempfile::tempdir().unwrap(), Painted::plain());
    let texel_m = write_large(&folder.path().join("textured"), &town);
    let tiles = tiles_of_written(folder.path(), &town, Precision::Float);
    is_valid_tileset(&tiles);
    let tileset: Value = serde_json::from_slice(&std::fs::read(tiles.join("tileset.json")).unwrap()).unwrap();
    let far = &tileset["root"]["children"][0]["children"][0];
    assert_eq!(
        (&far["content"]["uri"], &far["refine"]),
        (&json!("tiles/0/0_0-far.glb"), &json!("REPLACE")),
        "{tileset:#}"
    );
    assert_eq!(far["children"][0]["content"]["uri"], "tiles/0/0_0.glb");
    let [far_glb, near_glb] = ["0/0_0-far", "0/0_0"].map(|name| Glb::read(&tiles.join(format!("tiles/{name}.glb"))));
    let primitives = |glb: &Glb| glb.json["meshes"][0]["primitives"].as_array().unwrap().clone();
    let widest = |glb: &Glb| primitives(glb).iter().map(|primitive| glb.picture(primitive).width()).max().unwrap();
    let widths = [&far_glb, &near_glb].map(widest);
    assert!(widths[0] <= 512 && widths[1] > 1024, "{widths:?}");
    // Viewers go on to the near one where two pixels of theirs are one of it: 16 of error.
    let error_m = far["geometricError"].as_f64().unwrap();
    assert!((error_m - 8.0 * texel_m * f64::from(widths[1]) / f64::from(widths[0])).abs() < 0.001, "{error_m}");
    for glb in [&far_glb, &near_glb] {
        assert_eq!(glb.column("id"), IDS);
        let colours = colours_in_tile(glb, "tower");
        assert!(colours.iter().any(|(normal, colour)| normal.dot(DVec3::NEG_Z) > 0.99 && is_near(*colour, WALLS[3])));
    }
    let _ = triangles_of_valid_gltf(&["0/0_0-far", "0/0_0"].map(|name| tiles.join(format!("tiles/{name}.glb"))));
    let server = report::Server::bind(&tiles, &tiles, 0).unwrap();
    let address = server.address();
    std::thread::spawn(move || server.run());
    let Some(said) = browse("levels.mjs", &address, &[]) else { return };
    assert_eq!(said["errors"], json!([]));
    // Of three buildings each is there once, with the one picture or the other.
    for (when, expected) in [("far", ["0/0_0-far"].as_slice()), ("near", &["0/0_0"]), ("again", &["0/0_0-far"])] {
        assert_eq!((&said[when]["drawn"], &said[when]["buildings"]), (&json!(expected), &json!(3)), "{when}: {said:#}");
    }
}

#[test]
fn a_report_of_a_city_with_too_many_pictures_has_the_small_ones() {
    let (folder, town) = (tempfile::tempdir().unwrap(), Painted::plain());
    let textured = folder.path().join("textured");
    let _ = write_large(&textured, &town);
    let atlas = textured.join("appearance/atlas-0.jpg");
    let near = std::fs::read(&atlas).unwrap().len();
    // What follows the end of a JPEG is not read.
    OpenOptions::new().write(true).open(&atlas).unwrap().set_len(31_000_000).unwrap();
    let city = TexturedCity::of_result(folder.path()).unwrap();
    let crs = Crs::parse("EPSG:25832").unwrap();
    let (lineage, survey) = (Lineage::default(), Survey::default());
    let of_town = crate::outputs::town();
    let terrain = Terrain::Constant(AT.z);
    let report = Report {
        model: town.model(&crs, &lineage, &survey),
        terrain: &terrain,
        views: Vec::new(),
        textured: city.as_ref(),
        ..plain_report(&of_town)
    };
    let page = folder.path().join("report.html");
    report::write(&page, &report).unwrap();
    let text = std::fs::read_to_string(&page).unwrap();
    let (_, block) = text.split_once("id=\"textured\">").unwrap();
    let data: Value = serde_json::from_str(block.split_once("</script>").unwrap().0).unwrap();
    let buildings = data["buildings"].as_str().expect("textures in the report").len();
    assert!(buildings > 1000 && buildings < near, "{buildings} of {near}");
    looks_right(&format!("file://{}", page.display()), "report-far");
}

#[test]
fn an_export_of_other_heights_has_the_textures_of_the_faces_that_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let mut town = Painted::plain();
    let textured = folder.path().join("textured");
    write(&textured, &town);
    town.records[2].height_m = Some(25.0);
    let tiles = folder.path().join("tiles");
    let city = TexturedCity::read(&textured).unwrap();
    let crs = Crs::parse("EPSG:25832").unwrap();
    let (lineage, survey) = (Lineage::default(), Survey::default());
    let config = Tiles3dConfig { heights: Heights::GeoidHeight(40.0), ..Tiles3dConfig::default() };
    tiles3d::write_textured(&tiles, &town.model(&crs, &lineage, &survey), &config, Some(&city)).unwrap();
    let glb = Glb::read(&tiles.join("tiles/0/0_0.glb"));
    // The tower has the colour of its height all over, the house its own.
    let tower: BTreeSet<[u8; 3]> = colours_in_tile(&glb, "tower").into_iter().map(|(_, colour)| colour).collect();
    assert_eq!(tower.len(), 1);
    assert!(colours_in_tile(&glb, "house").iter().any(|(_, colour)| is_near(*colour, WALLS[3])));
    let cut = textured.join("textures.json");
    std::fs::write(&cut, "{").unwrap();
    let refused = TexturedCity::read(&textured).unwrap_err().to_string();
    assert!(refused.contains("textures.json"), "{refused}");
}

#[test]
fn an_obj_of_a_textured_city_has_its_materials_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let town = Painted::plain();
    let textured = folder.path().join("textured");
    write(&textured, &town);
    let crs = Crs::parse("EPSG:25832").unwrap();
    let (lineage, survey) = (Lineage::default(), Survey::default());
    let path = folder.path().join("city.obj");
    let city = TexturedCity::read(&textured).unwrap();
    mesh::write_textured_obj(&path, &town.model(&crs, &lineage, &survey), &city).unwrap();
    let obj = std::fs::read_to_string(&path).unwrap();
    let mtl = std::fs::read_to_string(folder.path().join("city.mtl")).unwrap();
    assert!(obj.contains("mtllib city.mtl\n") && mtl.contains("map_Kd city-textures/atlas-0.jpg\n"), "{mtl}");
    let named: BTreeSet<&str> = obj.lines().filter_map(|line| line.strip_prefix("usemtl ")).collect();
    let made: BTreeSet<&str> = mtl.lines().filter_map(|line| line.strip_prefix("newmtl ")).collect();
    assert_eq!(named, made);
    // The northern wall of the house: two triangles whose places on the picture have its colour.
    let picture = image::open(folder.path().join("city-textures/atlas-0.jpg")).unwrap().into_rgb8();
    let numbers = |kind: &str| -> Vec<Vec<f64>> {
        let of = obj.lines().filter_map(|line| line.strip_prefix(kind));
        of.map(|line| line.split(' ').map(|v| v.parse().unwrap()).collect()).collect()
    };
    let (corners, places) = (numbers("v "), numbers("vt "));
    let mut n_northern = 0;
    for face in obj.lines().filter_map(|line| line.strip_prefix("f ")).filter(|face| face.contains('/')) {
        let pairs: Vec<[usize; 2]> = face
            .split(' ')
            .map(|p| p.split_once('/').unwrap())
            .map(|(v, t)| [v, t].map(|n| n.parse().unwrap()))
            .collect();
        if pairs.iter().all(|[v, _]| (corners[v - 1][1] - 40.0).abs() < 0.01 && corners[v - 1][0] < 20.01) {
            let middle = [0, 1].map(|axis| pairs.iter().map(|[_, t]| places[t - 1][axis]).sum::<f64>() / 3.0);
            let [x, y] = [middle[0] * f64::from(picture.width()), (1.0 - middle[1]) * f64::from(picture.height())];
            let colour = picture.get_pixel(x as u32, y as u32).0;
            assert!(is_near(colour, WALLS[3]), "{colour:?}");
            n_northern += 1;
        }
    }
    assert_eq!(n_northern, 2);
}

/// Looks at a page of the town in the three ways to colour it; pictures are left in the target folder's `tmp/pictures/textures-NAME`.
fn looks_right(address: &str, name: &str) {
    let out = picture(&format!("textures-{name}"));
    std::fs::create_dir_all(&out).unwrap();
    let Some(said) = browse("textures.mjs", address, &[out.to_str().unwrap()]) else { return };
    assert_eq!((&said["errors"], &said["first"]), (&json!([]), &json!("textures")), "{said:#}");
    let n_near = |way: &str, colour: [u8; 3]| {
        let picture = image::open(out.join(format!("{way}.png"))).unwrap().into_rgb8();
        picture.pixels().filter(|pixel| is_near(pixel.0, colour)).count()
    };
    // The picture looks to the north-east: it shows the walls to the west and to the south.
    assert!(n_near("textures", GROUND) > 500, "{name}: {}", n_near("textures", GROUND));
    for colour in [ROOF, WALLS[0], WALLS[2]] {
        assert!(n_near("textures", colour) > 500, "{name}: {colour:?} {}", n_near("textures", colour));
        assert!(n_near("height", colour) < 100 && n_near("status", colour) < 100, "{name}: {colour:?}");
    }
}

#[test]
fn the_report_and_the_viewer_show_textures_first_with_a_switch_to_heights_and_status() {
    let folder = tempfile::tempdir().unwrap();
    let town = Painted::plain();
    write(&folder.path().join("textured"), &town);
    let city = TexturedCity::of_result(folder.path()).unwrap();
    let crs = Crs::parse("EPSG:25832").unwrap();
    let lineage = Lineage { crs: "EPSG:25832".to_owned(), ..Lineage::default() };
    let survey = Survey::default();
    let model = town.model(&crs, &lineage, &survey);
    let page = folder.path().join("report.html");
    let of_town = crate::outputs::town();
    let terrain = Terrain::Constant(AT.z);
    let plain = plain_report(&of_town);
    report::write(&page, &Report { model, terrain: &terrain, views: Vec::new(), textured: city.as_ref(), ..plain })
        .unwrap();
    looks_right(&format!("file://{}", page.display()), "report");
    cityjson::write(&folder.path().join("city.city.json"), &model, &CityJsonConfig::default()).unwrap();
    let tiles = report::tileset_of(folder.path()).unwrap();
    assert_eq!(tiles, folder.path().join("stages/view"));
    let server = report::Server::bind(&tiles, folder.path(), 0).unwrap();
    let address = server.address();
    // It serves until the test ends.
    std::thread::spawn(move || server.run());
    looks_right(&address, "view");
}

#[test]
fn a_finished_result_is_textured_afterwards_as_within_the_run() {
    let scene = Scene::with_page();
    // The scene has no photos: every wall is plain, and said to be.
    let run = scene.run(&["--set", "output.textures.enabled=true"]);
    assert!(run.code == 0 || run.code == 5, "{}", run.stderr);
    assert_eq!(scene.issues("surfaces_without_photo").len(), 1);
    let within = std::fs::read(scene.path("result/textured/city.city.json")).unwrap();
    std::fs::remove_dir_all(scene.path("result/textured")).unwrap();
    let after = scene.sizeup(&["texture", "result"]);
    assert_eq!(after.code, 0, "{}", after.stderr);
    assert!(after.stderr.contains("no photo shows") && after.stderr.contains("hint: "), "{}", after.stderr);
    assert_eq!(std::fs::read(scene.path("result/textured/city.city.json")).unwrap(), within);
    let coarse = scene.sizeup(&["texture", "result", "--set", "output.textures.texel_m=0"]);
    assert!(coarse.code == 2 && coarse.stderr.contains("`texel_m` is 0: expected 0.01 to 10 m"), "{}", coarse.stderr);
    // Results that are written without textures do not keep those of an earlier run.
    let textured_page = std::fs::read_to_string(scene.path("result/report.html")).unwrap();
    let again = scene.run(&["--from", "output"]);
    assert!(again.code == 0 || again.code == 5, "{}", again.stderr);
    assert!(!scene.path("result/textured").exists());
    // Nor does the report; textured again it has the same as within the run, and is named.
    let page = || std::fs::read_to_string(scene.path("result/report.html")).unwrap();
    let textures = |page: &str| {
        let (_, block) = page.split_once("<script type=\"application/json\" id=\"textured\">").unwrap();
        block.split_once("</script>").unwrap().0.to_owned()
    };
    let plain_page = page();
    assert_eq!(textures(&plain_page), "null");
    let later = scene.sizeup(&["texture", "result"]);
    assert!(later.stderr.contains("result/textured, result/report.html"), "{}", later.stderr);
    assert!(textures(&page()).len() > 1000);
    assert_eq!(textures(&page()), textures(&textured_page));
    assert_eq!(page().replace(&textures(&page()), "null"), plain_page);
    std::fs::remove_file(scene.path("result/report.html")).unwrap();
    let without = scene.sizeup(&["texture", "result"]);
    assert!(
        !without.stderr.contains("report.html") && !scene.path("result/report.html").exists(),
        "{}",
        without.stderr
    );
    let nowhere = scene.sizeup(&["texture", "elsewhere"]);
    assert!(nowhere.code == 2 && nowhere.stderr.contains("elsewhere/config.toml"), "{}", nowhere.stderr);
}
