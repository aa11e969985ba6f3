//! Pictures to points: the whole chain for one instrument.

use std::time::Instant;

use image::RgbImage;
use karst_core::{Calibration, FrameStatus, I18F14, Method, NoPoint, RowError, Spot, SpotDetector, reconstruct};
use karst_reference::Reference;
use karst_rig::{FitError, FixedPointError, Rig};
use karst_scene::FrameTruth;

use crate::result::{DetectorCounters, LaserResult, PointResult, Section, SpotResult, Timing, TruthResult};

/// Number format of the reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Arithmetic {
    /// Q18.14, as in firmware and gateware.
    #[default]
    Fixed,
    /// 64-bit floating point, the reference.
    F64,
}

impl Arithmetic {
    /// Name in results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fixed => "fixed",
            Self::F64 => "f64",
        }
    }
}

/// Name of a method in results.
pub fn method_name(method: Method) -> &'static str {
    match method {
        Method::Weighted => "weighted",
        Method::Paper => "paper",
    }
}

/// Why an instrument can not be set up from its rig.
#[derive(Debug, thiserror::Error)]
pub enum InstrumentError {
    /// No camera model in the water.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The rig does not fit the sensor's number formats.
    #[error(transparent)]
    FixedPoint(#[from] FixedPointError),
}

/// Lasers and candidate spots per laser that the sensor is built for.
const MOST_LASERS: usize = 720;
const CANDIDATES: usize = 4;

/// The fixed-point chain with its capacity hidden.
trait Chain {
    fn detect(&mut self, camera: usize, image: &RgbImage) -> Result<FrameStatus, RowError>;
    fn spots(&self, camera: usize, laser: usize) -> Vec<Spot>;
    fn reconstruct(&self, laser: usize, spots: [&[Spot]; 2], method: Method) -> Result<karst_core::Point, NoPoint>;
}

struct FixedChain<const LASERS: usize> {
    calibration: Calibration<LASERS>,
    detectors: [SpotDetector<LASERS, CANDIDATES>; 2],
}

impl<const LASERS: usize> Chain for FixedChain<LASERS> {
    fn detect(&mut self, camera: usize, image: &RgbImage) -> Result<FrameStatus, RowError> {
        let detector = &mut self.detectors[camera];
        detector.start_frame();
        for row in image.as_raw().chunks(3 * image.width().max(1) as usize) {
            detector.row(row)?;
        }
        Ok(detector.end_frame())
    }

    fn spots(&self, camera: usize, laser: usize) -> Vec<Spot> {
        self.detectors[camera].spots(laser).to_vec()
    }

    fn reconstruct(&self, laser: usize, spots: [&[Spot]; 2], method: Method) -> Result<karst_core::Point, NoPoint> {
        reconstruct(&self.calibration, laser, spots, method)
    }
}

/// What the detectors found in a pair of images.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    /// Candidate spots: per laser, per camera.
    pub spots: Vec<[Vec<Spot>; 2]>,
    /// What happened to the pixels of each image.
    pub status: [FrameStatus; 2],
}

/// An instrument ready to measure.
pub struct Instrument {
    rig: Rig,
    chain: Box<dyn Chain>,
    reference: Reference,
}

impl Instrument {
    /// Sets up detectors and calibration for a rig of up to 720 lasers.
    pub fn new(rig: Rig) -> Result<Self, InstrumentError> {
        fn sized<const LASERS: usize>(
            rig: &Rig,
            cameras: &[karst_rig::WaterCamera; 2],
        ) -> Result<Box<dyn Chain>, FixedPointError> {
            let fixed = rig.to_fixed::<LASERS>(cameras)?;
            let [first, second] = fixed.detectors.map(SpotDetector::new);
            let refused = |camera| move |error| FixedPointError::Detector { camera, error };
            let detectors = [first.map_err(refused(0))?, second.map_err(refused(1))?];
            Ok(Box::new(FixedChain::<LASERS> { calibration: fixed.calibration, detectors }))
        }
        let cameras = rig.water_cameras()?;
        let chain =
            if rig.lasers.len() <= 12 { sized::<12>(&rig, &cameras) } else { sized::<MOST_LASERS>(&rig, &cameras) }?;
        let reference = Reference::new(rig.clone(), cameras);
        Ok(Self { rig, chain, reference })
    }

    /// The rig.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Finds the spots in an image of one camera (0 or 1) of the rig's size: candidates per laser.
    pub fn detect_one(&mut self, camera: usize, image: &RgbImage) -> Result<(Vec<Vec<Spot>>, FrameStatus), RowError> {
        let status = self.chain.detect(camera, image)?;
        Ok(((0..self.rig.lasers.len()).map(|laser| self.chain.spots(camera, laser)).collect(), status))
    }

    /// Finds the spots in a pair of images of the rig's sizes.
    pub fn detect(&mut self, images: &[RgbImage; 2]) -> Result<Detection, RowError> {
        let (first, status1) = self.detect_one(0, &images[0])?;
        let (second, status2) = self.detect_one(1, &images[1])?;
        let spots = first.into_iter().zip(second).map(|(a, b)| [a, b]).collect();
        Ok(Detection { spots, status: [status1, status2] })
    }

