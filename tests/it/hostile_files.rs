//! Files that ask for more than they hold, lead elsewhere or are damaged: refused with a word, and cheaply.

use std::fs;
use std::io::{BufRead as _, BufReader, ErrorKind, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use gdal::DriverManager;
use gdal::raster::RasterCreationOptions;
use gdal::vector::LayerAccess as _;
use glam::{DMat3, DVec3};
use serde_json::json;
use sizeup::camera::Camera;
use sizeup::cloud;
use sizeup::crs::Crs;
use sizeup::frames::Rigid;
use sizeup::geodata::raster::{CellWindow, RasterFile, Resampling};
use sizeup::geodata::vector::VectorLayer;
use sizeup::onnx::Network;
use sizeup::output::read::{FoundBuildings, ReadOptions};
use sizeup::prior::{FilePriorConfig, FilePriors, PriorKind, PriorSource as _};
use sizeup::survey::View;
use sizeup::terrain::{self, MapBox, TerrainConfig};

use crate::shared_data::shared_data;
use crate::tiny_scene::{Outcome, Scene, sizeup};

/// No single file may keep anybody waiting for longer: what is refused is refused by its header.
const SOON: Duration = Duration::from_secs(5);

fn at_once<T>(what: &str, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let done = work();
    assert!(start.elapsed() < SOON, "{what} took {:?}", start.elapsed());
    done
}

fn view(name: &str, width_px: u32, height_px: u32) -> View {
    View {
        id: name.into(),
        camera: Arc::new(Camera::pinhole(width_px, height_px, 1000.0)),
        camera_from_map: Rigid::new(DMat3::IDENTITY, DVec3::ZERO),
        image: None,
    }
}

#[test]
fn a_header_of_las_that_claims_points_that_are_not_there_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("min.las");
    let mut bytes = vec![0_u8; 227];
    bytes[..4].copy_from_slice(b"LASF");
    (bytes[24], bytes[25]) = (1, 2);
    bytes[94..96].copy_from_slice(&227_u16.to_le_bytes());
    bytes[96..100].copy_from_slice(&227_u32.to_le_bytes());
    bytes[105..107].copy_from_slice(&20_u16.to_le_bytes());
    bytes[107..111].copy_from_slice(&u32::MAX.to_le_bytes());
    for scale in [131, 139, 147] {
        bytes[scale..scale + 8].copy_from_slice(&0.01_f64.to_le_bytes());
    }
    fs::write(&path, bytes).unwrap();
    let refused = at_once("the header", || cloud::read(&path)).unwrap_err().to_string();
    assert!(refused.contains("min.las") && refused.contains("hint: "), "{refused}");
}

#[test]
fn files_that_made_the_program_abort_are_refused() {
    let Some(folder) = shared_data("hostile") else { return };
    for name in ["min.las", "abort.laz"] {
        let refused = at_once(name, || cloud::read(&folder.join(name))).unwrap_err().to_string();
        assert!(refused.contains(name), "{refused}");
    }
    let refused = at_once("abort.onnx", || Network::open(&folder.join("abort.onnx"))).unwrap_err().to_string();
    assert!(refused.contains("no sound ONNX file"), "{refused}");
    let path = folder.join("sparse_36000x27000.tif").to_str().unwrap().to_owned();
    for photo in [view("a.jpg", 400, 300), view("a.jpg", 36_000, 27_000)] {
        let priors = FilePriors::new(FilePriorConfig::new(path.as_str(), PriorKind::Depth), [&photo.id]).unwrap();
        let refused = at_once("the sparse prior", || priors.load(&photo)).unwrap_err().to_string();
        assert!(refused.contains("sparse_36000x27000.tif"), "{refused}");
    }
}

/// A GeoTIFF without a single stored cell.
fn write_sparse(path: &Path, (width, height): (usize, usize), cell_m: f64, options: &[&str]) {
    let options = ["SPARSE_OK=TRUE", "BIGTIFF=YES"].iter().chain(options).copied().collect::<RasterCreationOptions>();
    let driver = DriverManager::get_driver_by_name("GTiff").unwrap();
    let mut dataset = driver.create_with_band_type_with_options::<f32, _>(path, width, height, 1, &options).unwrap();
    dataset.set_geo_transform(&[500_000.0, cell_m, 0.0, 5_700_000.0, 0.0, -cell_m]).unwrap();
    let crs = gdal::spatial_ref::SpatialRef::from_epsg(25832).unwrap();
    dataset.set_spatial_ref(&crs).unwrap();
    dataset.close().unwrap();
}

