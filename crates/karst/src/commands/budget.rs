//! `karst budget`: clocks and milliseconds of a frame in the sensor, and whether they are few enough.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, ensure};
use clap::Args;
use karst::output::plot::budget_plot;
use karst_core::SpotDetector;
use karst_cycles::{BudgetRow, Camera, MOST_LASERS, Reconstruction, Scenario, Scene, detectors};
use serde::Serialize;

use super::configure::Mode;
use super::{Method, load_rig, positive, print, print_json, write_text};

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  karst budget                                   the paper's frame at the paper's clock
  karst budget --clock 100 --ppc 8               a slower device with a wider detector
  karst budget --lasers 720 --mode software --baud 921600
  karst budget --resolution 2048x2048 --ppc 4 --row-blanking 40 --stray 0.001
  karst budget --rig my-rig.toml --json
  karst budget --svg budget.svg

Gateware clocks are those of a simulation of the gateware, to the clock; the processor's are within 2 % to the first and
the last byte with 12 lasers, and estimates beyond.
Exit status: 0 every limit is kept, 1 one is not.")]
pub struct Budget {
    /// Rig file: resolution and lasers are the rig's
    #[arg(long, value_name = "FILE", conflicts_with_all = ["resolution", "lasers"])]
    rig: Option<PathBuf>,
    /// Columns and rows of a picture, px
    #[arg(long, value_name = "WxH", default_value = "1024x768", value_parser = resolution)]
    resolution: [u16; 2],
    /// Lasers
    #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u16).range(1..=MOST_LASERS as i64))]
    lasers: u16,
    /// Pixels per clock and camera: 1, 2, 4 or 8
    #[arg(long, default_value = "1", value_parser = pixels_per_clock)]
    ppc: u32,
    /// Idle clocks of the cameras after each row
    #[arg(long, value_name = "CLOCKS", default_value_t = 0)]
    row_blanking: u32,
    /// Idle clocks of the cameras after each frame
    #[arg(long, value_name = "CLOCKS", default_value_t = 0)]
    frame_blanking: u32,
    /// Hits of a laser's spot, px; fewer if spots would touch
    #[arg(long, value_name = "HITS", default_value_t = 21, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    hits: u32,
    /// Share of all pixels that are hits without a laser: snow
    #[arg(long, value_name = "SHARE", default_value = "0", value_parser = share)]
    stray: f64,
    /// How the estimates become a point
    #[arg(long, value_enum, default_value_t)]
    method: Method,
    /// A spot in one camera alone may give a point; a rig says so itself
    #[arg(long)]
    single_camera: bool,
    /// Clock of the gateware and its processor, MHz
    #[arg(long, value_name = "MHZ", default_value = "275.18", value_parser = positive)]
    clock: f64,
    /// Who makes the points that are sent
    #[arg(long, value_enum, default_value = "accelerated")]
    mode: Mode,
    /// Bits per second of the serial line
    #[arg(long, default_value = "3000000", value_parser = positive)]
    baud: f64,
    /// Write the chart to an SVG file
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Print the table as JSON
    #[arg(long)]
    json: bool,
}

fn resolution(text: &str) -> Result<[u16; 2], &'static str> {
    let size = || {
        let [width, height] = text.split('x').collect::<Vec<_>>().try_into().ok()?;
        Some([width, height].map(|size: &str| size.trim().parse().ok().filter(|size| (16..=2048).contains(size))))
    };
    match size() {
        Some([Some(width), Some(height)]) => Ok([width, height]),
        _ => Err("expected columns and rows, 16 to 2048 each, such as 1024x768"),
    }
}

fn pixels_per_clock(text: &str) -> Result<u32, &'static str> {
    text.parse().ok().filter(|pixels| [1, 2, 4, 8].contains(pixels)).ok_or("expected 1, 2, 4 or 8")
}

fn share(text: &str) -> Result<f64, &'static str> {
    super::finite(text).filter(|share| (0.0..=1.0).contains(share)).ok_or("expected a number from 0 to 1")
}

