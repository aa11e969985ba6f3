//! The calibration of a whole instrument, from rendered pictures to the accuracy of the rig file that comes of them.

mod cli_common;

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use cli_common::{Run, run};
use karst::eval::evaluate;
use karst_rig::Rig;
use tempfile::TempDir;

/// What the README's section on calibration leaves: ten pairs of boards in air, ten under water, twelve of the belt of the
/// default rig, and its calibration. The drawing is the rig without its misalignments.
static PICTURES: LazyLock<TempDir> = LazyLock::new(|| {
    let readme = include_str!("../../../README.md");
    let section = readme.split("## Calibrate your own instrument").nth(1).unwrap();
    let block = section.split("```").nth(1).unwrap();
    let commands = block.lines().filter_map(|line| line.strip_prefix("cargo run --release -- "));
    let commands: Vec<&str> = commands.map(|line| line.split('#').next().unwrap().trim()).collect();
    // The evaluation is done by the test that looks at its figures.
    let (evaluation, steps) = commands.split_last().unwrap();
    assert_eq!(*evaluation, "eval --rig pictures/result/rig.toml --truth pictures/belt/rig.toml");
    let folder = tempfile::tempdir().unwrap();
    for arguments in steps {
        run(folder.path(), arguments).done();
    }
    folder
});

/// A copy of the set without its pictures: they stay where they are. The manifest is changed on the way.
fn copy(change: impl Fn(String) -> String) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let from = PICTURES.path().join("pictures");
    let absolute = |text: String| {
        ["air/", "water/", "belt/", "drawing.toml"]
            .iter()
            .fold(text, |text, place| text.replace(&format!("\"{place}"), &format!("\"{}/{place}", from.display())))
    };
    let manifest = fs::read_to_string(from.join("calibration.toml")).unwrap();
    let changed = change(manifest.clone());
    fs::write(folder.path().join("calibration.toml"), absolute(changed)).unwrap();
    let result = folder.path().join("result");
    fs::create_dir(&result).unwrap();
    for entry in fs::read_dir(from.join("result")).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, result.join(path.file_name().unwrap())).unwrap();
    }
    folder
}

fn calibrate(folder: &Path, arguments: &str) -> Run {
    run(folder, &format!("calibrate rig . {arguments}"))
}

/// The run failed and its complaints have all these words.
#[track_caller]
fn refused(run: Run, words: &[&str]) {
    let run = run.status(1);
    for words in words {
        assert!(run.stderr.contains(words), "{:?} lacks {words:?}", run.stderr);
    }
}

/// Changes every line but the header of a file.
fn edit(path: &Path, change: impl Fn(Vec<String>) -> Vec<String>) {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap().to_owned();
    let changed = lines.map(|line| change(line.split(',').map(str::to_owned).collect()).join(","));
    fs::write(path, std::iter::once(header).chain(changed).collect::<Vec<_>>().join("\n")).unwrap();
}

/// Changes the position of all corners on the board in the list of one camera.
fn edit_board(folder: &Path, name: &str, change: impl Fn([f64; 2]) -> [f64; 2]) {
    edit(&folder.join("result").join(name), |mut fields| {
        let board = change([2, 3].map(|i: usize| fields[i].parse().unwrap()));
        fields[2] = board[0].to_string();
        fields[3] = board[1].to_string();
        fields
    });
}

#[test]
fn a_rig_calibrated_from_20_board_pairs_and_12_belt_pictures_measures_to_0_3_percent() {
    let folder = PICTURES.path();
    let again = copy(|manifest| manifest);
    let json = calibrate(again.path(), "--from belt --json").done().json();
    assert_eq!(json["pairs_used"], 20);
    let baseline = json["baseline_mm"].as_f64().unwrap();
    let sigma = json["baseline_sigma_mm"].as_f64().unwrap();
    assert!((baseline - 500.17).abs() < 0.5 && sigma < 0.2, "{baseline} ± {sigma} mm");
    assert!(json["holdout_rms_px"].as_f64().unwrap() < 0.15);
    assert_eq!(json["rotation"].as_array().unwrap().len(), 3);
    for camera in json["cameras"].as_array().unwrap() {
        assert!(camera["rms_inliers_px"].as_f64().unwrap() < 0.1, "{}", camera["rms_inliers_px"]);
    }

    let rig = Rig::load(folder.join("pictures/result/rig.toml")).unwrap();
    let evaluation = evaluate(&rig, Some(&Rig::load(folder.join("pictures/belt/rig.toml")).unwrap()), || ()).unwrap();
    let (f, table) = (&evaluation.figures, evaluation.table());
    assert!(f.mean_abs_range_error_pct_to_3m.unwrap() <= 0.30, "{table}");
    assert!((0.8..=1.25).contains(&f.chi2_per_dof.unwrap()), "{table}");
    assert_eq!((f.false_points, f.decision_mismatches), (0, 0), "{table}");
    assert!(f.spots_found_pct.unwrap() >= 99.5, "{table}");
}

