//! Bad pictures, rigs, folders and arguments: the message says where, what was found and what was expected, the exit
//! status tells, and nothing that can be measured is lost.

mod cli_common;

use cli_common::{Folder, dark_picture};
use image::{DynamicImage, GrayImage, ImageFormat, RgbImage};
use karst_rig::Rig;

const PAIR: &str = "reconstruct --rig rig.toml 1.png 2.png";
const SEQUENCE: &str = "reconstruct --rig rig.toml camera1 camera2";

/// A folder with a good pair, `1.png` and `2.png`.
fn pair() -> Folder {
    let folder = Folder::new();
    folder.write_dark_picture("1.png");
    folder.write_dark_picture("2.png");
    folder
}

/// A folder with the default rig with one text replaced where it occurs for the n-th time (from 0), and its line.
fn rig_with(from: &str, n: usize, to: &str) -> (Folder, usize) {
    let text = Rig::DEFAULT_TOML;
    let (position, _) = text.match_indices(from).nth(n).unwrap_or_else(|| panic!("no {from:?} in the default rig"));
    let folder = pair();
    folder.write("rig.toml", format!("{}{to}{}", &text[..position], &text[position + from.len()..]));
    (folder, 1 + text[..position].matches('\n').count())
}

// Pictures

#[test]
fn good_pictures_without_spots_are_no_error() {
    let text = pair().run(PAIR).done().stdout;
    assert!(text.contains("0 points of 12 lasers in 1 frame"), "{text}");
}

#[test]
fn picture_of_the_wrong_size_for_the_rig() {
    let folder = pair();
    for name in ["1.png", "2.png"] {
        RgbImage::new(640, 480).save(folder.path(name)).unwrap();
    }
    let words = "1.png: found 640 x 480 px, expected 1024 x 768 px for camera 1 of the rig";
    folder.run(PAIR).fails(words);
    folder.run("detect 1.png").fails(words);
}

#[test]
fn two_pictures_of_different_sizes() {
    let folder = pair();
    RgbImage::new(1024, 767).save(folder.path("2.png")).unwrap();
    folder.run(PAIR).fails("2.png: found 1024 x 767 px, expected 1024 x 768 px for camera 2 of the rig");
}

#[test]
fn truncated_png() {
    let folder = pair();
    let bytes = dark_picture(ImageFormat::Png);
    folder.write("2.png", &bytes[..bytes.len() / 2]);
    folder.run(PAIR).fails("frame 1: 2.png is damaged or truncated: ");
}

#[test]
fn truncated_jpeg() {
    let folder = pair();
    let bytes = dark_picture(ImageFormat::Jpeg);
    folder.write("2.jpg", &bytes[..bytes.len() / 2]);
    folder
        .run("reconstruct --rig rig.toml 1.png 2.jpg")
        .fails("frame 1: 2.jpg is truncated: the JPEG end marker is missing");
}

#[test]
fn file_that_is_no_picture() {
    let folder = pair();
    folder.write("2.png", "not a picture");
    folder.run(PAIR).fails("frame 1: 2.png is not an image: expected PNG or JPEG");
}

#[test]
fn missing_picture() {
    let folder = pair();
    std::fs::remove_file(folder.path("2.png")).unwrap();
    let run = folder.run(PAIR).fails("2.png: cannot read it: ");
    // The reason of the operating system stands there once.
    assert_eq!(run.stderr.matches("os error").count(), 1, "{}", run.stderr);
}

#[test]
fn grey_picture() {
    let folder = pair();
    DynamicImage::from(GrayImage::new(1024, 768)).save(folder.path("1.png")).unwrap();
    folder.run(PAIR).fails("1.png: found 8-bit grey, expected 8-bit RGB");
}

#[test]
fn camera_other_than_1_and_2() {
    for camera in ["0", "3", "left"] {
        pair().run(&format!("detect --camera {camera} 1.png")).misused("'--camera <CAMERA>'");
    }
}

// Sequences

#[test]
fn gap_in_a_sequence_is_skipped_and_the_rest_goes_on() {
    let folder = Folder::new();
    folder.write_dark_sequence(&[1, 2, 4]);
    std::fs::remove_file(folder.path("camera2/0002.png")).unwrap();
    let run = folder.run(&format!("{SEQUENCE} --json")).status(3);
    let run = run.says("skipped: frame 0002: missing in camera 2's folder camera2, found only camera1/0002.png");
    let result = run.json();
    let frames: Vec<&str> =
        result["sections"].as_array().unwrap().iter().map(|s| s["frame"].as_str().unwrap()).collect();
    assert_eq!(frames, ["0001", "0004"]);
    assert!(result["skipped"][0].as_str().unwrap().starts_with("frame 0002: missing in camera 2's folder"));
}

