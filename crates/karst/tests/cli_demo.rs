//! `karst demo`: the whole chain, and the files that it leaves.

mod cli_common;

use std::path::PathBuf;
use std::sync::LazyLock;

use cli_common::{Folder, mean_range_error_percent, points, run};
use karst_rig::Rig;
use karst_scene::FrameTruth;
use serde_json::Value;

/// One run for all tests: its folder and what it printed.
static DEMO: LazyLock<(PathBuf, Value)> = LazyLock::new(|| {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("cli_demo");
    std::fs::create_dir_all(&folder).unwrap();
    let result = run(&folder, "demo --out result --json").done().json();
    (folder.join("result"), result)
});

fn read(name: &str) -> Vec<u8> {
    let path = DEMO.0.join(name);
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn text(name: &str) -> String {
    String::from_utf8(read(name)).unwrap()
}

#[test]
fn twelve_points_with_truth_within_a_quarter_per_cent_on_average() {
    let section = &DEMO.1;
    assert_eq!(section["method"], "weighted");
    assert_eq!(section["arithmetic"], "fixed");
    assert_eq!(points(section).iter().flatten().count(), 12);
    for laser in section["lasers"].as_array().unwrap() {
        assert!(laser["truth"]["range_mm"].is_f64() && laser["point"]["sigma_mm"].is_f64(), "{laser}");
    }
    let error = mean_range_error_percent([section]);
    assert!(error <= 0.25, "{error} %");
}

#[test]
fn pictures_have_the_rigs_size() {
    for name in ["camera1.png", "camera2.png", "demo_camera1_spots.png", "demo_camera2_spots.png"] {
        assert_eq!(image::load_from_memory(&read(name)).unwrap().into_rgb8().dimensions(), (1024, 768), "{name}");
    }
}

#[test]
fn rig_and_truth_files_read_back() {
    assert_eq!(Rig::load(DEMO.0.join("rig.toml")).unwrap(), Rig::default());
    let truth: FrameTruth = serde_json::from_slice(&read("truth.json")).unwrap();
    assert_eq!(truth.lasers.len(), 12);
}

#[test]
fn points_are_in_every_format() {
    assert!(read("points.ply").windows(17).any(|bytes| bytes == b"element vertex 12"));
    assert_eq!(text("points.csv").lines().count(), 1 + 12);
    let recording = read("points.mcap");
    assert!(mcap::read::MessageStream::new(&recording).unwrap().all(|message| message.is_ok()));
    let sections: Value = serde_json::from_slice(&read("sections.json")).unwrap();
    assert_eq!(sections, Value::from(vec![DEMO.1.clone()]));
}

#[test]
fn report_is_self_contained() {
    let report = text("report.html");
    // The name of a namespace looks like an address and is none.
    for (position, _) in report.match_indices("http") {
        let before = &report[..position];
        assert!(before.ends_with("xmlns=\"") || before.ends_with("xmlns:xlink=\""), "{}", &report[position..][..60]);
    }
    for reference in ["src=\"", "href=\"", "url("] {
        for (position, _) in report.match_indices(reference) {
            let target = &report[position + reference.len()..];
            assert!(target.starts_with("data:") || target.starts_with('#'), "{}", &target[..60]);
        }
    }
    for tag in ["<link", "<script src", "@import"] {
        assert!(!report.contains(tag), "{tag}");
    }
}

#[test]
fn result_goes_to_karst_demo_and_the_last_line_says_what_to_open() {
    let folder = Folder::new();
    let run = folder.run("demo --method paper --arithmetic f64").done();
    let lines: Vec<&str> = run.stdout.lines().collect();
    // Table and picture of the section, as of a sensor's frame, and what there is to say of it
    assert!(
        lines[0].starts_with("laser range mm ") && lines.iter().any(|line| line.contains(" m across")),
        "{lines:?}"
    );
    let said = lines.iter().position(|line| line.ends_with(" of 12 lasers in 1 frame")).expect("a summary");
    assert!(lines[said + 1].starts_with("range error: mean "), "{lines:?}");
    let report = lines.last().unwrap().strip_prefix("open ").unwrap();
    assert_eq!(report, "karst-demo/report.html");
    assert!(folder.path(report).is_file());
}

#[test]
fn same_seed_same_pictures() {
    let folder = Folder::new();
    for out in ["a", "b"] {
        folder.run(&format!("demo --seed 5 --out {out}")).done();
    }
    folder.run("demo --seed 6 --out c").done();
    let picture = |out: &str| std::fs::read(folder.path(out).join("camera1.png")).unwrap();
    assert!(picture("a") == picture("b"));
    assert!(picture("a") != picture("c"));
}

#[test]
fn output_folder_that_is_a_file_is_an_error_before_the_work() {
    let folder = Folder::new();
    folder.run("demo --out rig.toml").fails("output folder rig.toml: this is a file, expected a folder");
}
