//! The report of a calibration as one self-contained HTML file.

use std::time::SystemTime;

use karst_calib::BIAS_RANGES_MM;
use karst_rig::Rig;
use maud::{Markup, PreEscaped, html};

use super::{BeltResult, CameraResult, CamerasResult, CornersResult, Coverage, WayResult};
use crate::output::page::{Page, card};
use crate::output::{OutputError, plot};

/// What a report tells.
#[derive(Debug, Clone, Copy)]
pub struct Report<'a> {
    /// Time to print in the header.
    pub created: SystemTime,
    /// The calibrated rig.
    pub rig: &'a Rig,
    /// Corners per set and camera.
    pub corners: &'a [CornersResult],
    /// The cameras.
    pub cameras: &'a CamerasResult,
    /// The belt.
    pub belt: &'a BeltResult,
}

/// The report as HTML.
pub fn html(report: &Report) -> Result<String, OutputError> {
    let Report { rig, cameras, belt, .. } = report;
    let maps = [0, 1].map(|index| {
        let title = format!("Camera {}", index + 1);
        plot::residual_map(&title, &rig.cameras[index], &cameras.cameras[index].residuals)
    });
    let [first, second] = maps;
    let maps = [first?, second?];
    let advice: Vec<String> = cameras.advice().into_iter().chain(belt.advice(rig.reconstruction.range_mm)).collect();
    let title = format!("Calibration of {}", rig.name);
    let facts = vec![
        ("Lasers", rig.lasers.len().to_string()),
        ("Created", humantime::format_rfc3339_seconds(report.created).to_string()),
    ];
    let main = html! {
        (cards(cameras, belt))
        @if !cameras.warnings.is_empty() {
            section .problems {
                h2 { "What may be wrong" }
                ul { @for warning in &cameras.warnings { li { (warning) } } }
            }
        }
        h2 { "What to photograph next" }
        @if advice.is_empty() {
            p { "Nothing is missing: the boards cover both pictures, the spots the working range." }
        } @else {
            ul { @for line in &advice { li { (line) } } }
        }
        h2 { "Cameras" }
        (camera_table(&cameras.cameras))
        @for ((index, camera), map) in cameras.cameras.iter().enumerate().zip(maps) {
            h3 { "Residuals of camera " (index + 1) }
            figure .plot { (PreEscaped(map)) }
            (coverage_table(&camera.coverage))
        }
        @for (index, ways) in cameras.in_water.iter().enumerate() {
            @if !ways.is_empty() {
                h3 { "Three models of camera " (index + 1) " in the water" }
                (way_table(ways))
            }
        }
        h2 { "Standard deviations" }
        (parameter_table(cameras))
        h2 { "Belt" }
        (beam_table(belt))
        h2 { "What was not used" }
        (rejected(report))
    };
    let footer = html! {
        "Residuals of corners are lengths in the picture, those of spots are per axis; RMS over all. Held out: boards that "
        "the cameras were not fitted to, each with a pose from every other of its corners. Uncertainties are standard "
        "deviations."
    };
    Ok(Page { title: &title, facts, main, footer }.html())
}

fn cards(cameras: &CamerasResult, belt: &BeltResult) -> Markup {
    let holdout = cameras.holdout_rms_px.map_or("–".to_owned(), |rms| format!("{rms:.3} px"));
    let coverage = cameras.cameras.each_ref().map(|camera| format!("{:.0} %", 100.0 * camera.coverage.share()));
    html! {
        div .cards {
            (card("Corners, rms", &format!("{:.3} px", cameras.rms_inliers_px), "of the inliers"))
            (card("Corners held out, rms", &holdout, "close to the former: not overfitted"))
            (card(
                "Baseline",
                &format!("{:.2} mm", cameras.baseline_mm),
                &format!(
                    "± {:.2} mm, {:.2} in the drawing, {} pairs",
                    cameras.baseline_sigma_mm, cameras.baseline_drawn_mm, cameras.pairs_used
                ),
            ))
            (card("Coverage", &coverage.join(" / "), "of the two pictures"))
            (card("Spots, rms", &format!("{:.3} px", belt.rms_px), &format!("{} pairs of pictures", belt.pictures)))
            (card("χ² per degree of freedom", &format!("{:.2}", belt.chi2_per_dof), "of the spots on their beams"))
        }
    }
}

fn camera_table(cameras: &[CameraResult; 2]) -> Markup {
    html! {
        div .scroll {
            table .small {
                thead {
                    tr {
                        th .text { "Camera" } th { "Views" } th { "Corners" } th { "Outliers" }
                        th { "RMS" span .unit { "px" } } th { "RMS of inliers" span .unit { "px" } }
                        th { "Centre" span .unit { "px" } } th { "Degree" }
                        th { "Rays known to" span .unit { "mrad" } } th { "From, to" span .unit { "px from the centre" } }
                    }
                }
                tbody {
                    @for (index, camera) in cameras.iter().enumerate() {
                        tr {
                            td .text { (index + 1) } td { (camera.views_used) } td { (camera.corners) }
                            td { (camera.corners - camera.inliers) }
                            td { (format!("{:.3}", camera.rms_px)) } td { (format!("{:.3}", camera.rms_inliers_px)) }
                            td { (format!("{:.2}, {:.2}", camera.centre_px[0], camera.centre_px[1])) }
                            td { (camera.degree) } td { (format!("{:.2}", camera.ray_sigma_mrad)) }
                            td { (format!("{:.0}, {:.0}", camera.radius_px[0], camera.radius_px[1])) }
                        }
                    }
                }
            }
        }
    }
}