#[test]
fn one_bad_frame_is_skipped_and_the_rest_goes_on() {
    let folder = Folder::new();
    folder.write_dark_sequence(&[1, 2, 3]);
    folder.write("camera1/0002.png", "not a picture");
    let run = folder.run(&format!("{SEQUENCE} --out result")).status(3);
    let words = "frame 0002: camera1/0002.png is not an image: expected PNG or JPEG";
    let run = run.says(&format!("skipped: {words}"));
    assert!(run.stdout.contains("0 points of 24 lasers in 2 frames"), "{}", run.stdout);
    // The report tells as well.
    assert!(std::fs::read_to_string(folder.path("result/report.html")).unwrap().contains(words));
    assert_eq!(std::fs::read_to_string(folder.path("result/points.csv")).unwrap().lines().count(), 1 + 24);
}

#[test]
fn sequence_of_bad_frames_only_fails() {
    let folder = Folder::new();
    for name in ["camera1/1.png", "camera1/2.png", "camera2/1.png", "camera2/2.png"] {
        folder.write(name, "not a picture");
    }
    let run = folder.run(&format!("{SEQUENCE} --json --out result")).status(1);
    let run = run.says("skipped: frame 1: ").says("skipped: frame 2: ");
    let run = run.says("error: none of the 2 frames could be measured");
    assert_eq!(run.json()["sections"].as_array().unwrap().len(), 0);
    assert_eq!(run.json()["skipped"].as_array().unwrap().len(), 2);
}

#[test]
fn folders_that_do_not_pair() {
    let folder = pair();
    folder.write_dark_sequence(&[1]);
    folder.write_dark_picture("later/0007.png");
    folder.write("empty/readme.txt", "");
    let reconstruct = |inputs: &str| folder.run(&format!("reconstruct --rig rig.toml {inputs}"));
    reconstruct("camera1 later").fails("no number in common");
    reconstruct("camera1 empty").fails("empty: found no numbered PNG or JPEG file");
    reconstruct("camera1 2.png")
        .fails("camera1 is a folder and 2.png is a file: expected two image files or two folders");
    reconstruct("camera1 nowhere").fails("nowhere: cannot read it: ");
}

#[test]
fn missing_or_wrong_truth() {
    let folder = pair();
    folder.write_dark_sequence(&[1, 2]);
    folder.run(&format!("{PAIR} --truth nowhere.json")).fails("frame 1: cannot read the truth nowhere.json: ");
    folder.run(&format!("{PAIR} --truth rig.toml")).fails("frame 1: rig.toml is no truth file of karst render: ");
    for truth in ["nowhere", "rig.toml"] {
        folder
            .run(&format!("{SEQUENCE} --truth {truth}"))
            .fails(&format!("truth {truth}: expected a folder with one file per frame"));
    }
}

// Rig files: reading one is the same for every command, so `rig check` stands for all

#[test]
fn every_command_refuses_a_bad_rig_file_in_the_same_words() {
    let (folder, line) = rig_with("salinity = 0.0", 0, "salinity = -1.0");
    let words = format!("rig.toml:{line}: `water.salinity` is -1, expected 0 to 45 per mille");
    for arguments in [
        PAIR,
        "rig check rig.toml",
        "rig show rig.toml",
        "detect --rig rig.toml 1.png",
        "render --rig rig.toml --out out",
        "eval --rig rig.toml",
    ] {
        folder.run(arguments).fails(&words);
    }
    assert!(!folder.path("out").exists() && !folder.path("rig.svg").exists(), "nothing is written");
}

#[test]
fn missing_rig_file() {
    let run = pair().run("reconstruct --rig nowhere.toml 1.png 2.png").fails("nowhere.toml: ");
    assert_eq!(run.stderr.matches("os error").count(), 1, "{}", run.stderr);
}

#[test]
fn rig_with_a_missing_field() {
    let (folder, line) = rig_with("salinity = 0.0", 0, "");
    // The line of the section that lacks it.
    let line = line - 2;
    folder
        .run("rig check rig.toml")
        .fails(&format!("rig.toml:{line}: missing field `water.salinity`, expected a number"));
}

#[test]
fn rig_with_a_misspelt_field() {
    let (folder, line) = rig_with("wall_mm", 0, "wal_mm");
    folder
        .run("rig check rig.toml")
        .fails(&format!("rig.toml:{line}: unknown field `tube.wal_mm`, expected `wall_mm`"));
}

#[test]
fn rig_with_a_duplicate_field() {
    let (folder, line) = rig_with("salinity = 0.0", 0, "temperature_c = 11.0\nsalinity = 0.0");
    let run = folder.run("rig check rig.toml").fails(&format!("rig.toml:{line}: duplicate key"));
    assert!(run.stderr.contains("temperature_c"), "{}", run.stderr);
}

