//! Spots of two cameras to a point: pairing, fusion, acceptance.

use core::fmt;

use fixed::types::I18F14;

use crate::calibration::{Calibration, LaserCalibration, to_rig};
use crate::camera::CameraCalibration;
use crate::detector::Spot;
use crate::fusion::{BeamRay, Estimates, mono, stereo, to_q14};
use crate::paper;
use crate::weighted::{self, Fused};

/// How the three estimates become one point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Method {
    /// Weighted least squares over weighted centroids, with a standard deviation and a chi-squared gate.
    #[default]
    Weighted,
    /// The paper: farthest spot, middle of the bounding box, plain average.
    Paper,
}

/// Limits of an accepted point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ReconstructionSettings {
    /// Working range along the beam, mm.
    pub range: [I18F14; 2],
    /// Largest chi squared of an accepted point.
    pub chi2_max: I18F14,
    /// Whether one camera alone may give a point.
    pub single_camera: bool,
}

/// A reconstructed point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Point {
    /// Index of the laser.
    pub laser: u16,
    /// X, Y, Z in the rig frame, mm.
    pub position: [I18F14; 3],
    /// Distance along the beam from the laser's origin, mm.
    pub along: I18F14,
    /// Standard deviation along the beam, mm (weighted method).
    pub sigma: Option<I18F14>,
    /// chi squared: three degrees of freedom with two cameras, one with a single camera (weighted method).
    pub chi2: Option<I18F14>,
    /// The three single estimates.
    pub estimates: Estimates,
    /// Which of the laser's spots each camera gave; None: the camera took no part.
    pub spots: [Option<u8>; 2],
}

/// Why a laser gives no point. Of several reasons the last one in this order counts: it is the one nearest to a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum NoPoint {
    /// The calibration has no such laser.
    NoLaser,
    /// Neither camera has a spot.
    NoSpot,
    /// Only one camera has a spot, and that is not enough by the settings.
    OneCamera,
    /// The rays do not meet in front of the cameras.
    NoIntersection,
    /// The point is outside the working range.
    OutOfRange,
    /// The spots and the beam do not belong together.
    Inconsistent,
}

impl fmt::Display for NoPoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NoLaser => "no such laser",
            Self::NoSpot => "no spot",
            Self::OneCamera => "spot in one camera only",
            Self::NoIntersection => "rays do not meet",
            Self::OutOfRange => "outside the working range",
            Self::Inconsistent => "spots do not agree",
        })
    }
}

impl core::error::Error for NoPoint {}

/// The point of one laser from its candidate spots in the two cameras.
///
/// The weighted method fuses every pair of candidates; of those that pass the chi-squared gate within the working range
/// the farthest is the point: particles in the beam and reflections on the tube lie before the wall.
pub fn reconstruct<const LASERS: usize>(
    calibration: &Calibration<LASERS>,
    laser: usize,
    spots: [&[Spot]; 2],
    method: Method,
) -> Result<Point, NoPoint> {
    let Calibration { cameras, lasers, settings } = calibration;
    let beam = lasers.get(laser).ok_or(NoPoint::NoLaser)?;
    let candidates = Candidates { cameras, settings, beam, laser: laser as u16, spots: &spots };
    match method {
        Method::Weighted => candidates.weighted(),
        Method::Paper => candidates.paper(),
    }
}

struct Candidates<'a> {
    cameras: &'a [CameraCalibration; 2],
    settings: &'a ReconstructionSettings,
    beam: &'a LaserCalibration,
    laser: u16,
    spots: &'a [&'a [Spot]; 2],
}

/// An accepted result of the weighted method.
struct Accepted {
    fused: Fused,
    /// Distance along the beam, mm.
    along: I18F14,
    /// chi squared.
    chi2: I18F14,
}

/// Puts a point in the place of the best one so far if it is farther; a reason, if it is nearer to a point.
fn keep_better(best: &mut Result<Point, NoPoint>, other: Result<Point, NoPoint>) {
    let is_better = match (&other, &*best) {
        (Ok(other), Ok(best)) => other.along > best.along,
        (Ok(_), Err(_)) => true,
        (Err(reason), Err(best)) => reason > best,
        (Err(_), Ok(_)) => false,
    };
    if is_better {
        *best = other;
    }
}

