//! `karst detect`: the spots of one picture.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use image::RgbImage;
use karst::input::load_picture;
use karst::instrument::spot_result;
use karst::output::overlay::{self, Guides};
use karst::result::{LaserResult, Section, SpotResult};
use serde::Serialize;

use super::{count, load_rig, print, print_json, set_up};

#[derive(Debug, Args)]
#[command(after_help = "Example:
  karst detect --rig survey/rig.toml --camera 2 survey/camera2/0001.png --out spots.png")]
pub struct Detect {
    /// Rig file; the default rig without it
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Which camera took the picture
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=2), default_value_t = 1)]
    camera: u8,
    /// The picture, PNG or JPEG
    picture: PathBuf,
    /// Picture to write with the spots drawn in
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the spots as JSON
    #[arg(long)]
    json: bool,
}

/// All candidate spots of one laser.
#[derive(Serialize)]
struct LaserSpots {
    laser: usize,
    spots: Vec<SpotResult>,
}

impl Detect {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let rig = load_rig(self.rig.as_deref())?;
        let camera = usize::from(self.camera - 1);
        let image = load_picture(&self.picture, self.camera.into(), rig.cameras[camera].image_size_px)?;
        let guides = Guides::new(&rig);
        let mut instrument = set_up(rig, self.rig.as_deref())?;
        let (spots, _) = instrument.detect_one(camera, &image)?;
        let lasers: Vec<LaserSpots> = spots
            .iter()
            .enumerate()
            .map(|(laser, spots)| LaserSpots { laser, spots: spots.iter().map(spot_result).collect() })
            .collect();
        if let Some(path) = &self.out {
            draw(&image, camera, &lasers, &guides[camera])
                .save(path)
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
        if self.json {
            print_json(&lasers)?;
        } else {
            print("laser       x px       y px   sigma px   pixels   saturated")?;
            for LaserSpots { laser, spots } in &lasers {
                for SpotResult { pixel: [x, y], sigma_px, pixels, saturated, .. } in spots {
                    let position = format!("{laser:>5} {x:>10.3} {y:>10.3}");
                    print(format_args!("{position} {sigma_px:>10.3} {pixels:>8} {saturated:>11}"))?;
                }
            }
            print(count(lasers.iter().map(|laser| laser.spots.len()).sum(), "spot"))?;
            if let Some(path) = &self.out {
                print(format_args!("drawn in {}", path.display()))?;
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// The picture with every candidate marked.
fn draw(image: &RgbImage, camera: usize, lasers: &[LaserSpots], guides: &Guides) -> RgbImage {
    let marked = lasers.iter().flat_map(|LaserSpots { laser, spots }| {
        spots.iter().map(|spot| {
            let mut both = [None, None];
            both[camera] = Some(spot.clone());
            LaserResult { laser: *laser, status: String::new(), point: None, spots: both, truth: None }
        })
    });
    let section = Section {
        frame: String::new(),
        method: String::new(),
        arithmetic: String::new(),
        lasers: marked.collect(),
        detector: Default::default(),
        timing: None,
    };
    overlay::draw(image, &section, camera, Some(guides))
}
