//! Three ways to a camera in the water, from corners computed with the default rig.

#[path = "common/boards.rs"]
mod boards;

use boards::{Boards, boards, settings};
use karst_calib::{
    CameraError, CameraSettings, CornerList, InWater, RefractionError, Warning, calibrate_axial, calibrate_camera,
    calibrate_stereo, compare_refraction,
};
use karst_rig::Medium;
use karst_rig::{FitError, Rig, TracedCamera};

const RANGE_MM: [f64; 2] = [250.0, 6000.0];

fn in_water() -> CameraSettings {
    CameraSettings { image_size_px: [1024, 768], degree: None, tangential: true }
}

/// Boards in the water as camera 1 sees them.
fn corners(boards_like: Boards, seed: u64) -> CornerList {
    let [first, _] = boards(Medium::Water, boards_like, seed).corners;
    first
}

/// Camera 1 as calibrated in air, behind the tube of the data sheet: without its misalignment.
fn from_air(seed: u64) -> TracedCamera {
    let set = boards(Medium::Air, Boards::new(Medium::Air, 20), seed);
    let air = calibrate_stereo(&[set], &settings(&Rig::default())).unwrap();
    let truth = Rig::default().traced_camera(0).unwrap();
    TracedCamera { air: air.cameras[0].model.clone(), tube: Rig::ideal().tube.unwrap(), ..truth }
}

/// Largest bias, per cent, at 0.4 to 3 m and at all ranges.
fn largest_biases(way: &InWater) -> [f64; 2] {
    let largest = |biases: &[Option<f64>]| biases.iter().map(|bias| bias.unwrap().abs()).fold(0.0, f64::max);
    [largest(&way.bias_pct[1..6]), largest(&way.bias_pct)]
}

#[test]
fn air_with_tracing_equals_an_axial_model_from_the_water_and_a_compact_one_is_biased() {
    let truth = Rig::default().traced_camera(0).unwrap();
    for seed in 0..3 {
        let list = corners(Boards::new(Medium::Water, 20), 10 + seed);
        let ways = compare_refraction(&from_air(20 + seed), &truth, &list, &in_water(), RANGE_MM).unwrap();
        // Of corners with 0.05 px noise per axis.
        assert!(
            ways.traced.rms_px < 0.073 && ways.axial.rms_px < 0.073,
            "{}, {}",
            ways.traced.rms_px,
            ways.axial.rms_px
        );
        assert!(ways.compact.rms_px > 0.15, "{}", ways.compact.rms_px);
        let [traced, axial, compact] =
            [&ways.traced, &ways.axial, &ways.compact].map(|way| way.holdout_rms_px.unwrap());
        assert!(traced < 0.08 && axial < 0.1 && compact > 0.15, "{traced}, {axial}, {compact} px");

        let [traced, axial, compact] = [&ways.traced, &ways.axial, &ways.compact].map(largest_biases);
        assert!(traced[0] < 0.3 && traced[1] < 0.5, "{traced:?} %");
        assert!(axial[0] < 1.0 && axial[1] < 2.0, "{axial:?} %");
        // How a single viewpoint spreads its error over the ranges depends on where the boards were.
        assert!(compact[0] > 2.0 && compact[1] > 5.0, "{compact:?} %");
        assert!(ways.compact.bias_pct[0].unwrap() > 4.0, "{:?}", ways.compact.bias_pct);
    }
}

#[test]
fn an_axial_model_needs_boards_at_several_distances() {
    let many = calibrate_axial(&corners(Boards::new(Medium::Water, 20), 1), &in_water()).unwrap();
    assert_eq!(many.warnings, []);
    assert!(many.model.axial.len() > 2 && many.model.axial[0] == 0.0);
    assert_eq!(many.sigma.axial.len(), many.model.axial.len());

    let one = Boards { range_mm: [700.0, 720.0], tilt_rad: 0.2, ..Boards::new(Medium::Water, 20) };
    let one = calibrate_axial(&corners(one, 1), &in_water()).unwrap();
    let named = |warning: &Warning| matches!(warning, Warning::OneDistance { near_mm, far_mm } if *near_mm > 600.0 && *far_mm < 850.0);
    assert!(one.warnings.iter().any(named), "{:?}", one.warnings);

    let few = Boards { range_mm: [700.0, 720.0], tilt_rad: 0.15, ..Boards::new(Medium::Water, 3) };
    match calibrate_axial(&corners(few, 2), &in_water()) {
        Ok(result) => assert!(result.warnings.len() > 1, "{:?}", result.warnings),
        Err(error) => assert!(error.to_string().contains("cannot be observed"), "{error}"),
    }
}

#[test]
fn an_axial_model_of_a_camera_in_air_is_a_compact_one() {
    let [list, _] = boards(Medium::Air, Boards::new(Medium::Air, 20), 5).corners;
    let compact = calibrate_camera(&list, &in_water()).unwrap();
    let axial = calibrate_axial(&list, &in_water()).unwrap();
    assert!((axial.rms_px - compact.rms_px).abs() < 1e-3, "{}, {}", axial.rms_px, compact.rms_px);
    let height = |s: f64| 512.0 * axial.model.axial.iter().rev().fold(0.0, |sum, c| sum * s + c);
    let [inner, outer] = axial.radius_px.map(|radius| radius / 512.0);
    assert!((height(outer) - height(inner)).abs() < 2.0, "{} mm", height(outer) - height(inner));
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let truth = Rig::default().traced_camera(0).unwrap();
    let list = corners(Boards::new(Medium::Water, 8), 3);
    let few = CornerList { views: list.views[..2].to_vec(), image_size_px: None };
    let error = compare_refraction(&truth, &truth, &few, &in_water(), RANGE_MM).unwrap_err();
    let too_few = CameraError::TooFewViews { found: 2, expected: 3, rejected: Vec::new() };
    assert_eq!(error, RefractionError::Camera { model: "axial", source: too_few });
    let mut outside = truth.clone();
    outside.air.pose.position_mm[0] = 80.0;
    let error = compare_refraction(&outside, &truth, &list, &in_water(), RANGE_MM).unwrap_err();
    assert_eq!(error, RefractionError::Trace(FitError::NoRay));
}
