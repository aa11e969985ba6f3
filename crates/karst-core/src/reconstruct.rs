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
    Candidates { cameras, settings, beam, laser: laser as u16, spots }.point(method)
}

struct Candidates<'a> {
    cameras: &'a [CameraCalibration; 2],
    settings: &'a ReconstructionSettings,
    beam: &'a LaserCalibration,
    laser: u16,
    spots: [&'a [Spot]; 2],
}

/// An accepted result of the weighted method.
struct Accepted {
    fused: Fused,
    /// Distance along the beam, mm.
    along: I18F14,
    /// chi squared.
    chi2: I18F14,
    rays: [Option<BeamRay>; 2],
    spots: [Option<u8>; 2],
    stereo: Option<I18F14>,
}

impl Candidates<'_> {
    #[inline(never)]
    fn point(&self, method: Method) -> Result<Point, NoPoint> {
        match method {
            Method::Weighted => self.weighted(),
            Method::Paper => self.paper(),
        }
    }

    fn ray(&self, camera: usize, position: [I18F14; 2]) -> Option<BeamRay> {
        BeamRay::of_position(self.cameras.get(camera)?, self.beam.cameras.get(camera)?, position)
    }

    fn weighted(&self) -> Result<Point, NoPoint> {
        let mut best = Err(match (self.spots[0].len(), self.spots[1].len()) {
            (0, 0) => NoPoint::NoSpot,
            (0, _) | (_, 0) => NoPoint::OneCamera,
            _ => NoPoint::NoIntersection,
        });
        for (i, a) in self.spots[0].iter().enumerate() {
            let Some(ray_a) = self.ray(0, a.position) else { continue };
            for (j, b) in self.spots[1].iter().enumerate() {
                let Some(ray_b) = self.ray(1, b.position) else { continue };
                let pair = [ray_a, ray_b];
                let Some(crossing) = stereo(&ray_a, &ray_b) else { continue };
                let fused = weighted::stereo(self.beam, &pair, &crossing, [a.variance, b.variance]);
                self.consider(&mut best, fused, |fused, along, chi2| Accepted {
                    fused,
                    along,
                    chi2,
                    rays: pair.map(Some),
                    spots: [Some(i as u8), Some(j as u8)],
                    stereo: Some(crossing.estimate()),
                });
            }
        }
        if best.is_err() && self.settings.single_camera {
            for camera in 0..2 {
                for (i, spot) in self.spots[camera].iter().enumerate() {
                    let Some(ray) = self.ray(camera, spot.position) else { continue };
                    let fused = match mono(&ray) {
                        Some(crossing) => weighted::single(self.beam, &ray, &crossing, spot.variance),
                        None => Err(NoPoint::NoIntersection),
                    };
                    let (mut rays, mut spots) = ([None; 2], [None; 2]);
                    (rays[camera], spots[camera]) = (Some(ray), Some(i as u8));
                    self.consider(&mut best, fused, |fused, along, chi2| Accepted {
                        fused,
                        along,
                        chi2,
                        rays,
                        spots,
                        stereo: None,
                    });
                }
            }
        }
        let best = best?;
        let estimates = Estimates {
            mono: best.rays.map(|ray| ray.as_ref().and_then(mono).map(|crossing| crossing.estimate())),
            stereo: best.stereo,
        };
        let point = self.point_at(best.fused.beam, best.along, estimates, best.spots);
        Ok(Point { sigma: Some(to_q14(best.fused.sigma)), chi2: Some(best.chi2), ..point })
    }

    /// Puts a result in the place of the best one so far if it is acceptable and farther; a reason, if it is nearer to a
    /// point.
    fn consider(
        &self,
        best: &mut Result<Accepted, NoPoint>,
        fused: Result<Fused, NoPoint>,
        accepted: impl FnOnce(Fused, I18F14, I18F14) -> Accepted,
    ) {
        let acceptable = fused.and_then(|fused| {
            // Q.12 to Q.14
            let chi2 = I18F14::from_bits(if fused.chi2 < 1 << 29 { (fused.chi2 << 2) as i32 } else { i32::MAX });
            if chi2 > self.settings.chi2_max {
                return Err(NoPoint::Inconsistent);
            }
            let along = self.in_range(fused.beam[0])?;
            Ok((fused, along, chi2))
        });
        match (acceptable, &best) {
            (Ok((_, along, _)), Ok(best)) if along <= best.along => {}
            (Ok((fused, along, chi2)), _) => *best = Ok(accepted(fused, along, chi2)),
            (Err(reason), Err(other)) if reason > *other => *best = Err(reason),
            (Err(_), _) => {}
        }
    }

    fn paper(&self) -> Result<Point, NoPoint> {
        let farthest = self.spots.map(|spots| spots.iter().enumerate().max_by_key(|(_, s)| s.cluster.r_max()));
        if farthest == [None, None] {
            return Err(NoPoint::NoSpot);
        }
        let ray = |camera: usize, spot: Option<(usize, &Spot)>| self.ray(camera, spot?.1.midpoint());
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
