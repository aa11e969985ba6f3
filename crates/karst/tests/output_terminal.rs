//! Frames of a sensor on a terminal.

mod output_common;

use karst::output::terminal::{View, error_names, frame_line, picture, table};
use karst::result::{LaserResult, PointResult, Section};
use karst::sensor::{FrameCounts, SensorFrame};
use karst_link::{Errors, LinkCounters, Status};
use output_common::{DARK, REJECTED, section};

fn frame() -> SensorFrame {
    SensorFrame { number: 7, complete: true, lost_messages: 0, section: section(0) }
}

#[test]
fn a_page_fits_every_terminal_and_says_all_where_there_is_room() {
    let frame = frame();
    let errors = Errors { stuck_camera: true, ..Errors::default() };
    let status = Status { frames: 9, errors, ..Status::default() };
    let events = ["sensor says: no frame: a camera is stuck".to_owned()];
    let view = View {
        title: "simulated sensor",
        frame: Some(&frame),
        counts: FrameCounts { complete: 6, incomplete: 1, missing: 2 },
        link: LinkCounters { received: 91, lost: 4, ..LinkCounters::default() },
        status: Some(&status),
        events: &events,
    };
    for (columns, rows) in [(80, 24), (200, 60), (40, 10), (10, 3), (1, 1), (0, 0)] {
        let page = view.page(columns, rows);
        assert!(page.len() <= rows, "{columns} x {rows}: {page:?}");
        assert!(page.iter().all(|line| line.chars().count() <= columns), "{columns} x {rows}: {page:?}");
    }
    let page = view.page(120, 24).join("\n");
    for words in [
        "simulated sensor",
        "frame 7: 10 points of 12 lasers, range ",
        "no spot in camera 1 & 2",
        "chi squared 41.7 > 16.3",
        "6 complete, 1 incomplete, 2 missing",
        "91 messages, 4 lost",
        "errors: stuck camera",
        "a camera is stuck",
        "m across",
    ] {
        assert!(page.contains(words), "{words}: {page}");
    }
    // 80 columns hold the table and a picture
    assert!(view.page(80, 24).iter().any(|line| line.contains("    5 ") && line.contains('\u{2800}')));
}

#[test]
fn many_lasers_are_cut_where_the_page_ends() {
    let mut frame = frame();
    let laser = frame.section.lasers[0].clone();
    frame.section.lasers = (0..720).map(|number| LaserResult { laser: number, ..laser.clone() }).collect();
    let view = View {
        title: "",
        frame: Some(&frame),
        counts: FrameCounts::default(),
        link: LinkCounters::default(),
        status: None,
        events: &[],
    };
    let page = view.page(80, 24);
    assert_eq!(page.len(), 24);
    assert!(page.iter().any(|line| line.starts_with("... 720 lasers")), "{page:?}");
}

#[test]
fn an_incomplete_frame_says_so() {
    let frame = SensorFrame { complete: false, lost_messages: 3, ..frame() };
    assert!(frame_line(&frame).ends_with(", INCOMPLETE: 3 messages lost"), "{}", frame_line(&frame));
}

#[test]
fn the_table_has_a_line_per_laser_with_its_figures_or_the_reason() {
    let section = section(0);
    let lines = table(&section);
    assert_eq!(lines.len(), 13);
    let point = section.lasers[0].point.as_ref().unwrap();
    for figure in [format!("{:.1}", point.range_mm), format!("{:.2}", point.sigma_mm.unwrap())] {
        assert!(lines[1].contains(&figure), "{figure}: {}", lines[1]);
    }
    assert_eq!(lines[1 + DARK], "    4 no spot in camera 1 & 2");
    assert_eq!(lines[1 + REJECTED], "    9 chi squared 41.7 > 16.3");
}

#[test]
fn the_picture_has_x_to_the_right_and_y_up() {
    let empty = Section { lasers: Vec::new(), ..section(0) };
    let with = |places: &[[f64; 2]]| {
        let lasers = places.iter().map(|&[x, y]| LaserResult {
            laser: 0,
            status: "point".into(),
            point: Some(PointResult {
                position_mm: [x, y, 0.0],
                range_mm: x.hypot(y),
                sigma_mm: None,
                chi2: None,
                estimates_mm: [None; 3],
            }),
            spots: [None, None],
            truth: None,
        });
        picture(&Section { lasers: lasers.collect(), ..empty.clone() }, 40, 21)
    };
    // Cells that are not blank, as (column, row) from the top left
    let marks = |lines: &[String]| -> Vec<(usize, usize)> {
        let cells =
            lines[..20].iter().enumerate().flat_map(|(y, line)| line.chars().enumerate().map(move |(x, c)| (x, y, c)));
        cells.filter(|&(.., c)| c != '\u{2800}').map(|(x, y, _)| (x, y)).collect()
    };
    let axis = marks(&picture(&empty, 40, 21));
    assert!(axis.iter().all(|&(x, y)| (18..=21).contains(&x) && (9..=10).contains(&y)), "{axis:?}");
    let right = with(&[[1000.0, 0.0]]);
    assert!(marks(&right).iter().any(|&(x, y)| x >= 38 && (9..=10).contains(&y)), "{right:?}");
    assert!(right[20].contains("2.00 m across"), "{right:?}");
    let up = with(&[[0.0, 1000.0]]);
    assert!(marks(&up).iter().any(|&(x, y)| (19..=20).contains(&x) && y == 0), "{up:?}");
    // A line joins neighbours
    let joined = with(&[[1000.0, 1000.0], [-1000.0, 1000.0]]);
    assert!(marks(&joined).iter().filter(|&&(_, y)| y == 0).count() >= 38, "{joined:?}");
    let far_out = with(&[[f64::from(i32::MAX), f64::NAN]]);
    assert_eq!(far_out.len(), 21);
}

#[test]
fn errors_have_names() {
    assert!(error_names(&Errors::default()).is_empty());
    let errors = Errors { detector_overflow: true, link: true, ..Errors::default() };
    assert_eq!(error_names(&errors), ["detector overflow", "link"]);
}
