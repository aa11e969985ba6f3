//! The accuracy evaluation: rendered frames with known truth through the whole chain.

use std::collections::BTreeMap;

use anyhow::{Context, bail};
use karst_core::{Method, Spot};
use karst_reference::Point;
use karst_rig::{CameraModel, Rig, fit_axial, fit_compact, mono_bias};
use karst_scene::{FrameTruth, LaserTruth, NamedScene, Renderer, SpotTruth, evaluation_scenes, laser_free_scenes};
use nalgebra::Isometry3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::instrument::{Arithmetic, Detection, Instrument};
use crate::output::summary::mean;

/// A detected spot within this distance of the true one is that spot, px.
const FOUND_WITHIN_PX: f64 = 3.0;

/// Noise-free peak of G from which a spot is a bright one, grey levels above the background.
const BRIGHT_DN: f64 = 120.0;

/// A point further than this from the true one is a false point: a share of the range, and at least some millimetres.
const FALSE_BEYOND: f64 = 0.05;
const FALSE_BEYOND_MM: f64 = 25.0;

/// True ranges that count as near, and as 4.8 m, mm.
const NEAR_MM: f64 = 3000.0;
const FAR_MM: std::ops::Range<f64> = 4560.0..5040.0;

/// The figures of a group of frames. A figure without data is none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Mean |range error| of the weighted method over true ranges up to 3 m, per cent.
    pub mean_abs_range_error_pct_to_3m: Option<f64>,
    /// The same over true ranges of 4.56 to 5.04 m.
    pub mean_abs_range_error_pct_at_4_8m: Option<f64>,
    /// The same as the first, for the paper's method on the same images.
    pub paper_mean_abs_range_error_pct_to_3m: Option<f64>,
    /// The same as the second, for the paper's method.
    pub paper_mean_abs_range_error_pct_at_4_8m: Option<f64>,
    /// Mean square range error over the frames in the hexagonal pool, mm^2.
    pub hexagon_mse_mm2: Option<f64>,
    /// The same for the paper's method.
    pub paper_hexagon_mse_mm2: Option<f64>,
    /// Root mean square position error of bright spots, px per axis.
    pub spot_rms_px: Option<f64>,
    /// Spots found, per cent of the visible ones.
    pub spots_found_pct: Option<f64>,
    /// Points where there is nothing, or more than 5 % of the range (and 25 mm) from what is there.
    pub false_points: usize,
    /// Largest difference between Q18.14 and f64 in any coordinate of any point of either method, mm.
    pub fixed_vs_f64_max_mm: Option<f64>,
    /// Lasers for which Q18.14 and f64 came to different decisions.
    pub decision_mismatches: usize,
    /// Mean chi squared per degree of freedom.
    pub chi2_per_dof: Option<f64>,
    /// Points of the weighted method.
    pub points: usize,
    /// Lasers without a point although both cameras see the spot.
    pub missed_points: usize,
    /// Frames.
    pub frames: usize,
}

/// The figures of one scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneFigures {
    /// Name of the scene.
    pub name: String,
    /// Kind of the scene.
    pub kind: String,
    /// Its figures.
    #[serde(flatten)]
    pub figures: Figures,
}

/// Range error of one camera and a perfect laser, for the two kinds of camera model, both fitted to the same rays through
/// the tube.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ModelBias {
    /// True range, mm.
    pub range_mm: f64,
    /// Compact (single-viewpoint) model, calibrated in the water at 0.7 m, per cent.
    pub compact_pct: f64,
    /// Axial model, per cent.
    pub axial_pct: f64,
}

/// Where the paper's single-viewpoint model is calibrated for [`ModelBias`], mm.
const COMPACT_CALIBRATION_MM: f64 = 700.0;

/// The ranges of [`ModelBias`], mm.
const BIAS_RANGES_MM: [f64; 7] = [300.0, 400.0, 700.0, 1000.0, 2000.0, 3000.0, 4800.0];

