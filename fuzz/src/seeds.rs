//! Small sound files, one or more per reader, to begin with.

use std::error::Error;
use std::fs;
use std::io::{Cursor, Write as _};
use std::path::Path;

use exr::prelude::WritableImage as _;
use gdal::DriverManager;
use gdal::raster::Buffer;
use gdal::spatial_ref::SpatialRef;
use gdal::vector::{Geometry, LayerAccess as _, LayerOptions, OGRwkbGeometryType};
use sizeup::prior::{DepthPrior, PriorCache, PriorGeometry, PriorKind};

use crate::project::{self, Project};
use crate::shapefile;

const BLOCK: &str = "<BlocksExchange version=\"3.2\"><SpatialReferenceSystems><SRS><Id>0</Id><Definition>EPSG:25832</Definition>\
    </SRS></SpatialReferenceSystems><Block><SRSId>0</SRSId><Photogroups><Photogroup><ImageDimensions><Width>40</Width>\
    <Height>30</Height></ImageDimensions><FocalLengthPixels>30</FocalLengthPixels><PrincipalPoint><x>20</x><y>15</y>\
    </PrincipalPoint><Distortion><K1>0.1</K1><P1>1e-3</P1></Distortion><Photo><ImagePath>a.jpg</ImagePath><Pose><Rotation>\
    <Omega>180</Omega><Phi>0</Phi><Kappa>0</Kappa></Rotation><Center><x>5e5</x><y>57e5</y><z>90</z></Center></Pose></Photo>\
    </Photogroup></Photogroups></Block></BlocksExchange>";
const METASHAPE: &str = r#"<?xml version="1.0"?><document version="2.0.0"><chunk><sensors><sensor id="0" type="frame"><resolution
    width="40" height="30"/><calibration type="frame" class="adjusted"><resolution width="40" height="30"/><f>30</f><cx>1</cx>
    <b2>0.1</b2><k1>0.1</k1></calibration></sensor></sensors><components><component id="0"><transform><rotation>1 0 0 0 1 0 0 0 1
    </rotation><translation>5e5 57e5 0</translation><scale>1</scale></transform></component></components><cameras><camera id="0"
    sensor_id="0" component_id="0" label="a"><transform>1 0 0 1 0 -1 0 2 0 0 -1 100 0 0 0 1</transform></camera></cameras>
    <reference>LOCAL_CS["Local"]</reference></chunk></document>"#;
const SFM: &str = r#"[{"cameras":{"c":{"projection_type":"brown","width":40,"height":30,"focal_x":0.8,"k1":0.1}},"shots":{"a.jpg":
    {"rotation":[3.14159,0,0],"translation":[-5e5,57e5,100],"camera":"c"}}}]"#;
const SHOTS: &str = r#"{"features":[{"properties":{"filename":"a.jpg","rotation":[3.14159,0,0],"translation":[5e5,57e5,100],
    "camera":"c","gps_time":0}}]}"#;
const CITY: &str = r#"{"type":"CityJSON","version":"2.0","transform":{"scale":[0.5,0.5,0.5],"translate":[10,20,0]},"metadata":
    {"referenceSystem":"https://www.opengis.net/def/crs/EPSG/0/28992"},"CityObjects":{"b":{"type":"Building","attributes":
    {"height_m":3.5},"geometry":[{"type":"Solid","lod":"1.2","semantics":{"surfaces":[{"type":"RoofSurface"}],"values":[[0,0,0]]},
    "boundaries":[[[[0,3,2,1]],[[4,5,6,7]],[[0,1,5,4]],[[1,2,6,5]],[[2,3,7,6]],[[3,0,4,7]]]]}]}},
    "vertices":[[0,0,0],[4,0,0],[4,2,0],[0,2,0],[0,0,6],[4,0,6],[4,2,6],[0,2,6]]}"#;
