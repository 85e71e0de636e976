//! Model profiles: what a network wants and gives, as data.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::onnx::{Port, TensorContent, profiles};
use crate::prior::{PriorError, PriorKind};

/// How the photo is brought to the network's size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Fit {
    /// Longer side to `side_px`; area mean when shrinking, cubic when growing, on bytes; then each side to the
    /// nearest multiple, ties up (Depth Anything 3, `upper_bound_resize`).
    LongestSide,
    /// Shorter side to at least `side_px`, each side rounded to a multiple, one cubic resize on fractions
    /// (Depth Anything V2, `lower_bound`).
    ShortestSide,
    /// Largest that fits into `size_px`, linear on bytes, with `pad` around it; the result is cut accordingly (`Metric3D`).
    Letterbox,
    /// To `size_px` whatever its aspect, linear on normalised values (Depth Pro).
    Stretch,
}

/// Form of the depth output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// One number per pixel.
    #[default]
    Map,
    /// A point per pixel, `rows × columns × 3`; its third coordinate is the depth.
    Points,
}

/// Unit of lengths in the poses that a network takes, and in the depth that it gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PoseUnit {
    /// The median distance of the photos from the first one.
    #[default]
    MedianDistance,
    /// Metres, as the poses are given.
    Metre,
}

/// Which way the poses run that a network takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PoseDirection {
    /// From the world to the camera: `p_camera = R · p_world + t`.
    #[default]
    WorldToCamera,
    /// From the camera to the world: `t` is the projection centre.
    CameraToWorld,
}

/// Which photos a network takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Lens {
    /// As they were taken.
    #[default]
    AsTaken,
    /// As a camera without lens distortion would have taken them; the depth is laid back into the photo as taken.
    Ideal,
}

/// Several photos at once, with their poses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Company {
    /// How many photos, the view itself among them, where the graph does not say; at least 1.
    pub n_views: usize,
    /// Whether an image input of four dimensions holds photos that belong together, `n × 3 × rows × columns`, not a batch of single
    /// ones.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub photos_first: bool,
    /// Names of an input of poses, `1 × n × 4 × 4`, the first camera's as the world, in `unit`.
    #[serde(default)]
    pub extrinsics: Vec<String>,
    /// Direction of the poses that the network takes.
    #[serde(default, skip_serializing_if = "is_default")]
    pub direction: PoseDirection,
    /// Unit of the lengths in poses and depths that the network takes.
    #[serde(default)]
    pub unit: PoseUnit,
    /// Names of an input of the nearest and the farthest depth that is looked for in the view, `1 × 2`, in `unit`. A network
    /// that has it matches photos, and needs one neighbour at least.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub depth_range: Vec<String>,
    /// Names of an input of calibration matrices, `1 × n × 3 × 3`, in pixels of the resized photos.
    #[serde(default)]
    pub intrinsics: Vec<String>,
    /// Names of an output of poses, world to camera, in the unit of the depth: `1 × n × 3 × 4`, `1 × n × 4 × 4`, or `1 × n × 9` as
    /// VGGT has them (translation, quaternion x y z w, two fields of view). Laid over the calibrated ones, they bring the depth to
    /// metres.
    #[serde(default)]
    pub poses_output: Vec<String>,
}

