//! `karst render --boards`: pictures of a calibration board with the truth of its corners.

mod cli_common;

use cli_common::Folder;
use karst_rig::{Board, Rig};
use karst_scene::FrameTruth;

#[test]
fn boards_in_air_come_with_true_corners_and_a_rig_without_tube() {
    let folder = Folder::new();
    let text = folder.run("render --boards 2 --medium air --out boards").done().stdout;
    assert!(text.starts_with("2 stereo pairs in boards\ntrue corners in boards/truth "), "{text}");
    for number in ["0001", "0002"] {
        for camera in ["camera1", "camera2"] {
            let picture = image::open(folder.path(&format!("boards/{camera}/{number}.png"))).unwrap();
            assert_eq!(picture.into_rgb8().dimensions(), (1024, 768));
        }
        let truth = std::fs::read(folder.path(&format!("boards/truth/{number}.json"))).unwrap();
        let truth: FrameTruth = serde_json::from_slice(&truth).unwrap();
        let board = truth.board.unwrap();
        assert_eq!(board.board, Board { columns: 9, rows: 6, square_mm: 60.0 });
        assert!(board.corners.iter().all(|corners| corners.len() == 54));
        assert!(board.corners.iter().flatten().all(|corner| corner.is_some_and(|corner| corner.visible)));
        assert!(truth.lasers.is_empty());
    }
    let rig = Rig::load(folder.path("boards/rig.toml")).unwrap();
    assert_eq!(rig.tube, None);
}

#[test]
fn a_seed_fixes_the_pictures_and_another_one_changes_the_poses() {
    let folder = Folder::new();
    let render = |out: &str, seed: u64| {
        let frames = folder.run(&format!("render --boards 1 --board 6x5x50 --seed {seed} --out {out} --json")).done();
        let picture = std::fs::read(folder.path(&format!("{out}/camera1/0001.png"))).unwrap();
        (frames.json()[0]["truth"]["board"].clone(), picture)
    };
    let [(board, picture), again, (other, _)] = [("a", 1), ("b", 1), ("c", 2)].map(|(out, seed)| render(out, seed));
    assert_eq!(board["board"], serde_json::json!({ "columns": 6, "rows": 5, "square_mm": 50.0 }));
    assert_eq!(again, (board.clone(), picture));
    assert_ne!(other["pose"], board["pose"]);
    assert!(Rig::load(folder.path("a/rig.toml")).unwrap().tube.is_some());
}

#[test]
fn boards_that_cannot_be_rendered_are_refused() {
    let folder = Folder::new();
    for (arguments, words) in [
        ("--boards 1 --board 9x6x1", "found 0 of 1 poses in which both cameras see all corners of the board"),
        ("--boards 1 --board 9x6x1000", "it is too large or too small"),
        ("--boards 1 --board 1x6x60", "columns is 1, which is not between 2 and 100"),
        ("--boards 1 --medium air --haze 0.1", "--haze and --snow need water, found --medium air"),
    ] {
        folder.run(&format!("render --out out {arguments}")).fails(words);
        assert!(!folder.path("out").exists(), "{arguments}");
    }
    for (arguments, words) in [
        ("--boards 0", "invalid value '0' for '--boards <COUNT>': 0 is not in 1.."),
        ("--boards 2 --frames 3", "'--boards <COUNT>' cannot be used with '--frames <COUNT>'"),
        ("--boards 2 --shape tube", "'--boards <COUNT>' cannot be used with '--shape <SHAPE>'"),
        ("--boards 2 --board 9x6", "such as 9x6x60"),
        ("--boards 2 --board 9x6x-1", "such as 9x6x60"),
        ("--boards 2 --medium oil", "[possible values: air, water]"),
        ("--medium air", "--boards <COUNT>"),
        ("--board 9x6x60", "--boards <COUNT>"),
    ] {
        folder.run(&format!("render --out out {arguments}")).misused(words);
    }
}

#[test]
fn a_camera_without_a_model_in_air_cannot_be_rendered_in_air() {
    let folder = Folder::new();
    let mut rig = Rig::default();
    rig.cameras[0].water = Some(rig.water_camera(0).unwrap());
    rig.cameras[0].air = None;
    folder.write("water.toml", rig.to_toml());
    folder
        .run("render --rig water.toml --boards 1 --medium air --out out")
        .fails("water.toml: camera 1 has no air model, which --medium air needs");
}