const SEQUENCE: &str = "{\"type\":\"CityJSON\",\"version\":\"2.0\",\"transform\":{\"scale\":[0.5,0.5,0.5],\"translate\":[10,20,0]},\
    \"CityObjects\":{},\"vertices\":[]}\n{\"type\":\"CityJSONFeature\",\"id\":\"b\",\"CityObjects\":{\"b\":{\"type\":\"Building\",\
    \"geometry\":[{\"type\":\"MultiSurface\",\"lod\":\"2\",\"boundaries\":[[[0,1,2]]]}]}},\"vertices\":[[0,0,0],[4,0,0],[4,2,0]]}\n";
const LAYER: &str = r#"{"type":"FeatureCollection","crs":{"type":"name","properties":{"name":"EPSG:25832"}},"features":[{"type":
    "Feature","properties":{"id":"a","n":[1,2]},"geometry":{"type":"Polygon","coordinates":[[[0,0],[1,0],[1,1],[0,0]]]}}]}"#;
const COCO: &str = r#"{"images":[{"id":1,"file_name":"a.jpg","width":64,"height":48}],"categories":[{"id":1,"name":"building"}],
    "annotations":[{"id":1,"image_id":1,"category_id":1,"score":0.9,"segmentation":[[1,1,9,1,9,9,1,9]]},{"id":2,"image_id":1,
    "category_id":1,"segmentation":{"size":[48,64],"counts":[100,20,2952]}}]}"#;
const TILES: &str = r#"{"made_by":{"settings":{},"parts":{}},"origin_m":[0,0,0],"heights_m":[1,99],"halo_m":9,"view_margin_m":3,"config":
    {"project":{"crs":"EPSG:25832"},"survey":{"path":"s"},"footprints":{"path":"f"},"terrain":{"constant_m":1.0},"prior":{"source":"stereo"}},
    "tileset":{"written":{"geoid_height":44.0}},"inputs":[],"renamed":{"7":"b"},"n_buildings":1,"n_views":1,"tiles":[{"id":"e0_n0","core":
    {"west_m":0,"south_m":0,"east_m":1,"north_m":1},"halo":{"west_m":0,"south_m":0,"east_m":1,"north_m":1},"n_buildings":1,"n_solved":1,
    "n_views":1,"memory_mb":9,"views_sha256":"","reads":{"footprints":{"size_bytes":1,"sha256":"00"},"terrain":null}}]}"#;
const CONFIG: &str = "seed = 3\n[project]\ncrs = \"EPSG:25832\"\n[survey]\npath = \"s\"\n[survey.csv]\nangles = \"ypr\"\n[footprints]\n\
    path = \"f.gpkg\"\n[terrain]\nconstant_m = 12.0\n[prior]\nsource = \"files\"\npath = \"d/{stem}.npy\"\nkind = \"depth\"\n";
const OPF: &str = r#"{"format":"application/opf-project+json","version":"1.0","items":[{"id":"b","type":"camera_list","resources":[
    {"uri":"project.opf","format":"application/opf-camera-list+json"}]},{"id":"i","type":"input_cameras","resources":[
    {"uri":"project.opf","format":"application/opf-input-cameras+json"}]},{"id":"f","type":"scene_reference_frame","resources":[
    {"uri":"project.opf","format":"application/opf-scene-reference-frame+json"}]},{"id":"c","type":"calibration","resources":[{"uri":"project.opf",
    "format":"application/opf-calibrated-cameras+json"}]}],"cameras":[{"id":1,"uri":"a.jpg","sensor_id":1,"position":[5e5,57e5,100],
    "orientation_deg":[1,2,3]}],"sensors":[{"id":1,"image_size_px":[40,30],"internals":{"type":"perspective","principal_point_px":[20,15],
    "focal_length_px":30,"radial_distortion":[0.1,0,0],"tangential_distortion":[1e-3,0]}}],"captures":[],"base_to_canonical":{
    "shift":[0,0,0],"scale":[1,1,1],"swap_xy":false},"crs":{"definition":"EPSG:25832"}}"#;

