//! Calibration of a camera that is known, from corners computed with it.

mod common;

use common::{COLUMNS, SQUARE_MM, corners, settings, truth, view};
use karst_calib::{
    CalibratedCamera, CameraError, CameraSettings, Corner, CornerList, View, ViewReason, Warning, calibrate_camera,
};
use karst_rig::CameraModel;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

fn calibrate(list: &CornerList) -> Result<CalibratedCamera, CameraError> {
    calibrate_camera(list, &settings())
}

/// Errors of all terms in their own standard deviations.
fn errors_in_sigmas(result: &CalibratedCamera, truth: &CameraModel) -> Vec<f64> {
    let (model, sigma) = (&result.model, &result.sigma);
    let mut errors = Vec::new();
    let mut add = |found: f64, expected: f64, sigma: f64| {
        if sigma > 0.0 {
            errors.push((found - expected) / sigma);
        }
    };
    for (power, sigma) in sigma.polynomial.iter().enumerate() {
        add(model.polynomial[power], truth.polynomial[power], *sigma);
    }
    for axis in 0..2 {
        add(model.centre_px[axis], truth.centre_px[axis], sigma.centre_px[axis]);
        add(model.affine[axis], truth.affine[axis], sigma.affine[axis]);
        add(model.tangential[axis], truth.tangential[axis], sigma.tangential[axis]);
    }
    errors
}

#[test]
fn perfect_corners_give_the_true_camera() {
    let result = calibrate(&corners(&truth(), 8, 0.0, 1)).unwrap();
    assert!(result.rms_px < 1e-6, "{} px", result.rms_px);
    let off = Vector2::from(result.model.centre_px) - Vector2::from(truth().centre_px);
    assert!(off.norm() < 1e-5, "{off}");
    for (found, expected) in result.model.polynomial.iter().zip(truth().polynomial) {
        assert!((found - expected).abs() < 1e-6, "{found}, {expected}");
    }
}

#[test]
fn noisy_corners_give_the_true_camera_within_its_standard_deviations() {
    let mut sum = 0.0;
    let mut count = 0;
    for seed in 0..12 {
        let result = calibrate(&corners(&truth(), 12, 0.2, seed)).unwrap();
        let errors = errors_in_sigmas(&result, &truth());
        assert_eq!(errors.len(), 8);
        assert!(errors.iter().all(|error| error.abs() < 4.5), "{errors:?}");
        sum += errors.iter().map(|error| error * error).sum::<f64>();
        count += errors.len();
        // 0.2 px per axis in 2-D, less what the fit took up.
        assert!((0.26..0.30).contains(&result.rms_px), "{} px", result.rms_px);
        let holdout = result.holdout_rms_px.unwrap();
        assert!((result.rms_inliers_px..0.35).contains(&holdout), "{holdout} px");
        assert_eq!((result.rejected_views.len(), result.warnings.len()), (0, 0), "{:?}", result.warnings);
    }
    let chi2 = sum / f64::from(count as u32);
    assert!((0.6..1.5).contains(&chi2), "chi squared per term {chi2}");
}

#[test]
fn three_views_suffice_for_mirror_and_fisheye() {
    let fisheye = CameraModel { polynomial: vec![0.92, 0.0, -0.3765, 0.099, -0.0778], ..truth() };
    for camera in [truth(), fisheye] {
        for seed in 0..10 {
            let result = calibrate(&corners(&camera, 3, 0.3, seed)).unwrap();
            assert!(result.rms_px < 0.45 && result.views.len() == 3, "{} px", result.rms_px);
            let errors = errors_in_sigmas(&result, &camera);
            assert!(errors.iter().all(|error| error.abs() < 5.0), "{errors:?}");
        }
    }
}

#[test]
fn tangential_terms_are_found() {
    let mut camera = truth();
    camera.tangential = [0.02, -0.012];
    let list = corners(&camera, 14, 0.1, 5);
    let without = calibrate(&list).unwrap();
    assert!(without.rms_px > 0.3, "{} px", without.rms_px);
    let result = calibrate_camera(&list, &CameraSettings { tangential: true, ..settings() }).unwrap();
    let errors = errors_in_sigmas(&result, &camera);
    assert_eq!(errors.len(), 10);
    assert!(errors.iter().all(|error| error.abs() < 4.5), "{errors:?}");
}