impl Candidates<'_> {
    fn ray(&self, camera: usize, position: &[I18F14; 2]) -> Option<BeamRay> {
        BeamRay::of_position(self.cameras.get(camera)?, self.beam.cameras.get(camera)?, position)
    }

    fn weighted(&self) -> Result<Point, NoPoint> {
        match *self.spots {
            [[a], [b]] => self.pair(a, b, [0, 0], self.settings.single_camera),
            _ => self.farthest(),
        }
    }

    /// The farthest point of a spot of each camera; if there is none, and one camera is enough, of one spot alone.
    #[inline(never)]
    fn farthest(&self) -> Result<Point, NoPoint> {
        let mut best = Err(match (self.spots[0].len(), self.spots[1].len()) {
            (0, 0) => NoPoint::NoSpot,
            (0, _) | (_, 0) => NoPoint::OneCamera,
            _ => NoPoint::NoIntersection,
        });
        for (i, a) in self.spots[0].iter().enumerate() {
            for (j, b) in self.spots[1].iter().enumerate() {
                keep_better(&mut best, self.pair(a, b, [i as u8, j as u8], false));
            }
        }
        match best {
            Err(reason) if self.settings.single_camera => self.farthest_single(reason),
            _ => best,
        }
    }

    /// The farthest point of a spot of one camera alone. `reason` is why there is none of two.
    #[inline(never)]
    fn farthest_single(&self, reason: NoPoint) -> Result<Point, NoPoint> {
        let mut best = Err(reason);
        for camera in 0..2 {
            for (i, spot) in self.spots[camera].iter().enumerate() {
                if let Some(ray) = &self.ray(camera, &spot.position) {
                    keep_better(&mut best, self.single(camera, ray, spot.variance, i as u8));
                }
            }
        }
        best
    }

    /// The point of a spot of each camera, whose indices are for the result. If there is none, that of one of them where
    /// `or_single`.
    #[inline(never)]
    fn pair(&self, a: &Spot, b: &Spot, indices: [u8; 2], or_single: bool) -> Result<Point, NoPoint> {
        let rays = [self.ray(0, &a.position), self.ray(1, &b.position)];
        let accepted = match rays.each_ref().map(Option::as_ref) {
            [Some(ray_a), Some(ray_b)] => {
                let rays = [ray_a, ray_b];
                stereo(rays).ok_or(NoPoint::NoIntersection).and_then(|crossing| {
                    let fused = weighted::stereo(self.beam, rays, &crossing, [a.variance, b.variance])?;
                    Ok((self.accept(fused)?, crossing.estimate()))
                })
            }
            _ => Err(NoPoint::NoIntersection),
        };
        match accepted {
            Ok((accepted, stereo)) => {
                let mono = rays.each_ref().map(|ray| ray.as_ref().and_then(mono).map(|crossing| crossing.estimate()));
                let estimates = Estimates { mono, stereo: Some(stereo) };
                Ok(self.weighted_point(accepted, estimates, indices.map(Some)))
            }
            Err(reason) if or_single => self.farthest_single(reason),
            Err(reason) => Err(reason),
        }
    }

    /// The point of the ray of one camera.
    fn single(&self, camera: usize, ray: &BeamRay, variance: u32, index: u8) -> Result<Point, NoPoint> {
        let crossing = mono(ray).ok_or(NoPoint::NoIntersection)?;
        let accepted = self.accept(weighted::single(self.beam, ray, &crossing, variance)?)?;
        let (mut mono, mut spots) = ([None; 2], [None; 2]);
        (mono[camera], spots[camera]) = (Some(crossing.estimate()), Some(index));
        Ok(self.weighted_point(accepted, Estimates { mono, stereo: None }, spots))
    }

    /// A result with its distance and chi squared, if they are within the limits.
    #[inline(always)]
    fn accept(&self, fused: Fused) -> Result<Accepted, NoPoint> {
        // Q.12 to Q.14
        let chi2 = I18F14::from_bits(if fused.chi2 < 1 << 29 { (fused.chi2 << 2) as i32 } else { i32::MAX });
        if chi2 > self.settings.chi2_max {
            return Err(NoPoint::Inconsistent);
        }
        let along = self.in_range(fused.beam[0])?;
        Ok(Accepted { fused, along, chi2 })
    }

    #[inline(always)]
    fn weighted_point(&self, accepted: Accepted, estimates: Estimates, spots: [Option<u8>; 2]) -> Point {
        let Accepted { fused, along, chi2 } = accepted;
        let point = self.point_at(fused.beam, along, estimates, spots);
        Point { sigma: Some(to_q14(fused.sigma)), chi2: Some(chi2), ..point }
    }

    #[inline(never)]
    fn paper(&self) -> Result<Point, NoPoint> {
        let farthest = self.spots.map(|spots| spots.iter().enumerate().max_by_key(|(_, s)| s.cluster.r_max()));
        if farthest == [None, None] {
            return Err(NoPoint::NoSpot);
        }
        let ray = |camera: usize, spot: Option<(usize, &Spot)>| self.ray(camera, &spot?.1.midpoint());
        let rays = [ray(0, farthest[0]), ray(1, farthest[1])];
        let (beam, estimates) = paper::average(&rays).ok_or(NoPoint::NoIntersection)?;
        let along = self.in_range(beam[0])?;
        Ok(self.point_at(beam, along, estimates, farthest.map(|f| f.map(|(i, _)| i as u8))))
    }

    /// A distance along the beam (mm, Q.16), if it is within the working range.
    fn in_range(&self, along: i32) -> Result<I18F14, NoPoint> {
        let along = to_q14(along);
        let [least, most] = self.settings.range;
        if along < least || along > most { Err(NoPoint::OutOfRange) } else { Ok(along) }
    }

    /// The point of a place in the beam's frame, mm in Q.16.
    fn point_at(&self, beam: [i32; 3], along: I18F14, estimates: Estimates, spots: [Option<u8>; 2]) -> Point {
        Point { laser: self.laser, position: to_rig(self.beam, beam), along, sigma: None, chi2: None, estimates, spots }
    }
}
