//! `karst rig`: look at a rig file.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Subcommand};
use karst::instrument::Instrument;
use karst::output::plot;
use karst_rig::Rig;
use serde::Serialize;

use super::{load_rig, print_json, write_text};

#[derive(Debug, Subcommand)]
pub enum RigCommand {
    /// Draw the instrument and print its main figures
    Show(Show),
    /// Check that a rig file is complete and makes sense
    Check(Check),
    /// Print the default rig file, commented field by field
    Default,
}

#[derive(Debug, Args)]
pub struct Show {
    /// Rig file; the default rig without it
    rig: Option<PathBuf>,
    /// Drawing to write, SVG
    #[arg(long, default_value = "rig.svg")]
    out: PathBuf,
    /// Print the rig as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
pub struct Check {
    /// Rig file
    rig: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// What `rig check --json` prints.
#[derive(Serialize)]
struct CheckResult {
    ok: bool,
    problem: Option<String>,
}

impl RigCommand {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        match self {
            Self::Show(command) => command.run(),
            Self::Check(command) => command.run(),
            Self::Default => {
                print!("{}", Rig::DEFAULT_TOML);
                Ok(ExitCode::SUCCESS)
            }
        }
    }
}

impl Show {
    fn run(self) -> anyhow::Result<ExitCode> {
        let rig = load_rig(self.rig.as_deref())?;
        write_text(self.out.clone(), &plot::rig_plot(&rig)?)?;
        if self.json {
            print_json(&rig)?;
            return Ok(ExitCode::SUCCESS);
        }
        println!("rig \"{}\": {} lasers, water index {:.4}", rig.name, rig.lasers.len(), rig.water.index());
        for (i, camera) in rig.water_cameras()?.iter().enumerate() {
            let [x, y, z] = camera.model.pose.position_mm;
            let [u, v] = camera.model.centre_px;
            let kind = if camera.model.axial.is_empty() { "compact" } else { "axial" };
            println!(
                "camera {}: {kind} in water, viewpoint ({x:.2}, {y:.2}, {z:.2}) mm, centre ({u:.2}, {v:.2}) px",
                i + 1
            );
        }
        println!("drawn in {}", self.out.display());
        Ok(ExitCode::SUCCESS)
    }
}

impl Check {
    fn run(self) -> anyhow::Result<ExitCode> {
        // Loading checks every field; setting the instrument up checks that it all fits together.
        let checked = load_rig(Some(&self.rig)).and_then(|rig| Ok(Instrument::new(rig)?));
        if self.json {
            let problem = checked.as_ref().err().map(|error| format!("{error:#}"));
            print_json(&CheckResult { ok: problem.is_none(), problem })?;
            return Ok(if checked.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE });
        }
        checked?;
        println!("{} is a valid rig", self.rig.display());
        Ok(ExitCode::SUCCESS)
    }
}