#[test]
fn the_report_has_residual_maps_and_says_what_to_photograph_next() {
    let report = fs::read_to_string(PICTURES.path().join("pictures/result/report.html")).unwrap();
    for part in
        ["Residuals of camera 1", "Residuals of camera 2", "What to photograph next", "held out", "Belt", "<svg"]
    {
        assert!(report.contains(part), "{part}");
    }
}

#[test]
fn single_viewpoints_are_biased_with_range_and_axial_models_are_not() {
    let folder = PICTURES.path().join("pictures/result");
    let run = run(&folder, "calibrate refraction --rig cameras.toml --corners corners_water_1.csv --json").done();
    let models = run.json()["models"].clone();
    let biases = |model: usize| {
        let biases = models[model]["bias_pct"].as_array().unwrap().iter().map(|bias| bias.as_f64().unwrap());
        biases.collect::<Vec<_>>()
    };
    // At 0.3, 0.4, 0.7, 1, 2, 3 and 4.8 m
    assert!(biases(0).iter().all(|bias| bias.abs() < 0.3), "traced: {:?} %", biases(0));
    assert!(biases(1).iter().all(|bias| bias.abs() < 1.5), "axial: {:?} %", biases(1));
    assert!(biases(2)[0] > 4.0, "compact: {:?} %", biases(2));
    let report = fs::read_to_string(folder.join("report.html")).unwrap();
    assert!(report.contains("Three models of camera 1 in the water") && report.contains("Bias at 4.8 m"));
}

#[test]
fn a_fitted_model_goes_into_a_rig_file() {
    let folder = copy(|manifest| manifest);
    let result = folder.path().join("result");
    let command =
        "calibrate refraction --rig cameras.toml --corners corners_water_1.csv --model axial --out water.toml";
    run(&result, command).done();
    let cameras = fs::read_to_string(result.join("cameras.toml")).unwrap();
    let water = fs::read_to_string(result.join("water.toml")).unwrap();
    // Behind the first camera's section in air
    let (first, second) = cameras.split_at(cameras.rfind("[[camera]]").unwrap());
    fs::write(result.join("both.toml"), format!("{first}{water}\n{second}")).unwrap();
    run(&result, "rig check both.toml").done();
}

#[test]
fn the_belt_alone_gives_the_rig_that_all_steps_give() {
    let folder = PICTURES.path().join("pictures");
    let run = run(&folder, "calibrate belt --rig result/cameras.toml belt/camera1 belt/camera2 --out belt.toml").done();
    assert!(run.stdout.contains("12 pairs of pictures"), "{}", run.stdout);
    let [alone, all] = ["belt.toml", "result/rig.toml"].map(|name| Rig::load(folder.join(name)).unwrap());
    assert_eq!(alone, all);
}

#[test]
fn steps_run_again_from_what_earlier_ones_left_and_give_the_same_rig() {
    let folder = copy(|manifest| manifest);
    let file = |name: &str| fs::read_to_string(folder.path().join("result").join(name)).unwrap();
    let before = file("rig.toml");
    calibrate(folder.path(), "--from belt").done();
    assert_eq!(file("rig.toml"), before);
    // Corner lists have fewer digits than the step that wrote them knew, and are what it goes on with.
    calibrate(folder.path(), "--from cameras").done();
    assert_eq!(file("rig.toml"), before);
}

#[test]
fn a_folder_without_manifest_or_earlier_results_is_refused_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    refused(calibrate(folder.path(), ""), &["calibration.toml", "karst calibrate init"]);
    run(folder.path(), "calibrate init .").done();
    refused(run(folder.path(), "calibrate init ."), &["calibration.toml", "exists already"]);
    refused(calibrate(folder.path(), "--from belt"), &["corners.json", "--from corners"]);
    refused(calibrate(folder.path(), ""), &["air/camera1", "cannot read"]);
}

