//! Spots of two cameras to a point: pairing, fusion, acceptance.

use core::fmt;

use fixed::types::I18F14;
use karst_math::saturate_i32;

use crate::calibration::{Calibration, LaserCalibration, to_rig};
use crate::detector::Spot;
use crate::fusion::{BeamRay, Estimates, to_q14};
use crate::{paper, weighted};

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
    let beam = calibration.lasers.get(laser).ok_or(NoPoint::NoLaser)?;
    let candidates = Candidates { calibration, beam, laser: laser as u16, spots };
    match method {
        Method::Weighted => candidates.weighted(),
        Method::Paper => candidates.paper(),
    }
}

/// The farther of two points, or the reason nearer to a point.
fn better(a: Result<Point, NoPoint>, b: Result<Point, NoPoint>) -> Result<Point, NoPoint> {
    match (a, b) {
        (Ok(p), Ok(q)) => Ok(if q.along > p.along { q } else { p }),
        (Err(a), Err(b)) => Err(a.max(b)),
        (Ok(p), Err(_)) | (Err(_), Ok(p)) => Ok(p),
    }
}

struct Candidates<'a, const LASERS: usize> {
    calibration: &'a Calibration<LASERS>,
    beam: &'a LaserCalibration,
    laser: u16,
    spots: [&'a [Spot]; 2],
}

impl<const LASERS: usize> Candidates<'_, LASERS> {
    fn ray(&self, camera: usize, position: [I18F14; 2]) -> Option<BeamRay> {
        BeamRay::new(&self.calibration.cameras.get(camera)?.ray(position), self.beam.cameras.get(camera)?)
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
                let fused = weighted::stereo(self.beam, &pair, [a.variance, b.variance]);
                best = better(best, fused.and_then(|f| self.accept(f, pair.map(Some), [Some(i as u8), Some(j as u8)])));
            }
        }
        if best.is_ok() || !self.calibration.settings.single_camera {
            return best;
        }
        for camera in 0..2 {
            for (i, spot) in self.spots[camera].iter().enumerate() {
                let Some(ray) = self.ray(camera, spot.position) else { continue };
                let (mut one_ray, mut used) = ([None; 2], [None; 2]);
                (one_ray[camera], used[camera]) = (Some(ray), Some(i as u8));
                let fused = weighted::single(self.beam, &ray, spot.variance);
                best = better(best, fused.and_then(|f| self.accept(f, one_ray, used)));
            }
        }
        best
    }

    fn accept(
        &self,
        fused: weighted::Fused,
        rays: [Option<BeamRay>; 2],
        spots: [Option<u8>; 2],
    ) -> Result<Point, NoPoint> {
        // Q.12 to Q.14
        let chi2 = I18F14::from_bits(saturate_i32(fused.chi2.saturating_mul(4)));
        if chi2 > self.calibration.settings.chi2_max {
            return Err(NoPoint::Inconsistent);
        }
        let point = self.point(fused.beam, &rays, spots)?;
        Ok(Point { sigma: Some(to_q14(fused.sigma)), chi2: Some(chi2), ..point })
    }

    fn paper(&self) -> Result<Point, NoPoint> {
        let farthest = self.spots.map(|spots| spots.iter().enumerate().max_by_key(|(_, s)| s.cluster.r_max()));
        if farthest == [None, None] {
            return Err(NoPoint::NoSpot);
        }
        let ray = |camera: usize, spot: Option<(usize, &Spot)>| self.ray(camera, spot?.1.midpoint());
        let rays = [ray(0, farthest[0]), ray(1, farthest[1])];
        let beam = paper::average(&rays).ok_or(NoPoint::NoIntersection)?;
        self.point(beam, &rays, farthest.map(|f| f.map(|(i, _)| i as u8)))
    }

    fn point(&self, beam: [i64; 3], rays: &[Option<BeamRay>; 2], spots: [Option<u8>; 2]) -> Result<Point, NoPoint> {
        let along = to_q14(beam[0]);
        let [least, most] = self.calibration.settings.range;
        if along < least || along > most {
            return Err(NoPoint::OutOfRange);
        }
        Ok(Point {
            laser: self.laser,
            position: to_rig(self.beam, beam),
            along,
            sigma: None,
            chi2: None,
            estimates: Estimates::new(rays),
            spots,
        })
    }
}
