//! Where a photo looks, by the tags of its drone.
//!
//! ```text
//! gimbal  camera_from_ned = (Rz(yaw) Ry(pitch) Rx(roll) · [forward, right, down])ᵀ      pitch 0 looks to the horizon
//! below   camera_from_ned = (Rz(yaw) Ry(pitch) Rx(roll) · [down, right, back])ᵀ          pitch 0 looks straight down
//! ```
//!
//! A gimbal's roll turns the photo about its own axis, that of an aircraft with a camera below it tilts the view sideways. Yaw counts
//! clockwise from true north, positive pitch looks up, or forward.
//!
//! | tags | convention | by | sources |
//! |---|---|---|---|
//! | `GimbalYawDegree` …, any prefix | gimbal | DJI; Autel's newer firmware (`drone:`) | DJI's manuals; `OpenAthena` reads Autel's as DJI's |
//! | `drone-parrot:CameraYawDegree` … | gimbal | Parrot | values of real photos (−78° nearly straight down); `OpenAthena` |
//! | `drone-skydio:CameraOrientationNED` | gimbal | Skydio | Skydio, "Camera and metadata overview"; `OpenAthena` |
//! | `Camera:Yaw`, `Camera:Pitch`, `Camera:Roll` | below | Pix4D's namespace: senseFly, Sentera, Autel's older firmware, geotaggers | Pix4D, "Yaw, Pitch, Roll and Omega, Phi, Kappa angles"; `OpenSfM`'s and ODM's readers; `OpenAthena` (90° − pitch) |
//! | DJI's maker note | gimbal | DJI | see [`super`] |
//!
//! Parrot's own tags go before `Camera:`, as `OpenAthena` has it. Of senseFly's roll ODM changes the sign and `OpenSfM` does not: that
//! is remarked. All three angles are of one source.

use glam::DMat3;

use super::header::PhotoHeader;
use super::xmp::Tags;
use crate::angles::{AngleConvention, AngleKind, camera_below};
use exif::Tag;
use sizeup_geo::issue::{Issue, Severity, Subject};

/// Yaw, pitch and roll of a maker.
struct AngleTags {
    names: [&'static str; 3],
    convention: Convention,
}

/// Way from the angles to the direction of view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Convention {
    Gimbal,
    Below,
}

/// Names in XMP, in the order in which they are looked for.
const TAGS: [AngleTags; 4] = [
    AngleTags { names: ["GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree"], convention: Convention::Gimbal },
    AngleTags {
        names: ["drone-parrot:CameraYawDegree", "drone-parrot:CameraPitchDegree", "drone-parrot:CameraRollDegree"],
        convention: Convention::Gimbal,
    },
    AngleTags {
        names: [
            "drone-skydio:CameraOrientationNED/Yaw",
            "drone-skydio:CameraOrientationNED/Pitch",
            "drone-skydio:CameraOrientationNED/Roll",
        ],
        convention: Convention::Gimbal,
    },
    AngleTags { names: ["Camera:Yaw", "Camera:Pitch", "Camera:Roll"], convention: Convention::Below },
];

/// Tags of yaw, pitch and roll in DJI's maker note.
const MAKER_NOTE: [u16; 3] = [0x0A, 0x09, 0x0B];

/// Words in the names of tags that may tell where a photo looks.
const POSE_WORDS: [&str; 7] = ["yaw", "pitch", "roll", "heading", "orientation", "omega", "kappa"];

/// Where a photo looks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Direction {
    pub camera_from_world: DMat3,
    /// Angle of the optical axis above the horizon, degrees.
    pub pitch_deg: f64,
    /// Names of the tags, where they are not DJI's.
    pub foreign: Option<[&'static str; 3]>,
    /// Roll whose sign is doubtful, degrees.
    pub doubtful_roll_deg: Option<f64>,
}

