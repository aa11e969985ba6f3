//! The report of measured frames.

use super::overlay::{self, Guides};
use super::page::{Page, card};
use super::summary::{Summary, range_error_mm};
use super::{OutputError, plot};
use crate::result::{LaserResult, Section, SpotResult};
use base64::prelude::{BASE64_STANDARD, Engine};
use image::codecs::jpeg::JpegEncoder;
use image::{ImageFormat, RgbImage};
use karst_rig::Rig;
use maud::{Markup, PreEscaped, html};
use std::io::Cursor;
use std::time::SystemTime;

/// Quality of the camera pictures, per cent: the markers stay sharp, haze and noise stay small.
const JPEG_QUALITY: u8 = 88;

/// What a report tells.
#[derive(Debug, Clone, Copy)]
pub struct Report<'a> {
    /// Headline.
    pub title: &'a str,
    /// Time to print in the header.
    pub created: SystemTime,
    /// The rig that was used.
    pub rig: &'a Rig,
    /// The frames, in order.
    pub frames: &'a [ReportFrame<'a>],
    /// Frames that could not be processed and other problems, in words.
    pub problems: &'a [String],
}

/// One frame of a report.
#[derive(Debug, Clone, Copy)]
pub struct ReportFrame<'a> {
    /// Result.
    pub section: &'a Section,
    /// The camera images; about 0.5 MB of the report per frame.
    pub images: Option<[&'a RgbImage; 2]>,
    /// The true wall in the belt plane as a closed line (x, y), mm; empty: unknown.
    pub outline_mm: &'a [[f64; 2]],
}

/// The report as HTML.
pub fn html(report: &Report) -> Result<String, OutputError> {
    let sections: Vec<&Section> = report.frames.iter().map(|frame| frame.section).collect();
    let guides = Guides::new(report.rig);
    let frames = report.frames.iter().map(|frame| self::frame(frame, &guides)).collect::<Result<Vec<_>, _>>()?;
    let error_plot = plot::error_plot(&sections)?;
    let sequence_plot = if sections.len() > 1 { Some(plot::sequence_plot(&sections)?) } else { None };
    let methods = distinct(sections.iter().map(|s| format!("{}, {}", s.method, s.arithmetic)));
    let mut facts = vec![("Rig", report.rig.name.clone()), ("Lasers", report.rig.lasers.len().to_string())];
    if !methods.is_empty() {
        facts.push(("Method", methods));
    }
    facts.push(("Created", humantime::format_rfc3339_seconds(report.created).to_string()));
    let main = html! {
        (summary_cards(&Summary::new(&sections)))
        @if !report.problems.is_empty() {
            section .problems {
                h2 { (report.problems.len()) " problem" @if report.problems.len() != 1 { "s" } }
                ul { @for problem in report.problems { li { (problem) } } }
            }
        }
        @if let ([frame], [section]) = (frames.as_slice(), sections.as_slice()) {
            h2 { "Frame " (section.frame) }
            (frame)
        } @else if !frames.is_empty() {
            h2 { "Sequence" }
            (sequence_table(&sections))
            @if let Some(svg) = sequence_plot {
                h2 { "Cross-sections" }
                figure .plot { (PreEscaped(svg)) }
            }
        }
        @if let Some(svg) = error_plot {
            h2 { "Range error" }
            figure .plot { (PreEscaped(svg)) }
        }
        @if frames.len() > 1 {
            h2 { "Frames" }
            @for (frame, section) in frames.iter().zip(&sections) {
                details {
                    summary {
                        b { (section.frame) } " "
                        (frame_line(&Summary::new(&[section])))
                    }
                    (frame)
                }
            }
        }
    };
    let footer = html! {
        "Ranges are distances from the rig axis; σ is the reported standard deviation along the beam. The three single "
        "estimates are ranges along the beam from the laser's origin. χ² has three degrees of freedom."
    };
    Ok(Page { title: report.title, facts, main, footer }.html())
}

fn distinct(values: impl Iterator<Item = String>) -> String {
    let values: std::collections::BTreeSet<String> = values.collect();
    values.into_iter().collect::<Vec<_>>().join("; ")
}

