//! Reading 100,000 poses: parsed, checked, moved to another zone with grid convergence per camera; headers of photos.

use std::fmt::Write as _;
use std::fs;
use std::hint::black_box;
use std::path::Path;

use criterion::Criterion;
use sizeup::crs::Crs;
use sizeup::survey::{self, SurveyConfig};

const N_POSES: usize = 100_000;
const N_PHOTOS: usize = 1000;

fn centre(i: usize) -> [f64; 3] {
    [690_000.0 + (i % 400) as f64 * 20.0, 5_760_000.0 + (i / 400) as f64 * 20.0, 210.0]
}

fn write_colmap(folder: &Path) {
    let mut images = String::new();
    for i in 0..N_POSES {
        // Quaternion 0 1 0 0 turns y and z: t = (−x, y, z) of the centre.
        let [x, y, z] = centre(i);
        writeln!(images, "{i} 0 1 0 0 {} {y} {z} 1 {i:06}.jpg\n12.5 13.5 -1 14.5 15.5 -1", -x).unwrap();
    }
    fs::write(folder.join("images.txt"), images).unwrap();
    fs::write(folder.join("cameras.txt"), "1 PINHOLE 4000 3000 3000 3000 2000 1500\n").unwrap();
}

fn write_blocks_exchange(path: &Path) {
    let mut xml = "<BlocksExchange><SpatialReferenceSystems><SRS><Id>0</Id><Definition>EPSG:25832</Definition></SRS>\
        </SpatialReferenceSystems><Block><SRSId>0</SRSId><Photogroups><Photogroup><ImageDimensions><Width>4000</Width>\
        <Height>3000</Height></ImageDimensions><FocalLengthPixels>3000</FocalLengthPixels>"
        .to_owned();
    let mut matrix = String::new();
    for (i, value) in [1, 0, 0, 0, -1, 0, 0, 0, -1].iter().enumerate() {
        write!(matrix, "<M_{0}{1}>{value}</M_{0}{1}>", i / 3, i % 3).unwrap();
    }
    for i in 0..N_POSES {
        let [x, y, z] = centre(i);
        write!(
            xml,
            "<Photo><Id>{i}</Id><ImagePath>C:/flight/{i:06}.jpg</ImagePath><Pose><Rotation>{matrix}</Rotation><Center>\
             <x>{x}</x><y>{y}</y><z>{z}</z></Center></Pose></Photo>"
        )
        .unwrap();
    }
    xml.push_str("</Photogroup></Photogroups></Block></BlocksExchange>");
    fs::write(path, xml).unwrap();
}

/// A JPEG of nothing but what its header tells.
fn write_photo(path: &Path, i: usize) {
    let packet = format!(
        "http://ns.adobe.com/xap/1.0/\0<x><r GpsLatitude=\"+52.{i:04}\" GpsLongitude=\"+11.5\" RtkFlag=\"50\" \
         AbsoluteAltitude=\"+150\" GimbalYawDegree=\"10\" GimbalPitchDegree=\"-60\" GimbalRollDegree=\"0\" \
         CalibratedFocalLength=\"3700\"/></x>"
    );
    let mut bytes = vec![0xFF, 0xD8, 0xFF, 0xE1];
    bytes.extend(u16::try_from(packet.len() + 2).unwrap().to_be_bytes());
    bytes.extend(packet.as_bytes());
    bytes.extend([0xFF, 0xC0, 0, 11, 8, 15, 116, 20, 160, 1, 0, 0, 0]);
    fs::write(path, bytes).unwrap();
}

fn read_1000_photos(c: &mut Criterion) {
    let folder = tempfile::tempdir().unwrap();
    for i in 0..N_PHOTOS {
        write_photo(&folder.path().join(format!("{i:04}.jpg")), i);
    }
    let mut config = SurveyConfig::at(folder.path());
    config.height.keep_ellipsoidal = true;
    let utm = Crs::parse("EPSG:25832").unwrap();
    c.bench_function("survey/headers of 1000 photos", |bencher| {
        bencher.iter(|| {
            let survey = survey::read(&config, &utm).unwrap();
            assert_eq!(survey.views.len(), N_PHOTOS);
            black_box(survey)
        });
    });
}

fn read_100_000_poses(c: &mut Criterion) {
    let folder = tempfile::tempdir().unwrap();
    write_colmap(folder.path());
    let block = folder.path().join("block.xml");
    write_blocks_exchange(&block);
    let zone_33 = Crs::parse("EPSG:25833").unwrap();
    let utm = Crs::parse("EPSG:25832").unwrap();
    let mut group = c.benchmark_group("survey");
    group.sample_size(10);
    for (name, path) in [("colmap_text", folder.path()), ("blocks_exchange", block.as_path())] {
        let config = SurveyConfig { crs: Some(utm.clone()), ..SurveyConfig::at(path) };
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                let survey = survey::read(&config, &zone_33).unwrap();
                assert_eq!(survey.views.len(), N_POSES);
                black_box(survey)
            });
        });
    }
    group.finish();
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    read_100_000_poses(&mut criterion);
    read_1000_photos(&mut criterion);
    criterion.final_summary();
}