/// One kind of depth network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("x-expert" = true))]
pub struct Profile {
    /// Name in the configuration.
    pub name: String,
    /// Which network, and where its preprocessing was read.
    pub about: String,
    /// Names its image input goes by in known exports.
    pub inputs: Vec<String>,
    /// Names its depth output goes by.
    pub outputs: Vec<String>,
    /// Meaning of its numbers.
    pub kind: PriorKind,
    /// Form of the depth output.
    #[serde(default)]
    pub form: Form,
    /// Which photos it takes.
    #[serde(default)]
    pub lens: Lens,
    /// How the photo is resized.
    pub fit: Fit,
    /// Side that `fit` refers to, pixels.
    #[serde(default)]
    pub side_px: usize,
    /// Columns and rows that `fit` refers to, where the graph does not fix them, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size_px: Option<[usize; 2]>,
    /// Both sides are multiples of this, pixels: the patch size.
    #[serde(default = "one_pixel")]
    pub multiple_of: usize,
    /// Colour around a letterboxed photo, red, green and blue, 0 to 255.
    #[serde(default)]
    pub pad: [f32; 3],
    /// Full brightness before `mean` and `std` apply: 1, or 255 where the graph takes bytes' values.
    #[serde(default = "one")]
    pub white: f32,
    /// Subtracted from red, green and blue.
    pub mean: [f32; 3],
    /// Divided by after that.
    pub std: [f32; 3],
    /// Inputs that always get the same number.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub constants: BTreeMap<String, f32>,
    /// Further photos that it takes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub company: Option<Company>,
    /// Name of an output that tells sky, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sky_output: Option<String>,
    /// Where that output is above this, there is sky.
    #[serde(default)]
    pub sky_above: f32,
    /// Name of an output that tells where depth is to be believed, or how much, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask_output: Option<String>,
    /// Where that output is below this, there is no value.
    #[serde(default)]
    pub mask_least: f32,
    /// Focal length, pixels of the resized photo, at which the output is in metres; it grows in proportion to the real
    /// one. Left out where the output has no unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metres_at_focal_px: Option<f32>,
    /// Licence of its weights.
    pub licence: String,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

fn one() -> f32 {
    1.0
}

fn one_pixel() -> usize {
    1
}

/// The profiles that come with sizeup.
///
/// # Panics
/// Never: the text is part of the program and tested.
#[must_use]
pub fn built_in() -> Vec<Profile> {
    profiles(include_str!("profiles.toml")).expect("the built-in profiles are valid")
}

/// A built-in profile by name.
///
/// # Errors
/// [`PriorError::Config`] listing the names there are.
pub fn by_name(name: &str) -> Result<Profile, PriorError> {
    let all = built_in();
    let names: Vec<String> = all.iter().map(|p| p.name.clone()).collect();
    all.into_iter().find(|profile| profile.name == name).ok_or_else(|| PriorError::Config {
        problem: format!("no network profile {name:?}"),
        hint: format!("there are {}", names.join(", ")),
    })
}

/// The ports of a graph that a profile would use.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wiring {
    /// Name of the input that takes the image.
    pub input: String,
    /// Dimensions of the image input: 4 (batch or views, channel, row, column) or 5 (views after the batch).
    pub rank: usize,
    /// Photos that go in together, the view itself first.
    pub n_views: usize,
    /// Rows and columns where the graph fixes them.
    pub fixed_size: Option<(usize, usize)>,
    /// Inputs that get a constant.
    pub constants: Vec<String>,
    /// Input of poses, if the graph has it.
    pub extrinsics: Option<String>,
    /// Input of calibration matrices, if the graph has it.
    pub intrinsics: Option<String>,
    /// Input of the depths that are looked for, if the graph has it.
    pub depth_range: Option<String>,
    /// Name of the output that gives the depth.
    pub output: String,
    /// Sky output, if the graph has it.
    pub sky: Option<String>,
    /// Mask or confidence, if the graph has it.
    pub mask: Option<String>,
    /// Output of poses, if the graph has it.
    pub poses: Option<String>,
}

fn names(ports: &[Port]) -> String {
    ports.iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", ")
}

impl Profile {
    /// Whether its numbers can be worked with.
    ///
    /// # Errors
    /// [`PriorError::Config`] naming what is wrong.
    pub fn check(&self) -> Result<(), PriorError> {
        let is_known = |sides: &[usize]| sides.iter().all(|n| (1..=8192).contains(n));
        let problem = match self.fit {
            _ if !is_known(&[self.multiple_of]) => "`multiple_of` is out of range",
            Fit::LongestSide | Fit::ShortestSide if !is_known(&[self.side_px]) => "`side_px` is out of range",
            Fit::Letterbox | Fit::Stretch if !self.size_px.is_none_or(|size| is_known(&size)) => {
                "`size_px` is out of range"
            }
            _ if !self.std.iter().all(|s| *s > 0.0 && s.is_finite()) => "`std` has to be above 0",
            _ if !(self.white > 0.0 && self.white.is_finite()) => "`white` has to be above 0",
            _ if self.company.as_ref().is_some_and(|c| !(1..=64).contains(&c.n_views)) => "`n_views` is out of range",
            _ => return Ok(()),
        };
        Err(PriorError::Config {
            problem: format!("profile {:?}: {problem}", self.name),
            hint: "sides are 1 to 8192 pixels, views 1 to 64".to_owned(),
        })
    }

