//! `karst calibrate belt`: the beams of a rig from pictures of their spots.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use karst::calibration::{BeltResult, find_spots, with_belt};
use karst::input::FramePairs;
use karst::instrument::Instrument;
use karst_calib::calibrate_belt;
use karst_rig::Rig;

use super::{complain, print, print_json, progress, write_text};

#[derive(Debug, Args)]
#[command(after_help = "Example:
  karst calibrate belt --rig cameras.toml belt/camera1 belt/camera2 --out rig.toml

The rig has calibrated cameras; of its lasers only the rough directions count. The pictures show the spots on walls at
distances from near to far, at least four for each laser; the distances need not be known.")]
pub struct Belt {
    /// Folder of numbered pictures by camera 1
    camera1: PathBuf,
    /// Folder of camera 2
    camera2: PathBuf,
    /// Rig file with calibrated cameras and the belt as drawn
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Rig file to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Print what was found as JSON
    #[arg(long)]
    json: bool,
}

impl Belt {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let rig = Rig::load(&self.rig)?;
        let (result, calibrated) = belt(&rig, [&self.camera1, &self.camera2])?;
        write_text(self.out.clone(), &calibrated.to_toml())?;
        if self.json {
            print_json(&result)?;
            return Ok(ExitCode::SUCCESS);
        }
        print(summary(&result))?;
        for line in result.advice(rig.reconstruction.range_mm) {
            print(line)?;
        }
        print(format_args!("written to {}", self.out.display()))?;
        Ok(ExitCode::SUCCESS)
    }
}

/// Calibrates the belt of a rig with pictures in the folders of its two cameras.
pub(super) fn belt(rig: &Rig, folders: [&Path; 2]) -> anyhow::Result<(BeltResult, Rig)> {
    let sizes_px = rig.cameras.each_ref().map(|camera| camera.image_size_px);
    let pairs = FramePairs::open(folders[0], folders[1], sizes_px)?;
    let bar = progress(pairs.len(), "finding spots");
    let mut instrument = Instrument::new(rig.clone())?;
    let (pictures, failed) = find_spots(&mut instrument, pairs, || bar.inc(1));
    bar.finish_and_clear();
    for failed in &failed {
        complain(format_args!("not used: {failed}"));
    }
    let belt = calibrate_belt(rig, &pictures)?;
    let calibrated = with_belt(rig, &belt);
    calibrated.check().context("the calibrated rig makes no sense")?;
    Ok((BeltResult::new(&belt, pictures.len(), failed), calibrated))
}

/// The result for people, in one line.
pub(super) fn summary(belt: &BeltResult) -> String {
    format!(
        "spots {:.3} px rms in {} pairs of pictures, χ² per degree of freedom {:.2}, {} spots not used",
        belt.rms_px,
        belt.pictures,
        belt.chi2_per_dof,
        belt.spots_rejected.len()
    )
}
