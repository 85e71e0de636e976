//! Golden vectors: yaw, pitch, roll of a gimbal over grid north against what each tool writes for the same camera.

#![allow(clippy::approx_constant, reason = "golden vectors are printed numbers")]

use proptest::prelude::*;

use super::*;

struct Golden {
    ypr_deg: [f64; 3],
    opk_deg: [f64; 3],
    rows: [[f64; 3]; 3],
    colmap_wxyz: [f64; 4],
    rotation_vector: [f64; 3],
}

const GOLDEN: [Golden; 6] = [
    Golden {
        ypr_deg: [0.0, -90.0, 0.0],
        opk_deg: [0.0, 0.0, 0.0],
        rows: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        colmap_wxyz: [0.0, 1.0, 0.0, 0.0],
        rotation_vector: [std::f64::consts::PI, 0.0, 0.0],
    },
    Golden {
        ypr_deg: [90.0, -90.0, 0.0],
        opk_deg: [0.0, 0.0, -90.0],
        rows: [[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
        colmap_wxyz: [0.0, std::f64::consts::FRAC_1_SQRT_2, -std::f64::consts::FRAC_1_SQRT_2, 0.0],
        rotation_vector: [2.221_441, -2.221_441, 0.0],
    },
    Golden {
        ypr_deg: [30.0, -45.0, 0.0],
        opk_deg: [40.8934, -20.7048, -22.2077],
        rows: [[0.866_025, -0.5, 0.0], [-0.353_553, -0.612_372, -0.707_107], [0.353_553, 0.612_372, -0.707_107]],
        colmap_wxyz: [0.369_644, 0.892_399, -0.239_118, 0.099_046],
        rotation_vector: [2.289_975, -0.613_597, 0.254_16],
    },
    Golden {
        ypr_deg: [210.0, -60.0, 0.0],
        opk_deg: [-26.5651, 14.4775, 153.4349],
        rows: [[-0.866_025, 0.5, 0.0], [0.433_013, 0.75, -0.5], [-0.25, -0.433_013, -0.866_025]],
        colmap_wxyz: [0.066_987, 0.25, 0.933_013, -0.25],
        rotation_vector: [0.753_572, 2.812_369, -0.753_572],
    },
    Golden {
        ypr_deg: [0.0, -90.0, 180.0],
        opk_deg: [0.0, 0.0, 180.0],
        rows: [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]],
        colmap_wxyz: [0.0, 0.0, 1.0, 0.0],
        rotation_vector: [0.0, std::f64::consts::PI, 0.0],
    },
    Golden {
        ypr_deg: [30.0, -45.0, 5.0],
        opk_deg: [40.8934, -20.7048, -27.2077],
        rows: [
            [0.831_916, -0.551_469, -0.061_628],
            [-0.427_687, -0.566_464, -0.704_416],
            [0.353_553, 0.612_372, -0.707_107],
        ],
        colmap_wxyz: [0.373_612, 0.881_12, -0.277_816, 0.082_828],
        rotation_vector: [2.256_782, -0.711_561, 0.212_144],
    },
];

/// Half a unit of the last digit printed in the golden vectors.
const PRINTED: f64 = 1.1e-6;

fn convention(angles: AngleKind) -> AngleConvention {
    AngleConvention { angles, ..AngleConvention::default() }
}

fn largest_difference(a: DMat3, b: DMat3) -> f64 {
    (a - b).to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max)
}

#[test]
fn every_convention_of_a_golden_vector_is_the_same_camera() {
    for golden in &GOLDEN {
        let expected = rows(golden.rows[0], golden.rows[1], golden.rows[2]);
        let ypr = convention(AngleKind::Ypr).camera_from_world(&golden.ypr_deg).unwrap();
        let opk = convention(AngleKind::Opk).camera_from_world(&golden.opk_deg).unwrap();
        let quaternion = convention(AngleKind::Quaternion).camera_from_world(&golden.colmap_wxyz).unwrap();
        let vector = from_rotation_vector(golden.rotation_vector.into());
        let matrix = convention(AngleKind::Matrix).camera_from_world(&golden.rows.concat()).unwrap();
        for (name, rotation) in [("ypr", ypr), ("quaternion", quaternion), ("vector", vector), ("matrix", matrix)] {
            let difference = largest_difference(rotation, expected);
            assert!(difference < 2.0 * PRINTED, "{name} {:?}: {difference:.1e}", golden.ypr_deg);
        }
        // Printed to 1e-4 degrees.
        assert!(largest_difference(opk, expected) < 3e-6, "opk {:?}", golden.ypr_deg);
    }
}

#[test]
fn a_nadir_frame_with_roll_180_is_the_frame_turned_by_180() {
    let rolled = convention(AngleKind::Ypr).camera_from_world(&[40.0, -90.0, 180.0]).unwrap();
    let turned = convention(AngleKind::Ypr).camera_from_world(&[220.0, -90.0, 0.0]).unwrap();
    assert!(largest_difference(rolled, turned) < 1e-12);
}

