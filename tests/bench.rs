//! A sensor in the simulated SoC, with a host.

use std::io::{self, Read, Write};
use std::time::Duration;

use image::RgbImage;
use karst::instrument::{Arithmetic, Instrument};
use karst::result::Section;
use karst::sensor::soc::{Row, Soc};
use karst::sensor::{Assembler, Pace, SensorClient, SensorFrame, SimulatedSoc, as_sent};
use karst_core::{FixedRig, Method};
use karst_link::{Errors, Message, Settings, Status, TransferState};
use karst_rig::Rig;
use karst_scene::{Renderer, evaluation_scenes};

/// Most lasers of the simulated SoC.
const LASERS: usize = 12;

/// A frame, or whatever else is waited for, comes within this much of the host's time, or not at all.
const PATIENCE: Duration = Duration::from_millis(200);

/// What the cameras of the default rig see in so many of the scenes that the accuracy is measured with.
pub fn pictures(count: usize) -> Vec<[RgbImage; 2]> {
    let renderer = Renderer::new(&Rig::default()).expect("a rig that can be rendered");
    let scenes = evaluation_scenes();
    let scenes = (0..count).map(|index| &scenes[index * scenes.len() / count]);
    scenes.map(|scene| renderer.render(&scene.scene, scene.seed).expect("a scene").images).collect()
}

/// Damages bytes on their way.
pub type Noise = Box<dyn FnMut(&mut [u8])>;

/// The line of a simulated SoC, which may damage bytes.
pub struct Line {
    soc: SimulatedSoc,
    noise: Option<Noise>,
}

impl Line {
    fn damage(&mut self, bytes: &mut [u8]) {
        if let Some(noise) = &mut self.noise {
            noise(bytes);
        }
    }
}

impl Read for Line {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.soc.read(buffer)?;
        self.damage(&mut buffer[..count]);
        Ok(count)
    }
}

impl Write for Line {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let mut damaged = buffer.to_vec();
        self.damage(&mut damaged);
        self.soc.write(&damaged)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A sensor in the simulated SoC, and a host at its line.
pub struct Bench {
    /// The sensor.
    pub soc: SimulatedSoc,
    /// The host.
    pub client: SensorClient<Line>,
    rig: FixedRig<LASERS>,
    instrument: Instrument,
    assembler: Assembler,
    settings: Settings,
    /// What the firmware has said.
    pub log: Vec<String>,
    /// What it has said of calibrations on their way.
    pub transfers: Vec<TransferState>,
    errors: Vec<Errors>,
}

impl Bench {
    /// A sensor that has just been switched on; its cameras will see the pictures. The environment tells where the
    /// simulation and the firmware are.
    pub fn new(pace: Pace, pictures: Vec<[RgbImage; 2]>) -> Self {
        Self::with_noise(pace, pictures, None)
    }

    /// The same at a line that may damage bytes.
    pub fn with_noise(pace: Pace, pictures: Vec<[RgbImage; 2]>, noise: Option<Noise>) -> Self {
        let place =
            |name: &str| std::env::var_os(name).unwrap_or_else(|| panic!("{name} is not set: see tests/README.md"));
        let firmware = std::fs::read(place("KARST_FIRMWARE")).expect("the firmware");
        let soc = Soc::new(place("KARST_SOC").as_ref(), &firmware).expect("a simulation");
        let soc = SimulatedSoc::new(soc, pace, pictures.into_iter().map(Ok));
        let client = SensorClient::connect_by(Line { soc: soc.clone(), noise }, soc.clock()).expect("a sensor");
        let rig = Rig::default();
        let cameras = rig.water_cameras().expect("cameras under water");
        Self {
            soc,
            client,
            rig: rig.to_fixed(&cameras).expect("a rig for fixed point"),
            instrument: Instrument::new(rig).expect("an instrument"),
            assembler: Assembler::new(Settings::default()),
            settings: Settings::default(),
            log: Vec::new(),
            transfers: Vec::new(),
            errors: Vec::new(),
        }
    }

