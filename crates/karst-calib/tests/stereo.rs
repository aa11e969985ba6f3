//! Calibration of the default rig's cameras, and of its tube, from corners computed with it.

#[path = "common/boards.rs"]
mod boards;

use boards::{BOARD, Boards, boards, see, settings};
use karst_calib::{
    BoardSet, CalibratedStereo, CameraError, CornerList, Known, PairReason, StereoError, StereoSettings, StereoWarning,
    TubeKnowledge, calibrate_stereo,
};
use karst_rig::Medium;
use karst_rig::{Board, Ray, Rig};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;

fn air(pairs: usize, seed: u64) -> BoardSet {
    boards(Medium::Air, Boards::new(Medium::Air, pairs), seed)
}

fn water(pairs: usize, seed: u64) -> BoardSet {
    boards(Medium::Water, Boards::new(Medium::Water, pairs), seed)
}

fn calibrate(sets: &[BoardSet]) -> Result<CalibratedStereo, StereoError> {
    calibrate_stereo(sets, &settings(&Rig::default()))
}

/// The values of all parameters of a rig, named as in the result, turns relative to another rig.
fn values(rig: &Rig, from: &Rig) -> Vec<(String, f64)> {
    let mut values = Vec::new();
    let mut add = |name: String, value: f64| values.push((name, value));
    for (number, camera) in (1..).zip(&rig.cameras) {
        let air = camera.air.as_ref().unwrap();
        for (power, a) in air.polynomial.iter().enumerate() {
            add(format!("camera{number}.polynomial[{power}]"), *a);
        }
        for axis in 0..2 {
            add(format!("camera{number}.centre_px[{axis}]"), air.centre_px[axis]);
            add(format!("camera{number}.tangential[{axis}]"), air.tangential[axis]);
        }
        add(format!("camera{number}.affine[0]"), air.affine[0]);
        add(format!("camera{number}.shear"), air.affine[1]);
    }
    let second = |rig: &Rig| rig.cameras[1].air.as_ref().unwrap().pose.isometry();
    let turn = (second(rig).rotation * second(from).rotation.inverse()).scaled_axis();
    let (tube, from_tube) = (rig.tube.unwrap(), from.tube.unwrap());
    // Of the axis only: where it crosses z = 0, and its direction.
    let axis = |pose: Isometry3<f64>| {
        let direction = pose.rotation * Vector3::z();
        let crossing = pose.translation.vector - direction * (pose.translation.z / direction.z);
        (crossing, direction)
    };
    let ((crossing, direction), (_, from_direction)) = (axis(tube.pose.isometry()), axis(from_tube.pose.isometry()));
    let tilt = from_direction.cross(&direction);
    for i in 0..3 {
        add(format!("camera2.turn[{i}]"), turn[i]);
        add(format!("camera2.position_mm[{i}]"), second(rig).translation.vector[i]);
    }
    for i in 0..2 {
        add(format!("tube.position_mm[{i}]"), crossing[i]);
        add(format!("tube.turn[{i}]"), tilt[i]);
    }
    add("tube.inner_radius_mm".to_owned(), tube.inner_radius_mm);
    add("tube.wall_mm".to_owned(), tube.wall_mm);
    add("tube.index".to_owned(), tube.index);
    values
}

/// The default rig with what was calibrated in place of its own.
fn calibrated_rig(result: &CalibratedStereo) -> Rig {
    let mut rig = Rig::default();
    for (camera, found) in rig.cameras.iter_mut().zip(&result.cameras) {
        camera.air = Some(found.model.clone());
    }
    if let Some((tube, _)) = result.tube {
        rig.tube = Some(tube);
    }
    rig
}

/// Errors of all parameters in their standard deviations, by name.
fn errors_in_sigmas(result: &CalibratedStereo) -> Vec<(String, f64)> {
    let truth = Rig::default();
    let (found, expected) = (values(&calibrated_rig(result), &truth), values(&truth, &truth));
    let error = |parameter: &karst_calib::Parameter| {
        let place = expected.iter().position(|(name, _)| *name == parameter.name)?;
        Some((parameter.name.clone(), (found[place].1 - expected[place].1) / parameter.sigma))
    };
    result.parameters.iter().filter_map(error).collect()
}

