//! Published calibrations and corners of real cameras, in the folder that `KARST_DATA` names.

use std::path::PathBuf;

use karst_calib::{CameraSettings, CornerList, OcamModel, Warning, calibrate_camera, find_boards, picture_files};
use karst_rig::Board;
use nalgebra::{Point3, Vector2, Vector3};

/// A file of the folder. None, with a loud message, without one.
fn data(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("KARST_DATA");
    if folder.is_none() {
        eprintln!("SKIPPED: {name}. Set KARST_DATA to the folder with the real data.");
    }
    folder.map(|folder| PathBuf::from(folder).join(name))
}

const OCAM_FILES: [&str; 3] = [
    "ocam_models/calib_results_360SL_640x400.txt",
    "ocam_models/calib_results_homing_catadioptric_1024x768.txt",
    "ocam_models/calib_results_matsuren_1600x1600.txt",
];

/// Pixels of the whole image, 7 px apart.
fn pixels([width, height]: [u32; 2]) -> impl Iterator<Item = Vector2<f64>> {
    let rows = (0..height).step_by(7);
    rows.flat_map(move |row| (0..width).step_by(7).map(move |column| Vector2::new(column.into(), row.into())))
}

/// Radius of the image corner farthest from the centre, rounded up.
fn farthest_radius_px(model: &OcamModel) -> f64 {
    let [width, height] = model.image_size_px.map(f64::from);
    let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
    let camera = model.to_camera();
    corners.iter().map(|&corner| camera.corrected(corner.into()).norm()).fold(0.0, f64::max).ceil()
}

#[test]
fn published_ocam_files_are_written_back_without_loss() {
    for path in OCAM_FILES.iter().filter_map(|name| data(name)) {
        let model = OcamModel::load(&path).unwrap();
        assert_eq!(OcamModel::from_text(&model.to_text(), "").unwrap(), model, "{}", path.display());
    }
}

#[test]
fn pixel_to_ray_to_pixel_is_below_1e6_px_for_published_models() {
    for path in OCAM_FILES.iter().filter_map(|name| data(name)) {
        let model = OcamModel::load(&path).unwrap();
        let camera = model.to_camera();
        let radius_px = farthest_radius_px(&model);
        for pixel in pixels(model.image_size_px) {
            let seen = camera.project(Point3::from(1e3 * camera.ray(pixel).direction), radius_px);
            let error = (seen.unwrap() - pixel).norm();
            assert!(error < 1e-6, "{}: {error} px at {pixel}", path.display());
        }
    }
}

#[test]
fn pixel_to_ray_to_pixel_is_below_10_millipixels_in_fixed_point_for_published_models() {
    for path in OCAM_FILES.iter().filter_map(|name| data(name)) {
        let model = OcamModel::load(&path).unwrap();
        let camera = model.to_camera();
        let fixed = camera.to_fixed(0).unwrap();
        let radius_px = farthest_radius_px(&model);
        let mut worst = 0.0_f64;
        for pixel in pixels(model.image_size_px) {
            let ray = fixed.ray(&[pixel.x, pixel.y].map(karst_core::I18F14::from_num));
            let direction = Vector3::from(ray.direction.map(f64::from));
            let seen = camera.project(Point3::from(direction), radius_px);
            worst = worst.max((seen.unwrap() - pixel).norm());
        }
        println!("{}: worst {worst:.5} px", path.display());
        assert!(worst < 0.01, "{}: {worst} px", path.display());
    }
}

#[test]
fn exported_inverse_polynomials_of_published_models_are_good_to_10_millipixels() {
    for path in OCAM_FILES.iter().filter_map(|name| data(name)) {
        let model = OcamModel::load(&path).unwrap();
        let radius_px = 0.5 * f64::from(model.image_size_px[1]);
        let (exported, error_px) = OcamModel::from_camera(&model.to_camera(), model.image_size_px, radius_px).unwrap();
        println!("{}: {} terms, {error_px:.5} px", path.display(), exported.inverse_polynomial.len());
        assert!(error_px < 0.01, "{}: {error_px} px", path.display());
    }
}

fn kaidan() -> Option<CornerList> {
    data("kaidan_catadioptric/corners_ref_opencv.csv").map(|path| CornerList::load(path).unwrap())
}

fn settings(image_size_px: [u32; 2], degree: Option<usize>, tangential: bool) -> CameraSettings {
    CameraSettings { image_size_px, degree, tangential }
}

#[test]
fn kaidan_corners_at_degree_4_leave_at_most_0_474_px_and_0_398_px_on_inliers() {
    let Some(list) = kaidan() else { return };
    let result = calibrate_camera(&list, &settings([640, 480], Some(4), false)).unwrap();
    println!("{:.4} px, {:.4} px on {} of {}", result.rms_px, result.rms_inliers_px, result.inliers, result.corners);
    assert_eq!((result.corners, result.views.len(), result.rejected_views.len()), (1232, 16, 0));
    assert!(result.rms_px <= 0.474, "{} px", result.rms_px);
    assert!(result.rms_inliers_px <= 0.398, "{} px", result.rms_inliers_px);
    assert!(result.inliers >= 1200 && result.inliers + result.outliers.len() == 1232, "{}", result.inliers);
    let off = Vector2::from(result.model.centre_px) - Vector2::new(324.72, 247.59);
    assert!(off.norm() <= 0.5, "{off}");
    assert!(result.holdout_rms_px.unwrap() <= 0.45, "{:?}", result.holdout_rms_px);
    assert_eq!(result.warnings, []);
}

