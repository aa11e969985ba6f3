//! `karst render` and `karst reconstruct`: pictures to points, single frames and sequences.

mod cli_common;

use std::path::PathBuf;
use std::sync::LazyLock;

use cli_common::{Folder, mean_range_error_percent, points, run};
use image::codecs::jpeg::JpegEncoder;
use karst_scene::FrameTruth;
use serde_json::Value;

/// Three frames along a gallery in `survey`, one in a pool in `pool`: rendered once for all tests. Without snow, so that
/// no particle in front of a spot decides whether these tests pass.
static RENDERED: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("cli_reconstruct");
    std::fs::create_dir_all(&folder).unwrap();
    run(&folder, "render --out survey --frames 3 --to 0,0,600 --snow 0").done();
    run(&folder, "render --out pool --shape hexagon --size 3000 --seed 4 --snow 0").done();
    folder
});

const SURVEY: &str = "reconstruct --rig survey/rig.toml survey/camera1 survey/camera2";
const POOL: &str = "reconstruct --rig pool/rig.toml pool/camera1/0001.png pool/camera2/0001.png";

/// The one section of a run with `--json`.
fn section(arguments: &str) -> Value {
    let result = run(&RENDERED, arguments).done().json();
    let [section] = result["sections"].as_array().unwrap().as_slice() else { panic!("{result}") };
    section.clone()
}

/// Largest difference in any coordinate of any laser's point, mm. The same lasers must have points.
fn largest_difference_mm(a: &Value, b: &Value) -> f64 {
    let (a, b) = (points(a), points(b));
    assert_eq!(a.len(), b.len());
    let differences = a.iter().zip(&b).map(|(a, b)| match (a, b) {
        (Some(a), Some(b)) => (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max),
        (None, None) => 0.0,
        _ => panic!("{a:?} {b:?}"),
    });
    differences.fold(0.0, f64::max)
}

#[test]
fn render_numbers_its_frames_and_writes_truth_and_rig_beside_them() {
    for number in 1..=3 {
        for camera in ["camera1", "camera2"] {
            let picture = image::open(RENDERED.join(format!("survey/{camera}/{number:04}.png"))).unwrap();
            assert_eq!(picture.into_rgb8().dimensions(), (1024, 768));
        }
        let truth = std::fs::read(RENDERED.join(format!("survey/truth/{number:04}.json"))).unwrap();
        let truth: FrameTruth = serde_json::from_slice(&truth).unwrap();
        // Equal steps, both ends included.
        assert_eq!(truth.instrument.position_mm, [0.0, 0.0, 300.0 * f64::from(number - 1)]);
        assert_eq!(truth.lasers.len(), 12);
    }
    run(&RENDERED, "rig check survey/rig.toml").done();
}

#[test]
fn render_says_how_to_measure_its_frames() {
    let folder = Folder::new();
    let text = folder.run("render --out pool --shape tube --size 2000").done().stdout;
    assert!(text.starts_with("1 stereo pair in pool\n"), "{text}");
    let hint = text.lines().find_map(|line| line.strip_prefix("measure with: karst ")).unwrap();
    let result = folder.run(&format!("{hint} --json")).done().json();
    assert!(mean_range_error_percent(result["sections"].as_array().unwrap()) <= 0.25);
}

#[test]
fn render_prints_the_truth_as_json() {
    let folder = Folder::new();
    let frames = folder.run("render --out pool --shape square --json").done().json();
    assert_eq!(frames[0]["frame"], "0001");
    let written: Value = serde_json::from_slice(&std::fs::read(folder.path("pool/truth/0001.json")).unwrap()).unwrap();
    assert_eq!(frames[0]["truth"], written);
}

#[test]
fn lasers_switched_off_give_no_points() {
    let folder = Folder::new();
    folder.run("render --out dark --no-lasers --haze 0.02 --snow 100").done();
    let result = folder.run("reconstruct --rig dark/rig.toml dark/camera1 dark/camera2 --json").done().json();
    assert_eq!(points(&result["sections"][0]), [None; 12]);
    assert!(result["sections"][0]["lasers"][0]["status"].as_str().unwrap().contains("no spot"), "{result}");
}

#[test]
fn fixed_point_is_within_0_05_mm_of_f64_with_both_methods() {
    for method in ["weighted", "paper"] {
        let [fixed, float] = ["fixed", "f64"].map(|arithmetic| {
            let section = section(&format!("{POOL} --method {method} --arithmetic {arithmetic} --json"));
            assert_eq!(section["method"], method);
            assert_eq!(section["arithmetic"], arithmetic);
            section
        });
        assert_eq!(points(&fixed).iter().flatten().count(), 12);
        let difference = largest_difference_mm(&fixed, &float);
        assert!(difference <= 0.05, "{method}: {difference} mm");
        // Two different computations, not the same one under two names.
        assert!(difference > 0.0);
    }
}

#[test]
fn weighted_points_have_a_standard_deviation_and_paper_points_have_none() {
    for (method, has_sigma) in [("weighted", true), ("paper", false)] {
        let section = section(&format!("{POOL} --method {method} --json"));
        for laser in section["lasers"].as_array().unwrap() {
            assert_eq!(laser["point"]["sigma_mm"].is_f64(), has_sigma, "{method}: {laser}");
        }
    }
}