#[test]
fn a_prior_larger_than_its_photo_is_refused_before_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    write_sparse(&path, (36_000, 27_000), 1.0, &["BLOCKYSIZE=27000"]);
    let load = |photo: &View| {
        let template = folder.path().join("{stem}.tif").to_str().unwrap().to_owned();
        let priors = FilePriors::new(FilePriorConfig::new(template, PriorKind::Depth), [&photo.id]).unwrap();
        at_once("the prior", || priors.load(photo)).unwrap_err().to_string()
    };
    let refused = load(&view("a.jpg", 400, 300));
    assert!(refused.contains("a.tif") && refused.contains("four times the photo's pixels"), "{refused}");
    // A camera that claims as much: the file is too short to hold it.
    let refused = load(&view("a.jpg", 36_000, 27_000));
    assert!(refused.contains("nearly all of it is empty") && refused.contains("hint: "), "{refused}");
}

#[test]
fn a_terrain_model_of_nothing_is_refused_before_it_is_gone_through() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dtm.tif");
    write_sparse(&path, (200_000, 200_000), 0.05, &["TILED=YES", "BLOCKXSIZE=4096", "BLOCKYSIZE=4096"]);
    let crs = Crs::parse("EPSG:25832").unwrap();
    let area = MapBox { west_m: 500_100.0, south_m: 5_690_100.0, east_m: 509_900.0, north_m: 5_699_900.0 };
    let refused = at_once("the terrain", || terrain::load(&TerrainConfig::dtm(&path), &crs, area)).unwrap_err();
    assert!(refused.to_string().contains("dtm.tif") && refused.to_string().contains("hint: "), "{refused}");
}

/// A server that answers nothing, and whether anybody asked it.
struct Listener(TcpListener);

impl Listener {
    fn new() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        Self(listener)
    }

    fn url(&self) -> String {
        format!("http://127.0.0.1:{}/a", self.0.local_addr().unwrap().port())
    }

    fn assert_unasked(&self, what: &str) {
        let asked = self.0.accept();
        assert!(matches!(&asked, Err(e) if e.kind() == ErrorKind::WouldBlock), "{what} asked the server: {asked:?}");
    }
}

fn map_server(url: &str) -> String {
    format!(
        "<GDAL_WMS><Service name=\"TMS\"><ServerUrl>{url}/${{z}}/${{x}}/${{y}}.png</ServerUrl></Service><DataWindow>\
         <UpperLeftX>500000</UpperLeftX><UpperLeftY>5700000</UpperLeftY><LowerRightX>500100</LowerRightX>\
         <LowerRightY>5699900</LowerRightY><SizeX>100</SizeX><SizeY>100</SizeY><TileLevel>1</TileLevel></DataWindow>\
         <Projection>EPSG:25832</Projection><BandsCount>1</BandsCount></GDAL_WMS>"
    )
}

fn virtual_raster(source: &str) -> String {
    let source = source.replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;");
    format!(
        "<VRTDataset rasterXSize=\"9\" rasterYSize=\"9\"><GeoTransform>500000,1,0,5700000,0,-1</GeoTransform>\
         <VRTRasterBand dataType=\"Float32\" band=\"1\"><SimpleSource><SourceFilename relativeToVRT=\"0\">{source}\
         </SourceFilename><SourceBand>1</SourceBand><SrcRect xOff=\"0\" yOff=\"0\" xSize=\"9\" ySize=\"9\"/>\
         <DstRect xOff=\"0\" yOff=\"0\" xSize=\"9\" ySize=\"9\"/></SimpleSource></VRTRasterBand></VRTDataset>"
    )
}

