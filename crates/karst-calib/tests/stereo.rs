//! Calibration of the default rig's cameras, and of its tube, from corners computed with it.

#[path = "common/boards.rs"]
mod boards;

use boards::{BOARD, boards, boards_like, see, settings};
use karst_calib::{
    BoardSet, CalibratedStereo, CameraError, CornerList, Known, Medium, PairReason, StereoError, StereoSettings,
    StereoWarning, TubeKnowledge, calibrate_stereo,
};
use karst_rig::{Board, Ray, Rig};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};

fn air(pairs: usize, seed: u64) -> BoardSet {
    boards(&Rig::default(), Medium::Air, pairs, seed)
}

fn water(pairs: usize, seed: u64) -> BoardSet {
    boards(&Rig::default(), Medium::Water, pairs, seed)
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
        println!("seed {seed} {:?}", result.rejected_pairs);
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
    let mut all: Vec<(f64, f64, f64, usize)> = rays.iter().map(|r| (angle(r), see(&truth, r.0, Medium::Water, r.1).map(|p| (p - Vector2::from(truth.cameras[r.0].air.as_ref().unwrap().centre_px)).norm()).unwrap(), r.1.coords.xy().norm(), r.0)).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!("{:?} rms {}", &all[..12], (all.iter().map(|a| a.0*a.0).sum::<f64>()/all.len() as f64).sqrt());
    rays.iter().map(angle).fold(0.0, f64::max)
}

#[test]
fn pairs_in_air_give_cameras_and_baseline_within_their_standard_deviations() {
    let chi2 = chi2_per_parameter(|seed| vec![air(16, seed)], 8, 30);
    println!("air {chi2}");
    assert!((0.5..1.6).contains(&chi2), "chi squared per parameter {chi2}");
}

#[test]
fn pairs_in_water_alone_give_cameras_and_tube_within_their_standard_deviations() {
    let chi2 = chi2_per_parameter(|seed| vec![water(20, seed)], 6, 34);
    println!("water {chi2}");
    assert!((0.5..1.6).contains(&chi2), "chi squared per parameter {chi2}");
}

#[test]
fn pairs_in_air_and_water_give_cameras_and_tube_within_their_standard_deviations() {
    let chi2 = chi2_per_parameter(|seed| vec![air(10, seed), water(10, seed + 100)], 6, 34);
    println!("both {chi2}");
    assert!((0.5..1.6).contains(&chi2), "chi squared per parameter {chi2}");
}

#[test]
fn rays_of_the_calibrated_rig_are_within_0_3_mrad_of_the_true_ones() {
    for sets in [vec![water(20, 1)], vec![air(10, 2), water(20, 3)]] {
        let result = calibrate(&sets).unwrap();
        let worst = worst_ray_mrad(&calibrated_rig(&result));
        println!("{worst}");
        assert!(worst < 0.3, "{worst} mrad");
    }
}