#[test]
fn sequence_with_truth_is_within_a_quarter_per_cent_and_leaves_every_file() {
    let folder = Folder::new();
    let out = folder.path("result");
    let arguments = format!("{SURVEY} --truth survey/truth --json --out {}", out.display());
    let result = run(&RENDERED, &arguments).done().json();
    let sections = result["sections"].as_array().unwrap();
    assert_eq!(sections.iter().map(|section| &section["frame"]).collect::<Vec<_>>(), ["0001", "0002", "0003"]);
    assert_eq!(result["skipped"], Value::Array(vec![]));
    let count: usize = sections.iter().map(|section| points(section).iter().flatten().count()).sum();
    assert_eq!(count, 36);
    let error = mean_range_error_percent(sections);
    assert!(error <= 0.25, "{error} %");

    let written: Value = serde_json::from_slice(&std::fs::read(out.join("sections.json")).unwrap()).unwrap();
    assert_eq!(&written, &result["sections"]);
    assert_eq!(std::fs::read_to_string(out.join("points.csv")).unwrap().lines().count(), 1 + 36);
    let cloud = std::fs::read(out.join("points.ply")).unwrap();
    assert!(cloud.windows(17).any(|bytes| bytes == b"element vertex 36"));
    for name in ["points.mcap", "report.html", "0001_camera1_spots.png", "0003_camera2_spots.png"] {
        assert!(out.join(name).is_file(), "{name}");
    }
}

#[test]
fn a_single_frame_prints_a_table_with_one_line_per_laser() {
    let text = run(&RENDERED, &format!("{POOL} --truth pool/truth/0001.json")).done().stdout;
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[0].starts_with("laser       X mm"), "{text}");
    assert_eq!(lines[13], "12 points of 12 lasers in 1 frame");
    assert!(lines[14].starts_with("range error: mean 0."), "{text}");
}

#[test]
fn jpeg_pictures_give_the_points_of_the_png_pictures() {
    let folder = Folder::new();
    for camera in [1, 2] {
        let picture = image::open(RENDERED.join(format!("pool/camera{camera}/0001.png"))).unwrap();
        let file = std::fs::File::create(folder.path(&format!("{camera}.jpg"))).unwrap();
        JpegEncoder::new_with_quality(file, 98).encode_image(&picture).unwrap();
    }
    let jpeg = folder.run("reconstruct --rig rig.toml 1.jpg 2.jpg --json").done().json();
    let difference = largest_difference_mm(&jpeg["sections"][0], &section(&format!("{POOL} --json")));
    assert!(difference <= 3.0, "{difference} mm");
}

#[test]
fn without_the_truth_of_one_frame_the_others_are_measured() {
    let folder = Folder::new();
    for number in [1, 3] {
        let name = format!("survey/truth/{number:04}.json");
        folder.write(&format!("truth/{number:04}.json"), std::fs::read(RENDERED.join(name)).unwrap());
    }
    let truth = folder.path("truth");
    let run = run(&RENDERED, &format!("{SURVEY} --truth {} --json", truth.display())).status(3);
    let words = format!("skipped: frame 0002: cannot read the truth {}", truth.join("0002.json").display());
    let run = run.says(&words);
    assert_eq!(run.json()["sections"].as_array().unwrap().len(), 2);
    assert_eq!(run.json()["skipped"].as_array().unwrap().len(), 1);
}

#[test]
fn truth_is_found_by_the_whole_name_of_a_frame() {
    let folder = Folder::new();
    folder.write_dark_picture("run.1/left.0001.png");
    folder.write_dark_picture("run.2/right.0001.png");
    folder.write("truth/left.0001.json", std::fs::read(RENDERED.join("pool/truth/0001.json")).unwrap());
    let result = folder.run("reconstruct --rig rig.toml run.1 run.2 --truth truth --json").done().json();
    assert_eq!(result["sections"][0]["frame"], "left.0001");
    assert!(result["sections"][0]["lasers"][0]["truth"]["range_mm"].is_f64());
}

#[test]
fn detect_finds_every_spot_that_the_truth_calls_visible() {
    let truth = std::fs::read(RENDERED.join("pool/truth/0001.json")).unwrap();
    let truth: FrameTruth = serde_json::from_slice(&truth).unwrap();
    for camera in [0, 1] {
        let picture = format!("pool/camera{}/0001.png", camera + 1);
        let lasers = run(&RENDERED, &format!("detect --camera {} {picture} --json", camera + 1)).done().json();
        assert_eq!(lasers.as_array().unwrap().len(), 12);
        for laser in &truth.lasers {
            let Some(spot) = laser.spots[camera].filter(|spot| spot.visible) else { continue };
            let found = lasers[laser.laser]["spots"].as_array().unwrap();
            let near = |found: &Value| {
                let at = |i: usize| found["pixel"][i].as_f64().unwrap() - spot.position_px[i];
                at(0).hypot(at(1)) <= 1.0
            };
            assert!(found.iter().any(near), "laser {}: {spot:?} {found:?}", laser.laser);
        }
    }
}

#[test]
fn detect_draws_the_spots_and_counts_them() {
    let folder = Folder::new();
    let out = folder.path("spots.png");
    let text = run(&RENDERED, &format!("detect pool/camera1/0001.png --out {}", out.display())).done().stdout;
    assert!(text.contains("\n12 spots\n"), "{text}");
    assert!(text.ends_with(&format!("drawn in {}\n", out.display())), "{text}");
    assert_eq!(image::open(out).unwrap().into_rgb8().dimensions(), (1024, 768));
}
