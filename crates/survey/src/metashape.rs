//! Agisoft Metashape: `cameras.xml`, and the text export of omega, phi, kappa.
//!
//! A camera's `transform` is camera to chunk, row-major 4 × 4, axes ours. The chunk's own transform (rotation,
//! translation, scale) leads to earth-centred coordinates (EPSG:4978) where the chunk is referenced in a CRS, else the
//! chunk is local. A component may carry a transform in the chunk's place. Calibration:
//!
//! ```text
//! x_d = x (1 + K1 r² + K2 r⁴ + K3 r⁶ + K4 r⁸) + P1 (r² + 2x²) + 2 P2 x y
//! u = w/2 + cx + x_d f + x_d B1 + y_d B2,   v = h/2 + cy + y_d f
//! ```
//!
//! Files of `PhotoScan` before `f` have two focal lengths, the principal point from the top-left corner, a skew in pixels, and
//! P1 and P2 in the other order:
//!
//! ```text
//! x_d = x (1 + …) + P2 (r² + 2x²) + 2 P1 x y,   u = cx + x_d fx + y_d skew,   v = cy + y_d fy
//! ```
//!
//! Source: Agisoft Metashape manual, appendix "Camera models", and that of older `PhotoScan` manuals. The reference frame
//! of `EPSG:4978` follows from files.

use std::collections::BTreeMap;
use std::fs::File;
use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::angles::{nearest_rotation, rows};
use super::blocks_exchange::{is_tangential, tangential_order_assumed};
use super::config::TangentialOrder;
use super::formats::FileMarks;
use super::heights::FileUnits;
use super::poses::{Pose, Poses, World};
use super::xml::{Element, Xml, XmlStep};
use super::{SurveyConfig, SurveyError};
use sizeup_geo::crs::Crs;
use sizeup_geo::files::FileError;
use sizeup_heights::camera::{Camera, Distortion};

/// A similarity `p_world = s·R·p + t`.
#[derive(Debug, Clone, Copy)]
struct Similarity {
    rotation: DMat3,
    translation: DVec3,
    scale: f64,
}

/// A camera before its chunk is known as a whole.
struct MetashapeCamera {
    label: String,
    sensor: String,
    component: Option<String>,
    transform: Option<Vec<f64>>,
}

/// A file with a document and a chunk in its first bytes.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    marks.head.contains("<document") && marks.head.contains("<chunk")
}

/// Reads all chunks of a `cameras.xml`.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    let path = config.path.as_path();
    let file = File::open(path).map_err(FileError::on("cannot open", path))?;
    let mut xml = Xml::new(file, path);
    let mut poses = Poses { units: FileUnits::ONE_SCALE, ..Poses::new() };
    let mut chunk = Chunk::default();
    loop {
        match xml.step()? {
            XmlStep::Start(start) => match start.name.as_str() {
                "document" | "sensors" | "cameras" | "components" | "group" => {}
                "chunk" => chunk = Chunk::default(),
                "sensor" => {
                    let sensor = xml.element(start)?;
                    let id = sensor.attribute("id").unwrap_or_default().to_owned();
                    let camera = camera_of(&sensor, config.tangential.unwrap_or_default());
                    let is_assumed = camera.as_ref().is_ok_and(|(camera, is_old)| *is_old && is_tangential(camera));
                    if is_assumed && config.tangential.is_none() && poses.issues.is_empty() {
                        poses.issues.push(tangential_order_assumed(path));
                    }
                    chunk.sensors.insert(id, camera.map(|(camera, _)| Arc::new(camera)));
                }
                "component" => {
                    let component = xml.element(start)?;
                    if let Some(transform) = component.child("transform") {
                        let similarity = similarity(transform).map_err(|e| xml.error(e))?;
                        chunk.components.insert(component.attribute("id").unwrap_or_default().to_owned(), similarity);
                    }
                }
                "camera" => chunk.shots.push(shot(&xml.element(start)?).map_err(|e| xml.error(e))?),
                "transform" => {
                    let transform = xml.element(start)?;
                    chunk.transform = Some(similarity(&transform).map_err(|e| xml.error(e))?);
                }
                "reference" => chunk.reference = Some(xml.element(start)?.text.trim().to_owned()),
                _ => {
                    xml.element(start)?;
                }
            },
            XmlStep::End(name) if name == "chunk" => std::mem::take(&mut chunk).finish(&mut poses, &xml)?,
            XmlStep::End(_) => {}
            XmlStep::Done => return Ok(poses),
        }
    }
}