/// The bias of the two camera models behind the tube of the ideal rig, camera 1, laser 0.
pub fn model_bias() -> anyhow::Result<Vec<ModelBias>> {
    let rig = Rig::ideal();
    let camera = &rig.cameras[0];
    let radius_px = [camera.inner_radius_px, camera.mirror_radius_px];
    let traced = rig.traced_camera(0).context("the ideal rig has no tube")?;
    let (compact, _) = fit_compact(&traced, radius_px, COMPACT_CALIBRATION_MM)?;
    let (axial, _) = fit_axial(&traced, radius_px, rig.reconstruction.range_mm)?;
    let laser = &rig.lasers[0];
    let bias = |model: &CameraModel, range_mm: f64| {
        let bias = mono_bias(&traced, model, laser, range_mm).context("a point of the beam is not measured")?;
        anyhow::Ok(100.0 * bias)
    };
    let rows = BIAS_RANGES_MM.map(|range_mm| {
        Ok(ModelBias { range_mm, compact_pct: bias(&compact, range_mm)?, axial_pct: bias(&axial, range_mm)? })
    });
    rows.into_iter().collect()
}

/// The whole evaluation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Over all frames.
    #[serde(flatten)]
    pub figures: Figures,
    /// Per kind of scene.
    pub kinds: BTreeMap<String, Figures>,
    /// Per scene.
    pub scenes: Vec<SceneFigures>,
    /// What the camera model alone does to the range.
    pub model_bias: Vec<ModelBias>,
}

/// What one laser of one frame contributes.
#[derive(Debug, Clone, Default)]
struct Sample {
    hexagon: bool,
    true_range: Option<f64>,
    error: Option<f64>,
    paper_error: Option<f64>,
    chi2_per_dof: Option<f64>,
    false_point: bool,
    missed: bool,
    visible: usize,
    found: usize,
    bright_square_errors: Vec<f64>,
    fixed_vs_f64: Option<f64>,
    mismatches: usize,
}

impl Sample {
    fn new(instrument: &Instrument, detection: &Detection, laser: usize, truth: Option<&LaserTruth>) -> Self {
        let mut sample = Self::default();
        let mut fixed = [Method::Weighted, Method::Paper].map(|method| {
            let fixed = instrument.point(detection, laser, method, Arithmetic::Fixed);
            match (&fixed, instrument.point(detection, laser, method, Arithmetic::F64)) {
                (Ok(a), Ok(b)) if a.spots == b.spots => {
                    let worst = (0..3).map(|i| (a.position[i] - b.position[i]).abs()).fold(0.0, f64::max);
                    sample.fixed_vs_f64 = Some(sample.fixed_vs_f64.map_or(worst, |w| w.max(worst)));
                }
                (Err(a), Err(b)) if *a == b => {}
                _ => sample.mismatches += 1,
            }
            fixed.ok()
        });
        let target = truth.and_then(|t| t.target);
        sample.true_range = target.map(|t| t.range_mm);
        let [weighted, paper] = &mut fixed;
        let range_error = |p: &Point| Some(p.position[0].hypot(p.position[1]) - target?.range_mm);
        sample.error = weighted.as_ref().and_then(range_error);
        sample.paper_error = paper.as_ref().and_then(range_error);
        sample.chi2_per_dof = weighted.as_ref().and_then(|p| {
            let both = p.spots.iter().all(Option::is_some);
            Some(p.chi2? / if both { 3.0 } else { 1.0 })
        });
        sample.false_point = weighted.as_ref().is_some_and(|p| {
            target.is_none_or(|t| {
                let distance = (0..3).map(|i| (p.position[i] - t.point_mm[i]).powi(2)).sum::<f64>().sqrt();
                distance > (FALSE_BEYOND * t.range_mm).max(FALSE_BEYOND_MM)
            })
        });
        let spots = truth.map_or([None; 2], |t| t.spots);
        sample.missed = weighted.is_none() && spots.iter().all(|s| s.is_some_and(|s| s.visible));
        for (camera, spot) in spots.iter().enumerate() {
            if let Some(spot) = spot.filter(|s| s.visible) {
                sample.visible += 1;
                if let Some(square) = nearest_square(&detection.spots[laser][camera], &spot) {
                    sample.found += 1;
                    if spot.peak_dn >= BRIGHT_DN {
                        sample.bright_square_errors.push(square);
                    }
                }
            }
        }
        sample
    }
}

