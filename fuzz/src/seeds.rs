//! Writes small sound files, one or more per reader, to begin with: `seeds FOLDER` makes `FOLDER/READER/*`.

use std::fs;
use std::path::Path;

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
const TILES: &str = r#"{"sizeup":"0.1.0","origin_m":[0,0,0],"heights_m":[1,99],"halo_m":9,"view_margin_m":3,"config":{"project":
    {"crs":"EPSG:25832"},"survey":{"path":"s"},"footprints":{"path":"f"},"terrain":{"constant_m":1.0},"prior":{"source":"stereo"}},
    "inputs":[],"renamed":{},"n_buildings":1,"n_views":1,"tiles":[{"id":"e0_n0","core":{"west_m":0,"south_m":0,"east_m":1,
    "north_m":1},"halo":{"west_m":0,"south_m":0,"east_m":1,"north_m":1},"n_buildings":1,"n_solved":1,"n_views":1,"memory_mb":9,
    "views_sha256":""}]}"#;
const CONFIG: &str = "seed = 3\n[project]\ncrs = \"EPSG:25832\"\n[survey]\npath = \"s\"\n[survey.csv]\nangles = \"ypr\"\n[footprints]\n\
    path = \"f.gpkg\"\n[terrain]\nconstant_m = 12.0\n[prior]\nsource = \"files\"\npath = \"d/{stem}.npy\"\nkind = \"depth\"\n";
const OPF: &str = r#"{"format":"application/opf-project+json","version":"1.0","id":"a","name":"p","items":[{"id":"b","type":
    "camera_list","resources":[{"uri":"project.opf","format":"application/opf-camera-list+json"}]},{"id":"c","type":"calibration",
    "resources":[{"uri":"project.opf","format":"application/opf-calibrated-cameras+json"}]}],"cameras":[{"id":1,"uri":"a.jpg"}],
    "sensors":[]}"#;

/// What cannot be written as text.
fn binaries() -> Vec<(&'static str, Vec<u8>)> {
    let number = |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
    let depths: Vec<f32> = (1..=12_u8).map(f32::from).collect();
    let mut npy = b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }".to_vec();
    npy.resize(127, b' ');
    npy.push(b'\n');
    npy.extend(number(&depths));
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
    let tiff = b"II*\0\x08\0\0\0\x02\0\0\x01\x04\0\x01\0\0\0\x28\0\0\0\x01\x01\x04\0\x01\0\0\0\x1e\0\0\0\0\0\0\0".to_vec();
    vec![
        ("npy", npy),
        ("pfm", [b"Pf\n4 3\n-1.0\n".to_vec(), number(&depths)].concat()),
        ("colmap_binary", images),
        ("las", las),
        ("photo", photo),
        ("photo_tiff", tiff),
    ]
}

/// Files that tests compare with, and a zipped one.
const FIXTURES: [(&str, &str); 1] = [("npz", "priors/da3_mini.npz")];

fn main() -> std::io::Result<()> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| "fuzz/corpus".to_owned());
    let texts = [
        ("colmap_text", "# i\n1 0 1 0 0 -5e5 57e5 100 1 a b.jpg\n1 2 -1\n2 0 1 0 0 -5e5 57e5 90 1 c.jpg\n\n"),
        ("colmap_cameras", "1 PINHOLE 40 30 30 30 20 15\n2 OPENCV_FISHEYE 40 30 30 30 20 15 1e-2 0 0 0\n"),
        ("blocks_exchange", BLOCK),
        ("metashape", METASHAPE),
        ("metashape_opk", "# PhotoID, X\na\t5e5\t57e5\t100\t1\t2\t3\t0.1\nb\t5e5\t57e5\t9\t1\t2\t3\n"),
        ("opensfm", SFM),
        ("odm", SHOTS),
        ("geo_txt", "EPSG:25832\na.jpg 5e5 57e5 100 10 20 3 0.1 0.2\nb.jpg 5e5 57e5\n"),
        ("pix4d", "h\nh\nh\nh\nh\nh\nh\nh\na.jpg 40 30\n30 0 20\n0 30 15\n0 0 1\n-0.1 0.02 0\n1e-4 0\n1 2 100\n1 0 0\n0 -1 0\n0 0 -1\n"),
        ("opf", OPF),
        ("csv", "name,x,y,z,omega,phi,kappa,width,height,fx,cx,k1\na,5e5,57e5,100,1,2,3,40,30,30,20,0.1\n\"b,c\",5,6,7,1,2,3\n"),
        ("cityjson", CITY),
        ("cityjson_sequence", SEQUENCE),
        ("geojson", LAYER),
        ("coco", COCO),
        ("tiles", TILES),
        ("config", CONFIG),
    ];
    let write = |reader: &str, bytes: &[u8]| {
        let folder = Path::new(&folder).join(reader);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join("seed"), bytes)
    };
    texts.iter().try_for_each(|(reader, text)| write(reader, text.as_bytes()))?;
    binaries().iter().try_for_each(|(reader, bytes)| write(reader, bytes))?;
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures");
    FIXTURES.iter().try_for_each(|(reader, file)| write(reader, &fs::read(fixtures.join(file))?))
}
