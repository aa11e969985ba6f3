//! `karst rig`: look at a rig file.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Subcommand};
use karst::output::plot;
use karst_rig::Rig;
use serde::Serialize;

use super::{count, load_rig, message, print, print_json, set_up, write_text};

#[derive(Debug, Subcommand)]
#[command(after_help = "Examples:
  karst rig default > my-rig.toml
  karst rig check my-rig.toml
  karst rig show my-rig.toml --out my-rig.svg")]
pub enum RigCommand {
    /// Draw the instrument and print its main figures
    Show(Show),
    /// Check that a rig file is complete and makes sense
    Check(Check),
    /// Print the default rig file, commented field by field
    #[command(after_help = "Example:
  karst rig default > my-rig.toml")]
    Default,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:
  karst rig show my-rig.toml --out my-rig.svg")]
pub struct Show {
    /// Rig file; the default rig without it
    rig: Option<PathBuf>,
    /// Drawing to write, SVG
    #[arg(long, value_name = "FILE", default_value = "rig.svg")]
    out: PathBuf,
    /// Print the rig as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:
  karst rig check my-rig.toml")]
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
    /// Why the rig cannot be used.
    problem: Option<String>,
    /// What is allowed but probably not meant.
    warnings: Vec<String>,
}

impl RigCommand {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        match self {
            Self::Show(command) => command.run(),
            Self::Check(command) => command.run(),
            Self::Default => {
                print(Rig::DEFAULT_TOML.trim_end())?;
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
        let lasers = count(rig.lasers.len(), "laser");
        print(format_args!("rig \"{}\": {lasers}, water index {:.4}", rig.name, rig.water.index()))?;
        for (i, camera) in rig.water_cameras()?.iter().enumerate() {
            let [x, y, z] = camera.model.pose.position_mm;
            let [u, v] = camera.model.centre_px;
            let kind = if camera.model.axial.is_empty() { "compact" } else { "axial" };
            print(format_args!(
                "camera {}: {kind} in water, viewpoint ({x:.2}, {y:.2}, {z:.2}) mm, centre ({u:.2}, {v:.2}) px",
                i + 1
            ))?;
        }
        print(format_args!("drawn in {}", self.out.display()))?;
        Ok(ExitCode::SUCCESS)
    }
}

impl Check {
    fn run(self) -> anyhow::Result<ExitCode> {
        // Loading checks every field; setting the instrument up checks that it all fits together.
        let checked = load_rig(Some(&self.rig)).and_then(|rig| {
            let warnings = rig.warnings();
            set_up(rig, Some(&self.rig))?;
            Ok(warnings)
        });
        if self.json {
            let problem = checked.as_ref().err().map(message);
            let status = if problem.is_none() { ExitCode::SUCCESS } else { ExitCode::FAILURE };
            print_json(&CheckResult { ok: problem.is_none(), problem, warnings: checked.unwrap_or_default() })?;
            return Ok(status);
        }
        let warnings = checked?;
        print(format_args!("{} is a valid rig", self.rig.display()))?;
        for warning in warnings {
            print(format_args!("warning: {warning}"))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