#[test]
fn another_board_than_the_manifest_says_is_named_picture_by_picture() {
    let folder = copy(|manifest| manifest.replace("columns = 9", "columns = 8"));
    refused(
        calibrate(folder.path(), ""),
        &["air, camera 2, 0001.png: 54 corners of a grid of 9 x 6, expected all of 8 x 6", "usable views"],
    );
}

#[test]
fn pictures_of_another_size_and_files_that_are_no_pictures_are_named() {
    let folder = copy(|manifest| {
        manifest.replace("air = [\"air/camera1\", \"air/camera2\"]", "air = [\"own\", \"air/camera2\"]")
    });
    let own = folder.path().join("own");
    fs::create_dir(&own).unwrap();
    fs::write(own.join("0001.png"), "no picture").unwrap();
    // The boards under water are enough.
    let run = calibrate(folder.path(), "").status(0);
    assert!(run.stderr.contains("not used: air, camera 1, 0001.png: no picture that can be read"), "{}", run.stderr);
    image::RgbImage::new(800, 600).save(own.join("0002.png")).unwrap();
    refused(calibrate(folder.path(), ""), &["0002.png", "found 800 x 600 px", "expected 1024 x 768 px"]);
}

#[test]
fn boards_in_other_units_for_one_camera_are_refused() {
    let folder = copy(|manifest| manifest);
    edit_board(folder.path(), "corners_air_2.csv", |board| board.map(|mm| mm / 1000.0));
    refused(
        calibrate(folder.path(), "--from cameras"),
        &["air/0001.png, corner 1: at (0.06, 0) mm, expected (60, 0) mm on the board given"],
    );
}

#[test]
fn a_mirrored_corner_order_of_one_camera_is_refused() {
    let folder = copy(|manifest| manifest);
    for list in ["corners_air_2.csv", "corners_water_2.csv"] {
        edit(&folder.path().join("result").join(list), |mut fields| {
            let index: usize = fields[1].parse().unwrap();
            let mirrored = index / 9 * 9 + 8 - index % 9;
            fields[1] = mirrored.to_string();
            fields[2] = (60 * (mirrored % 9)).to_string();
            fields
        });
    }
    let run = calibrate(folder.path(), "--from cameras").status(1);
    assert!(
        run.stderr.contains("mirrored corner order") || run.stderr.contains("another corner order"),
        "{}",
        run.stderr
    );
}

#[test]
fn water_that_is_not_that_of_the_drawing_is_noticed() {
    let drawing = fs::read_to_string(PICTURES.path().join("pictures/drawing.toml")).unwrap();
    let folder = copy(|manifest| manifest.replace("drawing.toml", "own.toml"));
    fs::write(folder.path().join("own.toml"), drawing.replace("salinity = 0.0", "salinity = 35.0")).unwrap();
    refused(calibrate(folder.path(), "--from belt"), &["run again with --from cameras"]);
    let run = calibrate(folder.path(), "--from cameras").status(0);
    assert!(run.stderr.contains("are tube, temperature, salinity and the folders right?"), "{}", run.stderr);
}

#[test]
fn squares_of_another_size_than_given_are_noticed_by_the_baseline() {
    let folder = copy(|manifest| manifest.replace("square_mm = 60.0", "square_mm = 61.2"));
    for (set, camera) in [("air", 1), ("air", 2), ("water", 1), ("water", 2)] {
        edit_board(folder.path(), &format!("corners_{set}_{camera}.csv"), |board| board.map(|mm| 1.02 * mm));
    }
    let run = calibrate(folder.path(), "--from cameras");
    run.status(0).says("is the size of the squares right?");
}

#[test]
fn a_belt_seen_at_one_distance_only_is_refused() {
    let folder = copy(|manifest| manifest.replace("belt/camera", "own/camera"));
    let from = PICTURES.path().join("pictures/belt");
    for camera in ["camera1", "camera2"] {
        let own = folder.path().join("own").join(camera);
        fs::create_dir_all(&own).unwrap();
        for picture in 1..=5 {
            fs::copy(from.join(camera).join("0003.png"), own.join(format!("{picture:04}.png"))).unwrap();
        }
    }
    refused(calibrate(folder.path(), "--from belt"), &["direction of the beam cannot be observed"]);
}