/// Mean square of the errors of the parameters in their standard deviations, over some seeds.
fn chi2_per_parameter(sets: impl Fn(u64) -> Vec<BoardSet>, seeds: u64, parameters: usize) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for seed in 0..seeds {
        let result = calibrate(&sets(seed)).unwrap();
        let errors = errors_in_sigmas(&result);
        assert_eq!(errors.len(), parameters);
        assert!(errors.iter().all(|(_, error)| error.abs() < 4.5), "{errors:?}");
        assert_eq!((result.rejected_pairs.len(), result.warnings.len()), (0, 0), "{:?}", result.warnings);
        let error = result.baseline_mm - true_baseline();
        assert!(error.abs() < 0.2 && error.abs() < 4.0 * result.baseline_sigma_mm, "{error} mm");
        // 0.05 px per axis in 2-D, less what the fit took up.
        assert!((0.065..0.072).contains(&result.rms_px), "{} px", result.rms_px);
        let holdout = result.holdout_rms_px.unwrap();
        assert!((result.rms_inliers_px..0.08).contains(&holdout), "{holdout} px");
        sum += errors.iter().map(|(_, error)| error * error).sum::<f64>();
        count += errors.len() as f64;
    }
    sum / count
}

fn true_baseline() -> f64 {
    let position = |camera: usize| Vector3::from(Rig::default().cameras[camera].air.as_ref().unwrap().pose.position_mm);
    (position(1) - position(0)).norm()
}

/// Where two rays are nearest to each other.
fn midpoint([a, b]: &[Ray; 2]) -> Point3<f64> {
    let base = b.origin - a.origin;
    let cosine = a.direction.dot(&b.direction);
    let (p, q) = (base.dot(&a.direction), base.dot(&b.direction));
    let sine2 = 1.0 - cosine * cosine;
    nalgebra::center(
        &(a.origin + (p - cosine * q) / sine2 * a.direction),
        &(b.origin + (cosine * p - q) / sine2 * b.direction),
    )
}

/// The motion that takes one list of points nearest to another, as seen from the origin.
fn alignment(from: &[Point3<f64>], to: &[Point3<f64>]) -> Isometry3<f64> {
    let weights: Vec<f64> = to.iter().map(|point| 1.0 / point.coords.norm_squared()).collect();
    let mean = |points: &[Point3<f64>]| {
        let weighted = points.iter().zip(&weights).map(|(point, weight)| *weight * point.coords);
        weighted.sum::<Vector3<f64>>() / weights.iter().sum::<f64>()
    };
    let (from_mean, to_mean) = (mean(from), mean(to));
    let pairs = from.iter().zip(to).zip(&weights);
    let products = pairs.map(|((a, b), weight)| *weight * (b.coords - to_mean) * (a.coords - from_mean).transpose());
    let svd = products.sum::<Matrix3<f64>>().svd(true, true);
    let rotation = svd.u.unwrap() * svd.v_t.unwrap();
    assert!(rotation.determinant() > 0.0);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Isometry3::from_parts(Translation3::from(to_mean - rotation * from_mean), rotation)
}

/// Worst angle, mrad, between where the rays of a calibrated rig and of the true one are in water at 0.5 to 3 m, once the
/// rigs are aligned: no board tells where the rig frame is.
fn worst_ray_mrad(rig: &Rig) -> f64 {
    let truth = Rig::default();
    let traced = |rig: &Rig| [0, 1].map(|camera| rig.traced_camera(camera).unwrap());
    let (found, expected) = (traced(rig), traced(&truth));
    let (mut measured, mut true_points, mut rays) = (Vec::new(), Vec::new(), Vec::new());
    for step in 0..24 {
        let azimuth = f64::from(step) * 15_f64.to_radians();
        for distance in [500.0, 1000.0, 3000.0] {
            for height in [-0.3, -0.1, 0.1, 0.3] {
                let point = Point3::new(distance * azimuth.cos(), distance * azimuth.sin(), height * distance);
                let pixels = [0, 1].map(|camera| see(&truth, camera, Medium::Water, point));
                let ray = |camera: usize| found[camera].ray(pixels[camera]?);
                rays.extend([0, 1].into_iter().filter_map(|camera| Some((camera, point, ray(camera)?))));
                if let [Some(first), Some(second)] = [ray(0), ray(1)] {
                    measured.push(midpoint(&[first, second]));
                    true_points.push(point);
                }
            }
        }
    }
    assert!(true_points.len() > 200 && rays.len() > 500, "{}, {}", true_points.len(), rays.len());
    let to_truth = alignment(&measured, &true_points);
    let angle = |(camera, point, ray): &(usize, Point3<f64>, Ray)| {
        let (origin, direction) = (to_truth * ray.origin, to_truth * ray.direction);
        let miss = (point - origin).cross(&direction).norm();
        let viewpoint = Point3::from(expected[*camera].air.pose.position_mm);
        1e3 * miss / (point - viewpoint).norm()
    };
    rays.iter().map(angle).fold(0.0, f64::max)
}

