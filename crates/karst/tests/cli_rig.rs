//! `karst rig`: show, check, default.

mod cli_common;

use cli_common::Folder;
use karst_rig::Rig;
use serde_json::Value;

#[test]
fn default_rig_passes_the_check() {
    let folder = Folder::new();
    let text = folder.run("rig default").done().stdout;
    assert_eq!(text, Rig::DEFAULT_TOML);
    folder.write("my.toml", text);
    assert_eq!(folder.run("rig check my.toml").done().stdout, "my.toml is a valid rig\n");
    let result = folder.run("rig check my.toml --json").done().json();
    assert_eq!(result, serde_json::json!({"ok": true, "problem": null, "warnings": []}));
}

#[test]
fn bad_rig_fails_the_check_with_its_problem() {
    let folder = Folder::new();
    folder.write("my.toml", Rig::DEFAULT_TOML.replacen("wall_mm = 5.0", "wall_mm = -5.0", 1));
    let run = folder.run("rig check my.toml").fails("`tube.wall_mm` is -5, expected 0 to 100 mm");
    let json = folder.run("rig check my.toml --json").status(1);
    assert_eq!(json.json()["ok"], false);
    assert_eq!(json.json()["problem"], run.stderr.trim_end().strip_prefix("error: ").unwrap());
}

#[test]
fn rig_with_good_fields_that_cannot_measure_fails_the_check() {
    let folder = Folder::new();
    // Right at the centre the fitted polynomial is too steep.
    folder.write("my.toml", Rig::DEFAULT_TOML.replacen("inner_radius_px = 105.0", "inner_radius_px = 1.0", 1));
    folder
        .run("rig check my.toml")
        .fails("my.toml: a coefficient of the camera model in the water is too large for fixed point");
}

#[test]
fn check_warns_of_what_is_allowed_but_probably_not_meant() {
    let folder = Folder::new();
    folder
        .write("my.toml", Rig::DEFAULT_TOML.replacen("centre_px = [513.21, 381.87]", "centre_px = [513.21, 350.0]", 1));
    let text = folder.run("rig check my.toml").done().stdout;
    assert!(text.contains("\nwarning: The mirror around `camera[0].air.centre_px` reaches beyond the image"), "{text}");
    let result = folder.run("rig check my.toml --json").done().json();
    assert_eq!(result["ok"], true);
    assert_eq!(result["warnings"].as_array().unwrap().len(), 1);
}

#[test]
fn show_draws_the_rig_and_prints_its_main_figures() {
    let folder = Folder::new();
    let text = folder.run("rig show").done().stdout;
    assert!(text.starts_with("rig \"default\": 12 lasers, water index 1.33"), "{text}");
    assert!(text.contains("\ncamera 2: axial in water, viewpoint ("), "{text}");
    assert!(text.ends_with("drawn in rig.svg\n"), "{text}");
    folder.run("rig show rig.toml --out drawing.svg").done();
    let drawings = ["rig.svg", "drawing.svg"].map(|name| std::fs::read_to_string(folder.path(name)).unwrap());
    assert_eq!(drawings[0], drawings[1]);
    let drawing = roxmltree::Document::parse(&drawings[0]).unwrap();
    assert_eq!(drawing.root_element().tag_name().name(), "svg");
}

#[test]
fn show_prints_the_rig_as_json() {
    let result: Value = Folder::new().run("rig show --json").done().json();
    assert_eq!(result["name"], "default");
    assert_eq!(result["lasers"].as_array().or(result["laser"].as_array()).unwrap().len(), 12);
}