#[test]
fn rig_with_a_field_out_of_range() {
    let (folder, line) = rig_with("index = 1.49", 0, "index = 0.9");
    folder.run("rig check rig.toml").fails(&format!("rig.toml:{line}: `tube.index` is 0.9, expected 1 to 3"));
    let (folder, line) = rig_with("index = 1.49", 0, "index = nan");
    folder.run("rig check rig.toml").fails(&format!("rig.toml:{line}: `tube.index` is NaN, expected 1 to 3"));
}

#[test]
fn rig_with_a_field_of_the_wrong_type() {
    let (folder, line) = rig_with("single_camera = false", 0, "single_camera = 0");
    folder
        .run("rig check rig.toml")
        .fails(&format!("rig.toml:{line}: `reconstruction.single_camera` is 0, expected true or false"));
}

#[test]
fn rig_with_a_laser_listed_twice() {
    let text = Rig::DEFAULT_TOML;
    let last = text.rfind("[[laser]]").unwrap();
    let folder = pair();
    folder.write("rig.toml", format!("{text}\n{}", &text[last..]));
    let run = folder.run("rig check rig.toml").fails("`laser[12].azimuth_deg` is 330.165, expected at least twice");
    assert!(run.stderr.contains("from laser[11]"), "{}", run.stderr);
}

#[test]
fn rig_without_a_baseline() {
    // Camera 2 where camera 1 is.
    let (folder, line) = rig_with("[-0.28, 0.31, 249.76]", 0, "[0.35, -0.22, -250.41]");
    folder.run("rig check rig.toml").fails(&format!(
        "rig.toml:{line}: `camera[1].air.position_mm` is 0.0 mm from the other camera, expected at least 10 mm"
    ));
}

#[test]
fn rig_with_a_viewpoint_in_the_belt_plane() {
    let (folder, line) = rig_with("[-0.28, 0.31, 249.76]", 0, "[-0.28, 0.31, 0.0]");
    let run = folder.run("rig check rig.toml").fails(&format!("rig.toml:{line}: `camera[1].air.position_mm` is "));
    assert!(run.stderr.contains(" mm from the plane of laser[0], expected at least 10 mm"), "{}", run.stderr);
}

#[test]
fn rig_file_that_is_no_toml() {
    let folder = Folder::new();
    folder.write("rig.toml", dark_picture(ImageFormat::Png));
    folder.run("rig check rig.toml").fails("rig.toml: ");
    folder.write("rig.toml", "format = 1\nname = \"open");
    folder.run("rig check rig.toml").fails("rig.toml:2: ");
}

// Output

#[test]
fn output_folder_that_is_a_file() {
    let folder = pair();
    for arguments in [&format!("{PAIR} --out 1.png"), "render --out 1.png", "demo --out 1.png"] {
        folder.run(arguments).fails("output folder 1.png: this is a file, expected a folder");
    }
    assert_eq!(std::fs::read(folder.path("1.png")).unwrap(), dark_picture(ImageFormat::Png), "untouched");
}

#[test]
fn output_folder_that_cannot_be_created() {
    pair().run(&format!("{PAIR} --out 1.png/result")).fails("output folder 1.png/result: cannot create it: ");
}

#[test]
fn output_file_that_cannot_be_written() {
    let folder = pair();
    folder.run("detect 1.png --out nowhere/spots.png").fails("cannot write nowhere/spots.png: ");
    folder.run("detect 1.png --out spots.xyz").fails("cannot write spots.xyz: ");
    folder.run("rig show --out nowhere/rig.svg").fails("cannot write nowhere/rig.svg: ");
}

#[test]
fn bad_input_that_stops_everything_leaves_no_output_folder() {
    let folder = pair();
    folder.run("reconstruct --rig rig.toml nowhere camera2 --out result").fails("nowhere: cannot read it: ");
    folder.run("reconstruct --rig nowhere.toml 1.png 2.png --out result").fails("nowhere.toml: ");
    folder.run("render --mesh nowhere.stl --out result").fails("nowhere.stl: ");
    assert!(!folder.path("result").exists());
}

#[test]
fn frames_of_a_longer_sequence_are_not_mixed_with_new_ones() {
    let folder = Folder::new();
    folder.run("render --out out --frames 2").done();
    folder
        .run("render --out out --seed 9")
        .fails("out/camera1/0002.png: found a frame of a longer sequence, expected at most 1 frame to overwrite");
    folder.run("render --out out --seed 9 --frames 2").done();
}

// Scenes

#[test]
fn render_outside_the_walls() {
    Folder::new()
        .run("render --out out --position 9000,0,0")
        .fails("frame 0001 at (9000, 0, 0) mm: the instrument is outside the shape");
}