fn summary_cards(summary: &Summary) -> Markup {
    let card = |name: &str, value: Option<String>, note: String| {
        html! { @if let Some(value) = value { (card(name, &value, &note)) } }
    };
    let millimetres = |value: Option<f64>| value.map(|v| format!("{v:.2} mm"));
    let times = summary.timing.map(|t| {
        (
            format!("{:.2} ms", t.detect_ms + t.reconstruct_ms),
            format!("per frame: detection {:.2}, reconstruction {:.3}", t.detect_ms, t.reconstruct_ms),
        )
    });
    html! {
        div .cards {
            @if summary.frames != 1 { (card("Frames", Some(summary.frames.to_string()), String::new())) }
            (card("Points", Some(format!("{} of {}", summary.points, summary.lasers)), match summary.missed {
                Some(0) => "none missed that both cameras see".into(),
                Some(missed) => format!("{missed} missed that both cameras see"),
                None => "lasers".into(),
            }))
            (card("Mean range", summary.mean_range_mm.map(|r| format!("{:.3} m", r / 1000.0)), String::new()))
            (card("Mean σ", millimetres(summary.mean_sigma_mm), "as reported".into()))
            (card("Mean |error|", summary.mean_error_percent.map(|e| format!("{e:.3} %")), "of the true range".into()))
            (card("RMS error", millimetres(summary.rms_error_mm), match (summary.bias_mm, summary.worst_error_mm) {
                (Some(bias), Some(worst)) => format!("bias {bias:+.2} mm, largest {worst:.2} mm"),
                _ => String::new(),
            }))
            (card("Mean χ² / dof", summary.mean_chi2_per_dof.map(|c| format!("{c:.2}")), "1 when σ is right".into()))
            @if let Some((total, parts)) = times { (card("Time", Some(total), parts)) }
        }
    }
}

/// One line about a frame.
fn frame_line(summary: &Summary) -> Markup {
    html! {
        span .muted {
            (summary.points) " of " (summary.lasers) " points"
            @if let Some(rms) = summary.rms_error_mm { ", rms error " (format!("{rms:.2}")) " mm" }
        }
    }
}

fn sequence_table(sections: &[&Section]) -> Markup {
    html! {
        div .scroll {
            table {
                thead {
                    tr {
                        th .text { "Frame" } th { "Points" } th { "Mean range" span .unit { "m" } }
                        th { "Mean σ" span .unit { "mm" } } th { "RMS error" span .unit { "mm" } }
                        th { "Mean |error|" span .unit { "%" } } th { "Mean χ² / dof" }
                        th { "Time" span .unit { "ms" } }
                    }
                }
                tbody {
                    @for section in sections {
                        @let s = Summary::new(&[section]);
                        tr {
                            td .text { (section.frame) } td { (s.points) " / " (s.lasers) }
                            (number(s.mean_range_mm.map(|r| r / 1000.0), 3))
                            (number(s.mean_sigma_mm, 2)) (number(s.rms_error_mm, 2))
                            (number(s.mean_error_percent, 3)) (number(s.mean_chi2_per_dof, 2))
                            (number(s.timing.map(|t| t.detect_ms + t.reconstruct_ms), 2))
                        }
                    }
                }
            }
        }
    }
}

fn frame(frame: &ReportFrame, guides: &[Guides; 2]) -> Result<Markup, OutputError> {
    let section = frame.section;
    let section_plot = plot::section_plot(section, frame.outline_mm)?;
    let pictures = match frame.images {
        Some(images) => Some(pictures(images, section, guides)?),
        None => None,
    };
    Ok(html! {
        figure .plot { (PreEscaped(section_plot)) }
        (laser_table(section))
        @if let Some(pictures) = pictures { (pictures) }
        (detector_table(section))
    })
}

fn pictures(images: [&RgbImage; 2], section: &Section, guides: &[Guides; 2]) -> Result<Markup, OutputError> {
    let mut overlays = Vec::new();
    let mut galleries = Vec::new();
    for camera in [0, 1] {
        let image = images[camera];
        let picture = overlay::draw(image, section, camera, Some(&guides[camera]));
        overlays.push(jpeg_uri(&picture)?);
        let mut tiles = Vec::new();
        for laser in &section.lasers {
            if let Some(crop) = overlay::spot_crop(image, laser, camera) {
                tiles.push((laser, png_uri(&crop)?));
            }
        }
        galleries.push(tiles);
    }
    Ok(html! {
        h3 { "Camera images" }
        div .pair {
            @for (camera, uri) in overlays.iter().enumerate() {
                figure {
                    img src=(uri) alt={ "Camera " (camera + 1) " with the spots found" };
                    figcaption { "Camera " (camera + 1) }
                }
            }
        }
        p .key {
            span .accepted { "spot of a point" } span .rejected { "spot without a point" }
            span .truth { "true place" } span .beam { "image of the beam over the working range" }
            span .muted { "grey: mirror and sectors" }
        }
        @for (camera, tiles) in galleries.iter().enumerate() {
            h3 { "Spots of camera " (camera + 1) span .muted { ", magnified " (overlay::CROP_SCALE) " x" } }
            div .gallery {
                @for (laser, uri) in tiles {
                    figure {
                        img src=(uri) alt={ "Spot of laser " (laser.laser) };
                        figcaption { b { (laser.laser) } " " (spot_caption(laser, camera)) }
                    }
                }
            }
        }
    })
}