/// Squared distance of the detected spot nearest to the true one, px^2, if it is near enough.
fn nearest_square(detected: &[Spot], truth: &SpotTruth) -> Option<f64> {
    let squares = detected.iter().map(|spot| {
        let offset = |i: usize| spot.position[i].to_num::<f64>() - truth.position_px[i];
        offset(0).powi(2) + offset(1).powi(2)
    });
    squares.min_by(f64::total_cmp).filter(|square| square.sqrt() <= FOUND_WITHIN_PX)
}

impl Figures {
    fn new<'a>(samples: impl Iterator<Item = &'a Sample> + Clone, frames: usize) -> Self {
        let percent = |error: fn(&Sample) -> Option<f64>, range: std::ops::Range<f64>| {
            let inside = samples.clone().filter(move |s| s.true_range.is_some_and(|r| range.contains(&r)));
            mean(inside.filter_map(move |s| Some(100.0 * error(s)?.abs() / s.true_range?)))
        };
        let hexagon_mse = |error: fn(&Sample) -> Option<f64>| {
            mean(samples.clone().filter(|s| s.hexagon).filter_map(move |s| error(s).map(|e| e * e)))
        };
        let count = |of: fn(&Sample) -> usize| samples.clone().map(of).sum::<usize>();
        let visible = count(|s| s.visible);
        Self {
            mean_abs_range_error_pct_to_3m: percent(|s| s.error, 0.0..NEAR_MM),
            mean_abs_range_error_pct_at_4_8m: percent(|s| s.error, FAR_MM),
            paper_mean_abs_range_error_pct_to_3m: percent(|s| s.paper_error, 0.0..NEAR_MM),
            paper_mean_abs_range_error_pct_at_4_8m: percent(|s| s.paper_error, FAR_MM),
            hexagon_mse_mm2: hexagon_mse(|s| s.error),
            paper_hexagon_mse_mm2: hexagon_mse(|s| s.paper_error),
            spot_rms_px: mean(samples.clone().flat_map(|s| &s.bright_square_errors).map(|square| square / 2.0))
                .map(f64::sqrt),
            spots_found_pct: (visible > 0).then(|| 100.0 * count(|s| s.found) as f64 / visible as f64),
            false_points: count(|s| s.false_point.into()),
            fixed_vs_f64_max_mm: samples.clone().filter_map(|s| s.fixed_vs_f64).max_by(f64::total_cmp),
            decision_mismatches: count(|s| s.mismatches),
            chi2_per_dof: mean(samples.clone().filter_map(|s| s.chi2_per_dof)),
            points: count(|s| s.chi2_per_dof.is_some().into()),
            missed_points: count(|s| s.missed.into()),
            frames,
        }
    }
}

impl Evaluation {
    /// The main figures beside their targets, as a Markdown table.
    pub fn table(&self) -> String {
        let f = &self.figures;
        let number = |value: Option<f64>, digits: usize, unit: &str| {
            value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}{unit}"))
        };
        let rows = [
            (
                "mean range error up to 3 m",
                "2.5 %",
                "0.25 %",
                number(f.mean_abs_range_error_pct_to_3m, 3, " %"),
                number(f.paper_mean_abs_range_error_pct_to_3m, 2, " %"),
            ),
            (
                "mean range error at 4.8 m",
                "",
                "0.6 %",
                number(f.mean_abs_range_error_pct_at_4_8m, 3, " %"),
                number(f.paper_mean_abs_range_error_pct_at_4_8m, 2, " %"),
            ),
            (
                "mean square error, 3 m hexagon",
                "5.45 mm²",
                "2.5 mm²",
                number(f.hexagon_mse_mm2, 2, " mm²"),
                number(f.paper_hexagon_mse_mm2, 1, " mm²"),
            ),
            (
                "position of bright spots, rms per axis",
                "1 px",
                "0.05 px",
                number(f.spot_rms_px, 3, " px"),
                String::new(),
            ),
            ("visible spots found", "", "99.5 %", number(f.spots_found_pct, 1, " %"), String::new()),
            ("false points", "", "0", f.false_points.to_string(), String::new()),
            (
                "Q18.14 against f64, worst",
                "4.6 mm mean",
                "0.05 mm",
                number(f.fixed_vs_f64_max_mm, 3, " mm"),
                String::new(),
            ),
            ("χ² per degree of freedom", "", "0.9 to 1.1", number(f.chi2_per_dof, 2, ""), String::new()),
        ];
        let mut table = format!(
            "| {} frames | paper | target | karst | paper's method on the same images |\n|---|---|---|---|---|\n",
            f.frames
        );
        for (what, paper, target, karst, paper_method) in rows {
            table += &format!("| {what} | {paper} | {target} | **{karst}** | {paper_method} |\n");
        }
        table += "\n| one camera and laser at | compact model | axial model |\n|---|---|---|\n";
        for bias in &self.model_bias {
            let ModelBias { range_mm, compact_pct, axial_pct } = bias;
            // Adding zero turns a rounded -0 into 0
            let axial_pct = (axial_pct * 100.0).round() / 100.0 + 0.0;
            table += &format!("| {:.1} m | {compact_pct:+.1} % | {axial_pct:.2} % |\n", range_mm / 1000.0);
        }
        table
    }
}