    /// Connection of this profile to a graph.
    ///
    /// # Errors
    /// What does not fit, in one sentence.
    pub fn wire(&self, inputs: &[Port], outputs: &[Port]) -> Result<Wiring, String> {
        let input = inputs
            .iter()
            .find(|port| self.inputs.contains(&port.name))
            .ok_or_else(|| format!("expected an input named {}, found {}", self.inputs.join(" or "), names(inputs)))?;
        let is_image = matches!(input.shape.len(), 4 | 5)
            && input.shape[input.shape.len() - 3].is_none_or(|n| n == 3)
            && input.numbers != TensorContent::Other;
        if !is_image {
            return Err(format!(
                "input {} has shape {}, expected batch × 3 × rows × columns",
                input.name,
                shape(input)
            ));
        }
        let pick = |wanted: &[String], ports: &[Port]| {
            ports.iter().find(|port| wanted.contains(&port.name)).map(|port| port.name.clone())
        };
        let of_company =
            |names: fn(&Company) -> &[String]| self.company.as_ref().and_then(|company| pick(names(company), inputs));
        let extrinsics = of_company(|c| &c.extrinsics);
        let intrinsics = of_company(|c| &c.intrinsics);
        let depth_range = of_company(|c| &c.depth_range);
        if let (Some(company), None) = (&self.company, &depth_range)
            && !company.depth_range.is_empty()
        {
            return Err(format!(
                "expected an input named {}, found {}",
                company.depth_range.join(" or "),
                names(inputs)
            ));
        }
        let is_fed = |port: &Port| {
            port.name == input.name
                || self.constants.contains_key(&port.name)
                || [&extrinsics, &intrinsics, &depth_range].into_iter().flatten().any(|name| *name == port.name)
        };
        if let Some(unfed) = inputs.iter().find(|port| !is_fed(port)) {
            return Err(format!("nothing is known of its input {}", unfed.name));
        }
        let output = pick(&self.outputs, outputs).ok_or_else(|| {
            format!("expected an output named {}, found {}", self.outputs.join(" or "), names(outputs))
        })?;
        let [.., rows, columns] = input.shape[..] else { return Err("input without rows and columns".to_owned()) };
        let constants = self.constants.keys().filter(|name| inputs.iter().any(|port| port.name == **name));
        let optional = |name: &Option<String>| name.clone().filter(|name| outputs.iter().any(|p| p.name == *name));
        Ok(Wiring {
            input: input.name.clone(),
            rank: input.shape.len(),
            n_views: self.n_views(input)?,
            fixed_size: rows.zip(columns),
            constants: constants.cloned().collect(),
            extrinsics,
            intrinsics,
            depth_range,
            output,
            sky: optional(&self.sky_output),
            mask: optional(&self.mask_output),
            poses: self.company.as_ref().and_then(|company| pick(&company.poses_output, outputs)),
        })
    }

    /// Number of photos that go in at once.
    fn n_views(&self, input: &Port) -> Result<usize, String> {
        let of_graph = match (&self.company, &input.shape[..]) {
            (_, [_, n, _, _, _]) | (Some(Company { photos_first: true, .. }), [n, ..]) => *n,
            _ => Some(1),
        };
        match (&self.company, of_graph) {
            (Some(_), Some(n)) => Ok(n),
            (Some(company), None) => Ok(company.n_views),
            (None, Some(n)) if n > 1 => Err(format!("it takes {n} photos at once, expected one")),
            (None, _) => Ok(1),
        }
    }
}

