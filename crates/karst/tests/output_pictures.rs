//! Pictures, plots and reports.

mod output_common;

use karst::output::{overlay, plot, report};
use karst_rig::Rig;
use output_common::{image, outline_mm, section};
use std::time::{Duration, SystemTime};

#[test]
fn samples() {
    let Some(folder) = std::env::var_os("KARST_SAMPLES") else { return };
    let folder = std::path::PathBuf::from(folder);
    let rig = Rig::default();
    let sections: Vec<_> = (0..3).map(section).collect();
    let images: Vec<_> = sections.iter().map(|s| [image(s, 0), image(s, 1)]).collect();
    let outlines: Vec<_> = (0..3).map(outline_mm).collect();
    let frames: Vec<_> = (0..3)
        .map(|i| report::ReportFrame {
            section: &sections[i],
            images: Some(images[i].each_ref()),
            outline_mm: &outlines[i],
        })
        .collect();
    for (name, frames) in [("one", &frames[..1]), ("many", &frames[..])] {
        let html = report::html(&report::Report {
            title: "Gallery <north> & sump",
            created: SystemTime::UNIX_EPOCH + Duration::from_secs(1_800_000_000),
            rig: &rig,
            frames,
            problems: &["frame 0007: missing in camera 2's folder".to_owned()][..frames.len() / 3],
        })
        .unwrap();
        std::fs::write(folder.join(format!("{name}.html")), html).unwrap();
    }
    let guides = overlay::Guides::new(&rig);
    overlay::draw(&images[0][0], &sections[0], 0, Some(&guides[0])).save(folder.join("overlay.png")).unwrap();
    overlay::gallery(&images[0][1], &sections[0], 1).save(folder.join("gallery.png")).unwrap();
    std::fs::write(folder.join("section.svg"), plot::section_plot(&sections[0], &outlines[0]).unwrap()).unwrap();
    std::fs::write(folder.join("error.svg"), plot::error_plot(&[&sections[0]]).unwrap().unwrap()).unwrap();
    std::fs::write(folder.join("rig.svg"), plot::rig_plot(&rig).unwrap()).unwrap();
}
