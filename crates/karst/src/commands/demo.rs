//! `karst demo`: the whole chain with nothing but this program.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use console::Term;
use karst::instrument::{Instrument, add_truth};
use karst::output::folder;
use karst::output::terminal::side_by_side;
use karst_rig::Rig;
use karst_scene::{Renderer, demo_scene};

use super::files::{self, MeasuredFrame};
use super::render::outline;
use super::{Chain, print, print_json, write_text};

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  karst demo
  karst demo --method paper --seed 7 --out paper-demo")]
pub struct Demo {
    /// Folder for pictures, points and report
    #[arg(long, value_name = "FOLDER", default_value = "karst-demo")]
    out: PathBuf,
    /// Seed of the scene's noise, snow and laser errors
    #[arg(long)]
    seed: Option<u64>,
    #[command(flatten)]
    chain: Chain,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

impl Demo {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        folder::prepare(&self.out)?;
        let rig = Rig::default();
        let scene = demo_scene();
        let frame = Renderer::new(&rig)?.render(&scene.scene, self.seed.unwrap_or(scene.seed))?;
        for (camera, image) in frame.images.iter().enumerate() {
            let path = self.out.join(format!("camera{}.png", camera + 1));
            image.save(&path).with_context(|| format!("cannot write {}", path.display()))?;
        }
        write_text(self.out.join("rig.toml"), Rig::DEFAULT_TOML)?;
        write_text(self.out.join("truth.json"), &serde_json::to_string_pretty(&frame.truth)?)?;

        let mut instrument = Instrument::new(rig)?;
        let mut section =
            instrument.section(&scene.name, &frame.images, self.chain.method.into(), self.chain.arithmetic)?;
        add_truth(&mut section, &frame.truth);
        let measured = [MeasuredFrame { section, images: Some(frame.images), outline_mm: outline(&scene.scene) }];
        files::write(&self.out, "A section of a flooded gallery", instrument.rig(), &measured, &[])?;
        if self.json {
            print_json(&measured[0].section)?;
        } else {
            let (rows, columns) = Term::stdout().size();
            for line in side_by_side(&measured[0].section, columns.into(), rows.into()) {
                print(line)?;
            }
            files::print_summary(&[&measured[0].section])?;
            print(format_args!("open {}", self.out.join("report.html").display()))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