/// The scenes of the evaluation: [`evaluation_scenes`] and [`laser_free_scenes`].
fn scenes() -> Vec<NamedScene> {
    evaluation_scenes().into_iter().chain(laser_free_scenes()).collect()
}

/// Number of frames that [`evaluate`] renders.
pub fn frames() -> usize {
    scenes().len()
}

/// Renders the standard scenes with one rig and measures them with another that describes the same instrument.
///
/// With `truth` the pictures are those of that rig, its beams exactly where it says. Without, `rig` is the truth but for
/// the uncertainties it gives its lasers: beams deviate by them in each frame anew. The two rigs may be in different
/// frames; they are compared in the frame of the instrument's own parts ([`Rig::own_frame`]). `progress` is called after
/// each frame.
pub fn evaluate(rig: &Rig, truth: Option<&Rig>, progress: impl Fn() + Sync) -> anyhow::Result<Evaluation> {
    let mut scenes = scenes();
    let mut to_rig = Isometry3::identity();
    if let Some(truth) = truth {
        if truth.lasers.len() != rig.lasers.len() {
            bail!("the true rig has {} lasers, expected {} as in the rig", truth.lasers.len(), rig.lasers.len());
        }
        let own = |rig: &Rig| rig.own_frame().context("the viewpoints of the cameras define no frame");
        to_rig = own(rig)? * own(truth)?.inverse();
        for lasers in scenes.iter_mut().filter_map(|named| named.scene.lasers.as_mut()) {
            lasers.errors = false;
        }
    }
    let renderer = Renderer::new(truth.unwrap_or(rig))?;
    let samples: Vec<Vec<Sample>> = scenes
        .par_iter()
        .map(|named| {
            let mut frame = renderer.render(&named.scene, named.seed)?;
            frame.truth.transform(&to_rig);
            let mut instrument = Instrument::new(rig.clone())?;
            let detection = instrument.detect(&frame.images)?;
            let truth: &FrameTruth = &frame.truth;
            let laser_truth = |laser| truth.lasers.iter().find(|t| t.laser == laser);
            let samples = (0..rig.lasers.len()).map(|laser| {
                let sample = Sample::new(&instrument, &detection, laser, laser_truth(laser));
                Sample { hexagon: named.kind == "hexagon", ..sample }
            });
            let samples = samples.collect();
            progress();
            Ok(samples)
        })
        .collect::<anyhow::Result<_>>()?;
    let of_kind = |kind: &str| {
        let chosen: Vec<&Vec<Sample>> =
            scenes.iter().zip(&samples).filter(|(scene, _)| scene.kind == kind).map(|(_, s)| s).collect();
        Figures::new(chosen.iter().flat_map(|s| s.iter()), chosen.len())
    };
    Ok(Evaluation {
        model_bias: model_bias()?,
        figures: Figures::new(samples.iter().flatten(), scenes.len()),
        kinds: scenes.iter().map(|scene| (scene.kind.to_owned(), of_kind(scene.kind))).collect(),
        scenes: scenes
            .iter()
            .zip(&samples)
            .map(|(scene, samples)| SceneFigures {
                name: scene.name.clone(),
                kind: scene.kind.to_owned(),
                figures: Figures::new(samples.iter(), 1),
            })
            .collect(),
    })
}