#[test]
fn no_file_reaches_for_the_network() {
    let (folder, listener) = (tempfile::tempdir().unwrap(), Listener::new());
    let url = listener.url();
    let layers = |source: &str| {
        format!(
            "<OGRVRTDataSource><OGRVRTLayer name=\"a\"><SrcDataSource>{source}</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>"
        )
    };
    let written = |name: &str, text: String| -> PathBuf {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        path
    };
    let on_server = |system: &str, end: &str| format!("/vsi{system}/{url}{end}");
    let rasters = [
        written("dtm.tif", map_server(&url)),
        written("prior.png", map_server(&url)),
        written("vrt.tif", virtual_raster(&on_server("curl", ".tif"))),
        written("wms.xml", map_server(&url)),
        written("curl.vrt", virtual_raster(&on_server("curl", ".tif"))),
        written("stream.vrt", virtual_raster(&on_server("curl_streaming", ".tif"))),
        written("service.vrt", virtual_raster(&map_server(&url))),
        written("url.vrt", virtual_raster(&url)),
        PathBuf::from(on_server("curl", ".tif")),
        PathBuf::from(on_server("curl_streaming", ".tif")),
        PathBuf::from(format!("/vsizip//vsicurl/{url}.zip/a.tif")),
        PathBuf::from(&url),
    ];
    for path in rasters {
        let read = RasterFile::open(&path).and_then(|file| file.read(1));
        assert!(read.is_err(), "{}", path.display());
        listener.assert_unasked(&path.display().to_string());
    }
    let vectors = [
        written("a.gpkg", layers(&format!("{url}.geojson"))),
        written("a.geojson", layers(&on_server("curl", ".geojson"))),
        written("layers.vrt", layers(&format!("{url}.geojson"))),
        PathBuf::from(on_server("curl", ".gpkg")),
        PathBuf::from(format!("{url}.geojson")),
        PathBuf::from(format!("WFS:{url}")),
    ];
    for path in vectors {
        assert!(VectorLayer::open(&path, None).is_err(), "{}", path.display());
        listener.assert_unasked(&path.display().to_string());
    }
    let refused = RasterFile::open(Path::new(&on_server("curl", ".tif"))).unwrap_err().to_string();
    assert!(refused.contains("--allow-remote"), "{refused}");
}

#[test]
fn remote_input_is_asked_for_where_it_is_allowed() {
    let listener = Listener::new();
    let dtm = format!("/vsicurl/{}.tif", listener.url());
    let scene = Scene::new();
    scene.edit("sizeup.toml", |text| text.replace("dtm.tif", &dtm));
    let outcome = scene.run(&[]);
    assert_eq!(outcome.code, 3, "{}", outcome.stderr);
    assert!(outcome.stderr.contains("--allow-remote"), "{}", outcome.stderr);
    listener.assert_unasked("a run");
    // Somebody has to answer every time, or GDAL waits.
    let (is_over, n_asked) = (AtomicBool::new(false), AtomicUsize::new(0));
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                match listener.0.accept() {
                    Ok(_) => drop(n_asked.fetch_add(1, Ordering::Relaxed)),
                    Err(_) => std::thread::sleep(Duration::from_millis(10)),
                }
            }
        });
        let outcome = scene.run(&["--allow-remote"]);
        is_over.store(true, Ordering::Relaxed);
        assert_eq!(outcome.code, 3, "{}", outcome.stderr);
    });
    assert!(n_asked.into_inner() > 0, "nobody asked");
}

/// Serves the files of a folder on this machine, in whole or in ranges, until it is dropped.
struct FileServer {
    address: String,
    n_asked: Arc<AtomicUsize>,
    is_over: Arc<AtomicBool>,
}

impl FileServer {
    fn of(folder: PathBuf) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let address = format!("http://127.0.0.1:{}", listener.local_addr().unwrap().port());
        let (n_asked, is_over) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicBool::new(false)));
        let (count, over) = (Arc::clone(&n_asked), Arc::clone(&is_over));
        std::thread::spawn(move || {
            while !over.load(Ordering::Relaxed) {
                match listener.accept() {
                    Ok((stream, _)) => {
                        count.fetch_add(1, Ordering::Relaxed);
                        stream.set_nonblocking(false).unwrap();
                        // A client that has gone is its own affair.
                        let _ = answer(&stream, &folder);
                    }
                    Err(_) => std::thread::sleep(Duration::from_millis(1)),
                }
            }
        });
        Self { address, n_asked, is_over }
    }
}