/// One chunk, gathered before its cameras are placed: the transforms stand behind them in the file.
#[derive(Default)]
struct Chunk {
    sensors: BTreeMap<String, Result<Arc<Camera>, String>>,
    components: BTreeMap<String, Similarity>,
    shots: Vec<MetashapeCamera>,
    transform: Option<Similarity>,
    reference: Option<String>,
}

impl Chunk {
    fn finish<R: std::io::Read>(self, poses: &mut Poses, xml: &Xml<R>) -> Result<(), SurveyError> {
        if self.shots.is_empty() {
            return Ok(());
        }
        let is_local = self.reference.as_deref().is_some_and(|wkt| wkt.starts_with("LOCAL"));
        let is_referenced = (self.transform.is_some() || !self.components.is_empty()) && !is_local;
        let world = if is_referenced { World::Crs(Crs::parse("EPSG:4978")?) } else { World::Unsaid };
        if !poses.poses.is_empty() && poses.world != world {
            return Err(xml
                .error("its chunks are in different worlds, referenced and local")
                .hint("export one chunk at a time"));
        }
        poses.world = world;
        for shot in self.shots {
            let name = shot.label;
            let Some(matrix) = shot.transform else {
                poses.refuse("photo_without_pose", &name, "the camera is not aligned: it has no transform");
                continue;
            };
            let camera = match self.sensors.get(&shot.sensor) {
                Some(Ok(camera)) => Arc::clone(camera),
                Some(Err(reason)) => {
                    poses.refuse("camera_unusable", &name, reason.clone());
                    continue;
                }
                None => {
                    poses.refuse("camera_unknown", &name, format!("its sensor {} is not in the file", shot.sensor));
                    continue;
                }
            };
            let component = shot.component.and_then(|id| self.components.get(&id).copied());
            match placed(&matrix, component.or(self.transform)) {
                Ok((camera_from_world, centre)) => {
                    poses.poses.push(Pose { name, camera, camera_from_world, centre });
                }
                Err(reason) => poses.refuse("pose_unusable", &name, reason),
            }
        }
        Ok(())
    }
}

fn placed(matrix: &[f64], chunk: Option<Similarity>) -> Result<(DMat3, DVec3), String> {
    let m: [f64; 16] =
        matrix.try_into().map_err(|_| format!("a transform of {} numbers: expected 16", matrix.len()))?;
    let chunk_from_camera = nearest_rotation(rows([m[0], m[1], m[2]], [m[4], m[5], m[6]], [m[8], m[9], m[10]]))?;
    let centre_in_chunk = DVec3::new(m[3], m[7], m[11]);
    let Some(Similarity { rotation, translation, scale }) = chunk else {
        return Ok((chunk_from_camera.transpose(), centre_in_chunk));
    };
    Ok(((rotation * chunk_from_camera).transpose(), scale * (rotation * centre_in_chunk) + translation))
}

fn shot(camera: &Element) -> Result<MetashapeCamera, String> {
    let is_enabled = !matches!(camera.attribute("enabled"), Some("0" | "false"));
    let transform = camera.child("transform").filter(|_| is_enabled).map(Element::numbers).transpose()?;
    let text = |name: &str| camera.attribute(name).map(str::to_owned);
    Ok(MetashapeCamera {
        label: text("label").unwrap_or_else(|| format!("camera {}", camera.attribute("id").unwrap_or("without id"))),
        sensor: text("sensor_id").unwrap_or_default(),
        component: text("component_id"),
        transform,
    })
}