const INPHO: &str = "$PROJECT 15.0.0\n  $PROJECT_NAME : a\n  $LINEAR_UNITS_OF_OBJECT : m\n$END\n$PHOTO\n  $PHOTO_NUM : 17\n  \
    $PHOTO_FILE : D:\\b 1\\a.tif\n  $CAMERA_ID : c\n  $EXT_ORI : 19:07:49 17/08/2018\n   100.5 500000.0 5700000.0 900.0\n   1 0 0 0 1 0 0 0 1\n\
    $END\n$CAMERA_DEFINITION\n  $ID : c\n  $KIND : CCDFrame\n  $CCD_INTERIOR_ORIENTATION :\n    217.39 0 5798.57\n    0 -217.39 4358.13\n  \
    $CCD_COLUMNS : 11608\n  $CCD_ROWS : 8708\n  $PIXEL_REFERENCE : CenterTopLeft\n  $FOCAL_LENGTH : 100.5\n  $PRINCIPAL_POINT_PPA : 0 0\n  \
    $RADIAL_COEFFS :\n   0 0 0\n  $END\n$END\n";
const STAC: &str = r#"{"type":"Feature","stac_version":"1.0.0","stac_extensions":["https://stac-extensions.github.io/perspective-imagery/v1.0.0/schema.json"],
    "id":"a","properties":{"proj:shape":[8578,11478],"pers:omega":0,"pers:phi":0,"pers:kappa":0,"pers:perspective_center":[5e5,57e5,1504],
    "pers:crs":25832,"pers:rotation_matrix":[1,0,0,0,1,0,0,0,1],"pers:interior_orientation":{"camera_id":"c","focal_length":108,
    "pixel_spacing":[0.0046,0.0046],"principal_point_offset":[0,0],"sensor_array_dimensions":[11478,8578]}},"assets":{},"links":[]}"#;
const NERFSTUDIO: &str = r#"{"w":40,"h":30,"fl_x":30,"fl_y":30,"cx":20,"cy":15,"k1":0.1,"camera_model":"OPENCV","applied_transform":
    [[1,0,0,0],[0,0,1,0],[0,-1,0,0]],"frames":[{"file_path":"a.jpg","transform_matrix":[[1,0,0,5e5],[0,0,1,100],[0,-1,0,57e5],[0,0,0,1]]},
    {"file_path":"b.jpg","transform_matrix":[[1,0],[0,1]]}]}"#;
const OSM: &str = r#"<?xml version="1.0"?><osm version="0.6"><node id="1" lat="51.4" lon="9"/><node id="2" lat="51.4" lon="9.001"/>
    <node id="3" lat="51.401" lon="9"/><way id="4"><nd ref="1"/><nd ref="2"/><nd ref="3"/><nd ref="1"/><tag k="building" v="yes"/></way>
    <relation id="5"><member type="way" ref="4" role="outer"/><tag k="type" v="multipolygon"/><tag k="building" v="yes"/></relation></osm>"#;

fn npy() -> Vec<u8> {
    let mut npy = b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }".to_vec();
    npy.resize(127, b' ');
    npy.push(b'\n');
    npy.extend((1..=12_u8).flat_map(|depth| f32::from(depth).to_le_bytes()));
    npy
}