/// The direction of view by the first complete set of angles.
pub(super) fn of(header: &PhotoHeader, tags: &Tags) -> Result<Direction, String> {
    for (i, AngleTags { names, convention }) in TAGS.iter().enumerate() {
        let mut angles = [None; 3];
        for (angle, name) in angles.iter_mut().zip(names) {
            *angle = tags.number(name)?;
        }
        match angles {
            [Some(yaw), Some(pitch), Some(roll)] => {
                let is_doubtful = *convention == Convention::Below
                    && header.text(Tag::Make).is_some_and(|make| make.eq_ignore_ascii_case("senseFly"));
                return Ok(Direction {
                    foreign: (i > 0).then_some(*names),
                    doubtful_roll_deg: is_doubtful.then_some(roll),
                    ..convention.direction([yaw, pitch, roll])?
                });
            }
            [None, None, None] => {}
            _ => {
                let missing = names.iter().zip(angles).find(|(_, angle)| angle.is_none());
                return Err(unknown(missing.map_or(names[0], |(name, _)| name), tags));
            }
        }
    }
    match MAKER_NOTE.map(|tag| header.maker_note(tag)) {
        [Some(yaw), Some(pitch), Some(roll)] => Convention::Gimbal.direction([yaw, pitch, roll]),
        _ => Err(unknown(TAGS[0].names[0], tags)),
    }
}

impl Convention {
    fn direction(self, angles_deg: [f64; 3]) -> Result<Direction, String> {
        let camera_from_world = match self {
            Self::Gimbal => {
                let convention = AngleConvention { angles: AngleKind::Ypr, ..AngleConvention::default() };
                convention.camera_from_world(&angles_deg)?
            }
            Self::Below => camera_below(angles_deg),
        };
        let pitch_deg = camera_from_world.row(2).z.clamp(-1.0, 1.0).asin().to_degrees();
        Ok(Direction { camera_from_world, pitch_deg, foreign: None, doubtful_roll_deg: None })
    }
}

/// Why there is no direction, with the tags that a reader of photos could have taken for one.
fn unknown(missing: &str, tags: &Tags) -> String {
    let is_alike = |name: &&str| {
        let name = name.to_ascii_lowercase();
        POSE_WORDS.iter().any(|word| name.contains(word))
    };
    let alike: Vec<&str> = tags.names().filter(is_alike).collect();
    let about = match alike[..] {
        [] => String::new(),
        _ => format!(" (it has {}, which are not read)", alike.join(", ")),
    };
    format!("its metadata lack {missing}: the direction of view is unknown{about}")
}