fn similarity(transform: &Element) -> Result<Similarity, String> {
    if transform.child("rotation").is_none() && transform.children.is_empty() {
        return similarity_of_matrix(&transform.numbers()?);
    }
    let numbers = |name: &str, n: usize| -> Result<Option<Vec<f64>>, String> {
        let Some(child) = transform.child(name) else { return Ok(None) };
        let numbers = child.numbers()?;
        if numbers.len() == n {
            Ok(Some(numbers))
        } else {
            Err(format!("<{name}> has {} numbers: expected {n}", numbers.len()))
        }
    };
    let rotation = match numbers("rotation", 9)? {
        Some(m) => nearest_rotation(rows([m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]))?,
        None => DMat3::IDENTITY,
    };
    let translation = numbers("translation", 3)?.map_or(DVec3::ZERO, |t| DVec3::new(t[0], t[1], t[2]));
    let scale = numbers("scale", 1)?.map_or(1.0, |s| s[0]);
    if scale <= 0.0 {
        return Err(format!("the chunk's scale is {scale}: expected a positive number"));
    }
    Ok(Similarity { rotation, translation, scale })
}

/// Older files: one 4 × 4 matrix with the scale inside.
fn similarity_of_matrix(m: &[f64]) -> Result<Similarity, String> {
    let m: [f64; 16] = m.try_into().map_err(|_| format!("a chunk transform of {} numbers: expected 16", m.len()))?;
    let scaled = rows([m[0], m[1], m[2]], [m[4], m[5], m[6]], [m[8], m[9], m[10]]);
    let scale = scaled.determinant().cbrt();
    if scale.is_nan() || scale <= 0.0 {
        return Err("the chunk's transform is no similarity".to_owned());
    }
    Ok(Similarity {
        rotation: nearest_rotation(scaled * (1.0 / scale))?,
        translation: DVec3::new(m[3], m[7], m[11]),
        scale,
    })
}

