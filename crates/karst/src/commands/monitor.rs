//! `karst monitor`: what a sensor measures, live.

use std::io;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::bail;
use clap::Args;
use clap::error::ErrorKind;
use image::RgbImage;
use karst::input::FramePairs;
use karst::output::folder;
use karst::sensor::{MOST_LASERS, SimulatedSensor};
use karst_link::Settings;
use karst_rig::Rig;
use karst_scene::{Renderer, demo_scene};

use super::line::{BAUD, Connection, fixed};
use super::session::{Session, stop_on_ctrl_c};
use super::{files, load_rig, print, spinner};

#[derive(Debug, Args)]
#[command(
    override_usage = "karst monitor [OPTIONS] <PORT>\n       karst monitor [OPTIONS] --simulated [CAMERA1 CAMERA2]",
    after_help = "Examples:
  karst monitor --simulated
  karst monitor --simulated --rig survey/rig.toml survey/camera1 survey/camera2 --out result
  karst monitor --simulated --frames 3 --json
  karst monitor /dev/ttyUSB0 --out survey

The simulated sensor is the sensor's own program on a software model of its hardware; its cameras see a rendered gallery
over and over, or the pictures once. A real sensor needs its calibration first: karst configure.
Ctrl-C ends it; --out is written then. Without a terminal there is one line per frame."
)]
pub struct Monitor {
    /// Serial port of the sensor, such as /dev/ttyUSB0 or COM3; with --simulated the pictures of camera 1
    #[arg(value_name = "PORT|CAMERA1", required_unless_present = "simulated")]
    port: Option<PathBuf>,
    /// With --simulated: the pictures of camera 2
    #[arg(value_name = "CAMERA2", requires = "simulated")]
    camera2: Option<PathBuf>,
    /// Bits per second on the serial line
    #[arg(long, default_value_t = BAUD)]
    baud: u32,
    /// A simulated sensor in this program: no hardware is needed
    #[arg(long)]
    simulated: bool,
    /// Rig file of the simulated sensor; the default rig without it
    #[arg(long, value_name = "FILE", requires = "simulated")]
    rig: Option<PathBuf>,
    /// End after this many frames
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    /// Folder for the points (PLY, CSV, MCAP)
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print one JSON object per frame, each in a line
    #[arg(long)]
    json: bool,
}

impl Monitor {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        if let Some(out) = &self.out {
            folder::prepare(out)?;
        }
        let Source { mut connection, settings, pictures } = self.connect()?;
        let stop = stop_on_ctrl_c()?;
        let mut session = Session::new(&connection, &settings, self.json, self.out.is_some());
        let watched = session.watch(&mut connection, self.frames.or(pictures), &settings, &stop);
        // What has been measured is kept, whatever ended it
        session.end(&connection.client.counters())?;
        if let Some(out) = self.out.as_ref().filter(|_| !session.sections().is_empty()) {
            files::write_points(out, session.sections())?;
            if !self.json {
                print(format_args!("points in {}", out.display()))?;
            }
        }
        watched.map(|()| ExitCode::SUCCESS)
    }

    fn connect(&self) -> anyhow::Result<Source> {
        match (self.simulated, &self.port, &self.camera2) {
            (false, Some(port), _) => {
                let mut connection = Connection::open(&port.to_string_lossy(), self.baud)?;
                let settings = connection.client.settings()?;
                if connection.client.status()?.calibration.is_none() {
                    bail!(
                        "{}: the sensor has no calibration and measures nothing: send it with karst configure",
                        connection.place
                    );
                }
                Ok(Source { connection, settings, pictures: None })
            }
            (true, Some(camera1), Some(camera2)) => {
                let rig = load_rig(self.rig.as_deref())?;
                let sizes = rig.cameras.each_ref().map(|camera| camera.image_size_px);
                let pairs = FramePairs::open(camera1, camera2, sizes)?;
                let frames = pairs.len() as u32;
                let pictures = pairs.map(|pair| pair.map(|pair| pair.images).map_err(io::Error::other));
                Ok(Source { pictures: Some(frames), ..simulate(&rig, pictures)? })
            }
            (true, None, _) => {
                let rig = load_rig(self.rig.as_deref())?;
                let scene = demo_scene();
                let bar = spinner("rendering what the cameras see");
                let images = Renderer::new(&rig)?.render(&scene.scene, scene.seed)?.images;
                bar.finish_and_clear();
                simulate(&rig, std::iter::repeat_with(move || Ok(images.clone())))
            }
            (true, Some(_), None) => {
                let message = "--simulated takes the pictures of both cameras or none, and no port\n";
                clap::Error::raw(ErrorKind::MissingRequiredArgument, message).exit()
            }
            // The parser sees to it
            (false, None, _) => bail!("expected a serial port, or --simulated"),
        }
    }
}

/// A sensor that measures.
struct Source {
    connection: Connection,
    settings: Settings,
    /// How many pairs of pictures it will see, if that is known.
    pictures: Option<u32>,
}

/// A simulated sensor with its calibration, lasers on.
fn simulate(rig: &Rig, pictures: impl Iterator<Item = io::Result<[RgbImage; 2]>> + 'static) -> anyhow::Result<Source> {
    let fixed = fixed::<MOST_LASERS>(rig)?;
    let sensor = SimulatedSensor::new(rig.lasers.len(), pictures);
    let mut connection = Connection::new(Box::new(sensor), "simulated sensor".to_owned())?;
    let settings = Settings { lasers: true, ..Settings::default() };
    connection.client.set_settings(&settings)?;
    connection.client.set_calibration(&fixed, |_, _| {})?;
    Ok(Source { connection, settings, pictures: None })
}