/// Quality of a spot and, where the truth is known, its distance from it.
fn spot_caption(laser: &LaserResult, camera: usize) -> Markup {
    let Some(spot) = &laser.spots[camera] else {
        return html! { span .muted { "not found" } };
    };
    let truth = laser.truth.as_ref().and_then(|t| t.pixels[camera]);
    let offset = truth.map(|[x, y]| (spot.pixel[0] - x).hypot(spot.pixel[1] - y));
    html! {
        "σ " (format!("{:.3}", spot.sigma_px)) " px"
        @if let Some(offset) = offset { br; span .muted { "off by " (format!("{offset:.3}")) " px" } }
    }
}

fn laser_table(section: &Section) -> Markup {
    let truth_known = section.lasers.iter().any(|l| l.truth.is_some());
    html! {
        h3 { "Lasers" }
        div .scroll {
            table {
                thead {
                    tr {
                        th { "Laser" } th .text { "Status" }
                        th { "Range" span .unit { "mm" } } th { "σ" span .unit { "mm" } }
                        @if truth_known {
                            th { "Truth" span .unit { "mm" } } th { "Error" span .unit { "mm" } }
                            th { "Error" span .unit { "σ" } }
                        }
                        th { "χ²" }
                        th { "Camera 1 + laser" span .unit { "mm" } }
                        th { "Camera 2 + laser" span .unit { "mm" } }
                        th { "Stereo" span .unit { "mm" } }
                        th { "Spot 1" span .unit { "px" } } th { "σ" span .unit { "px" } }
                        th { "Pixels" span .unit { "saturated" } }
                        th { "Spot 2" span .unit { "px" } } th { "σ" span .unit { "px" } }
                        th { "Pixels" span .unit { "saturated" } }
                    }
                }
                tbody { @for laser in &section.lasers { (laser_row(laser, truth_known)) } }
            }
        }
    }
}

fn laser_row(laser: &LaserResult, truth_known: bool) -> Markup {
    let point = laser.point.as_ref();
    let sigma = point.and_then(|p| p.sigma_mm);
    let error = range_error_mm(laser);
    let class = if point.is_some() { "" } else { "nopoint" };
    html! {
        tr class=(class) {
            td { b { (laser.laser) } }
            td .status { (laser.status) }
            (number(point.map(|p| p.range_mm), 2)) (number(sigma, 2))
            @if truth_known {
                (number(laser.truth.as_ref().and_then(|t| t.range_mm), 2))
                (signed(error, 2))
                (signed(error.zip(sigma).filter(|(_, s)| *s > 0.0).map(|(e, s)| e / s), 1))
            }
            (number(point.and_then(|p| p.chi2), 2))
            @for i in 0..3 { (number(point.and_then(|p| p.estimates_mm[i]), 1)) }
            @for spot in &laser.spots { (spot_cells(spot.as_ref())) }
        }
    }
}

fn spot_cells(spot: Option<&SpotResult>) -> Markup {
    html! {
        @match spot {
            Some(spot) => {
                td { (format!("{:.2}, {:.2}", spot.pixel[0], spot.pixel[1])) }
                (number(Some(spot.sigma_px), 3))
                td { (spot.pixels) @if spot.saturated > 0 { " (" (spot.saturated) ")" } }
            }
            None => { (number(None, 0)) (number(None, 0)) (number(None, 0)) }
        }
    }
}

fn detector_table(section: &Section) -> Markup {
    html! {
        h3 { "Detector" }
        div .scroll {
            table .small {
                thead {
                    tr {
                        th .text { "Camera" } th { "Green pixels" } th { "Outside mirror or sectors" }
                        th { "Without a free candidate" } th { "Spots kept" }
                    }
                }
                tbody {
                    @for (camera, counters) in section.detector.iter().enumerate() {
                        tr {
                            td .text { (camera + 1) } td { (counters.hits) } td { (counters.outside) }
                            td { (counters.overflow) } td { @if let Some(spots) = counters.spots { (spots) } @else { "-" } }
                        }
                    }
                }
            }
        }
        @if let Some(timing) = section.timing {
            p .muted {
                "Detection in both images " (format!("{:.2}", timing.detect_ms)) " ms, reconstruction "
                (format!("{:.3}", timing.reconstruct_ms)) " ms."
            }
        }
    }
}

fn number(value: Option<f64>, digits: usize) -> Markup {
    html! { td { @if let Some(value) = value { (format!("{value:.digits$}")) } @else { span .muted { "–" } } } }
}

fn signed(value: Option<f64>, digits: usize) -> Markup {
    html! { td { @if let Some(value) = value { (format!("{value:+.digits$}")) } @else { span .muted { "–" } } } }
}

fn jpeg_uri(image: &RgbImage) -> Result<String, OutputError> {
    let mut bytes = Vec::new();
    image.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY))?;
    Ok(format!("data:image/jpeg;base64,{}", BASE64_STANDARD.encode(bytes)))
}

fn png_uri(image: &RgbImage) -> Result<String, OutputError> {
    let mut bytes = Vec::new();
    image.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png)?;
    Ok(format!("data:image/png;base64,{}", BASE64_STANDARD.encode(bytes)))
}
