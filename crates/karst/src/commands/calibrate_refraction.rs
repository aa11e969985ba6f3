//! `karst calibrate refraction`: the model of a camera in the water.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::{Args, ValueEnum};
use karst::calibration::WayResult;
use karst_calib::{BIAS_RANGES_MM, CameraSettings, CornerList, InWater, compare_refraction};
use karst_rig::{CameraModel, Rig};
use serde::Serialize;

use super::{complain, print, print_json, write_text};

#[derive(Debug, Args)]
#[command(after_help = "Example:
  karst calibrate refraction --rig cameras.toml --camera 1 --corners corners_water_1.csv

Compares three models of a camera in the water on corners of boards seen there: traced through tube and water from the rig's
camera in air; axial, fitted to the boards without any knowledge of the tube; compact (a single viewpoint, as in the paper),
fitted likewise. A rig file with a camera in air and a tube needs none of them: karst traces it by itself.")]
pub struct Refraction {
    /// Rig file with the camera in air, tube and water
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Camera, 1 or 2
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    camera: u8,
    /// Corners of boards in water, CSV, or OpenCV XML or YAML
    #[arg(long, value_name = "FILE")]
    corners: PathBuf,
    /// Model to write with --out
    #[arg(long, value_enum, default_value_t, requires = "out")]
    model: Way,
    /// File to write, .toml: the [camera.water] section of a rig file
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the comparison as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum Way {
    /// Traced from air
    #[default]
    Traced,
    /// Fitted to the boards, with a height for each ray
    Axial,
    /// Fitted to the boards, with a single viewpoint
    Compact,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Output {
    range_mm: [f64; BIAS_RANGES_MM.len()],
    models: Vec<WayResult>,
    warnings: Vec<String>,
}

impl Refraction {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let rig = Rig::load(&self.rig)?;
        let index = usize::from(self.camera) - 1;
        let place = || format!("{}: camera {}", self.rig.display(), self.camera);
        let traced =
            rig.traced_camera(index).with_context(|| format!("{}: needs a tube and a model in air", place()))?;
        let list = CornerList::load(&self.corners)?;
        let image_size_px = rig.cameras[index].image_size_px;
        let settings = CameraSettings { image_size_px, degree: None, tangential: true };
        let ways = compare_refraction(&traced, &traced, &list, &settings, rig.reconstruction.range_mm)?;
        let warnings = WayResult::warnings(&ways);
        for warning in &warnings {
            complain(format_args!("warning: {warning}"));
        }
        let all: [(&str, &InWater); 3] = [("traced", &ways.traced), ("axial", &ways.axial), ("compact", &ways.compact)];
        let models: Vec<WayResult> = all.iter().map(|(way, found)| WayResult::new(way, found)).collect();
        if self.json {
            print_json(&Output { range_mm: BIAS_RANGES_MM, models, warnings })?;
        } else {
            print(table(&models))?;
        }
        if let Some(path) = self.out {
            let found = match self.model {
                Way::Traced => &ways.traced,
                Way::Axial => &ways.axial,
                Way::Compact => &ways.compact,
            };
            write_text(path, &section(&found.model)?)?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

fn section(model: &CameraModel) -> anyhow::Result<String> {
    #[derive(Serialize)]
    struct File<'a> {
        camera: Section<'a>,
    }
    #[derive(Serialize)]
    struct Section<'a> {
        water: &'a CameraModel,
    }
    Ok(toml::to_string(&File { camera: Section { water: model } })?)
}

/// The comparison for people.
fn table(models: &[WayResult]) -> String {
    let mut text = format!("{:8} {:>8} {:>9}", "model", "rms px", "held out");
    for range in BIAS_RANGES_MM {
        text += &format!(" {:>8}", format!("{:.1} m", range / 1000.0));
    }
    let number = |value: Option<f64>, digits: usize| value.map_or("-".to_owned(), |value| format!("{value:.digits$}"));
    for model in models {
        text += &format!("\n{:8} {:8.3} {:>9}", model.way, model.rms_px, number(model.holdout_rms_px, 3));
        for bias in model.bias_pct {
            text += &format!(" {:>6} %", number(bias, 2));
        }
    }
    text + "\nper cent: mean range error with a perfectly known laser half way between the cameras, against the traced camera"
}