#[test]
fn the_true_degree_is_chosen() {
    let result = calibrate_camera(&corners(&truth(), 16, 0.1, 3), &CameraSettings { degree: None, ..settings() });
    let result = result.unwrap();
    assert_eq!(result.degree, 4, "{:?}", result.degrees);
}

#[test]
fn a_degree_that_is_chosen_is_fitted_as_if_it_had_been_given() {
    // Noise that hides all but the parabola
    let flat = CameraModel { polynomial: vec![0.6, 0.0, -0.4], ..truth() };
    let list = corners(&flat, 16, 0.3, 5);
    let of_degree = |degree| calibrate_camera(&list, &CameraSettings { degree, ..settings() }).unwrap();
    let chosen = of_degree(None);
    let given = of_degree(Some(chosen.degree));
    assert!(chosen.degree < 4, "{:?}", chosen.degrees);
    assert_eq!(chosen.model.polynomial.len(), chosen.degree + 1);
    for (a, b) in chosen.model.polynomial.iter().zip(&given.model.polynomial) {
        assert!((a - b).abs() < 1e-4, "{:?}, {:?}", chosen.model.polynomial, given.model.polynomial);
    }
}

#[test]
fn gross_outliers_are_named_and_do_no_harm() {
    let mut list = corners(&truth(), 12, 0.2, 7);
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let mut moved = Vec::new();
    for view in &mut list.views {
        // 3 of 63 in every view
        for start in [0, 21, 42] {
            let corner = &mut view.corners[start + random.random_range(0..21)];
            let angle: f64 = random.random_range(0.0..std::f64::consts::TAU);
            let distance = random.random_range(5.0..60.0);
            let wrong = Vector2::from(corner.pixel) + distance * Vector2::new(angle.cos(), angle.sin());
            corner.pixel = [wrong.x.clamp(0.0, 1023.0), wrong.y.clamp(0.0, 767.0)];
            moved.push((view.name.clone(), corner.index));
        }
    }
    let result = calibrate(&list).unwrap();
    for (view, index) in &moved {
        let named = result.outliers.iter().any(|outlier| outlier.view == *view && outlier.index == *index);
        assert!(named, "{view}, corner {index}");
    }
    assert!(result.outliers.len() < moved.len() + 8, "{} outliers", result.outliers.len());
    let errors = errors_in_sigmas(&result, &truth());
    assert!(errors.iter().all(|error| error.abs() < 4.5), "{errors:?}");
}

#[test]
fn too_few_views_or_corners_are_refused() {
    let mut list = corners(&truth(), 4, 0.1, 1);
    list.views[0].corners.truncate(7);
    list.views.truncate(3);
    let error = calibrate(&list).unwrap_err();
    assert_eq!(error.to_string(), "2 usable views, expected at least 3\n  0.png: fewer than 8 corners", "{error:?}");
    let none = CornerList { views: vec![], image_size_px: None };
    assert!(matches!(calibrate(&none), Err(CameraError::TooFewViews { found: 0, .. })));
}

#[test]
fn boards_parallel_to_the_image_leave_the_scale_of_f_unobservable() {
    let mut list = CornerList { views: vec![], image_size_px: None };
    for (i, x) in [-300.0, -200.0, -100.0, 0.0].into_iter().enumerate() {
        let pose = Isometry3::from_parts(Translation3::new(x, x / 2.0, 250.0), UnitQuaternion::identity());
        list.views.extend(view(&truth(), &pose, format!("{i}.png")));
    }
    assert!(list.views.len() >= 3);
    let error = calibrate(&list).unwrap_err();
    assert!(matches!(error, CameraError::Parallel { .. }), "{error}");
    assert!(error.to_string().contains("the scale of f against the distance of the boards cannot be observed"));
}

