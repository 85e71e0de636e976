//! Agisoft Metashape: `cameras.xml`, and the text export of omega, phi, kappa.
//!
//! A camera's `transform` is camera to chunk, row-major 4 × 4, axes ours. The chunk's own transform (rotation,
//! translation, scale) leads to earth-centred coordinates (EPSG:4978) where the chunk is referenced in a CRS, else the
//! chunk is local. A component may carry a transform in the chunk's place.
//!
//! Rigs: the other cameras of a shot name its first one (`master_id`) and have no `transform`; their sensor has `rotation` R
//! (3 × 3, row-major) and `location` t (absent: 0), the sensor's camera to that of its master, in the chunk's unit:
//!
//! ```text
//! chunk_from_camera = chunk_from_master · [R t]
//! ```
//!
//! Sources that agree on the direction: Meta's reader of its captures with rigs of 9 and 22 cameras (`slave2master`, in the
//! chunk's unit); the Metashape Expert Manual (rotation slave to master, location in the master's frame); a converter that writes
//! such files (a sensor that looks 36° to the right has (sin 36°, 0, cos 36°) as third column).
//!
//! Calibration:
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

use std::collections::{BTreeMap, BTreeSet};
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
    is_enabled: bool,
    transform: Option<Vec<f64>>,
    /// The camera itself, and the one that it is mounted with.
    id: String,
    master: Option<String>,
    /// Labels of the groups that it is in, outermost first.
    groups: Vec<String>,
}

/// The way from the camera of a rig's sensor to that of its master, in the chunk's unit.
#[derive(Debug, Clone)]
struct Mounting {
    master_sensor: String,
    master_from_camera: Result<(DMat3, DVec3), String>,
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
    let mut groups: Vec<String> = Vec::new();
    loop {
        match xml.step()? {
            XmlStep::Start(start) => match start.name.as_str() {
                "document" | "sensors" | "cameras" | "components" => {}
                "group" => groups.push(start.attribute("label").unwrap_or_default().to_owned()),
                "chunk" => chunk = Chunk::default(),
                "sensor" => {
                    let sensor = xml.element(start)?;
                    let id = sensor.attribute("id").unwrap_or_default().to_owned();
                    let label = sensor.attribute("label").unwrap_or_default().to_owned();
                    chunk.sensor_labels.insert(id.clone(), label);
                    chunk.mountings.extend(mounting(&sensor).map(|mounting| (id.clone(), mounting)));
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
                "camera" => chunk.shots.push(shot(&xml.element(start)?, &groups).map_err(|e| xml.error(e))?),
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
            XmlStep::End(name) if name == "group" => drop(groups.pop()),
            XmlStep::End(_) => {}
            XmlStep::Done => return Ok(poses),
        }
    }
}

/// One chunk, gathered before its cameras are placed: the transforms stand behind them in the file.
#[derive(Default)]
struct Chunk {
    sensors: BTreeMap<String, Result<Arc<Camera>, String>>,
    sensor_labels: BTreeMap<String, String>,
    mountings: BTreeMap<String, Mounting>,
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
        let by_id: BTreeMap<&str, &MetashapeCamera> = self.shots.iter().map(|shot| (shot.id.as_str(), shot)).collect();
        for (shot, name) in self.shots.iter().zip(self.names()) {
            let ChunkPose { rigid, counted_by } = match self.pose_of(shot, &by_id) {
                Ok(pose) => pose,
                Err((code, reason)) => {
                    poses.refuse(code, &name, reason);
                    continue;
                }
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
            let component = counted_by.component.as_ref().and_then(|id| self.components.get(id).copied());
            let (camera_from_world, centre) = placed(rigid, component.or(self.transform));
            poses.poses.push(Pose { name, camera, camera_from_world, centre });
        }
        Ok(())
    }

    /// The pose of a camera in the chunk: its own, or by that of the camera that it is mounted with.
    fn pose_of<'a>(
        &'a self,
        shot: &'a MetashapeCamera,
        by_id: &BTreeMap<&str, &'a MetashapeCamera>,
    ) -> Result<ChunkPose<'a>, (&'static str, String)> {
        let unusable = |reason: String| ("pose_unusable", reason);
        let no_rig = |reason: String| unusable(format!("rigs are not read: {reason}"));
        let not_aligned = ("photo_without_pose", "the camera is not aligned: it has no transform".to_owned());
        if !shot.is_enabled {
            return Err(not_aligned);
        }
        if let Some(matrix) = &shot.transform {
            return Ok(ChunkPose { rigid: rigid(matrix).map_err(unusable)?, counted_by: shot });
        }
        let master_id = shot.master.as_deref().filter(|id| *id != shot.id).ok_or(not_aligned)?;
        let master = *by_id
            .get(master_id)
            .ok_or_else(|| no_rig(format!("its master, camera {master_id}, is not in the file")))?;
        let label = &master.label;
        let matrix = master
            .transform
            .as_ref()
            .ok_or_else(|| ("photo_without_pose", format!("its master {label} is not aligned: it has no transform")))?;
        let mounting = self.mountings.get(&shot.sensor).filter(|mounting| mounting.master_sensor == master.sensor);
        let mounting = mounting.ok_or_else(|| {
            no_rig(format!(
                "its sensor {} is not mounted on sensor {} of its master {label}",
                shot.sensor, master.sensor
            ))
        })?;
        let (rotation, location) = mounting
            .master_from_camera
            .clone()
            .map_err(|reason| no_rig(format!("{reason} (its master is {label})")))?;
        let (chunk_from_master, centre) = rigid(matrix).map_err(unusable)?;
        let rigid = (chunk_from_master * rotation, centre + chunk_from_master * location);
        Ok(ChunkPose { rigid, counted_by: master })
    }

