//! `karst calibrate` from the command line.

mod cli_common;

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Output};

use cli_common::Folder;
use karst_calib::{OcamModel, find_corners};
use karst_rig::{CameraModel, Pose, Rig};
use karst_scene::FrameTruth;
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use serde_json::Value;

/// A degree-4 camera, without decentring.
fn truth() -> CameraModel {
    CameraModel {
        pose: Pose { position_mm: [0.0; 3], rotation_deg: [0.0; 3] },
        centre_px: [518.3, 377.6],
        affine: [1.0, 0.0, 0.0],
        tangential: [0.0; 2],
        polynomial: vec![0.302, 0.0, -0.784, -0.0028, 0.1265],
        axial: vec![],
    }
}

/// Corners of boards all around the camera.
fn corner_list() -> String {
    let camera = truth();
    let mut text = "image,idx,board_x_mm,board_y_mm,u_px,v_px\n".to_owned();
    for view in 0..8 {
        let azimuth = f64::from(view) * 0.8;
        let pixel = Vector2::from(camera.centre_px) + 200.0 * Vector2::new(azimuth.cos(), azimuth.sin());
        let direction = camera.ray(pixel).direction;
        let tilt = 0.5 * f64::from(view % 3 - 1);
        let turn = Rotation3::face_towards(&direction, &Vector3::z()) * Rotation3::from_euler_angles(tilt, 0.4, 0.3);
        let rotation = UnitQuaternion::from_rotation_matrix(&turn);
        let pose = Isometry3::from_parts(Translation3::from(450.0 * direction), rotation);
        for index in 0..35 {
            let (x, y) = (f64::from(index % 7) * 30.0 - 90.0, f64::from(index / 7) * 30.0 - 60.0);
            let pixel = camera.project(pose * Point3::new(x, y, 0.0), 400.0).unwrap();
            writeln!(text, "{view}.png,{index},{x},{y},{},{}", pixel.x, pixel.y).unwrap();
        }
    }
    text
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    let corners = folder.join("corners.csv");
    std::fs::write(&corners, corner_list()).unwrap();
    let command = ["calibrate", "camera", "--corners", corners.to_str().unwrap()];
    Command::new(env!("CARGO_BIN_EXE_karst")).args(command).args(arguments).output().unwrap()
}

#[test]
fn camera_prints_every_promised_field_as_json() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &["--image-size", "1024x768", "--degree", "4", "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    for field in ["rms_px", "rms_inliers_px", "holdout_rms_px"] {
        assert!(result[field].as_f64().unwrap() < 1e-5, "{field}: {}", result[field]);
    }
    assert_eq!((result["corners"].as_u64(), result["views_used"].as_u64()), (Some(280), Some(8)));
    assert_eq!((result["inliers"].is_u64(), result["views_rejected"].as_array().unwrap().len()), (true, 0));
    assert!((result["centre_px"][0].as_f64().unwrap() - 518.3).abs() < 1e-3, "{}", result["centre_px"]);
    for (found, expected) in result["polynomial"].as_array().unwrap().iter().zip(truth().polynomial) {
        assert!((found.as_f64().unwrap() - expected).abs() < 1e-4, "{found}, {expected}");
    }
}

#[test]
fn camera_writes_a_section_that_rig_files_take() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("camera.toml");
    let arguments = ["--image-size", "1024x768", "--degree", "4", "--out", out.to_str().unwrap()];
    let output = run(folder.path(), &arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let section = std::fs::read_to_string(&out).unwrap();
    // In place of the section of the first camera, with its pose.
    let rig = Rig::default().to_toml();
    let (before, rest) = rig.split_once("[camera.air]").unwrap();
    let after = &rest[rest.find("\n[").unwrap()..];
    let section = section.replacen("position_mm = [0.0, 0.0, 0.0]", "position_mm = [0.0, 0.0, -250.0]", 1);
    let rig = Rig::from_toml(&format!("{before}{section}{after}"), "rig.toml").unwrap();
    assert!((rig.cameras[0].air.as_ref().unwrap().centre_px[1] - 377.6).abs() < 1e-3);
}