#[test]
fn pairs_in_air_give_cameras_and_baseline_within_their_standard_deviations() {
    let chi2 = chi2_per_parameter(|seed| vec![air(16, seed)], 6, 30);
    assert!((0.5..1.6).contains(&chi2), "chi squared per parameter {chi2}");
}

#[test]
fn pairs_in_water_alone_give_cameras_and_tube_within_their_standard_deviations() {
    let chi2 = chi2_per_parameter(|seed| vec![water(20, seed)], 3, 34);
    assert!((0.5..1.6).contains(&chi2), "chi squared per parameter {chi2}");
}

#[test]
fn pairs_in_air_and_water_give_cameras_and_tube_within_their_standard_deviations() {
    let chi2 = chi2_per_parameter(|seed| vec![air(10, seed), water(10, seed + 100)], 3, 34);
    assert!((0.5..1.6).contains(&chi2), "chi squared per parameter {chi2}");
}

#[test]
fn rays_of_the_calibrated_rig_are_within_0_3_mrad_of_the_true_ones() {
    for sets in [vec![water(20, 1)], vec![air(10, 2), water(20, 3)]] {
        let result = calibrate(&sets).unwrap();
        let worst = worst_ray_mrad(&calibrated_rig(&result));
        assert!(worst < 0.3, "{worst} mrad");
    }
}

#[test]
fn a_corner_moved_by_15_px_is_named_and_changes_hardly_anything() {
    let mut sets = [air(6, 3), water(10, 4)];
    let before = calibrate(&sets).unwrap();
    let corner = &mut sets[1].corners[1].views[4].corners[7];
    let index = corner.index;
    corner.pixel[0] += 15.0;
    let after = calibrate(&sets).unwrap();
    let outlier = after.cameras[1].outliers.iter().find(|o| o.view == "water/04.png" && o.index == index).unwrap();
    assert!((outlier.residual_px.unwrap() - 15.0).abs() < 1.0, "{outlier}");
    let residual =
        after.residuals.iter().find(|r| r.view == "water/04.png" && r.camera == 2 && r.index == index).unwrap();
    assert!(!residual.inlier && (residual.residual_px.unwrap()[0] - 15.0).abs() < 1.0);
    assert!((after.rms_inliers_px / before.rms_inliers_px - 1.0).abs() < 0.01);
    assert!((after.baseline_mm - before.baseline_mm).abs() < 0.2 * before.baseline_sigma_mm);
    let (before, after) = (errors_in_sigmas(&before), errors_in_sigmas(&after));
    for ((name, before), (_, after)) in before.iter().zip(&after) {
        assert!((before - after).abs() < 0.3, "{name}: {before}, {after} standard deviations");
    }
}

#[test]
fn views_paired_wrongly_are_named_and_serve_their_own_camera() {
    let mut set = air(12, 5);
    let [_, second] = &mut set.corners;
    let (third, fourth) = (second.views[3].name.clone(), second.views[4].name.clone());
    (second.views[3].name, second.views[4].name) = (fourth, third);
    let result = calibrate(&[set]).unwrap();
    let mut names: Vec<&str> = result.rejected_pairs.iter().map(|pair| pair.pair.as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, ["air/03", "air/04"]);
    for rejected in &result.rejected_pairs {
        assert_eq!(rejected.reason, PairReason::Disagree);
        assert!(rejected.residual_px.unwrap() > 10.0, "{rejected}");
    }
    assert_eq!((result.pairs.len(), result.cameras[1].views.len()), (10, 12));
    assert!((result.baseline_mm - true_baseline()).abs() < 0.2);
    assert!(result.rms_px < 0.072, "{} px", result.rms_px);
}

#[test]
fn pictures_of_one_camera_swapped_with_the_other_are_named() {
    let mut set = water(12, 5);
    let [first, second] = &mut set.corners;
    std::mem::swap(&mut first.views[2].corners, &mut second.views[2].corners);
    let result = calibrate(&[set]).unwrap();
    let [rejected] = result.rejected_pairs.as_slice() else { panic!("{:?}", result.rejected_pairs) };
    assert_eq!(rejected.pair, "water/02");
    assert!((result.baseline_mm - true_baseline()).abs() < 0.3);
}