    /// Names of the photos. A label has no folder: where several cameras share one, their groups, or groups and sensors, tell
    /// them apart.
    fn names(&self) -> Vec<String> {
        let folders: [fn(&Self, &MetashapeCamera) -> Vec<String>; 3] = [
            |_, _| Vec::new(),
            |_, shot| shot.groups.clone(),
            |chunk, shot| shot.groups.iter().chain(chunk.sensor_labels.get(&shot.sensor)).cloned().collect(),
        ];
        let mut ways =
            folders.map(|folders| self.shots.iter().map(move |shot| shot.named(&folders(self, shot))).collect());
        let is_posed = |shot: &MetashapeCamera| shot.is_enabled && (shot.transform.is_some() || shot.master.is_some());
        let is_distinct = |names: &Vec<String>| {
            let mut found = BTreeSet::new();
            self.shots.iter().zip(names).filter(|(shot, _)| is_posed(shot)).all(|(_, name)| found.insert(name))
        };
        let way = ways.iter().position(is_distinct).unwrap_or(0);
        std::mem::take(&mut ways[way])
    }
}

/// A camera's pose in the chunk, and the camera in whose component it is counted.
struct ChunkPose<'a> {
    rigid: (DMat3, DVec3),
    counted_by: &'a MetashapeCamera,
}

impl MetashapeCamera {
    /// The label below folders; a label that is a path has its own.
    fn named(&self, folders: &[String]) -> String {
        if self.label.contains(['/', '\\']) {
            return self.label.clone();
        }
        let folders = folders.iter().map(|folder| folder.replace(['/', '\\'], "_")).filter(|folder| !folder.is_empty());
        folders.chain([self.label.clone()]).collect::<Vec<String>>().join("/")
    }
}

/// Rotation and centre of a camera's 4 × 4 matrix.
fn rigid(matrix: &[f64]) -> Result<(DMat3, DVec3), String> {
    let m: [f64; 16] =
        matrix.try_into().map_err(|_| format!("a transform of {} numbers: expected 16", matrix.len()))?;
    let rotation = nearest_rotation(rows([m[0], m[1], m[2]], [m[4], m[5], m[6]], [m[8], m[9], m[10]]))?;
    Ok((rotation, DVec3::new(m[3], m[7], m[11])))
}

fn placed((chunk_from_camera, centre_in_chunk): (DMat3, DVec3), chunk: Option<Similarity>) -> (DMat3, DVec3) {
    let Some(Similarity { rotation, translation, scale }) = chunk else {
        return (chunk_from_camera.transpose(), centre_in_chunk);
    };
    ((rotation * chunk_from_camera).transpose(), scale * (rotation * centre_in_chunk) + translation)
}

/// How a sensor is mounted on another one; `None` where it is not.
fn mounting(sensor: &Element) -> Option<Mounting> {
    let master_sensor = sensor.attribute("master_id").filter(|id| Some(*id) != sensor.attribute("id"))?.to_owned();
    Some(Mounting { master_sensor, master_from_camera: master_from_camera(sensor) })
}

fn master_from_camera(sensor: &Element) -> Result<(DMat3, DVec3), String> {
    let rotation = sensor.child("rotation").ok_or("its sensor has no <rotation> to that of its master")?;
    let m: [f64; 9] = numbers_of(rotation)?;
    let rotation = nearest_rotation(rows([m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]))?;
    let location = sensor.child("location").or_else(|| sensor.child("translation"));
    Ok((rotation, location.map(numbers_of::<3>).transpose()?.map_or(DVec3::ZERO, DVec3::from)))
}

fn numbers_of<const N: usize>(element: &Element) -> Result<[f64; N], String> {
    let numbers = element.numbers()?;
    let n = numbers.len();
    numbers.try_into().map_err(|_| format!("<{}> has {n} numbers: expected {N}", element.name))
}