/// The adjusted calibration of a sensor, else its first one, and whether it is one of the old form, whose P1 and P2 are in the
/// order `tangential`.
fn camera_of(sensor: &Element, tangential: TangentialOrder) -> Result<(Camera, bool), String> {
    let calibration = sensor
        .all("calibration")
        .find(|c| c.attribute("class") == Some("adjusted"))
        .or_else(|| sensor.child("calibration"))
        .ok_or("the sensor has no calibration")?;
    let resolution = calibration.child("resolution").or_else(|| sensor.child("resolution"));
    let side = |name: &str| {
        let text = resolution.and_then(|r| r.attribute(name)).ok_or("the sensor has no resolution")?;
        text.parse::<u32>().map_err(|_| format!("resolution {name} is {text:?}: expected pixels"))
    };
    let (width_px, height_px) = (side("width")?, side("height")?);
    let number = |name: &str| calibration.number(name).map(|value| value.unwrap_or(0.0));
    let is_old = calibration.child("f").is_none();
    let middle_px = (f64::from(width_px) / 2.0, f64::from(height_px) / 2.0);
    let from_corner = |name: &str, middle_px: f64| calibration.number(name).map(|value| value.unwrap_or(middle_px));
    let (fx_px, fy_px, cx_px, cy_px, skew_px) = if is_old {
        let fx_px = calibration.number("fx")?.ok_or("the calibration has no focal length")?;
        let fy_px = calibration.number("fy")?.unwrap_or(fx_px);
        (fx_px, fy_px, from_corner("cx", middle_px.0)?, from_corner("cy", middle_px.1)?, number("skew")?)
    } else {
        let focal_px = number("f")?;
        let centre_px = (middle_px.0 + number("cx")?, middle_px.1 + number("cy")?);
        (focal_px + number("b1")?, focal_px, centre_px.0, centre_px.1, number("b2")?)
    };
    let [k1, k2, k3, k4] = [number("k1")?, number("k2")?, number("k3")?, number("k4")?];
    if number("p3")? != 0.0 || number("p4")? != 0.0 {
        return Err("tangential terms p3, p4 are not supported: undistort the photos, or calibrate without".to_owned());
    }
    let order = if is_old { tangential } else { TangentialOrder::Metashape };
    let [p1, p2] = order.opencv([number("p1")?, number("p2")?]);
    let distortion = match calibration.attribute("type").or_else(|| sensor.attribute("type")).unwrap_or("frame") {
        "frame" if k4 == 0.0 && skew_px == 0.0 => Distortion::brown([k1, k2, k3], [p1, p2]),
        "frame" => Distortion::BrownAffine { k1, k2, k3, k4, p1, p2, skew: skew_px / fx_px },
        "fisheye" | "equidistant_fisheye" => {
            if p1 != 0.0 || p2 != 0.0 || skew_px != 0.0 {
                return Err("a fisheye with tangential or skew terms is not supported: undistort the photos".to_owned());
            }
            Distortion::Fisheye { k1, k2, k3, k4 }
        }
        other => return Err(format!("sensor type {other} is not supported: expected frame or fisheye")),
    };
    let camera = Camera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, distortion };
    camera.validate().map_err(|e| e.to_string())?;
    Ok((camera, is_old))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera whose sensor has this calibration, in an encoding of its declaration.
    fn read_calibration(calibration: &str, tangential: Option<TangentialOrder>) -> Poses {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cameras.xml");
        let xml = format!(
            "<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?><document version=\"1.2.0\"><chunk><sensors><sensor id=\"0\" type=\"frame\">\
             <resolution width=\"320\" height=\"240\"/><calibration type=\"frame\" class=\"adjusted\">{calibration}</calibration></sensor>\
             </sensors><cameras><camera id=\"0\" sensor_id=\"0\" label=\"Straße\"><transform>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform>\
             </camera></cameras></chunk></document>"
        );
        let latin_1: Vec<u8> = xml.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
        std::fs::write(&path, latin_1).unwrap();
        read(&SurveyConfig { tangential, ..SurveyConfig::at(path) }).unwrap()
    }

    #[test]
    fn photoscans_calibration_has_two_focal_lengths_and_its_principal_point_from_the_corner() {
        let old = "<fx>300</fx><fy>294</fy><cx>147.5</cx><cy>127.25</cy><skew>3</skew><k1>0.1</k1>";
        let poses = read_calibration(old, None);
        let pose = &poses.poses[0];
        assert_eq!(pose.name, "Straße");
        let camera = &pose.camera;
        assert_eq!((camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px), (300.0, 294.0, 147.5, 127.25));
        let expected = Distortion::BrownAffine { k1: 0.1, k2: 0.0, k3: 0.0, k4: 0.0, p1: 0.0, p2: 0.0, skew: 0.01 };
        assert_eq!(camera.distortion, expected);
        assert_eq!(poses.issues, []);
        let without = read_calibration("<fx>300</fx>", None);
        let camera = &without.poses[0].camera;
        assert_eq!((camera.fy_px, camera.cx_px, camera.cy_px), (300.0, 160.0, 120.0));
    }

    #[test]
    fn the_order_of_photoscans_tangential_terms_is_told_or_declared() {
        let old = "<fx>300</fx><fy>300</fy><p1>0.001</p1><p2>0.002</p2>";
        let terms = |poses: &Poses| match poses.poses[0].camera.distortion {
            Distortion::Brown { p1, p2, .. } => (p1, p2),
            ref other => panic!("{other:?}"),
        };
        let assumed = read_calibration(old, None);
        assert_eq!((terms(&assumed), assumed.issues[0].code.as_str()), ((0.001, 0.002), "tangential_order_assumed"));
        let declared = read_calibration(old, Some(TangentialOrder::Metashape));
        assert_eq!((terms(&declared), declared.issues.len()), ((0.002, 0.001), 0));
        let new = read_calibration("<f>300</f><cx>1</cx><cy>-2</cy><p1>0.001</p1><p2>0.002</p2>", None);
        assert_eq!((terms(&new), new.issues.len()), ((0.002, 0.001), 0));
        assert_eq!((new.poses[0].camera.cx_px, new.poses[0].camera.cy_px), (161.0, 118.0));
    }
}