#[test]
fn camera_writes_an_ocamcalib_file() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("calib_results.txt");
    let arguments = ["--image-size", "1024x768", "--degree", "4", "--out", out.to_str().unwrap()];
    assert!(run(folder.path(), &arguments).status.success());
    let model = OcamModel::load(&out).unwrap();
    assert!((model.centre_row_col[0] - 377.6).abs() < 1e-3, "{:?}", model.centre_row_col);
}

#[test]
fn ocamcalib_files_are_converted_to_a_rig_section_and_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (model, _) = OcamModel::from_camera(&truth(), [1024, 768], 360.0).unwrap();
    std::fs::write(path("calib_results.txt"), model.to_text()).unwrap();
    for out in ["camera.toml", "again.txt"] {
        let arguments = ["calibrate", "convert", &path("calib_results.txt"), "--out", &path(out)];
        let output = Command::new(env!("CARGO_BIN_EXE_karst")).args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert!(std::fs::read_to_string(path("camera.toml")).unwrap().contains("[camera.air]"));
    let again = OcamModel::load(path("again.txt")).unwrap();
    assert!((again.polynomial[2] / model.polynomial[2] - 1.0).abs() < 1e-12);
}

#[test]
fn opencv_yaml_is_converted_as_opencv_xml_is() {
    let folder = Folder::new();
    folder.write(
        "mei.xml",
        "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_width>1280</image_width><image_height>960</image_height>\n\
        <camera_matrix type_id=\"opencv-matrix\"><rows>3</rows><cols>3</cols><dt>d</dt>\n\
        <data>930. 0. 640. 0. 931. 480. 0. 0. 1.</data></camera_matrix>\n\
        <distortion_coefficients type_id=\"opencv-matrix\"><rows>1</rows><cols>4</cols><dt>d</dt>\n\
        <data>-0.15 0.02 0. 0.</data></distortion_coefficients>\n<xi>1.2</xi>\n</opencv_storage>\n",
    );
    let yaml = "%YAML:1.0\n---\nimage_width: 1280\nimage_height: 960\ncamera_matrix: !!opencv-matrix\n   rows: 3\n\
        \x20  cols: 3\n   dt: d\n   data: [ 930., 0., 640., 0., 931., 480., 0., 0., 1. ]\n\
        distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 4\n   dt: d\n\
        \x20  data: [ -0.15, 0.02, 0., 0. ]\nxi: 1.2\n";
    let cameras = ["mei.xml", "mei.yml", "mei.YAML"].map(|name| {
        if name != "mei.xml" {
            folder.write(name, yaml);
        }
        folder.run(&format!("calibrate convert {name} --out camera.toml")).done();
        let text = std::fs::read_to_string(folder.path("camera.toml")).unwrap();
        assert!(text.starts_with(&format!("# Converted from \"{name}\": residual 0.0")), "{text}");
        text.split_once('\n').unwrap().1.to_owned()
    });
    assert!(cameras[0].contains("[camera.air]") && cameras[1..] == [cameras[0].clone(), cameras[0].clone()]);
    folder.write("short.yml", yaml.replace("xi: 1.2\n", ""));
    folder.run("calibrate convert short.yml --out camera.toml").fails("short.yml:3: xi: found none, expected one");
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
    assert!(message(&["--image-size", "1024"]).contains("expected width and height such as 640x480"));
    assert!(message(&["--image-size", "320x240"]).contains("wrong image size?"));
    assert!(message(&["--image-size", "1024x768", "--degree", "1"]).contains("degree is 1, expected 2 to 7"));
    assert!(message(&["--image-size", "1024x768", "--out", "a.json"]).contains("ends in .toml or .txt"));
}

#[test]
fn camera_takes_pictures_or_a_corner_list_but_not_both_or_neither() {
    let refused = |arguments: &[&str]| {
        let command = [&["calibrate", "camera"], arguments].concat();
        let output = Command::new(env!("CARGO_BIN_EXE_karst")).args(command).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
    };
    refused(&[]);
    refused(&["a.png"]);
    refused(&["--board", "9x6x60"]);
    refused(&["--board", "9x6", "a.png"]);
    refused(&["--board", "9x6x60", "--corners", "corners.csv", "a.png"]);
    refused(&["--corners", "corners.csv", "--save-corners", "saved.csv"]);
}