fn shot(camera: &Element, groups: &[String]) -> Result<MetashapeCamera, String> {
    let text = |name: &str| camera.attribute(name).map(str::to_owned);
    let is_enabled = !matches!(camera.attribute("enabled"), Some("0" | "false"));
    Ok(MetashapeCamera {
        label: text("label").unwrap_or_else(|| format!("camera {}", camera.attribute("id").unwrap_or("without id"))),
        sensor: text("sensor_id").unwrap_or_default(),
        component: text("component_id"),
        is_enabled,
        // That of a camera that is not used matters to those that are mounted with it alone.
        transform: camera
            .child("transform")
            .map(Element::numbers)
            .transpose()
            .or_else(|e| if is_enabled { Err(e) } else { Ok(None) })?,
        id: text("id").unwrap_or_default(),
        master: text("master_id"),
        groups: groups.to_vec(),
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

    /// A document of a master camera and one that is mounted with it, by the sensor and the camera of the second.
    fn rig(master: &str, sensor: &str, camera: &str) -> Result<Poses, SurveyError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cameras.xml");
        let lens = "<resolution width=\"400\" height=\"300\"/><calibration><f>500</f></calibration>";
        let document = format!(
            "<document version=\"2.0.0\"><chunk><sensors><sensor id=\"0\" type=\"frame\">{lens}</sensor>\
             <sensor id=\"1\" type=\"frame\" master_id=\"0\">{lens}{sensor}</sensor></sensors>\
             <components><component id=\"0\"><transform><rotation>0 -1 0 1 0 0 0 0 1</rotation><translation>10 20 30</translation>\
             <scale>2</scale></transform></component></components><cameras>{master}{camera}</cameras></chunk></document>"
        );
        std::fs::write(&path, document).unwrap();
        read(&SurveyConfig::at(path))
    }

    /// At (1, 2, 3) in the chunk, x along the chunk's y and y along its −x.
    const MASTER: &str = "<camera id=\"7\" sensor_id=\"0\" component_id=\"0\" label=\"nadir\"><transform>0 -1 0 1 1 0 0 2 0 0 1 3 \
                          0 0 0 1</transform></camera>";
    /// Looks 30° to the right of its master.
    const SENSOR: &str = "<rotation>0.8660254037844387 0 0.5 0 1 0 -0.5 0 0.8660254037844387</rotation>\
                          <location>0.5 0.25 0</location>";
    const CAMERA: &str = "<camera id=\"8\" sensor_id=\"1\" component_id=\"0\" master_id=\"7\" label=\"right\"/>";

    #[test]
    fn a_camera_of_a_rig_is_placed_by_its_master_and_its_sensor() {
        let poses = rig(MASTER, SENSOR, CAMERA).unwrap().poses;
        let [master, camera] = &poses[..] else { panic!("{poses:?}") };
        assert_eq!((master.name.as_str(), camera.name.as_str()), ("nadir", "right"));
        // The chunk turns by 90° and doubles. In it: 0.5 along the master's x and 0.25 along its y, from (1, 2, 3).
        assert!((master.centre - DVec3::new(10.0 - 4.0, 20.0 + 2.0, 36.0)).length() < 1e-12, "{}", master.centre);
        assert!((camera.centre - DVec3::new(10.0 - 5.0, 20.0 + 1.5, 36.0)).length() < 1e-12, "{}", camera.centre);
        // Straight on is (0.5, 0, 0.866) for the master: 0.5 along its x, which is the chunk's y and the world's −x.
        let axis = camera.camera_from_world.transpose() * DVec3::Z;
        assert!((axis - DVec3::new(-0.5, 0.0, 0.75_f64.sqrt())).length() < 1e-12, "{axis}");
        // A document without a location has both in one place; other versions call it a translation.
        let together = rig(MASTER, SENSOR.split("<location>").next().unwrap(), CAMERA).unwrap().poses;
        assert_eq!(together[1].centre, together[0].centre);
        let renamed = rig(MASTER, &SENSOR.replace("location", "translation"), CAMERA).unwrap().poses;
        assert_eq!(renamed[1].centre, camera.centre);
        // A master that is not used itself still says where its camera is.
        let of_disabled = rig(&MASTER.replace("id=\"7\"", "id=\"7\" enabled=\"false\""), SENSOR, CAMERA).unwrap();
        assert_eq!((of_disabled.poses.len(), of_disabled.issues.len()), (1, 1));
        assert_eq!(of_disabled.poses[0].centre, camera.centre);
    }

    #[test]
    fn a_rig_that_cannot_be_read_is_refused_with_its_master() {
        let unaligned = "<camera id=\"7\" sensor_id=\"0\" label=\"nadir\"/>";
        for (master, sensor, camera, expected) in [
            (
                MASTER,
                "",
                CAMERA,
                "rigs are not read: its sensor has no <rotation> to that of its master (its master is nadir)",
            ),
            (MASTER, "<rotation>1 2</rotation>", CAMERA, "rigs are not read: <rotation> has 2 numbers: expected 9"),
            (
                MASTER,
                SENSOR,
                &CAMERA.replace("sensor_id=\"1\"", "sensor_id=\"0\""),
                "is not mounted on sensor 0 of its master nadir",
            ),
            (
                MASTER,
                SENSOR,
                &CAMERA.replace("master_id=\"7\"", "master_id=\"6\""),
                "its master, camera 6, is not in the file",
            ),
            (unaligned, SENSOR, CAMERA, "its master nadir is not aligned"),
        ] {
            let poses = rig(master, sensor, camera).unwrap();
            let last = poses.issues.last().unwrap();
            assert!(last.message.contains(expected), "{}", last.message);
            assert!(poses.poses.iter().all(|pose| pose.name == "nadir"));
        }
    }
}