#[test]
fn pictures_by_one_camera_serve_that_camera() {
    let mut set = air(12, 6);
    set.corners[1].views.truncate(6);
    let result = calibrate(&[set.clone()]).unwrap();
    assert_eq!((result.pairs.len(), result.cameras[0].views.len(), result.cameras[1].views.len()), (6, 12, 6));
    let names: Vec<(usize, &str)> = result.single_views.iter().map(|(camera, name)| (*camera, name.as_str())).collect();
    assert_eq!(names[0], (1, "air/06.png"));
    assert_eq!(names.len(), 6);
    set.corners[0].views.truncate(6);
    let fewer = calibrate(&[set]).unwrap();
    let centre_sigma = |result: &CalibratedStereo| result.cameras[0].sigma.centre_px[0];
    assert!(centre_sigma(&result) < centre_sigma(&fewer));
}

#[test]
fn a_board_numbered_from_its_other_end_is_turned_if_the_board_is_known() {
    let board = Board { columns: 8, rows: 6, square_mm: 40.0 };
    let rig = Rig::default();
    let mut set = boards(Medium::Air, Boards { board, ..Boards::new(Medium::Air, 10) }, 7);
    for corner in &mut set.corners[1].views[2].corners {
        corner.index = board.corners() - 1 - corner.index;
        corner.board_mm = board.corner_mm(corner.index);
    }
    let known = StereoSettings { board: Some(board), ..settings(&rig) };
    let result = calibrate_stereo(&[set.clone()], &known).unwrap();
    assert_eq!(result.rejected_pairs, []);
    let turned: Vec<&str> = result.pairs.iter().filter(|pair| pair.turned).map(|pair| pair.pair.as_str()).collect();
    assert_eq!(turned, ["air/02"]);
    assert!(result.rms_px < 0.072, "{} px", result.rms_px);
    let unknown = StereoSettings { board: None, ..settings(&rig) };
    let result = calibrate_stereo(&[set], &unknown).unwrap();
    let [rejected] = result.rejected_pairs.as_slice() else { panic!("{:?}", result.rejected_pairs) };
    assert_eq!((rejected.pair.as_str(), rejected.reason), ("air/02", PairReason::Disagree));
}

#[test]
fn the_degree_is_chosen_by_boards_held_out_of_the_fit() {
    let rig = Rig::default();
    let mut settings = settings(&rig);
    settings.cameras.iter_mut().for_each(|camera| camera.degree = None);
    let result = calibrate_stereo(&[water(16, 8)], &settings).unwrap();
    for camera in &result.cameras {
        assert_eq!(camera.degrees.iter().map(|(degree, _)| *degree).collect::<Vec<_>>(), [4, 5, 6]);
        let chosen = camera.degrees.iter().find(|(degree, _)| *degree == camera.degree).unwrap();
        assert!(camera.degrees.iter().all(|(_, rms)| chosen.1 <= 1.01 * rms), "{:?}", camera.degrees);
    }
    assert!(result.holdout_rms_px.unwrap() < 0.08, "{:?}", result.holdout_rms_px);
    let worst = worst_ray_mrad(&calibrated_rig(&result));
    assert!(worst < 0.4, "{worst} mrad");
}

#[test]
fn dimensions_and_indices_known_to_a_tolerance_are_found() {
    let rig = Rig::default();
    let mut settings = settings(&rig);
    let tube = settings.tube.as_mut().unwrap();
    tube.tube.inner_radius_mm += 0.4;
    tube.tube.wall_mm -= 0.2;
    tube.water_index += 0.002;
    tube.known = TubeKnowledge {
        inner_radius_mm: Known::Within(0.5),
        wall_mm: Known::Within(0.3),
        wall_index: Known::Within(0.005),
        water_index: Known::Within(0.002),
        ..TubeKnowledge::default()
    };
    let result = calibrate_stereo(&[air(10, 1), water(16, 9)], &settings).unwrap();
    let errors = errors_in_sigmas(&result);
    assert_eq!(errors.len(), 37);
    assert!(errors.iter().all(|(_, error)| error.abs() < 4.0), "{errors:?}");
    let (tube, water_index) = result.tube.unwrap();
    let index_error = (water_index - rig.water.index()).abs();
    assert!(index_error < 3e-4, "{index_error}");
    assert!((tube.inner_radius_mm - 75.0).abs() < 0.5, "{} mm", tube.inner_radius_mm);
    let of = |name: &str| result.parameters.iter().find(|parameter| parameter.name == name).unwrap();
    assert!(of("water.index").sigma < 3e-4 && of("water.index").unit.is_empty());
    assert!(result.rms_px < 0.072, "{} px", result.rms_px);
}