#[test]
fn pitch_from_nadir_is_pitch_from_the_horizon_plus_90() {
    let odm = AngleConvention { pitch_zero: PitchZero::Nadir, ..convention(AngleKind::Ypr) };
    let a = odm.camera_from_world(&[30.0, 45.0, 5.0]).unwrap();
    let b = convention(AngleKind::Ypr).camera_from_world(&[30.0, -45.0, 5.0]).unwrap();
    assert!(largest_difference(a, b) < 1e-12);
}

#[test]
fn zero_quaternions_and_reflections_are_refused() {
    assert!(convention(AngleKind::Quaternion).camera_from_world(&[0.0; 4]).is_err());
    assert!(convention(AngleKind::Opk).camera_from_world(&[0.0, f64::NAN, 0.0]).is_err());
    let mirror = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0];
    assert!(convention(AngleKind::Matrix).camera_from_world(&mirror).unwrap_err().contains("reflection"));
    assert!(convention(AngleKind::Matrix).camera_from_world(&[1.0; 9]).is_err());
}

#[test]
fn camera_axes_are_rotations_that_agree_with_their_names() {
    use CameraAxes::*;
    for axes in [XRightYDown, XRightYUp, XLeftYDown, XLeftYUp, XDownYRight, XDownYLeft, XUpYLeft, XUpYRight] {
        let name = format!("{axes:?}");
        let matrix = axes.camera_from_axes();
        assert_eq!(matrix.determinant(), 1.0, "{name}");
        let direction = |word: &str| match word {
            "Right" => DVec3::X,
            "Left" => -DVec3::X,
            "Down" => DVec3::Y,
            _ => -DVec3::Y,
        };
        let (x, y) = name[1..].split_once('Y').unwrap();
        assert_eq!((matrix * DVec3::X, matrix * DVec3::Y), (direction(x), direction(y)), "{name}");
    }
}

proptest! {
    #[test]
    fn roll_turns_about_the_optical_axis_only(
        yaw in -180.0..180.0_f64, pitch in -89.0..-5.0_f64, roll in -170.0..170.0_f64
    ) {
        let opk = |roll| opk_deg(convention(AngleKind::Ypr).camera_from_world(&[yaw, pitch, roll]).unwrap());
        let (level, rolled) = (opk(0.0), opk(roll));
        prop_assert!((level[0] - rolled[0]).abs() < 1e-9 && (level[1] - rolled[1]).abs() < 1e-9);
        let turned = (level[2] - roll - rolled[2]).rem_euclid(360.0);
        prop_assert!(turned.min(360.0 - turned) < 1e-9);
    }

    #[test]
    fn opk_and_quaternion_survive_the_round_trip(
        yaw in -180.0..180.0_f64, pitch in -89.0..-5.0_f64, roll in -170.0..170.0_f64
    ) {
        let rotation = convention(AngleKind::Ypr).camera_from_world(&[yaw, pitch, roll]).unwrap();
        let opk = convention(AngleKind::Opk).camera_from_world(&opk_deg(rotation)).unwrap();
        let quaternion = convention(AngleKind::Quaternion).camera_from_world(&quaternion_wxyz(rotation)).unwrap();
        prop_assert!(largest_difference(opk, rotation) < 1e-9);
        prop_assert!(largest_difference(quaternion, rotation) < 1e-9);
    }
}

#[test]
fn a_camera_below_an_aircraft_looks_down_at_zero_forward_with_pitch_and_sideways_with_roll() {
    let axis = |angles: [f64; 3]| camera_below(angles).row(2);
    let top = |angles: [f64; 3]| -camera_below(angles).row(1);
    for (angles, looks, up) in [
        // Pix4D's examples: the top of a photo straight down to the north, and to the east.
        ([0.0, 0.0, 0.0], -DVec3::Z, DVec3::Y),
        ([90.0, 0.0, 0.0], -DVec3::Z, DVec3::X),
        ([0.0, 90.0, 0.0], DVec3::Y, DVec3::Z),
        // The right wing down, flying north: the view goes to the west.
        ([0.0, 0.0, 30.0], DVec3::new(-0.5, 0.0, -(0.75_f64.sqrt())), DVec3::Y),
    ] {
        assert!((axis(angles) - looks).length() < 1e-12 && (top(angles) - up).length() < 1e-12, "{angles:?}");
    }
    // Without roll it is a gimbal's whose pitch counts from the nadir.
    let gimbal = AngleConvention { pitch_zero: PitchZero::Nadir, ..convention(AngleKind::Ypr) };
    let expected = gimbal.camera_from_world(&[30.0, 45.0, 0.0]).unwrap();
    assert!(largest_difference(camera_below([30.0, 45.0, 0.0]), expected) < 1e-12);
}