/// What cannot be written as text.
fn binaries() -> Vec<(&'static str, Vec<u8>)> {
    let number = |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
    let depths: Vec<f32> = (1..=12_u8).map(f32::from).collect();
    let npy = npy();
    let mut images = Vec::new();
    images.extend(1_u64.to_le_bytes());
    images.extend(1_u32.to_le_bytes());
    images.extend([0.0_f64, 1.0, 0.0, 0.0, -5e5, 57e5, 100.0].iter().flat_map(|v| v.to_le_bytes()));
    images.extend(1_u32.to_le_bytes());
    images.extend(b"a.jpg\0");
    images.extend(1_u64.to_le_bytes());
    images.extend([0; 24]);
    let mut las = vec![0_u8; 227];
    las[..4].copy_from_slice(b"LASF");
    (las[24], las[25]) = (1, 2);
    las[94..96].copy_from_slice(&227_u16.to_le_bytes());
    las[96..100].copy_from_slice(&227_u32.to_le_bytes());
    las[105..107].copy_from_slice(&20_u16.to_le_bytes());
    las[107..111].copy_from_slice(&2_u32.to_le_bytes());
    for at in [131, 139, 147] {
        las[at..at + 8].copy_from_slice(&0.01_f64.to_le_bytes());
    }
    las.extend([7; 40]);
    let xmp = b"http://ns.adobe.com/xap/1.0/\0<x><r drone-dji:GpsLatitude=\"+52\" drone-dji:GpsLongitude=\"+11\" \
        drone-dji:AbsoluteAltitude=\"+150\" drone-dji:GimbalYawDegree=\"1\" drone-dji:GimbalPitchDegree=\"-60\" \
        drone-dji:GimbalRollDegree=\"0\" drone-dji:DewarpData=\"2020-01-01;37,37,0,0,-0.1,0.02,0,0,0\"/></x>";
    let mut photo = vec![0xFF, 0xD8, 0xFF, 0xE1];
    photo.extend(u16::try_from(xmp.len() + 2).unwrap_or(2).to_be_bytes());
    photo.extend(xmp);
    photo.extend([0xFF, 0xC0, 0, 11, 8, 0, 30, 0, 40, 1, 0, 0, 0, 0xFF, 0xD9]);
    let mut tiff =
        b"II*\0\x08\0\0\0\x03\0\0\x01\x04\0\x01\0\0\0\x28\0\0\0\x01\x01\x04\0\x01\0\0\0\x1e\0\0\0\xbc\x02\x01\0"
            .to_vec();
    let packet = xmp.splitn(2, |&byte| byte == 0).nth(1).unwrap_or_default();
    tiff.extend(u32::try_from(packet.len()).unwrap_or_default().to_le_bytes());
    tiff.extend([50, 0, 0, 0, 0, 0, 0, 0]);
    tiff.extend(packet);
    vec![
        ("npy", npy),
        ("pfm", [b"Pf\n4 3\n-1.0\n".to_vec(), number(&depths)].concat()),
        ("colmap_binary", images),
        ("las", las),
        ("photo", photo),
        ("photo_tiff", tiff),
    ]
}

/// Files that tests compare with.
const FIXTURES: [(&str, &str); 5] = [
    ("onnx", "onnx/depth_in_range.onnx"),
    ("onnx", "onnx/depth_of_poses.onnx"),
    ("onnx", "onnx/fpsam_head.onnx"),
    ("onnx", "onnx/pad_by_axes.onnx"),
    ("onnx", "onnx/buildings_of_brightness.onnx"),
];