#[test]
fn a_value_far_from_what_was_said_of_it_is_a_named_warning() {
    let mut settings = settings(&Rig::default());
    let tube = settings.tube.as_mut().unwrap();
    tube.water_index = 1.342;
    tube.known.water_index = Known::Within(0.0005);
    let result = calibrate_stereo(&[air(8, 1), water(12, 9)], &settings).unwrap();
    let warned = result
        .warnings
        .iter()
        .any(|warning| matches!(warning, StereoWarning::Implausible { quantity: "the water's refractive index", .. }));
    assert!(warned, "{:?}", result.warnings);
}

#[test]
fn too_few_pairs_are_refused() {
    let mut set = air(6, 1);
    for (number, view) in (0..).zip(&mut set.corners[1].views[2..]) {
        view.name = format!("other {number}.png");
    }
    let error = calibrate(&[set]).unwrap_err();
    assert_eq!(error.to_string(), "2 usable pairs of pictures with the same name, expected at least 3");
    let none = BoardSet { name: String::new(), medium: Medium::Air, corners: [empty(), empty()] };
    let error = calibrate(&[none]).unwrap_err();
    assert!(matches!(error, StereoError::Camera { camera: 1, source: CameraError::TooFewViews { .. } }), "{error}");
}

fn empty() -> CornerList {
    CornerList { views: Vec::new(), image_size_px: None }
}

#[test]
fn few_pairs_are_a_named_warning() {
    let mut set = air(10, 1);
    set.corners[1].views.truncate(4);
    let result = calibrate(&[set]).unwrap();
    assert!(result.warnings.contains(&StereoWarning::FewPairs { pairs: 4, expected: 6 }), "{:?}", result.warnings);
}

#[test]
fn names_that_are_there_twice_are_refused() {
    let mut set = air(6, 1);
    set.corners[1].views[3].name = "left/02.jpg".to_owned();
    let error = calibrate(&[set]).unwrap_err();
    let message = "camera 2: two pictures are called air/02, expected one: pictures are paired by name";
    assert_eq!(error.to_string(), message);
}

#[test]
fn lists_without_a_common_corner_are_refused() {
    let mut set = air(6, 1);
    for corner in set.corners[1].views.iter_mut().flat_map(|view| &mut view.corners) {
        corner.index += 100;
    }
    let settings = StereoSettings { board: None, ..settings(&Rig::default()) };
    assert_eq!(calibrate_stereo(&[set], &settings).unwrap_err(), StereoError::NoCommonCorner);
}

fn in_metres(list: &mut CornerList) {
    for corner in list.views.iter_mut().flat_map(|view| &mut view.corners) {
        corner.board_mm = corner.board_mm.map(|value| 1e-3 * value);
    }
}

#[test]
fn one_list_in_other_units_is_refused_with_the_ratio() {
    let settings = StereoSettings { board: None, ..settings(&Rig::default()) };
    let mut set = air(6, 1);
    in_metres(&mut set.corners[1]);
    let error = calibrate_stereo(&[set], &settings).unwrap_err();
    assert!(matches!(error, StereoError::BoardsDiffer { ratio, .. } if (ratio - 1e-3).abs() < 1e-6), "{error}");
    assert!(error.to_string().contains("0.0010 times as large: other units or another board?"), "{error}");
}

#[test]
fn both_lists_in_metres_are_a_named_warning() {
    let settings = StereoSettings { board: None, ..settings(&Rig::default()) };
    let mut set = air(8, 1);
    set.corners.iter_mut().for_each(in_metres);
    let result = calibrate_stereo(&[set], &settings).unwrap();
    let small = |warning: &StereoWarning| matches!(warning, StereoWarning::SmallBaseline { .. });
    assert!(result.warnings.iter().any(small), "{:?}", result.warnings);
}