impl Drop for FileServer {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}

fn answer(mut stream: &TcpStream, folder: &Path) -> std::io::Result<()> {
    let mut lines = BufReader::new(stream).lines();
    let first = lines.next().transpose()?.unwrap_or_default();
    let head: Vec<String> = lines.map_while(Result::ok).take_while(|line| !line.is_empty()).collect();
    let mut words = first.split(' ');
    let (method, target) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    let name = target.trim_start_matches('/').replace("%20", " ");
    let Ok(file) = fs::read(folder.join(name)) else {
        return stream.write_all(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
    };
    let range = head.iter().find_map(|line| line.to_ascii_lowercase().strip_prefix("range: bytes=").map(str::to_owned));
    let ends = range.and_then(|range| {
        let (first, last) = range.split_once('-')?;
        Some((first.parse::<usize>().ok()?, last.parse::<usize>().ok()?.min(file.len() - 1)))
    });
    let (status, part) = match ends {
        Some((first, last)) if first <= last => ("206 Partial Content", &file[first..=last]),
        _ => ("200 OK", &file[..]),
    };
    let place = ends.map_or_else(String::new, |(a, b)| format!("Content-Range: bytes {a}-{b}/{}\r\n", file.len()));
    let length = part.len();
    let head = format!(
        "HTTP/1.1 {status}\r\n{place}Content-Length: {length}\r\nAccept-Ranges: bytes\r\nConnection: close\r\n\r\n"
    );
    stream.write_all(head.as_bytes())?;
    if method == "HEAD" { Ok(()) } else { stream.write_all(part) }
}

#[test]
fn photos_on_a_server_are_read_where_that_is_allowed_and_mean_the_same() {
    let scene = Scene::new();
    fs::create_dir(scene.path("images")).unwrap();
    for (i, stem) in scene.stems().iter().enumerate() {
        let photo = image::RgbImage::from_fn(160, 120, |x, y| image::Rgb([(x * y) as u8, x as u8 ^ i as u8, y as u8]));
        photo.save(scene.path(&format!("images/{stem}.jpg"))).unwrap();
    }
    let server = FileServer::of(scene.path("images"));
    let on_server = format!("images = \"/vsicurl/{}/{{name}}\"", server.address);
    let city = || scene.json("result/city.city.json")["CityObjects"].take();
    scene.edit("sizeup.toml", |text| text.replace("path = \"sparse\"", "path = \"sparse\"\nimages = \"images\""));
    let of_folder = scene.run(&[]);
    assert!([0, 5].contains(&of_folder.code), "{}", of_folder.stderr);
    let of_folder_city = city();

    scene.edit("sizeup.toml", |text| text.replace("images = \"images\"", &on_server));
    let refused = scene.run(&[]);
    assert_eq!(refused.code, 3, "{}", refused.stderr);
    assert!(refused.stderr.contains("on a server") && refused.stderr.contains("--allow-remote"), "{}", refused.stderr);
    let inspected = scene.sizeup(&["survey", "inspect", "--config", "sizeup.toml"]);
    assert_eq!(inspected.code, 3, "{}", inspected.stdout);
    let address = format!("/vsicurl/{}", server.address);
    let by_flag = scene.sizeup(&["survey", "inspect", "sparse", "--crs", "EPSG:25832", "--images", &address]);
    assert!(by_flag.code == 3 && by_flag.stderr.contains(&address), "{}", by_flag.stderr);
    assert_eq!(server.n_asked.load(Ordering::Relaxed), 0, "nobody was asked");

    let allowed = scene.run(&["--allow-remote"]);
    assert_eq!(allowed.code, of_folder.code, "{}", allowed.stderr);
    assert!(server.n_asked.load(Ordering::Relaxed) > 0, "the photos were asked for");
    assert_eq!(city(), of_folder_city);
}

#[test]
fn photos_in_an_archive_are_named_by_a_template_and_absent_ones_are_told() {
    let scene = Scene::new();
    let stems = scene.stems();
    let mut zip = zip::ZipWriter::new(fs::File::create(scene.path("photos.zip")).unwrap());
    // Every second photo is not there.
    for (i, stem) in stems.iter().enumerate().step_by(2) {
        let photo = image::RgbImage::from_fn(160, 120, |x, y| image::Rgb([(x * y) as u8, x as u8 ^ i as u8, y as u8]));
        let mut bytes = std::io::Cursor::new(Vec::new());
        photo.write_to(&mut bytes, image::ImageFormat::Jpeg).unwrap();
        zip.start_file(format!("{stem}.jpg"), zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(bytes.get_ref()).unwrap();
    }
    zip.finish().unwrap();
    let images = format!("path = \"sparse\"\nimages = \"/vsizip/{}/{{stem}}.jpg\"", scene.path("photos.zip").display());
    scene.edit("sizeup.toml", |text| text.replace("path = \"sparse\"", &images));
    let outcome = scene.run(&[]);
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    let unread = scene.issues("photo_unreadable");
    let is_absent = |name: &str| stems.iter().skip(1).step_by(2).any(|stem| name == format!("{stem}.jpg"));
    assert!(!unread.is_empty(), "{}", outcome.stderr);
    assert!(unread.iter().all(|issue| is_absent(issue["subject"]["id"].as_str().unwrap())), "{unread:?}");
    let wrong =
        scene.sizeup(&["survey", "inspect", "sparse", "--crs", "EPSG:25832", "--images", "/vsizip/a.zip/{photo}"]);
    assert!(wrong.code == 3 && wrong.stderr.contains("{photo}"), "{}", wrong.stderr);
}

#[test]
fn what_a_run_left_behind_is_held_against_what_it_belongs_to() {
    let scene = Scene::new();
    assert!([0, 5].contains(&scene.run(&[]).code));
    let altered = |name: &str, alter: &dyn Fn(&mut serde_json::Value), expected: &str| {
        let path = format!("result/stages/{name}.json");
        let before = scene.json(&path);
        let mut artefact = before.clone();
        alter(&mut artefact["data"]);
        assert_ne!(artefact, before, "{name}: nothing is altered");
        fs::write(scene.path(&path), artefact.to_string()).unwrap();
        let outcome = scene.run(&["--from", "output"]);
        fs::write(scene.path(&path), before.to_string()).unwrap();
        assert_eq!(outcome.code, 3, "{expected}: {}", outcome.stderr);
        for word in [expected, "hint: ", &format!("--from {name}")] {
            assert!(outcome.stderr.contains(word), "{word:?} is missing in: {}", outcome.stderr);
        }
    };
    altered(
        "heights",
        &|data| data["parts"].as_array_mut().unwrap().last_mut().unwrap()["building"] = json!(9999),
        "building 9999",
    );
    altered("heights", &|data| data["solution"]["heights"][0]["views"] = json!([777]), "view 777");
    altered("heights", &|data| data["solution"]["used_views"][0] = json!(888), "view 888");
    altered("heights", &|data| data["unread_photos"] = json!([[999, "x"]]), "view 999");
    altered("heights", &|data| drop(data["parts"].as_array_mut().unwrap().pop()), "heights of");
    altered("footprints", &|data| drop(data["ground"].as_array_mut().unwrap().pop()), "ground under");
    altered("footprints", &|data| data["ground"][0]["lowest_m"] = json!(1e300), "a ground of");
    let footprint = |data: &mut serde_json::Value, to: serde_json::Value| {
        data["layer"]["footprints"][0]["polygon"]["exterior"][0] = to;
    };
    altered("footprints", &|data| footprint(data, json!({"x": 1e300, "y": 0.0})), "the footprint of");
    altered("footprints", &|data| footprint(data, json!({"x": 0.0, "y": 0.0})), "the footprint of"); // no longer closed
    altered("survey", &|data| data["views"][0]["camera"]["width_px"] = json!(0), "0 ×");
    assert!([0, 5].contains(&scene.run(&["--from", "output"]).code), "as it was");
}

/// Rewrites a terrain model five times as fine and in one block, which is read as a whole: 4 bytes a cell, some megabytes.
fn write_in_one_block(path: &Path) {
    let coarse = gdal::Dataset::open(path).unwrap();
    let (width, height) = coarse.raster_size();
    let [west, cell_x, _, north, _, cell_y] = coarse.geo_transform().unwrap();
    let size = (5 * width, 5 * height);
    let mut heights = coarse.rasterband(1).unwrap().read_as::<f32>((0, 0), (width, height), size, None).unwrap();
    assert!(4 * heights.data().len() > 2_000_000, "more than the limit of the test");
    let options = RasterCreationOptions::from_iter([format!("BLOCKYSIZE={}", size.1).as_str()]);
    let fine = path.with_extension("fine.tif");
    let driver = DriverManager::get_driver_by_name("GTiff").unwrap();
    let mut dataset = driver.create_with_band_type_with_options::<f32, _>(&fine, size.0, size.1, 1, &options).unwrap();
    dataset.set_geo_transform(&[west, cell_x / 5.0, 0.0, north, 0.0, cell_y / 5.0]).unwrap();
    dataset.set_spatial_ref(&coarse.spatial_ref().unwrap()).unwrap();
    dataset.rasterband(1).unwrap().write((0, 0), size, &mut heights).unwrap();
    dataset.close().unwrap();
    fs::rename(fine, path).unwrap();
}

#[test]
fn what_one_file_may_take_is_set_by_flag_and_configuration() {
    let scene = Scene::new();
    write_in_one_block(&scene.path("dtm.tif"));
    for more in [&["--input-memory", "1"][..], &["--set", "limits.input_mb=1"]] {
        let outcome = scene.run(more);
        assert_eq!(outcome.code, 3, "{}", outcome.stderr);
        for word in ["dtm.tif", "one input may take 1 MB", "--input-memory", "limits.input_mb"] {
            assert!(outcome.stderr.contains(word), "{word:?} is missing in: {}", outcome.stderr);
        }
    }
    // The command line goes before the configuration.
    let outcome = scene.run(&["--until", "footprints", "--set", "limits.input_mb=1", "--input-memory", "4096"]);
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
}

#[test]
fn no_more_threads_are_started_than_the_machine_has() {
    let outcome: Outcome = sizeup().args(["--threads", "100000", "schema", "run"]).output().unwrap().into();
    assert_eq!(outcome.code, 0);
    assert!(outcome.stderr.contains("--threads 100000"), "{}", outcome.stderr);
    let outcome: Outcome = sizeup().args(["--threads", "1", "schema", "run"]).output().unwrap().into();
    assert_eq!((outcome.code, outcome.stderr.as_str()), (0, ""));
}

#[test]
fn a_vertex_that_lies_nowhere_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let city = |far: serde_json::Value| {
        json!({"type": "CityJSON", "version": "2.0", "transform": {"scale": [1.0, 1.0, 1.0], "translate": [0, 0, 0]},
            "CityObjects": {"a": {"type": "Building", "geometry": [{"type": "MultiSurface", "lod": "1.2",
                "boundaries": [[[0, 1, 2]]]}]}},
            "vertices": [[0, 0, 0], [1, 0, 0], [0, far, 0]]})
    };
    let path = folder.path().join("a.city.json");
    for far in ["1e308", "-1e308", "1e300"] {
        fs::write(&path, city(serde_json::from_str(far).unwrap()).to_string()).unwrap();
        let outcome: Outcome = sizeup().args(["check", "--no-schema"]).arg(&path).output().unwrap().into();
        assert_eq!(outcome.code, 3, "{}", outcome.stderr);
        assert!(outcome.stderr.contains("vertex 2") && !outcome.stderr.contains("panicked"), "{}", outcome.stderr);
    }
    // A tolerance so small that cells end where whole numbers do.
    fs::write(&path, city(json!(1000)).to_string()).unwrap();
    let outcome: Outcome =
        sizeup().args(["check", "--no-schema", "--snap-tolerance", "1e-300"]).arg(&path).output().unwrap().into();
    assert!(!outcome.stderr.contains("panicked"), "{}", outcome.stderr);
}

#[test]
fn corners_of_results_that_are_no_numbers_enclose_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fgb");
    let mut dataset = DriverManager::get_driver_by_name("FlatGeobuf").unwrap().create_vector_only(&path).unwrap();
    let crs = gdal::spatial_ref::SpatialRef::from_epsg(25832).unwrap();
    let ty = gdal::vector::OGRwkbGeometryType::wkbPolygon;
    let options = gdal::vector::LayerOptions { name: "a", srs: Some(&crs), ty, ..Default::default() };
    let mut layer = dataset.create_layer(options).unwrap();
    let footprint = "POLYGON ((500000 5700000, 500009 5700000, 500009 5700007, 500000 5700000))";
    layer.create_feature(gdal::vector::Geometry::from_wkt(footprint).unwrap()).unwrap();
    dataset.close().unwrap();
    let read = || FoundBuildings::read(&path, &ReadOptions::default()).unwrap().to_records();
    assert!(read()[0].footprint.is_some());
    // A northing of the last corner but one, behind those of the header and the index.
    let mut bytes = fs::read(&path).unwrap();
    let northing = 5_700_007.0_f64.to_le_bytes();
    let at = bytes.windows(8).rposition(|window| window == northing).unwrap();
    bytes[at..at + 8].copy_from_slice(&f64::NAN.to_le_bytes());
    fs::write(&path, bytes).unwrap();
    assert_eq!((read().len(), &read()[0].footprint), (1, &None));
}