fn shape(port: &Port) -> String {
    let lengths = port.shape.iter().map(|n| n.map_or_else(|| "?".to_owned(), |n| n.to_string()));
    lengths.collect::<Vec<_>>().join(" × ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_profiles_are_valid_and_distinct() {
        let all = built_in();
        for profile in &all {
            profile.check().unwrap();
            assert_eq!(by_name(&profile.name).unwrap(), *profile);
            assert!(profile.fit == Fit::Letterbox || profile.fit == Fit::Stretch || profile.side_px >= 14);
        }
        assert!(by_name("da4").unwrap_err().to_string().contains("depth-anything-v2"));
    }

    /// Ports as the exports that design/models.md lists declare them.
    #[test]
    fn profiles_fit_the_known_exports() {
        let any = None;
        let image = |shape: &[Option<usize>]| Port::floats("image", shape);
        let of = |name: &str, inputs: &[Port], outputs: &[&str]| {
            let outputs: Vec<Port> = outputs.iter().map(|name| Port::floats(name, &[])).collect();
            by_name(name).unwrap().wire(inputs, &outputs)
        };
        let da3 = [image(&[Some(1), Some(3), Some(280), Some(504)])];
        let wiring = of("da3-metric", &da3, &["depth", "sky"]).unwrap();
        assert_eq!((wiring.fixed_size, wiring.sky.as_deref()), (Some((280, 504)), Some("sky")));
        let many = [Port::floats("pixel_values", &[any, any, Some(3), any, any])];
        let outputs = ["predicted_depth", "confidence", "extrinsics", "intrinsics"];
        let wiring = of("da3-anyview", &many, &outputs).unwrap();
        assert_eq!((wiring.rank, wiring.n_views, wiring.extrinsics), (5, 4, None));
        assert_eq!(wiring.poses.as_deref(), Some("extrinsics"));
        assert_eq!(of("da3-anyview", &[image(&[any, Some(2), Some(3), any, any])], &["depth"]).unwrap().n_views, 2);
        assert!(of("da3-mono", &[image(&[any, Some(2), Some(3), any, any])], &["depth"]).is_err());
        let moge = [image(&[any, Some(3), any, any]), Port::floats("num_tokens", &[])];
        let wiring = of("moge", &moge, &["points", "normal", "mask", "metric_scale"]).unwrap();
        assert_eq!(
            (wiring.constants.as_slice(), wiring.mask.as_deref()),
            (&["num_tokens".to_owned()][..], Some("mask"))
        );
        assert!(of("depth-anything-v2", &moge, &["depth"]).unwrap_err().contains("num_tokens"));
        let pixels = [Port::floats("pixel_values", &[any, Some(3), any, any])];
        assert!(of("depth-pro", &pixels, &["predicted_depth", "focallength_px"]).is_ok());
        let outputs = ["pred_depth", "pred_normal"];
        // VGGT by its authors' names, and with photos in the first dimension, as others export it.
        let poses = ["depth", "depth_conf", "pose_enc"];
        let wiring = of("vggt", &[Port::floats("images", &[Some(1), any, Some(3), any, any])], &poses).unwrap();
        assert_eq!((wiring.rank, wiring.n_views, wiring.poses.as_deref()), (5, 4, Some("pose_enc")));
        let wiring = of("vggt", &[Port::floats("input_images", &[Some(6), Some(3), any, any])], &poses).unwrap();
        assert_eq!((wiring.rank, wiring.n_views), (4, 6));
        assert!(of("itermvs", &[Port::floats("images", &[Some(1), any, Some(3), any, any])], &poses).is_err());
        let posed = [
            Port::floats("images", &[Some(1), Some(4), Some(3), Some(392), Some(518)]),
            Port::floats("camera_poses", &[]),
            Port::floats("intrinsics", &[]),
        ];
        let wiring = of("map-anything", &posed, &["depth_z", "conf", "non_ambiguous_mask"]).unwrap();
        assert_eq!(
            (wiring.extrinsics.as_deref(), wiring.mask.as_deref()),
            (Some("camera_poses"), Some("non_ambiguous_mask"))
        );
        assert!(of("vggt", &posed, &["depth_z"]).is_err(), "nothing is known of its poses");
        assert!(of("metric3d", &[image(&[Some(1), Some(3), Some(616), Some(1064)])], &outputs).is_ok());
    }
}