#[test]
fn corners_that_are_not_the_boards_are_refused() {
    let mut settings = settings(&Rig::default());
    settings.board = Some(Board { columns: 8, ..BOARD });
    let error = calibrate_stereo(&[air(6, 1)], &settings).unwrap_err();
    assert!(matches!(error, StereoError::NotTheBoard { .. }), "{error}");
    settings.board = Some(Board { columns: 0, ..BOARD });
    let error = calibrate_stereo(&[air(6, 1)], &settings).unwrap_err();
    assert!(matches!(error, StereoError::Setting { what: "the board", .. }), "{error}");
}

#[test]
fn pictures_paired_wrongly_throughout_are_refused() {
    let mut set = air(9, 1);
    let views = &mut set.corners[1].views;
    let names: Vec<String> = views.iter().map(|view| view.name.clone()).collect();
    for (i, view) in views.iter_mut().enumerate() {
        view.name.clone_from(&names[(i + 1) % names.len()]);
    }
    let error = calibrate(&[set]).unwrap_err();
    assert!(matches!(error, StereoError::PairsDisagree { pairs: 9, .. }), "{error}");
    assert!(error.to_string().contains("air/00: the views disagree"), "{error}");
}

#[test]
fn mirrored_corner_order_of_one_camera_is_refused() {
    let mut set = air(9, 1);
    for corner in set.corners[1].views.iter_mut().flat_map(|view| &mut view.corners) {
        let (column, row) = (corner.index % BOARD.columns, corner.index / BOARD.columns);
        corner.index = row * BOARD.columns + BOARD.columns - 1 - column;
        corner.board_mm = BOARD.corner_mm(corner.index);
    }
    assert_eq!(calibrate(&[set]).unwrap_err(), StereoError::MirroredOrder { camera: 2 });
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_corners_are_calibrated_or_refused(
        pixels in proptest::collection::vec([0.0..1023.0, 0.0..767.0], 0..120),
        damaged in 0_usize..6,
        in_water in any::<bool>(),
    ) {
        // Some views with corners anywhere.
        let mut set = if in_water { water(6, 3) } else { air(6, 3) };
        let views = set.corners.iter_mut().flat_map(|list| &mut list.views[..damaged]);
        for (corner, pixel) in views.flat_map(|view| &mut view.corners).zip(pixels) {
            corner.pixel = pixel;
        }
        let _ = calibrate(&[set]);
    }
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    let rig = Rig::default();
    let sets = [water(4, 1)];
    let message = |change: &dyn Fn(&mut StereoSettings)| {
        let mut settings = settings(&rig);
        change(&mut settings);
        calibrate_stereo(&sets, &settings).unwrap_err().to_string()
    };
    let missing = message(&|settings| settings.tube = None);
    assert_eq!(missing, "the tube is missing, expected tube and water, for the boards in water");
    let radius = message(&|settings| settings.tube.as_mut().unwrap().tube.inner_radius_mm = f64::NAN);
    assert_eq!(radius, "the tube's inner radius is NaN mm, expected a positive length, mm");
    let index = message(&|settings| settings.tube.as_mut().unwrap().water_index = 0.0);
    assert_eq!(index, "the water's refractive index is 0, expected 1 to 3");
    let sigma = message(&|settings| settings.tube.as_mut().unwrap().known.wall_mm = Known::Within(0.0));
    assert_eq!(sigma, "a standard deviation of tube or water is 0, expected a positive number");
    let size = message(&|settings| settings.cameras[1].image_size_px = [512, 384]);
    assert!(size.starts_with("camera 2: water/") || size.starts_with("camera 2: 0"), "{size}");
}

#[test]
fn what_boards_in_water_cannot_tell_is_named() {
    let mut settings = settings(&Rig::default());
    settings.tube.as_mut().unwrap().known = TubeKnowledge {
        offset_mm: Known::NotAtAll,
        tilt_mrad: Known::NotAtAll,
        inner_radius_mm: Known::NotAtAll,
        wall_mm: Known::NotAtAll,
        wall_index: Known::NotAtAll,
        water_index: Known::NotAtAll,
    };
    match calibrate_stereo(&[water(10, 2)], &settings) {
        Ok(result) => {
            let warned = |warning: &StereoWarning| {
                matches!(
                    warning,
                    StereoWarning::Uncertain { quantity: "the tube's wall" | "the wall's refractive index", .. }
                )
            };
            assert!(result.warnings.iter().any(warned), "{:?}", result.warnings);
        }
        Err(error) => assert!(error.to_string().contains("cannot be observed"), "{error}"),
    }
}