    /// A sensor that measures. It sees what [`Bench::expose`] shows it.
    pub fn calibrated() -> Self {
        let mut bench = Self::new(Pace::Patient, Vec::new());
        bench.calibrate(Settings { lasers: true, ..Settings::default() });
        bench
    }

    /// Sends settings and calibration.
    pub fn calibrate(&mut self, settings: Settings) {
        self.set(settings);
        self.client.set_calibration(&self.rig, |_, _| {}).expect("a calibration that is taken");
    }

    /// Sends settings.
    pub fn set(&mut self, settings: Settings) {
        self.client.set_settings(&settings).expect("settings that are taken");
        self.settings = settings;
        self.assembler = Assembler::new(settings);
    }

    /// The calibration in use.
    pub fn rig(&self) -> &FixedRig<LASERS> {
        &self.rig
    }

    /// Shows the cameras some rows of a pair of pictures: all of them are there before the sensor sees the first one.
    pub fn expose(&mut self, images: &[RgbImage; 2], rows: [usize; 2]) {
        let mut soc = self.soc.soc_mut();
        for (camera, (image, rows)) in images.iter().zip(rows).enumerate() {
            let height = image.height() as usize;
            for (y, rgb) in image.as_raw().chunks(3 * image.width() as usize).take(rows).enumerate() {
                let row = Row { rgb, start: y == 0, last: true, ends_frame: y + 1 == height, idle: 0 };
                soc.row(camera, &row).expect("a simulation");
            }
        }
    }

    fn take(&mut self, message: &Message) -> Vec<SensorFrame> {
        match message {
            Message::Log(log) => self.log.push(log.text.to_string()),
            Message::CalibrationReply(reply) => self.transfers.push(reply.state.clone()),
            Message::Status(status) => self.errors.push(status.errors),
            _ => {}
        }
        self.assembler.take(message)
    }

    /// The frames of so much of the host's time.
    pub fn wait(&mut self, time: Duration) -> Vec<SensorFrame> {
        let clock = self.soc.clock();
        let until = clock.now() + time;
        let mut frames = Vec::new();
        loop {
            let left = until.saturating_sub(clock.now());
            let Some(message) = self.client.receive(left).expect("a line") else { return frames };
            frames.extend(self.take(&message));
        }
    }

    /// The next frame.
    pub fn frame(&mut self) -> SensorFrame {
        let clock = self.soc.clock();
        let until = clock.now() + PATIENCE;
        while let Some(left) = until.checked_sub(clock.now()) {
            let message = self.client.receive(left).expect("a line");
            if let Some(frame) = message.and_then(|message| self.take(&message).pop()) {
                return frame;
            }
        }
        panic!("no frame: {:?}, {:?}", self.status(), self.log);
    }

    /// How the sensor is, by its own account.
    pub fn status(&mut self) -> Status {
        // The client forgets older ones
        self.wait(Duration::ZERO);
        let status = self.client.status().expect("a status");
        self.errors.push(status.errors);
        status
    }

    /// The errors of all statuses since the last call of this.
    pub fn told(&mut self) -> Vec<Errors> {
        self.status();
        std::mem::take(&mut self.errors)
    }

    /// What `karst reconstruct` makes of a pair of pictures, as far as the sensor tells it.
    pub fn expected(&mut self, number: u32, images: &[RgbImage; 2], method: Method) -> Section {
        let section = self.instrument.section(&number.to_string(), images, method, Arithmetic::Fixed);
        as_sent(section.expect("pictures of the rig's size"))
    }

    /// After trouble the next frame is measured as ever.
    #[track_caller]
    pub fn measures_on(&mut self, images: &[RgbImage; 2]) {
        self.expose(images, [usize::MAX; 2]);
        // One that waited may come first
        for _ in 0..2 {
            let frame = self.frame();
            let expected = self.expected(frame.number, images, self.settings.method);
            assert!(expected.lasers.iter().filter(|laser| laser.point.is_some()).count() > 9, "{expected:?}");
            if frame.section == expected {
                return;
            }
        }
        panic!("not the points of karst reconstruct");
    }
}
