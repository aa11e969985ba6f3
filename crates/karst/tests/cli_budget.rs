//! `karst budget`: the table, its limits and the exit status.

mod cli_common;

use cli_common::Folder;
use serde_json::Value;

fn rows(arguments: &str, status: i32) -> Vec<Value> {
    let run = Folder::new().run(&format!("budget --json {arguments}")).status(status);
    let table: Value = serde_json::from_str(&run.stdout).unwrap();
    table["rows"].as_array().unwrap().clone()
}

fn clocks(rows: &[Value], name: &str) -> u64 {
    rows.iter().find(|row| row["name"] == name).unwrap()["clocks"].as_u64().unwrap()
}

#[test]
fn the_frame_of_the_paper_keeps_every_limit() {
    let rows = rows("", 0);
    assert!(rows.iter().all(|row| row["met"] == true), "{rows:#?}");
    let rest = clocks(&rows, "of these, not for pixels");
    assert_eq!(clocks(&rows, "first pixel to results"), 786_432 + rest);
    assert_eq!(clocks(&rows, "from frame to frame"), 786_432);
    assert!(rest <= 582 && clocks(&rows, "last pixel to last point") <= 150);
    assert!(clocks(&rows, "paper's picture, 720 lasers") <= 8000);
}

#[test]
fn a_limit_that_is_missed_is_told_by_its_row_and_by_the_exit_status() {
    let slow_clock = rows("--clock 100", 1);
    let missed: Vec<&Value> = slow_clock.iter().filter(|row| row["met"] == false).collect();
    assert_eq!(missed.len(), 1, "{missed:#?}");
    assert_eq!(missed[0]["limit"], "2.86 ms: the paper's frame");
    let missed_line = rows("--baud 115200", 1);
    let line = missed_line.iter().find(|row| row["name"] == "serial line, per frame").unwrap();
    assert_eq!(line["met"], false);
    let text = Folder::new().run("budget --clock 100").status(1).stdout;
    assert_eq!(text.matches("MISSED").count(), 1, "{text}");
}

#[test]
fn wider_detectors_blanking_and_snow_change_the_clocks_of_a_frame() {
    let period = |arguments: &str, status| clocks(&rows(arguments, status), "from frame to frame");
    let all_green = period("--resolution 512x384 --stray 0.5", 1);
    assert!(all_green > 512 * 384, "{all_green}");
    assert_eq!(period("--resolution 512x384 --ppc 4", 0), 512 * 384 / 4);
    assert_eq!(period("--resolution 512x384 --row-blanking 7 --frame-blanking 100", 0), 512 * 384 + 383 * 7 + 100);
}

#[test]
fn the_chart_is_an_svg_with_a_bar_per_row() {
    let folder = Folder::new();
    let run = folder.run("budget --resolution 256x192 --svg chart.svg").done();
    let chart = std::fs::read_to_string(folder.path("chart.svg")).unwrap();
    roxmltree::Document::parse(&chart).unwrap();
    for name in ["first pixel to results", "last pixel to last point", "serial line, per frame"] {
        assert!(run.stdout.contains(name) && chart.contains(name), "{name}");
    }
}

#[test]
fn sizes_that_the_detector_can_not_have_are_told() {
    let folder = Folder::new();
    folder.run("budget --resolution 1000").status(2).says("expected columns and rows");
    folder.run("budget --ppc 3").status(2).says("expected 1, 2, 4 or 8");
    folder.run("budget --resolution 1020x768 --ppc 8").status(1).says("1020 columns are not whole clocks");
}
