//! A recording for the self-test: the default rig, and spots of random points near its beams.

use anyhow::Context;
use karst_core::{Bounds, Cluster, FixedRig, I18F14, Spot};
use karst_link::{CalibrationSender, Encoder, FrameEnd, LaserSpot, MAX_FRAME, Message};
use karst_rig::{Rig, TracedCamera};
use karst_selftest::LASERS;
use nalgebra::{Point3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Frames of one laser each. The first twelve have one good spot per camera for each laser.
const FRAMES: u32 = 1500;

/// The recording: always the same.
pub fn recording() -> anyhow::Result<Vec<u8>> {
    let rig = Rig::default();
    let fixed: FixedRig<LASERS> = rig.to_fixed(&rig.water_cameras()?)?;
    let mut stream = Stream::default();
    for part in CalibrationSender::new(&fixed).parts() {
        stream.send(&Message::Calibration(part))?;
    }
    let mut scene = Scene::new(&rig)?;
    for frame in 0..FRAMES {
        let laser = frame as usize % LASERS;
        let spots = scene.spots(laser, frame >= LASERS as u32);
        for (camera, spots) in (0..).zip(&spots) {
            for &spot in spots {
                stream.send(&Message::Spot(LaserSpot { frame, camera, laser: laser as u16, spot }))?;
            }
        }
        let spots = spots.iter().map(Vec::len).sum::<usize>() as u16;
        stream.send(&Message::FrameEnd(FrameEnd { frame, spots, ..FrameEnd::default() }))?;
    }
    Ok(stream.bytes)
}

#[derive(Default)]
struct Stream {
    encoder: Encoder,
    bytes: Vec<u8>,
}

impl Stream {
    fn send(&mut self, message: &Message) -> anyhow::Result<()> {
        self.bytes.extend_from_slice(self.encoder.encode(message, &mut [0; MAX_FRAME])?);
        Ok(())
    }
}

/// Makes spots.
struct Scene<'a> {
    rig: &'a Rig,
    cameras: [TracedCamera; 2],
    rng: ChaCha8Rng,
}

impl<'a> Scene<'a> {
    fn new(rig: &'a Rig) -> anyhow::Result<Self> {
        let camera = |i| rig.traced_camera(i).context("the rig has no air calibration");
        Ok(Self { rig, cameras: [camera(0)?, camera(1)?], rng: ChaCha8Rng::seed_from_u64(1) })
    }

    /// Spots of the two cameras. If `mixed`, not all of them good: particles, glints, and cameras that see nothing.
    fn spots(&mut self, laser: usize, mixed: bool) -> [Vec<Spot>; 2] {
        let pair = self.pair(laser, 0.1);
        let mut spots = pair.map(|spot| vec![spot]);
        if !mixed {
            return spots;
        }
        match self.rng.random_range(0..10) {
            0 => spots[self.rng.random_range(0..2)].clear(),
            1 => spots = self.pair(laser, 10.0).map(|spot| vec![spot]),
            2 | 3 => {
                for (camera, spots) in spots.iter_mut().enumerate() {
                    for _ in 0..self.rng.random_range(0..4) {
                        spots.push(self.pair(laser, 1.0)[camera]);
                    }
                }
            }
            _ => {}
        }
        spots
    }

    /// The spots of a random point near a beam, at 0.3 to 4.8 m, that both cameras see.
    fn pair(&mut self, laser: usize, noise_px: f64) -> [Spot; 2] {
        let beam = &self.rig.lasers[laser];
        loop {
            let along = 300.0 * 16.0_f64.powf(self.rng.random());
            let mut across = || (self.rng.random::<f64>() - 0.5) * (1.0 + 2e-3 * along);
            let offset = Vector3::new(along, across(), across());
            let point = Point3::from(Vector3::from(beam.origin_mm) + beam.frame().transpose() * offset);
            if let [Some(a), Some(b)] = [0, 1].map(|camera| self.spot(camera, point, noise_px)) {
                return [a, b];
            }
        }
    }

    fn spot(&mut self, camera: usize, point: Point3<f64>, noise_px: f64) -> Option<Spot> {
        let part = &self.rig.cameras[camera];
        let pixel = self.cameras[camera].project(point)?;
        let radius = (pixel - Vector2::from(part.air.as_ref()?.centre_px)).norm();
        if !(part.inner_radius_px..part.mirror_radius_px).contains(&radius) {
            return None;
        }
        let mut moved = |at: f64| I18F14::from_num(at + (self.rng.random::<f64>() - 0.5) * noise_px);
        let position = [moved(pixel.x), moved(pixel.y)];
        let pixels = self.rng.random_range(5..60);
        let weight = pixels * self.rng.random_range(20..300);
        let [x, y] = [pixel.x as u16, pixel.y as u16];
        let cluster = Cluster {
            pixels,
            green: pixels,
            saturated: 0,
            weight,
            weight_x: u64::from(weight) * u64::from(x),
            weight_y: u64::from(weight) * u64::from(y),
            bounds: Bounds { x_min: x - 1, x_max: x + 2, y_min: y - 1, y_max: y + 2 },
            radius_squared: ((radius * 16.0) as u32 + 24).pow(2),
        };
        Some(Spot { position, variance: self.rng.random_range(2416..100_000), cluster })
    }
}