#[test]
fn pictures_without_the_board_are_named_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    image::GrayImage::new(64, 48).save(folder.path().join("black.png")).unwrap();
    std::fs::write(folder.path().join("damaged.png"), "").unwrap();
    let arguments = ["calibrate", "camera", "--board", "9x6x60", folder.path().to_str().unwrap()];
    let output = Command::new(env!("CARGO_BIN_EXE_karst")).args(arguments).output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("black.png: no checkerboard among 0 candidates"), "{message}");
    assert!(message.contains("damaged.png: no picture that can be read"), "{message}");
    assert!(message.contains("the board was found in none of 2 pictures"), "{message}");
}

#[test]
fn corners_saved_from_pictures_are_a_list_that_gives_the_same_camera() {
    let folder = Folder::new();
    folder.run("render --boards 6 --medium air --out air").done();
    image::GrayImage::new(1024, 768).save(folder.path("air/camera1/blank.png")).unwrap();
    let found = folder
        .run("calibrate camera --board 9x6x60 air/camera1 --degree 4 --save-corners corners.csv --json")
        .done()
        .json();
    let listed =
        folder.run("calibrate camera --corners corners.csv --image-size 1024x768 --degree 4 --json").done().json();

    assert_eq!(found["views_used"], 6);
    let [rejected] = found["views_rejected"].as_array().unwrap().as_slice() else { panic!("{found}") };
    assert_eq!((&rejected["view"], &rejected["reason"]), (&"blank.png".into(), &"board_not_found".into()));
    assert_eq!(listed["views_rejected"], serde_json::json!([]));
    for field in ["corners", "image_size_px", "degree", "views_used"] {
        assert_eq!(found[field], listed[field], "{field}");
    }
    // The list has ten thousandths of a pixel.
    let numbers = |result: &Value| -> Vec<f64> {
        let lists = ["centre_px", "polynomial", "affine"].map(|field| result[field].as_array().unwrap().clone());
        let numbers = lists.concat().into_iter().chain([result["rms_px"].clone()]);
        numbers.map(|number| number.as_f64().unwrap()).collect()
    };
    for (found, listed) in numbers(&found).into_iter().zip(numbers(&listed)) {
        assert!((found - listed).abs() < 1e-4, "{found}, {listed}");
    }
}

#[test]
fn corners_found_in_rendered_pictures_have_the_true_numbers_and_are_right_to_60_millipixels_rms() {
    let folder = Folder::new();
    for medium in ["air", "water"] {
        folder.run(&format!("render --boards 2 --medium {medium} --out {medium}")).done();
        let mut off_px = Vec::new();
        for number in ["0001", "0002"] {
            let truth = std::fs::read(folder.path(&format!("{medium}/truth/{number}.json"))).unwrap();
            let truth: FrameTruth = serde_json::from_slice(&truth).unwrap();
            let board = truth.board.unwrap();
            for (camera, true_corners) in ["camera1", "camera2"].into_iter().zip(&board.corners) {
                let picture = image::open(folder.path(&format!("{medium}/{camera}/{number}.png"))).unwrap();
                let corners = find_corners(&picture.into_luma8(), &board.board).unwrap();
                assert_eq!(corners.len(), 54, "{medium} {camera} {number}");
                for corner in corners {
                    let position_px = true_corners[corner.index].unwrap().position_px;
                    let off = (Vector2::from(corner.pixel) - Vector2::from(position_px)).norm();
                    assert!(off < 0.5, "{medium} {camera} {number}: corner {} is {off} px off", corner.index);
                    off_px.push(off);
                }
            }
        }
        let rms_px = (off_px.iter().map(|off| off * off).sum::<f64>() / off_px.len() as f64).sqrt();
        println!("{medium}: {rms_px:.4} px rms");
        assert!(rms_px <= 0.06, "{medium}: {rms_px} px");
    }
}
