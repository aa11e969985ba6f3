//! The files of a measured sequence.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::time::SystemTime;

use anyhow::Context;
use image::RgbImage;
use karst::output::overlay::{self, Guides};
use karst::output::report::{Report, ReportFrame};
use karst::output::{csv, folder, mcap, plot, ply, report};
use karst::result::Section;
use karst_rig::Rig;

use super::{count, print, write_text};

/// Frames of a sequence whose pictures are shown and kept; the report would grow by half a megabyte with each.
pub const PICTURED_FRAMES: usize = 24;

/// One frame with what the report shows of it.
pub struct MeasuredFrame {
    /// The result.
    pub section: Section,
    /// The pictures, for the first [`PICTURED_FRAMES`].
    pub images: Option<[RgbImage; 2]>,
    /// The true wall in the belt plane, if known.
    pub outline_mm: Vec<[f64; 2]>,
}

/// Writes points (PLY, CSV, MCAP), results (JSON), pictures with the spots drawn in, and the report.
pub fn write(out: &Path, title: &str, rig: &Rig, frames: &[MeasuredFrame], problems: &[String]) -> anyhow::Result<()> {
    let sections: Vec<Section> = frames.iter().map(|f| f.section.clone()).collect();
    write_points(out, &sections)?;
    if let [frame] = frames {
        write_text(out.join("section.svg"), &plot::section_plot(&frame.section, &frame.outline_mm)?)?;
    }
    let guides = Guides::new(rig);
    for frame in frames {
        for (camera, image) in frame.images.iter().flatten().enumerate() {
            let path = out.join(format!("{}_camera{}_spots.png", frame.section.frame, camera + 1));
            overlay::draw(image, &frame.section, camera, Some(&guides[camera]))
                .save(&path)
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
    }
    let report_frames: Vec<ReportFrame> = frames
        .iter()
        .map(|f| ReportFrame {
            section: &f.section,
            images: f.images.as_ref().map(|[a, b]| [a, b]),
            outline_mm: &f.outline_mm,
        })
        .collect();
    let html = report::html(&Report { title, created: SystemTime::now(), rig, frames: &report_frames, problems })?;
    write_text(out.join("report.html"), &html)
}

/// Writes points (PLY, CSV, MCAP) and results (JSON).
pub fn write_points(out: &Path, sections: &[Section]) -> anyhow::Result<()> {
    folder::prepare(out)?;
    let create = |name: &str| {
        let path = out.join(name);
        File::create(&path).map(BufWriter::new).with_context(|| format!("cannot write {}", path.display()))
    };
    ply::write(sections, create("points.ply")?)?;
    csv::write(sections, create("points.csv")?)?;
    mcap::write(sections, create("points.mcap")?)?;
    write_text(out.join("sections.json"), &serde_json::to_string_pretty(sections)?)
}

/// A few lines for people.
pub fn print_summary(sections: &[&Section]) -> anyhow::Result<()> {
    let summary = karst::output::summary::Summary::new(sections);
    let [points, lasers, frames] = [(summary.points, "point"), (summary.lasers, "laser"), (summary.frames, "frame")]
        .map(|(number, noun)| count(number, noun));
    print(format_args!("{points} of {lasers} in {frames}"))?;
    if let (Some(mean), Some(worst)) = (summary.mean_error_percent, summary.worst_error_mm) {
        print(format_args!("range error: mean {mean:.3} %, worst {worst:.2} mm"))?;
    }
    if let Some(t) = summary.timing {
        print(format_args!(
            "per frame: {:.2} ms to find the spots, {:.3} ms to reconstruct",
            t.detect_ms, t.reconstruct_ms
        ))?;
    }
    Ok(())
}
