//! `karst reconstruct`: stereo pairs to points.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::Args;
use image::RgbImage;
use karst::input::{FramePair, FramePairs, InputError};
use karst::instrument::{Instrument, add_truth};
use karst::output::folder;
use karst::result::Section;
use karst_scene::FrameTruth;
use serde::Serialize;

use super::files::{self, MeasuredFrame, PICTURED_FRAMES};
use super::{Chain, SOME_FRAMES_FAILED, complain, count, load_rig, message, print, print_json, progress, set_up};

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  karst reconstruct --rig rig.toml left.png right.png --json
  karst reconstruct --rig survey/rig.toml survey/camera1 survey/camera2 --truth survey/truth --out result

A folder holds one numbered picture per frame (frame_0001.png, ...); frames are paired by number.
Exit status 3: some frames failed, the others were measured.")]
pub struct Reconstruct {
    /// Rig file
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Picture or folder of numbered pictures of camera 1, PNG or JPEG
    camera1: PathBuf,
    /// Picture or folder of numbered pictures of camera 2
    camera2: PathBuf,
    #[command(flatten)]
    chain: Chain,
    /// Truth written by `karst render`: a file, or a folder with one file per frame
    #[arg(long, value_name = "FILE|FOLDER")]
    truth: Option<PathBuf>,
    /// Folder for points (PLY, CSV, MCAP), pictures and report
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print the results as JSON
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Output<'a> {
    /// One section per measured frame.
    sections: &'a [&'a Section],
    /// Frames that failed, in words.
    skipped: &'a [String],
}

impl Reconstruct {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let rig = load_rig(Some(&self.rig))?;
        let sizes = rig.cameras.each_ref().map(|camera| camera.image_size_px);
        let pairs = FramePairs::open(&self.camera1, &self.camera2, sizes)?;
        let total = pairs.len();
        if let Some(truth) = self.truth.as_ref().filter(|truth| total > 1 && !truth.is_dir()) {
            bail!("truth {}: expected a folder with one file per frame", truth.display());
        }
        let mut instrument = set_up(rig, Some(&self.rig))?;
        if let Some(out) = &self.out {
            folder::prepare(out)?;
        }
        let bar = progress(total, "measuring");
        let mut frames: Vec<MeasuredFrame> = Vec::new();
        let mut skipped = Vec::new();
        for pair in pairs {
            match self.measure(&mut instrument, pair) {
                Ok((section, images)) => {
                    let images = (self.out.is_some() && frames.len() < PICTURED_FRAMES).then_some(images);
                    frames.push(MeasuredFrame { section, images, outline_mm: Vec::new() });
                }
                // A single frame that fails is the whole job that fails.
                Err(error) if total == 1 => return Err(error),
                Err(error) => skipped.push(message(&error)),
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        for problem in &skipped {
            complain(format_args!("skipped: {problem}"));
        }
        if let Some(out) = self.out.as_ref().filter(|_| !frames.is_empty()) {
            files::write(out, "Measured sections", instrument.rig(), &frames, &skipped)?;
        }
        let sections: Vec<&Section> = frames.iter().map(|f| &f.section).collect();
        if self.json {
            print_json(&Output { sections: &sections, skipped: &skipped })?;
        }
        if frames.is_empty() {
            bail!("none of the {} could be measured", count(total, "frame"));
        }
        if !self.json {
            if let [section] = sections[..] {
                print_table(section)?;
            }
            files::print_summary(&sections)?;
            if let Some(out) = &self.out {
                print(format_args!("open {}", out.join("report.html").display()))?;
            }
        }
        Ok(if skipped.is_empty() { ExitCode::SUCCESS } else { SOME_FRAMES_FAILED.into() })
    }

    fn measure(
        &self,
        instrument: &mut Instrument,
        pair: Result<FramePair, InputError>,
    ) -> anyhow::Result<(Section, [RgbImage; 2])> {
        let FramePair { name, images } = pair?;
        let frame = || format!("frame {name}");
        let mut section =
            instrument.section(&name, &images, self.chain.method.into(), self.chain.arithmetic).with_context(frame)?;
        if let Some(truth) = &self.truth {
            add_truth(&mut section, &load_truth(truth, &name).with_context(frame)?);
        }
        Ok((section, images))
    }
}

/// The truth of a frame: the file itself, or the file of that name in the folder.
fn load_truth(path: &Path, frame: &str) -> anyhow::Result<FrameTruth> {
    let file = if path.is_dir() { path.join(format!("{frame}.json")) } else { path.to_owned() };
    let text = std::fs::read_to_string(&file).with_context(|| format!("cannot read the truth {}", file.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{} is no truth file of karst render", file.display()))
}

fn print_table(section: &Section) -> anyhow::Result<()> {
    print("laser       X mm       Y mm       Z mm   range mm   sigma mm")?;
    for laser in &section.lasers {
        match &laser.point {
            Some(point) => {
                let [x, y, z] = point.position_mm;
                let sigma = point.sigma_mm.map_or_else(|| "-".to_owned(), |s| format!("{s:.2}"));
                let position = format!("{:>5} {x:>10.2} {y:>10.2} {z:>10.2}", laser.laser);
                print(format_args!("{position} {:>10.2} {sigma:>10}", point.range_mm))?;
            }
            None => print(format_args!("{:>5} {}", laser.laser, laser.status))?,
        }
    }
    Ok(())
}