#[test]
fn names_that_lead_out_of_their_folder_are_refused() {
    let scene = Scene::new();
    let planned = scene.sizeup(&["tiles", "plan", "sizeup.toml", "--output", "city"]);
    assert_eq!(planned.code, 0, "{}", planned.stderr);
    let manifest = scene.json("city/tiles.json");
    let id = manifest["tiles"][0]["id"].as_str().unwrap().to_owned();
    for escape in ["../../escaped", "/tmp/escaped", "a/../../../escaped", ".."] {
        let mut escaping = manifest.clone();
        escaping["tiles"][0]["id"] = json!(escape);
        fs::write(scene.path("city/tiles.json"), escaping.to_string()).unwrap();
        let before = scene.files("").len();
        for command in
            [&["tiles", "run", "city", "--tile", "0"][..], &["tiles", "merge", "city"], &["tiles", "status", "city"]]
        {
            let outcome = scene.sizeup(command);
            assert_eq!(outcome.code, 3, "{command:?}: {}", outcome.stderr);
            assert!(outcome.stderr.contains(escape) && outcome.stderr.contains("hint: "), "{}", outcome.stderr);
        }
        assert_eq!(scene.files("").len(), before, "nothing was written");
    }
    fs::write(scene.path("city/tiles.json"), manifest.to_string()).unwrap();
    let outcome = scene.sizeup(&["tiles", "status", "city"]);
    assert!(outcome.code == 0 && outcome.stdout.contains(&id), "{}", outcome.stderr);
}