/// A row as JSON.
#[derive(Debug, Serialize)]
struct JsonRow<'a> {
    name: &'a str,
    clocks: u64,
    ms: f64,
    limit_clocks: u64,
    limit_ms: f64,
    limit: &'a str,
    met: bool,
}

#[derive(Debug, Serialize)]
struct Json<'a> {
    clock_mhz: f64,
    rows: Vec<JsonRow<'a>>,
}

impl Budget {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let scenario = self.scenario()?;
        let [width, height, lasers] = {
            let config = &scenario.detectors[0];
            [config.width.into(), config.height.into(), config.azimuths.len()]
        };
        let rows = scenario.budget().context("the detector can not be set up")?;
        let title = format!(
            "{width} x {height} px, {lasers} lasers, {} px/clk, {} MHz, {} Bd",
            self.ppc, self.clock, self.baud
        );
        if self.json {
            print_json(&self.json(&rows))?;
        } else {
            print(format_args!("{title}\n\n{}", self.table(&rows)))?;
        }
        if let Some(path) = self.svg {
            write_text(path, &budget_plot(&title, &rows, 1e6 * self.clock)?)?;
        }
        Ok(if rows.iter().all(BudgetRow::met) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
    }

    fn scenario(&self) -> anyhow::Result<Scenario> {
        let [width, height] = self.resolution;
        let (detectors, single_camera) = match &self.rig {
            Some(path) => {
                let rig = load_rig(Some(path))?;
                let fixed = Box::new(rig.to_fixed::<MOST_LASERS>(&rig.water_cameras()?)?);
                (fixed.detectors, fixed.calibration.settings.single_camera)
            }
            None => (detectors(width, height, self.lasers), false),
        };
        for config in &detectors {
            ensure!(u32::from(config.width) % self.ppc == 0, "{} columns are not whole clocks", config.width);
            SpotDetector::<MOST_LASERS, 1>::new(config.clone())?;
        }
        let paper = karst_core::Method::from(self.method) == karst_core::Method::Paper;
        let reconstruction = Reconstruction { paper, single_camera: self.single_camera || single_camera };
        Ok(Scenario {
            detectors,
            pixels_per_clock: self.ppc,
            camera: Camera { row_blanking: self.row_blanking, frame_blanking: self.frame_blanking },
            scene: Scene { spot_pixels: self.hits, stray: self.stray },
            reconstruction,
            clock_hz: 1e6 * self.clock,
            mode: self.mode.into(),
            bits_per_second: self.baud,
        })
    }

    fn ms(&self, clocks: u64) -> f64 {
        clocks as f64 / self.clock / 1000.0
    }

    fn json<'a>(&self, rows: &'a [BudgetRow]) -> Json<'a> {
        let row = |row: &'a BudgetRow| JsonRow {
            name: &row.name,
            clocks: row.clocks,
            ms: self.ms(row.clocks),
            limit_clocks: row.limit_clocks,
            limit_ms: self.ms(row.limit_clocks),
            limit: row.limit,
            met: row.met(),
        };
        Json { clock_mhz: self.clock, rows: rows.iter().map(row).collect() }
    }

    fn table(&self, rows: &[BudgetRow]) -> String {
        const BAR: usize = 24;
        let mut table =
            format!("{:26} {:>10} {:>10} {:>10}  {:BAR$}\n", "", "clocks", "ms", "limit ms", "share of the limit");
        for row in rows {
            let share = row.clocks as f64 / row.limit_clocks.max(1) as f64;
            let full = ((share * BAR as f64).ceil() as usize).min(BAR);
            let bar = format!("{}{}", "█".repeat(full), "·".repeat(BAR - full));
            let verdict = if row.met() { "" } else { "  MISSED" };
            table += &format!(
                "{:26} {:>10} {:>10.4} {:>10.4}  {bar} {:>5.0} %{verdict}  {}\n",
                row.name,
                row.clocks,
                self.ms(row.clocks),
                self.ms(row.limit_clocks),
                100.0 * share,
                row.limit
            );
        }
        table.truncate(table.trim_end().len());
        table
    }
}