#[test]
fn render_path_that_leaves_the_walls_names_the_frame_and_keeps_the_frames_before() {
    let folder = Folder::new();
    folder
        .run("render --out out --shape square --size 2000 --frames 2 --to 0,1500,0")
        .fails("frame 0002 at (0, 1500, 0) mm: the instrument is outside the shape");
    assert!(folder.path("out/camera2/0001.png").is_file());
}

#[test]
fn render_with_impossible_numbers() {
    for (arguments, words) in [
        ("--frames 0", "invalid value '0' for '--frames <COUNT>': 0 is not in 1.."),
        ("--frames -3", "invalid value '-3' for '--frames <COUNT>': -3 is not in 1.."),
        ("--size -5", "invalid value '-5' for '--size <MM>': expected a positive number"),
        ("--size 0", "invalid value '0' for '--size <MM>': expected a positive number"),
        ("--size NaN", "invalid value 'NaN' for '--size <MM>': expected a positive number"),
        ("--size inf", "invalid value 'inf' for '--size <MM>': expected a positive number"),
        ("--size wide", "invalid value 'wide' for '--size <MM>': expected a positive number"),
        ("--haze -1", "invalid value '-1' for '--haze <PER_M>': expected zero or a positive number"),
        ("--snow nan", "invalid value 'nan' for '--snow <COUNT>': expected zero or a positive number"),
        ("--position 0,NaN,0", "'--position <X,Y,Z>': expected three numbers such as 0,0,1500"),
        ("--position 0,0", "'--position <X,Y,Z>': expected three numbers such as 0,0,1500"),
        ("--rotation 0,0,inf", "'--rotation <X,Y,Z>': expected three numbers such as 0,0,1500"),
        ("--shape cube", "invalid value 'cube' for '--shape <SHAPE>'"),
        ("--mesh cave.stl --mesh-unit-mm 0", "'--mesh-unit-mm <MM>': expected a positive number"),
    ] {
        let folder = Folder::new();
        folder.run(&format!("render --out out {arguments}")).misused(words);
        assert!(!folder.path("out").exists(), "{arguments}");
    }
    Folder::new().run("render --out out --snow 1e6").fails("snow_per_m3 is 1000000, which is not between 0 and 100000");
}

#[test]
fn render_arguments_that_would_have_no_effect() {
    for (arguments, words) in [
        ("--to 0,0,100", "--frames <COUNT>"),
        ("--mesh cave.stl --shape tube", "the argument '--mesh <FILE>' cannot be used with '--shape <SHAPE>'"),
        ("--mesh cave.stl --size 2000", "the argument '--mesh <FILE>' cannot be used with '--size <MM>'"),
        ("--mesh-unit-mm 10", "--mesh <FILE>"),
    ] {
        Folder::new().run(&format!("render --out out {arguments}")).misused(words);
    }
}

#[test]
fn render_with_the_largest_seed_goes_on_from_zero() {
    let seed = u64::MAX;
    Folder::new().run(&format!("render --out out --frames 2 --seed {seed}")).done();
}

#[test]
fn mesh_that_cannot_be_used() {
    for (name, content, words) in [
        ("cave.txt", "", "cave.txt: not a Wavefront OBJ (.obj) or stereolithography (.stl) file name"),
        ("cave.stl", "solid cave\nfacet\nvertex 1 2\n", "cave.stl: line 3: expected three numbers"),
        ("cave.obj", "v 0 0 0\nf 1 2 3\n", "cave.obj: "),
        ("cave.obj", "", "cave.obj: no triangles"),
    ] {
        let folder = Folder::new();
        folder.write(name, content);
        folder.run(&format!("render --out out --mesh {name}")).fails(words);
        assert!(!folder.path("out").exists(), "{name}");
    }
    let folder = Folder::new();
    folder.write("cave.stl", [0xAB; 200]);
    folder.run("render --out out --mesh cave.stl").fails("cave.stl: truncated: ");
    folder.run("render --out out --mesh nowhere.stl").fails("nowhere.stl: ");
}

// Usage

#[test]
fn unknown_commands_and_arguments_are_wrong_usage() {
    let folder = pair();
    for (arguments, words) in [
        ("", "Usage: karst <COMMAND>"),
        ("measure", "unrecognized subcommand 'measure'"),
        ("rig", "Usage: karst rig <COMMAND>"),
        ("rig make", "unrecognized subcommand 'make'"),
        ("demo --fast", "unexpected argument '--fast'"),
        ("reconstruct 1.png 2.png", "--rig <FILE>"),
        ("reconstruct --rig rig.toml 1.png", "<CAMERA2>"),
        ("render", "--out <FOLDER>"),
        (&format!("{PAIR} --method guess"), "[possible values: weighted, paper]"),
        (&format!("{PAIR} --arithmetic f32"), "[possible values: fixed, f64]"),
    ] {
        folder.run(arguments).misused(words);
    }
}