#[test]
fn a_photo_whose_name_leads_elsewhere_is_named_without_that_way_and_its_prior_is_not_read() {
    let scene = Scene::new();
    let stem = scene.stems().remove(0);
    fs::create_dir(scene.path("secret")).unwrap();
    fs::rename(scene.path(&format!("priors/{stem}.npy")), scene.path(&format!("secret/{stem}.npy"))).unwrap();
    scene.edit("sparse/images.txt", |text| text.replace(&format!("{stem}.jpg"), &format!("../secret/{stem}.jpg")));
    let outcome = scene.run(&[]);
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    assert!(scene.issues("photo_name_unusable").is_empty());
    for file in scene.files("result").iter().filter(|file| file.extension().is_some_and(|e| e == "json")) {
        assert!(!fs::read_to_string(file).unwrap().contains("secret"), "{}", file.display());
    }
    // What is no path of a file has no name that is left.
    scene.edit("sparse/images.txt", |text| text.replace(&format!("../secret/{stem}.jpg"), ".."));
    let outcome = scene.run(&[]);
    assert_eq!(outcome.code, 5, "{}", outcome.stderr);
    let issue = &scene.issues("photo_name_unusable")[0];
    assert!(issue["subject"]["id"] == ".." && issue["hint"].is_string(), "{issue}");
}