#[test]
fn parallel_tilted_boards_leave_centre_and_affine_terms_unobservable() {
    let mut list = CornerList { views: vec![], image_size_px: None };
    let tilted = UnitQuaternion::from_euler_angles(0.5, 0.3, 0.0);
    for (i, x) in [-400.0, -300.0, -250.0, -200.0, -150.0].into_iter().enumerate() {
        let pose = Isometry3::from_parts(Translation3::new(x, x / 2.0, 300.0), tilted);
        list.views.extend(view(&truth(), &pose, format!("{i}.png")));
    }
    assert!(list.views.len() >= 3);
    let error = calibrate(&list).unwrap_err();
    assert!(matches!(error, CameraError::Parallel { .. }), "{error}");
    assert!(error.to_string().contains("the image centre and the affine terms"), "{error}");
}

#[test]
fn wrong_board_size_is_refused() {
    let list = corners(&truth(), 8, 0.2, 2);
    // There are 9 columns.
    for columns in [7, 8, 10, 11] {
        let mut list = list.clone();
        for corner in list.views.iter_mut().flat_map(|view| &mut view.corners) {
            corner.board_mm = [corner.index % columns, corner.index / columns].map(|i| i as f64 * SQUARE_MM);
        }
        let error = calibrate(&list).unwrap_err();
        assert!(matches!(error, CameraError::NotABoard { .. } | CameraError::PoorFit { .. }), "{columns}: {error}");
        assert!(error.to_string().contains("wrong board size or corner order?"), "{error}");
    }
}

#[test]
fn a_view_in_wrong_order_is_rejected_and_named() {
    let mut list = corners(&truth(), 8, 0.2, 2);
    let pixels: Vec<[f64; 2]> = list.views[3].corners.iter().map(|corner| corner.pixel).collect();
    for (i, corner) in list.views[3].corners.iter_mut().enumerate() {
        corner.pixel = pixels[(i * 5 + 3) % pixels.len()];
    }
    let result = calibrate(&list).unwrap();
    let [rejected] = result.rejected_views.as_slice() else { panic!("{:?}", result.rejected_views) };
    assert_eq!((rejected.view.as_str(), rejected.reason), ("3.png", ViewReason::NotTheBoard));
    assert!(rejected.residual_px.unwrap() > 5.0 && result.views.len() == 7);
}

#[test]
fn a_view_by_another_camera_is_rejected_and_named() {
    let mut list = corners(&truth(), 9, 0.2, 2);
    let centre = Vector2::from(truth().centre_px);
    for corner in &mut list.views[4].corners {
        let offset = Vector2::from(corner.pixel) - centre;
        // Radii ripple: corners stay on their lines through the centre.
        corner.pixel = (centre + offset * (1.0 + 20.0 * (offset.norm() / 15.0).sin() / offset.norm())).into();
    }
    let result = calibrate(&list).unwrap();
    let [rejected] = result.rejected_views.as_slice() else { panic!("{:?}", result.rejected_views) };
    assert_eq!((rejected.view.as_str(), rejected.reason), ("4.png", ViewReason::NotTheCamera));
}

fn mirror(view: &mut View) {
    for corner in &mut view.corners {
        corner.board_mm[0] = (COLUMNS - 1) as f64 * SQUARE_MM - corner.board_mm[0];
    }
}

#[test]
fn a_view_in_mirrored_order_is_rejected_and_named() {
    let mut list = corners(&truth(), 12, 0.1, 4);
    mirror(&mut list.views[5]);
    let result = calibrate(&list).unwrap();
    let [rejected] = result.rejected_views.as_slice() else { panic!("{:?}", result.rejected_views) };
    assert_eq!((rejected.view.as_str(), rejected.reason), ("5.png", ViewReason::Mirrored));
    assert_eq!(result.warnings, []);
}

#[test]
fn mirrored_order_in_all_views_is_a_named_warning() {
    let mut list = corners(&truth(), 12, 0.1, 4);
    list.views.iter_mut().for_each(mirror);
    let result = calibrate(&list).unwrap();
    assert_eq!(result.warnings, [Warning::AllMirrored]);
}