/// Issues on directions that other drones than DJI's state, and on those whose sign is doubtful.
pub(super) fn remark(directions: &[Direction]) -> Vec<Issue> {
    let about = || Subject::Input("survey".to_owned());
    let mut issues = Vec::new();
    for AngleTags { names, convention } in &TAGS[1..] {
        let n = directions.iter().filter(|direction| direction.foreign == Some(*names)).count();
        let zero = if *convention == Convention::Below { "straight down" } else { "to the horizon" };
        if n > 0 {
            let message = format!("directions of {n} photos are by {}; pitch 0 looks {zero}", names.join(", "));
            issues.push(Issue::new(Severity::Note, "view_directions", about(), message));
        }
    }
    let rolls_deg: Vec<f64> = directions.iter().filter_map(|direction| direction.doubtful_roll_deg).collect();
    if !rolls_deg.is_empty() {
        let most_deg = rolls_deg.iter().fold(0.0_f64, |most, roll| most.max(roll.abs()));
        let message = format!(
            "{} photos are by senseFly, and programs differ in the sign of its Camera:Roll, {most_deg:.1}° at most here: taken as \
             Pix4D defines it, positive with the right side down",
            rolls_deg.len()
        );
        issues.push(
            Issue::new(Severity::Warning, "roll_sign_assumed", about(), message).hint(
                "compare the image footprints (survey convert) with a map, or use poses adjusted with the photos",
            ),
        );
    }
    issues
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photo::xmp;
    use std::path::Path;

    /// Tags of a packet with these attributes and elements.
    fn tags(attributes: &str, elements: &str) -> Tags {
        let packet = format!(
            "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"r\"><rdf:Description xmlns:Camera=\"http://pix4d.com/camera/1.0/\" \
             {attributes}>{elements}</rdf:Description></rdf:RDF></x:xmpmeta>"
        );
        xmp::tags(packet.as_bytes(), Path::new("a.jpg")).unwrap()
    }

    fn header(make: &str) -> PhotoHeader {
        PhotoHeader::with_make(make)
    }

    fn rotation(attributes: &str, elements: &str) -> DMat3 {
        of(&header(""), &tags(attributes, elements)).unwrap().camera_from_world
    }

    fn is_near(a: DMat3, b: DMat3) -> bool {
        (a - b).to_cols_array().iter().all(|off| off.abs() < 1e-12)
    }

    const DJI: &str =
        "drone-dji:GimbalYawDegree=\"+30\" drone-dji:GimbalPitchDegree=\"-47.5\" drone-dji:GimbalRollDegree=\"0\"";

    #[test]
    fn each_makers_tags_of_one_view_give_one_rotation() {
        let expected = rotation(DJI, "");
        let parrot = "<drone-parrot:CameraYawDegree>30.0</drone-parrot:CameraYawDegree><drone-parrot:CameraPitchDegree>-47.5\
                      </drone-parrot:CameraPitchDegree><drone-parrot:CameraRollDegree>0</drone-parrot:CameraRollDegree>";
        let skydio = "<drone-skydio:VehicleOrientationNED rdf:parseType=\"Resource\"><drone-skydio:Yaw>1</drone-skydio:Yaw>\
                      <drone-skydio:Pitch>2</drone-skydio:Pitch><drone-skydio:Roll>3</drone-skydio:Roll>\
                      </drone-skydio:VehicleOrientationNED>\
                      <drone-skydio:CameraOrientationNED rdf:parseType=\"Resource\"><drone-skydio:Roll>0</drone-skydio:Roll>\
                      <drone-skydio:Pitch>-47.5</drone-skydio:Pitch><drone-skydio:Yaw>30</drone-skydio:Yaw>\
                      </drone-skydio:CameraOrientationNED>";
        let skydio_attributes = "<drone-skydio:CameraOrientationNED drone-skydio:Roll=\"0\" drone-skydio:Pitch=\"-47.5\" \
                                 drone-skydio:Yaw=\"30\"/>";
        for (maker, found) in [
            ("Autel", rotation(&DJI.replace("drone-dji", "drone"), "")),
            ("Parrot", rotation("", parrot)),
            ("Parrot before Pix4D's", rotation("Camera:Yaw=\"1\" Camera:Pitch=\"2\" Camera:Roll=\"3\"", parrot)),
            ("Skydio", rotation("", skydio)),
            ("Skydio's attributes", rotation("", skydio_attributes)),
            ("Pix4D", rotation("Camera:Yaw=\"30\" Camera:Pitch=\"42.5\" Camera:Roll=\"0\"", "")),
            (
                "fractions",
                rotation(
                    "",
                    "<Camera:Yaw>3000/100</Camera:Yaw><Camera:Pitch>85/2</Camera:Pitch><Camera:Roll>0/1</Camera:Roll>",
                ),
            ),
        ] {
            assert!(is_near(found, expected), "{maker}: {found}");
        }
        let pitch_deg =
            of(&header(""), &tags("Camera:Yaw=\"30\" Camera:Pitch=\"42.5\" Camera:Roll=\"0\"", "")).unwrap().pitch_deg;
        assert!((pitch_deg + 47.5).abs() < 1e-9, "{pitch_deg}");
    }

    #[test]
    fn the_sign_of_senseflys_roll_is_told_once() {
        let camera = tags("Camera:Yaw=\"30\" Camera:Pitch=\"4\" Camera:Roll=\"-6\"", "");
        let by = |make: &str| of(&header(make), &camera).unwrap();
        let codes =
            |directions: &[Direction]| remark(directions).into_iter().map(|issue| issue.code).collect::<Vec<_>>();
        assert_eq!(codes(&[by("senseFly"), by("senseFly")]), ["view_directions", "roll_sign_assumed"]);
        assert!(remark(&[by("senseFly")])[1].message.contains("6.0°"));
        assert_eq!(codes(&[by("Sentera")]), ["view_directions"]);
        let dji = of(&header("DJI"), &tags(DJI, "")).unwrap();
        assert_eq!(codes(&[dji]), Vec::<String>::new());
    }

    #[test]
    fn a_photo_without_a_direction_names_the_tags_that_look_like_one() {
        let reason = |attributes: &str| of(&header("X"), &tags(attributes, "")).unwrap_err();
        let unread = reason("FLIR:MAVYaw=\"3\" FLIR:MAVPitch=\"4\" FLIR:Emissivity=\"1\"");
        assert!(unread.contains("lack GimbalYawDegree") && unread.contains("FLIR:MAVPitch, FLIR:MAVYaw"), "{unread}");
        assert!(!unread.contains("Emissivity"), "{unread}");
        let partly = reason("Camera:Yaw=\"3\" Camera:Pitch=\"4\"");
        assert!(partly.contains("lack Camera:Roll") && partly.contains("Camera:Pitch"), "{partly}");
        assert!(reason("Camera:Yaw=\"north\"").contains("expected a number"));
        assert_eq!(reason(""), "its metadata lack GimbalYawDegree: the direction of view is unknown");
    }
}
