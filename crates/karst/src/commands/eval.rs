//! `karst eval`: the accuracy table.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use karst::eval::evaluate;
use karst_rig::Rig;

use super::{load_rig, print, print_json, progress};

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  karst eval
  karst eval --rig my-rig.toml --json > accuracy.json
  karst eval --rig calibrated.toml --truth true.toml")]
pub struct Eval {
    /// Rig file; the default rig without it
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Rig file to render with, its beams exactly where it says; without it, the rig is the truth but for the
    /// uncertainties of its lasers
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Print the figures of all scenes as JSON
    #[arg(long)]
    json: bool,
}

impl Eval {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let rig = load_rig(self.rig.as_deref())?;
        let truth = self.truth.as_deref().map(Rig::load).transpose()?;
        let bar = progress(karst::eval::frames(), "rendering and measuring");
        let evaluation = evaluate(&rig, truth.as_ref(), || bar.inc(1))?;
        bar.finish_and_clear();
        if self.json {
            print_json(&evaluation)?;
        } else {
            print(evaluation.table().trim_end())?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
