//! `karst calibrate stereo` from the command line.

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Output};

use karst_rig::Rig;
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Corners of boards around the default rig, in air, by one of its cameras.
fn corner_list(camera: usize) -> String {
    let rig = Rig::default();
    let air = rig.cameras[camera].air.as_ref().unwrap();
    let mut text = "image,idx,board_x_mm,board_y_mm,u_px,v_px\n".to_owned();
    for view in 0..10 {
        let azimuth = f64::from(view) * 0.7;
        let height = 60.0 * f64::from(view % 3 - 1);
        let direction = Vector3::new(azimuth.cos(), azimuth.sin(), 0.0);
        let tilts = Rotation3::from_euler_angles(0.5 * f64::from(view % 3 - 1), 0.6 * f64::from(view % 2) - 0.3, 0.3);
        let turn = Rotation3::face_towards(&direction, &Vector3::z()) * tilts;
        let centre = (420.0 + 40.0 * f64::from(view)) * direction + height * Vector3::z();
        let pose = Isometry3::from_parts(Translation3::from(centre), UnitQuaternion::from_rotation_matrix(&turn));
        for index in 0..35 {
            let (x, y) = (f64::from(index % 7) * 30.0 - 90.0, f64::from(index / 7) * 30.0 - 60.0);
            let pixel = air.project(pose * Point3::new(x, y, 0.0), 370.0).unwrap();
            let noise = |seed: i32| 0.03 * (f64::from(view * 35 + index + seed)).sin();
            writeln!(text, "{view}.png,{index},{x},{y},{},{}", pixel.x + noise(0), pixel.y + noise(11)).unwrap();
        }
    }
    text
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    let lists = [0, 1].map(|camera| {
        let path = folder.join(format!("corners{}.csv", camera + 1));
        std::fs::write(&path, corner_list(camera)).unwrap();
        path.to_str().unwrap().to_owned()
    });
    let command = ["calibrate", "stereo", "--corners1", &lists[0], "--corners2", &lists[1]];
    Command::new(env!("CARGO_BIN_EXE_karst")).args(command).args(arguments).output().unwrap()
}

#[test]
fn stereo_prints_every_promised_field_as_json() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &["--image-size", "1024x768", "--degree", "5", "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let number = |field: &str| result[field].as_f64().unwrap();
    assert!((number("baseline_mm") - 500.17).abs() < 0.5, "{}", result["baseline_mm"]);
    assert!(number("baseline_sigma_mm") < 0.5 && number("rms_px") < 0.1 && number("holdout_rms_px") < 0.1);
    assert_eq!(result["pairs_used"], 10);
    assert_eq!(result["pairs"].as_array().unwrap().len(), 10);
    assert!(result["pairs_rejected"].as_array().unwrap().is_empty());
    let about_x = result["rotation"][0].as_f64().unwrap();
    assert!((about_x.abs() - 180.0).abs() < 0.5, "{about_x}");
    for camera in result["cameras"].as_array().unwrap() {
        assert_eq!(camera["views_used"], 10);
        for field in [
            "rms_px",
            "rms_inliers_px",
            "inliers",
            "corners",
            "centre_px",
            "views_rejected",
            "polynomial",
            "holdout_rms_px",
        ] {
            assert!(!camera[field].is_null(), "{field}");
        }
    }
}

#[test]
fn stereo_writes_sections_that_rig_files_take() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("cameras.toml");
    let arguments =
        ["--image-size", "1024x768", "--degree", "5", "--position", "0,0,-250.4", "--out", out.to_str().unwrap()];
    let output = run(folder.path(), &arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("baseline ") && text.contains("10 pairs: ") && text.contains("camera 2\n"), "{text}");
    // In place of the sections of both cameras.
    let rig = Rig::default().to_toml();
    let (before, rest) = rig.split_once("[[camera]]").unwrap();
    let after = &rest[rest.find("\n[[laser]]").unwrap()..];
    let sections = std::fs::read_to_string(&out).unwrap();
    let rig = Rig::from_toml(&format!("{before}{sections}{after}"), "rig.toml").unwrap();
    let position = rig.cameras[1].air.as_ref().unwrap().pose.position_mm;
    assert!((position[2] - 249.77).abs() < 0.5, "{position:?}");
}

#[test]
fn wrong_arguments_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let message = |arguments: &[&str]| {
        let output = run(folder.path(), arguments);
        assert!(!output.status.success() && output.stdout.is_empty());
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(message(&[]).contains("give --image-size"));
    assert!(message(&["--image-size", "320x240"]).contains("camera 1: "));
    assert!(message(&["--image-size", "1024x768", "--out", "a.txt"]).contains("ends in .toml"));
}