#[test]
fn a_smaller_image_size_is_refused_and_a_larger_one_is_a_named_warning() {
    let list = corners(&truth(), 12, 0.1, 4);
    let of_size = |image_size_px| calibrate_camera(&list, &CameraSettings { image_size_px, ..settings() });
    let error = of_size([512, 384]).unwrap_err();
    assert!(matches!(error, CameraError::OutsideImage { .. }), "{error}");
    assert!(error.to_string().contains("wrong image size?"));
    let result = of_size([2048, 1536]).unwrap();
    assert!(matches!(result.warnings[..], [Warning::CentreOffMiddle { .. }]), "{:?}", result.warnings);
    assert!(matches!(of_size([0, 10]), Err(CameraError::Setting { .. })));
    let degree = calibrate_camera(&list, &CameraSettings { degree: Some(8), ..settings() });
    assert_eq!(degree.unwrap_err().to_string(), "degree is 8, expected 2 to 7");
}

#[test]
fn coordinates_in_metres_are_a_named_warning() {
    let mut list = corners(&truth(), 12, 0.1, 4);
    for corner in list.views.iter_mut().flat_map(|view| &mut view.corners) {
        corner.board_mm = corner.board_mm.map(|value| value * 1e-3);
    }
    let result = calibrate(&list).unwrap();
    assert!(matches!(result.warnings[..], [Warning::SmallBoard { .. }]), "{:?}", result.warnings);
}

#[test]
fn values_that_are_not_finite_are_refused() {
    for bad in [f64::NAN, f64::INFINITY] {
        let mut list = corners(&truth(), 4, 0.2, 4);
        list.views[2].corners[9].pixel[1] = bad;
        let error = calibrate(&list).unwrap_err();
        assert_eq!(error.to_string(), "2.png, corner 9: a coordinate is not finite");
        let mut list = corners(&truth(), 4, 0.2, 4);
        list.views[2].corners[9].board_mm[0] = bad;
        assert!(matches!(calibrate(&list), Err(CameraError::NotFinite { .. })));
    }
}

#[test]
fn corners_on_one_line_or_in_one_place_are_refused() {
    let mut list = corners(&truth(), 6, 0.2, 4);
    for view in &mut list.views {
        view.corners.truncate(COLUMNS);
    }
    let error = calibrate(&list).unwrap_err();
    assert!(!error.to_string().is_empty());
    for corner in list.views.iter_mut().flat_map(|view| &mut view.corners) {
        corner.board_mm = [0.0; 2];
    }
    assert!(matches!(calibrate(&list), Err(CameraError::NotABoard { .. })));
}

#[test]
fn hardly_tilted_small_boards_leave_something_unknown() {
    // Twenty pixels of board, and noise: whatever is fitted, it is not known well.
    let mut list = corners(&truth(), 4, 0.0, 4);
    let mut random = ChaCha8Rng::seed_from_u64(8);
    for view in &mut list.views {
        let middle = view.corners[31].pixel;
        for corner in &mut view.corners {
            for (value, middle) in corner.pixel.iter_mut().zip(middle) {
                let error: f64 = StandardNormal.sample(&mut random);
                *value = middle + 0.08 * (*value - middle) + 0.5 * error;
            }
        }
    }
    match calibrate(&list) {
        Ok(result) => assert!(!result.warnings.is_empty()),
        Err(error) => assert!(matches!(error, CameraError::Unobservable { .. }), "{error}"),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_corners_are_calibrated_or_refused(
        views in proptest::collection::vec(
            proptest::collection::vec(([-1e3..1e3, -1e3..1e3], [0.0..1023.0, 0.0..767.0]), 8..14), 0..5),
    ) {
        let views = views.into_iter().enumerate().map(|(i, corners)| {
            let corners = corners.into_iter().enumerate();
            let corners = corners.map(|(index, (board_mm, pixel))| Corner { index, board_mm, pixel }).collect();
            View { name: i.to_string(), corners }
        });
        let _ = calibrate(&CornerList { views: views.collect(), image_size_px: None });
    }
}
