//! `karst reconstruct`: stereo pairs to points.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use karst::input::FramePairs;
use karst::instrument::{Instrument, add_truth};
use karst::output::folder;
use karst::result::Section;
use karst_scene::FrameTruth;
use serde::Serialize;

use super::files::{self, MeasuredFrame, PICTURED_FRAMES};
use super::{Chain, SOME_FRAMES_FAILED, load_rig, print_json, progress};

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  karst reconstruct --rig rig.toml left.png right.png --json
  karst reconstruct --rig survey/rig.toml survey/camera1 survey/camera2 --truth survey/truth --out result

A folder holds one numbered picture per frame (frame_0001.png, ...); frames are paired by number.
Exit status 3: some frames failed, the others were measured.")]
pub struct Reconstruct {
    /// Rig file
    #[arg(long)]
    rig: PathBuf,
    /// Picture or folder of numbered pictures of camera 1, PNG or JPEG
    camera1: PathBuf,
    /// Picture or folder of numbered pictures of camera 2
    camera2: PathBuf,
    #[command(flatten)]
    chain: Chain,
    /// Truth written by `karst render`: a file, or a folder with one file per frame
    #[arg(long)]
    truth: Option<PathBuf>,
    /// Folder for points (PLY, CSV, MCAP), pictures and report
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print the results as JSON
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Output<'a> {
    /// One section per measured frame.
    sections: Vec<&'a Section>,
    /// Frames that failed, in words.
    skipped: &'a [String],
}

impl Reconstruct {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let rig = load_rig(Some(&self.rig))?;
        if let Some(out) = &self.out {
            folder::prepare(out)?;
        }
        let sizes = rig.cameras.each_ref().map(|camera| camera.image_size_px);
        let pairs = FramePairs::open(&self.camera1, &self.camera2, sizes)?;
        let total = pairs.len();
        let mut instrument = Instrument::new(rig)?;
        let bar = progress(total, "measuring");
        let mut frames: Vec<MeasuredFrame> = Vec::new();
        let mut skipped = Vec::new();
        for pair in pairs {
            match pair {
                Ok(pair) => {
                    let mut section = instrument.section(
                        &pair.name,
                        &pair.images,
                        self.chain.method.into(),
                        self.chain.arithmetic,
                    )?;
                    if let Some(truth) = &self.truth {
                        add_truth(&mut section, &load_truth(truth, &pair.name)?);
                    }
                    let images = (self.out.is_some() && frames.len() < PICTURED_FRAMES).then_some(pair.images);
                    frames.push(MeasuredFrame { section, images, outline_mm: Vec::new() });
                }
                // A single frame that fails is the whole job that fails.
                Err(error) if total == 1 => return Err(error.into()),
                Err(error) => skipped.push(error.to_string()),
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        let sections: Vec<&Section> = frames.iter().map(|f| &f.section).collect();
        if let Some(out) = &self.out {
            files::write(out, "Measured sections", instrument.rig(), &frames, &skipped)?;
        }
        if self.json {
            print_json(&Output { sections, skipped: &skipped })?;
        } else {
            if let [section] = sections[..] {
                print_table(section);
            }
            files::print_summary(&sections, &skipped);
            if let Some(out) = &self.out {
                println!("open {}", out.join("report.html").display());
            }
        }
        Ok(if skipped.is_empty() { ExitCode::SUCCESS } else { SOME_FRAMES_FAILED.into() })
    }
}

/// The truth of a frame: the file itself, or the file of that name in the folder.
fn load_truth(path: &Path, frame: &str) -> anyhow::Result<FrameTruth> {
    let file = if path.is_dir() { path.join(frame).with_extension("json") } else { path.to_owned() };
    let text = std::fs::read_to_string(&file).with_context(|| format!("cannot read the truth {}", file.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{} is no truth file of karst render", file.display()))
}

fn print_table(section: &Section) {
    println!("laser       X mm       Y mm       Z mm   range mm   sigma mm");
    for laser in &section.lasers {
        match &laser.point {
            Some(point) => {
                let [x, y, z] = point.position_mm;
                let sigma = point.sigma_mm.map_or_else(|| "-".to_owned(), |s| format!("{s:.2}"));
                println!("{:>5} {x:>10.2} {y:>10.2} {z:>10.2} {:>10.2} {sigma:>10}", laser.laser, point.range_mm);
            }
            None => println!("{:>5} {}", laser.laser, laser.status),
        }
    }
}
