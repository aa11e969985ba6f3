//! Published calibrations and corners of real cameras, in the folder that `KARST_DATA` names.

use std::path::PathBuf;

use karst_calib::OcamModel;
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
            let ray = fixed.ray([pixel.x, pixel.y].map(karst_core::I18F14::from_num));
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