#[test]
fn photos_that_are_cut_short_or_there_twice_are_named() {
    let scene = Scene::new();
    fs::create_dir(scene.path("images")).unwrap();
    let stems = scene.stems();
    for (i, stem) in stems.iter().enumerate() {
        let photo = image::RgbImage::from_fn(160, 120, |x, y| image::Rgb([(x * y) as u8, x as u8 ^ i as u8, y as u8]));
        photo.save(scene.path(&format!("images/{stem}.jpg"))).unwrap();
    }
    let photo = |i: usize| scene.path(&format!("images/{}.jpg", stems[i]));
    for (i, share) in [(0, 0.95), (1, 0.75), (2, 0.5)] {
        let whole = fs::read(photo(i)).unwrap();
        fs::write(photo(i), &whole[..(share * whole.len() as f64) as usize]).unwrap();
    }
    fs::copy(photo(3), photo(4)).unwrap();
    scene.edit("sizeup.toml", |text| text.replace("path = \"sparse\"", "path = \"sparse\"\nimages = \"images\""));
    let outcome = scene.run(&[]);
    assert_eq!(outcome.code, 5, "{}", outcome.stderr);
    let mut cut: Vec<String> =
        scene.issues("photo_cut_short").iter().map(|i| i["subject"]["id"].as_str().unwrap().to_owned()).collect();
    cut.sort();
    let expected: Vec<String> = stems[..3].iter().map(|stem| format!("{stem}.jpg")).collect();
    assert_eq!(cut, expected);
    let double = scene.issues("duplicate_photo");
    assert_eq!(double.len(), 1, "{double:?}");
    assert!(double[0]["message"].as_str().unwrap().contains(&*stems[3]), "{}", double[0]);
}