    /// The point of one laser.
    pub fn point(
        &self,
        detection: &Detection,
        laser: usize,
        method: Method,
        arithmetic: Arithmetic,
    ) -> Result<karst_reference::Point, NoPoint> {
        let candidates = detection.spots.get(laser).ok_or(NoPoint::NoLaser)?;
        let spots = [candidates[0].as_slice(), candidates[1].as_slice()];
        match arithmetic {
            Arithmetic::Fixed => self.chain.reconstruct(laser, spots, method).map(|p| to_f64(&p)),
            Arithmetic::F64 => self.reference.reconstruct(laser, spots, method),
        }
    }

    /// Detection and reconstruction of a pair of images.
    pub fn section(
        &mut self,
        name: &str,
        images: &[RgbImage; 2],
        method: Method,
        arithmetic: Arithmetic,
    ) -> Result<Section, RowError> {
        let start = Instant::now();
        let detection = self.detect(images)?;
        let detected = Instant::now();
        let points: Vec<_> =
            (0..self.rig.lasers.len()).map(|laser| self.point(&detection, laser, method, arithmetic)).collect();
        let reconstructed = Instant::now();
        let lasers = points.iter().enumerate().map(|(laser, p)| laser_result(laser, p, &detection.spots[laser]));
        let milliseconds = |from: Instant, to: Instant| (to - from).as_secs_f64() * 1e3;
        Ok(Section {
            frame: name.to_owned(),
            method: method_name(method).to_owned(),
            arithmetic: arithmetic.name().to_owned(),
            lasers: lasers.collect(),
            detector: [0, 1].map(|camera| counters(&detection, camera)),
            timing: Some(Timing {
                detect_ms: milliseconds(start, detected),
                reconstruct_ms: milliseconds(detected, reconstructed),
            }),
        })
    }
}

pub(crate) fn to_f64(point: &karst_core::Point) -> karst_reference::Point {
    let estimates = &point.estimates;
    karst_reference::Point {
        position: point.position.map(I18F14::to_num),
        along: point.along.to_num(),
        sigma: point.sigma.map(I18F14::to_num),
        chi2: point.chi2.map(I18F14::to_num),
        estimates: karst_reference::Estimates {
            mono: estimates.mono.map(|m| m.map(I18F14::to_num)),
            stereo: estimates.stereo.map(I18F14::to_num),
        },
        spots: point.spots,
    }
}

fn counters(detection: &Detection, camera: usize) -> DetectorCounters {
    let status = &detection.status[camera];
    DetectorCounters {
        hits: status.hits,
        outside: status.outside,
        overflow: status.overflow,
        spots: Some(detection.spots.iter().map(|laser| laser[camera].len() as u32).sum()),
    }
}

pub(crate) fn laser_result(
    laser: usize,
    point: &Result<karst_reference::Point, NoPoint>,
    candidates: &[Vec<Spot>; 2],
) -> LaserResult {
    let spot = |camera: usize| {
        let spots = &candidates[camera];
        match point {
            Ok(p) => p.spots[camera].and_then(|i| spots.get(usize::from(i))),
            Err(_) => spots.iter().max_by_key(|s| s.cluster.r_max()),
        }
    };
    LaserResult {
        laser,
        status: point.as_ref().map_or_else(ToString::to_string, |_| "point".to_owned()),
        point: point.as_ref().ok().map(|p| PointResult {
            position_mm: p.position,
            range_mm: p.position[0].hypot(p.position[1]),
            sigma_mm: p.sigma,
            chi2: p.chi2,
            estimates_mm: [p.estimates.mono[0], p.estimates.mono[1], p.estimates.stereo],
        }),
        spots: [0, 1].map(|camera| spot(camera).map(spot_result)),
        truth: None,
    }
}

/// A detected spot as it is reported.
pub fn spot_result(spot: &Spot) -> SpotResult {
    let b = &spot.cluster.bounds;
    SpotResult {
        pixel: spot.position.map(I18F14::to_num),
        sigma_px: (f64::from(spot.variance) / f64::from(1 << 24)).sqrt(),
        pixels: spot.cluster.pixels,
        saturated: spot.cluster.saturated,
        bounds: [b.x_min, b.y_min, b.x_max, b.y_max],
    }
}

/// Adds what is really there to a section.
pub fn add_truth(section: &mut Section, truth: &FrameTruth) {
    for known in &truth.lasers {
        if let Some(laser) = section.lasers.get_mut(known.laser) {
            laser.truth = Some(TruthResult {
                position_mm: known.target.map(|t| t.point_mm),
                range_mm: known.target.map(|t| t.range_mm),
                pixels: known.spots.map(|s| s.map(|s| s.position_px)),
                visible: known.spots.map(|s| s.is_some_and(|s| s.visible)),
            });
        }
    }
}