fn coverage_table(coverage: &Coverage) -> Markup {
    let sectors = coverage.corners.first().map_or(0, |ring| ring.len());
    html! {
        div .scroll {
            table .small {
                thead {
                    tr {
                        th .text { "Corners by radius and azimuth" }
                        @for sector in 0..sectors { th { (360 * sector / sectors) "°" } }
                    }
                }
                tbody {
                    @for (limits, ring) in coverage.radii_px.windows(2).zip(&coverage.corners) {
                        tr {
                            td .text { (format!("{:.0} to {:.0} px", limits[0], limits[1])) }
                            @for count in ring { td { (count) } }
                        }
                    }
                }
            }
        }
    }
}

fn way_table(ways: &[WayResult]) -> Markup {
    let name = |way: &str| match way {
        "traced" => "traced through tube and water",
        "axial" => "axial, from boards in the water",
        _ => "compact (single viewpoint), from boards in the water",
    };
    html! {
        div .scroll {
            table .small {
                thead {
                    tr {
                        th .text { "Model" } th { "RMS" span .unit { "px" } } th { "Held out" span .unit { "px" } }
                        @for range in BIAS_RANGES_MM { th { "Bias at " (range / 1000.0) " m" span .unit { "%" } } }
                    }
                }
                tbody {
                    @for way in ways {
                        tr {
                            td .text { (name(&way.way)) } td { (format!("{:.3}", way.rms_px)) }
                            td { @if let Some(rms) = way.holdout_rms_px { (format!("{rms:.3}")) } @else { "–" } }
                            @for bias in way.bias_pct {
                                td { @if let Some(bias) = bias { (format!("{:+.2}", bias)) } @else { "–" } }
                            }
                        }
                    }
                }
            }
        }
        p .muted {
            "Bias: mean range error of this camera with a perfectly known laser half way between the cameras, against the "
            "calibrated camera traced through tube and water."
        }
    }
}

fn parameter_table(cameras: &CamerasResult) -> Markup {
    html! {
        details {
            summary { (cameras.parameters.len()) " parameters of cameras and tube" }
            div .scroll {
                table .small {
                    thead { tr { th .text { "Parameter" } th { "Standard deviation" } th .text { "Unit" } } }
                    tbody {
                        @for parameter in &cameras.parameters {
                            tr {
                                td .text { (parameter.name) }
                                td { (format!("{:.6}", parameter.sigma)) }
                                td .text { (parameter.unit) }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn beam_table(belt: &BeltResult) -> Markup {
    html! {
        p {
            "Smallest uncertainty of a spot that explains the residuals: " (format!("{:.4}", belt.sigma_floor_px))
            " px per axis."
        }
        div .scroll {
            table .small {
                thead {
                    tr {
                        th .text { "Laser" } th { "Spots" } th { "Nearest" span .unit { "mm" } }
                        th { "Farthest" span .unit { "mm" } } th { "Origin known to" span .unit { "mm" } }
                        th { "Direction known to" span .unit { "mrad" } } th { "RMS" span .unit { "px" } }
                        th { "χ² per degree of freedom" }
                    }
                }
                tbody {
                    @for (index, beam) in belt.beams.iter().enumerate() {
                        tr {
                            td .text { (index) } td { (beam.spots) }
                            td { (format!("{:.0}", beam.range_mm[0])) } td { (format!("{:.0}", beam.range_mm[1])) }
                            td { (format!("{:.3}", beam.origin_sigma_mm)) }
                            td { (format!("{:.3}", beam.direction_sigma_mrad)) }
                            td { (format!("{:.3}", beam.rms_px)) } td { (format!("{:.2}", beam.chi2_per_dof)) }
                        }
                    }
                }
            }
        }
    }
}

fn rejected(report: &Report) -> Markup {
    let pictures = report.corners.iter().flat_map(|set| &set.rejected);
    let views = report.cameras.cameras.iter().flat_map(|camera| &camera.views_rejected);
    let corners = report.cameras.cameras.iter().flat_map(|camera| &camera.outliers);
    let groups: [(&str, Vec<&String>); 5] = [
        ("Pictures without the board", pictures.chain(&report.belt.pictures_failed).collect()),
        ("Views", views.collect()),
        ("Pairs of views", report.cameras.pairs_rejected.iter().collect()),
        ("Corners", corners.collect()),
        ("Spots", report.belt.spots_rejected.iter().collect()),
    ];
    html! {
        @for (name, lines) in &groups {
            details {
                summary { (name) ": " (lines.len()) }
                ul { @for line in lines { li { (line) } } }
            }
        }
    }
}