#[test]
fn pixels_that_the_decoder_makes_up_are_not_passed_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    let mut state = 1_u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let photo = image::RgbImage::from_fn(256, 192, |_, _| image::Rgb([noise(), noise(), noise()]));
    photo.save(&path).unwrap();
    let whole = fs::read(&path).unwrap();
    let read = || RasterFile::open(&path).and_then(|file| file.read(1));
    assert!(read().is_ok());
    fs::write(&path, &whole[..whole.len() * 3 / 4]).unwrap();
    let refused = read().unwrap_err().to_string();
    assert!(refused.contains("damaged") && refused.contains("hint: "), "{refused}");
    // Also at reduced size, from the file's own coarser scales.
    let window = CellWindow { col: 0, row: 0, width: 256, height: 192 };
    let reduced = RasterFile::open(&path).unwrap().read_window(1, window, (32, 24), Resampling::Average);
    assert!(reduced.unwrap_err().to_string().contains("damaged"));
}

/// Runs a command whose reader is gone before it says a word.
fn into_closed_pipe(scene: &Scene, args: &[&str]) {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut command = Command::new(env!("CARGO_BIN_EXE_sizeup"));
    let child =
        command.current_dir(scene.path("")).args(args).stdin(Stdio::null()).stdout(writer).stderr(Stdio::piped());
    let output = child.spawn().unwrap().wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!stderr.contains("panicked"), "{args:?}: {stderr}");
    assert!(
        output.status.code().is_some_and(|code| [0, 3, 5].contains(&code)),
        "{args:?}: {:?} {stderr}",
        output.status
    );
}

#[test]
fn a_reader_that_has_gone_is_no_failure() {
    let scene = Scene::new();
    assert!([0, 5].contains(&scene.run(&[]).code));
    let city = "result/city.city.json";
    let commands: [&[&str]; 12] = [
        &["check", city, "--all"],
        &["check", city, "--json"],
        &["survey", "inspect", "--config", "sizeup.toml"],
        &["survey", "inspect", "--config", "sizeup.toml", "--json"],
        &["survey", "convert", "sparse", "--crs", "EPSG:25832", "--output", "poses.csv"],
        &["evaluate", city, "truth.geojson"],
        &["schema", "run"],
        &["survey", "formats"],
        &["survey", "formats", "--json"],
        &["completions", "bash"],
        &["--help"],
        &["run", "--help"],
    ];
    for command in commands {
        into_closed_pipe(&scene, command);
    }
}