/// A message of protocol buffers: fields of bytes, and of numbers.
fn message(fields: &[(u8, Result<&[u8], u8>)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (number, value) in fields {
        match value {
            Ok(value) => {
                bytes.extend([number << 3 | 2, u8::try_from(value.len()).expect("seeds are small")]);
                bytes.extend(*value);
            }
            Err(value) => bytes.extend([number << 3, *value]),
        }
    }
    bytes
}

/// OpenStreetMap's binary form: a header, and a building of three corners.
fn osm_pbf() -> Vec<u8> {
    let block = |kind: &[u8], data: &[u8]| {
        let blob = message(&[(1, Ok(data))]);
        let length = u8::try_from(blob.len()).expect("seeds are small");
        let mut head = message(&[(1, Ok(kind))]);
        // A length over 127 takes two bytes.
        head.push(3 << 3);
        if length < 128 {
            head.push(length)
        } else {
            head.extend([length | 128, length >> 7])
        }
        [&u32::try_from(head.len()).expect("seeds are small").to_be_bytes()[..], &head, &blob].concat()
    };
    let strings = message(&[(1, Ok(b"")), (1, Ok(b"building")), (1, Ok(b"yes"))]);
    let nodes = message(&[(1, Ok(&[2, 2, 2])), (8, Ok(&[2, 200, 1, 100])), (9, Ok(&[2, 100, 200, 1]))]);
    let way = message(&[(1, Err(7)), (2, Ok(&[1])), (3, Ok(&[2])), (8, Ok(&[2, 2, 2, 3]))]);
    let (dense, ways) = (message(&[(2, Ok(&nodes))]), message(&[(3, Ok(&way))]));
    let primitives = message(&[(1, Ok(&strings)), (2, Ok(&dense)), (2, Ok(&ways))]);
    let features = message(&[(4, Ok(b"OsmSchema-V0.6")), (4, Ok(b"DenseNodes"))]);
    [block(b"OSMHeader", &features), block(b"OSMData", &primitives)].concat()
}

/// Files that libraries of the program itself write, by reader.
fn written(folder: &Path) -> Result<Vec<(&'static str, Vec<u8>)>, Box<dyn Error>> {
    let mut all = Vec::new();
    let depths: Vec<f32> = (1..=12_u8).map(f32::from).collect();
    let utm = SpatialRef::from_epsg(25832)?;
    for (reader, driver, name) in [("gpkg", "GPKG", "a.gpkg"), ("fgb", "FlatGeobuf", "a.fgb")] {
        let path = folder.join(name);
        let mut dataset = DriverManager::get_driver_by_name(driver)?.create_vector_only(&path)?;
        let options =
            LayerOptions { name: "b", srs: Some(&utm), ty: OGRwkbGeometryType::wkbPolygon, ..LayerOptions::default() };
        let mut layer = dataset.create_layer(options)?;
        layer.create_feature(Geometry::from_wkt("POLYGON ((5e5 57e5, 500009 57e5, 500009 5700009, 5e5 57e5))")?)?;
        drop(dataset);
        all.push((reader, fs::read(&path)?));
        all.push((if reader == "gpkg" { "city_gpkg" } else { "city_fgb" }, fs::read(&path)?));
    }
    for (reader, name) in [("prior_tiff", "a.tif"), ("dtm", "dtm.tif")] {
        let path = folder.join(name);
        let mut dataset =
            DriverManager::get_driver_by_name("GTiff")?.create_with_band_type::<f32, _>(&path, 4, 3, 1)?;
        if reader == "dtm" {
            dataset.set_geo_transform(&[5e5, 3.0, 0.0, 57e5, 0.0, -3.0])?;
            dataset.set_spatial_ref(&utm)?;
        }
        dataset.rasterband(1)?.write((0, 0), (4, 3), &mut Buffer::new((4, 3), depths.clone()))?;
        drop(dataset);
        all.push((reader, fs::read(&path)?));
    }
    let png = folder.join("a.png");
    let levels: Vec<u16> = (0..12).map(|n| 100 * n).collect();
    image::ImageBuffer::<image::Luma<u16>, _>::from_raw(4, 3, levels).ok_or("a picture")?.save(&png)?;
    all.push(("prior_png", fs::read(&png)?));
    let squares: Vec<u8> = (0..64 * 48_u32).map(|n| u8::from(n % 64 / 16 == 1 && n / 64 / 16 == 1)).collect();
    image::ImageBuffer::<image::Luma<u8>, _>::from_raw(64, 48, squares).ok_or("a picture")?.save(&png)?;
    all.push(("mask_png", fs::read(&png)?));
    let exr = folder.join("a.exr");
    let rows = exr::prelude::FlatSamples::F32(depths);
    let channels = exr::prelude::AnyChannels::sort([exr::prelude::AnyChannel::new("Z", rows)].into_iter().collect());
    exr::prelude::Image::from_channels((4, 3), channels).write().to_file(&exr)?;
    all.push(("exr", fs::read(&exr)?));
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file("block.xml", zip::write::SimpleFileOptions::default())?;
    zip.write_all(BLOCK.as_bytes())?;
    all.push(("blocks_exchange_zip", zip.finish()?.into_inner()));
    for (reader, name) in [("las", "a.las"), ("laz", "a.laz")] {
        let mut builder = las::Builder::from((1, 4));
        builder.point_format = las::point::Format::new(6)?;
        builder.point_format.is_compressed = reader == "laz";
        let mut writer = las::Writer::from_path(folder.join(name), builder.into_header()?)?;
        for i in 0..20_u8 {
            writer.write_point(las::Point { x: f64::from(i), gps_time: Some(1.0), ..las::Point::default() })?;
        }
        writer.close()?;
        drop(writer);
        all.push((reader, fs::read(folder.join(name))?));
    }
    all.push(("osm_pbf", osm_pbf()));
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file("depth.npy", zip::write::SimpleFileOptions::default())?;
    zip.write_all(&npy())?;
    all.push(("npz", zip.finish()?.into_inner()));
    let values = sizeup::raster::Raster::from_vec(4, 3, (1..=12_u8).map(f32::from).collect()).ok_or("a raster")?;
    let prior = DepthPrior { values, kind: PriorKind::Depth, geometry: PriorGeometry::default() };
    PriorCache::open(folder, 1 << 30)?.put("a", &prior)?;
    all.push(("kept_prior", fs::read(folder.join("a.prior"))?));
    Ok(all)
}

/// Writes them to `READER/*` in a folder.
pub fn write(folder: &Path) -> Result<(), Box<dyn Error>> {
    let texts = [
        ("colmap_text", "# i\n1 0 1 0 0 -5e5 57e5 100 1 a b.jpg\n1 2 -1\n2 0 1 0 0 -5e5 57e5 90 1 c.jpg\n\n"),
        ("colmap_cameras", "1 PINHOLE 40 30 30 30 20 15\n2 OPENCV_FISHEYE 40 30 30 30 20 15 1e-2 0 0 0\n"),
        ("blocks_exchange", BLOCK),
        ("metashape", METASHAPE),
        ("metashape_opk", "# PhotoID, X\na\t5e5\t57e5\t100\t1\t2\t3\t0.1\nb\t5e5\t57e5\t9\t1\t2\t3\n"),
        ("opensfm", SFM),
        ("odm", SHOTS),
        ("geo_txt", "EPSG:25832\na.jpg 5e5 57e5 100 10 20 3 0.1 0.2\nb.jpg 5e5 57e5\n"),
        (
            "pix4d",
            "h\nh\nh\nh\nh\nh\nh\nh\na.jpg 40 30\n30 0 20\n0 30 15\n0 0 1\n-0.1 0.02 0\n1e-4 0\n1 2 100\n1 0 0\n0 -1 0\n0 0 -1\n",
        ),
        ("opf", OPF),
        (
            "csv",
            "name,x,y,z,omega,phi,kappa,width,height,fx,cx,k1\na,5e5,57e5,100,1,2,3,40,30,30,20,0.1\n\"b,c\",5,6,7,1,2,3\n",
        ),
        ("opensfm_reference", r#"{"latitude":52.0,"longitude":9.0,"altitude":100.0}"#),
        ("odm_cameras", r#"{"c":{"projection_type":"brown","width":40,"height":30,"focal_x":0.8,"k1":0.1,"p2":1e-3}}"#),
        ("pix4d_external", "imageName X Y Z Omega Phi Kappa\na.jpg 5e5 57e5 100 1 2 3\nb.jpg 5e5 57e5 90 4 5 6\n"),
        ("pix4d_offset", "5e5 57e5 0\n"),
        ("inpho", INPHO),
        ("stac", STAC),
        ("nerfstudio", NERFSTUDIO),
        (
            "recognised",
            "# ImageID X Y Z Omega Phi Kappa width height fx\na 5e5 57e5 100 1 2 3 40 30 30\nb 5e5 57e5 100 4 5 6 40 30 30\n",
        ),
        (
            "image_log",
            "31\t1.5\t[2364]\t  -339,N\t  -361,E\t   348,V\t52.00001,Lat\t9.0,Lon\t310.25,Ellh\t0.012, 0.010, 0.020\t50,Q\n",
        ),
        ("crs", "EPSG:25832+7837"),
        ("solids", CITY),
        ("obj", "o a\nv 5e5 57e5 0\nv 500009 57e5 0\nv 500009 5700009 9\nf 1 2 3\nf 1//1 -2 -1\n"),
        ("prior_names", "a.jpg\nb.jpg\n"),
        ("osm", OSM),
        (
            "reviews",
            r#"{"type":"FeatureCollection","features":[{"type":"Feature","geometry":null,"properties":{"building_id":"a",
            "decision":"corrected","height_m":9.5,"sigma_m":0.2}}]}"#,
        ),
        (
            "tile_done",
            r#"{"tile":"a","made_by":{"settings":{},"parts":{"a":"00"}},"outputs":{"a.json":"00"},"n_buildings":1,"n_heights":1,"by_status":{"measured":1},
            "n_used_views":1,"exit_code":0}"#,
        ),
        ("tile_attempt", r#"{"tile":"a","n_tries":1,"exit_code":3,"cause":"x"}"#),
        ("hashes", r#"{"a":{"length":1,"sha256":"00"}}"#),
        (
            "survey_config",
            "path = \"s\"\ncrs = \"EPSG:25832\"\noffset = [1, 2, 3]\n[csv]\nangles = \"ypr\"\n[camera]\nwidth = 40\nheight = 30\nfx = 30\n[height]\n\
             geoid_offset = 44.1\n",
        ),
        ("cloud_text", "x y z instance\n500000.5 5700000.25 12.5 1\n# a\n5e5;57e5;9;0\n5e5,57e5,9,2\n"),
        ("http", "GET /tiles/tiles/a%20b.glb?v=1 HTTP/1.1\r\nHost: HOST\r\nAccept: */*\r\n\r\n"),
        ("simulate_config", "seed = 3\n[town]\n"),
        ("assignment", "heights.max_m=99.5"),
        ("cityjson", CITY),
        ("cityjson_sequence", SEQUENCE),
        ("geojson", LAYER),
        ("coco", COCO),
        ("tiles", TILES),
        ("config", CONFIG),
    ];
    let write = |reader: &str, name: &str, bytes: &[u8]| {
        let folder = folder.join(reader);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join(name), bytes)
    };
    texts.iter().try_for_each(|(reader, text)| write(reader, "seed", text.as_bytes()))?;
    binaries().iter().try_for_each(|(reader, bytes)| write(reader, "seed", bytes))?;
    let place = tempfile::tempdir()?;
    written(place.path())?.iter().try_for_each(|(reader, bytes)| write(reader, "seed-written", bytes))?;
    shapefile::write(place.path())?;
    for part in shapefile::PARTS {
        write(part, "seed", &fs::read(place.path().join(format!("a.{part}")))?)?;
    }
    let project = Project::new();
    for (stage, _) in project::STAGES {
        write(&format!("stage_{stage}"), "seed", project.artefact(stage)["data"].to_string().as_bytes())?;
    }
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures");
    for (reader, file) in FIXTURES {
        write(reader, &format!("seed-{}", file.replace('/', "-")), &fs::read(fixtures.join(file))?)?;
    }
    Ok(())
}