#[test]
fn corners_found_in_all_17_kaidan_pictures_leave_at_most_0_33_px_and_0_28_px_on_inliers() {
    let Some(folder) = data("kaidan_catadioptric") else { return };
    let board = Board { columns: 11, rows: 7, square_mm: 30.0 };
    let found = find_boards(&picture_files(&[folder]).unwrap(), &board, None, || ()).unwrap();
    assert_eq!((found.list.views.len(), found.rejected.len(), found.list.image_size_px), (17, 0, Some([640, 480])));
    let result = calibrate_camera(&found.list, &settings([640, 480], Some(4), false)).unwrap();
    println!("{:.4} px, {:.4} px on {} of {}", result.rms_px, result.rms_inliers_px, result.inliers, result.corners);
    assert_eq!((result.views.len(), result.rejected_views.len()), (17, 0));
    assert!(result.corners >= 1305, "{}", result.corners);
    assert!(result.rms_px <= 0.33, "{} px", result.rms_px);
    assert!(result.rms_inliers_px <= 0.28, "{} px", result.rms_inliers_px);
    let off = Vector2::from(result.model.centre_px) - Vector2::new(324.72, 247.59);
    assert!(off.norm() <= 0.5, "{off}");
    assert!(result.holdout_rms_px.unwrap() <= 0.29, "{:?}", result.holdout_rms_px);
    // The numbering is that of a picture that is not mirrored.
    assert_eq!(result.warnings, []);
}

#[test]
fn kaidan_degree_is_chosen_by_holdout_among_those_that_fit_the_rig_file() {
    let Some(list) = kaidan() else { return };
    let result = calibrate_camera(&list, &settings([640, 480], None, false)).unwrap();
    let best = result.degrees.iter().map(|(_, rms)| *rms).fold(f64::INFINITY, f64::min);
    let chosen = result.degrees.iter().find(|(degree, _)| *degree == result.degree).unwrap().1;
    assert!(chosen <= 1.01 * best, "{:?}", result.degrees);
    assert!(result.model.polynomial.iter().all(|a| a.abs() < karst_rig::MAX_POLYNOMIAL_COEFFICIENT));
}

#[test]
fn a_kaidan_corner_moved_by_15_px_is_named_and_changes_less_than_1_percent() {
    let Some(list) = kaidan() else { return };
    let settings = settings([640, 480], Some(4), false);
    let before = calibrate_camera(&list, &settings).unwrap();
    for (view, corner) in [(0, 0), (7, 38), (15, 76)] {
        let mut moved = list.clone();
        moved.views[view].corners[corner].pixel[0] += 15.0;
        let after = calibrate_camera(&moved, &settings).unwrap();
        let (name, index) = (&list.views[view].name, list.views[view].corners[corner].index);
        let named = after.outliers.iter().find(|outlier| outlier.view == *name && outlier.index == index);
        let residual = named.and_then(|outlier| outlier.residual_px).unwrap();
        assert!((13.5..16.5).contains(&residual), "{residual} px");
        assert!((after.rms_inliers_px / before.rms_inliers_px - 1.0).abs() < 0.01);
        // 1 % of the scatter of a corner is nothing; of the rays' own uncertainty it is still little.
        for pixel in pixels([640, 480]) {
            let radius = before.model.corrected(pixel).norm();
            if (before.radius_px[0]..before.radius_px[1]).contains(&radius) {
                let f = |model: &karst_rig::CameraModel| {
                    let ray = model.ray(pixel).direction;
                    ray.z.atan2(ray.xy().norm())
                };
                let change = (f(&after.model) - f(&before.model)).abs();
                assert!(change < 0.01 * std::f64::consts::FRAC_PI_4, "{change} rad at {pixel}");
                assert!(change < 0.5e-3, "{change} rad at {pixel}");
            }
        }
        let shift = Vector2::from(after.model.centre_px) - Vector2::from(before.model.centre_px);
        assert!(shift.norm() < 0.05, "{shift}");
    }
}

#[test]
fn opencv_omni_corners_with_tangential_terms_leave_at_most_0_80_px() {
    let Some(path) = data("opencv_omni/omni_calib_data.xml") else { return };
    let list = CornerList::load(path).unwrap();
    let result = calibrate_camera(&list, &settings(list.image_size_px.unwrap(), Some(4), true)).unwrap();
    println!("{:.4} px, {:.4} px on {} of {}", result.rms_px, result.rms_inliers_px, result.inliers, result.corners);
    assert_eq!((result.corners, result.views.len()), (810, 15));
    assert!(result.rms_px <= 0.80, "{} px", result.rms_px);
    // The board is given in other units than millimetres.
    assert!(result.warnings.iter().any(|warning| matches!(warning, Warning::SmallBoard { .. })));
}
