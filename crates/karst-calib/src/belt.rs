//! Calibration of the laser belt: each beam as a line, from its spots on walls at several distances.

use std::fmt;

use karst_rig::{CameraOptics, Laser, Rig};
use nalgebra::{Cholesky, DMatrix, DVector, Matrix4, Point3, Vector2, Vector3};
use serde::Serialize;

use crate::initial::median;

/// Fewest spots that define a beam and still tell when one of them is wrong.
const MIN_SPOTS: usize = 4;
/// The farthest spot of a beam is at least this many times as far as the nearest.
const MIN_SPAN: f64 = 1.5;
/// How far two rays to one spot may pass each other, and a spot may be off the beam, before anything is refined:
/// mm, and mm per mm of distance.
const COARSE_GATE: [f64; 2] = [3.0, 5e-3];
/// Largest angle between a beam and its direction in the drawing, degrees.
const MAX_TURN_DEG: f64 = 10.0;
/// chi squared of a spot pair (3 degrees of freedom) beyond which it is no spot of the beam: 0.1 % of normally
/// distributed ones, as in the reconstruction.
const GATE_CHI2: f64 = 16.3;
/// Median of chi squared with 3 degrees of freedom.
const MEDIAN_CHI2: f64 = 2.366;
/// Gauss-Newton steps for one beam.
const STEPS: usize = 20;
/// A fit has converged when its step is shorter than this, mm: far below any uncertainty, above the rounding of projections.
const CONVERGED_MM: f64 = 1e-5;
/// Step of the numeric derivative of an image position, mm: small against distances, large against rounding.
const DERIVATIVE_STEP_MM: f64 = 0.1;

/// A candidate spot in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeltSpot {
    /// Position, px.
    pub pixel: [f64; 2],
    /// Standard uncertainty per axis as the detector gives it, px.
    pub sigma_px: f64,
}

/// The candidate spots in one pair of pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct BeltPicture {
    /// Name of the pair.
    pub name: String,
    /// Candidates per laser and camera.
    pub spots: Vec<[Vec<BeltSpot>; 2]>,
}

/// A spot on a calibrated beam.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BeamSpot {
    /// Name of the pair of pictures.
    pub picture: String,
    /// Distance along the beam from the laser's origin, mm.
    pub along_mm: f64,
    /// Where each camera found it, px.
    pub pixel: [[f64; 2]; 2],
    /// Found minus expected in each camera, px.
    pub residual_px: [[f64; 2]; 2],
}

/// A spot pair that is not on the beam.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RejectedSpot {
    /// Name of the pair of pictures.
    pub picture: String,
    /// Index of the laser.
    pub laser: usize,
    /// Why.
    pub reason: SpotReason,
}

/// Why a laser has no spot pair in a pair of pictures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum SpotReason {
    /// At least one camera found no spot.
    #[error("not found in both pictures")]
    NotFound,
    /// No two candidates belong together and are on the beam.
    #[error("no candidate pair is on the beam")]
    OffTheBeam,
    /// The pair nearest to the beam is still too far away.
    #[error("{distance_px:.2} px off the beam")]
    Outlier {
        /// Root of the sum of squares of its residuals, px.
        distance_px: f64,
    },
}

impl fmt::Display for RejectedSpot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, laser {}: {}", self.picture, self.laser, self.reason)
    }
}

/// A calibrated beam.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedLaser {
    /// The beam, with uncertainties that hold over the working range of the rig.
    pub laser: Laser,
    /// Covariance of the offset across the beam at the origin (along `up` and `side`, mm) and of the slopes in the same
    /// two directions.
    pub covariance: Matrix4<f64>,
    /// Its spots.
    pub spots: Vec<BeamSpot>,
    /// Chi squared of the spots.
    pub chi2: f64,
    /// Degrees of freedom of chi squared.
    pub freedom: usize,
}

/// A calibrated belt.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedBelt {
    /// In the order of the rig.
    pub lasers: Vec<CalibratedLaser>,
    /// The part of the uncertainty of spot positions, px per axis, that the spots on the beams show beyond what follows
    /// from the image noise: texture, particles, what is left in the cameras' calibration. At least the rig's floor.
    pub sigma_floor_px: f64,
    /// Chi squared per degree of freedom with this floor.
    pub chi2_per_dof: f64,
    /// RMS residual over all spots, px per axis.
    pub rms_px: f64,
    /// What was not used.
    pub rejected: Vec<RejectedSpot>,
}

/// Why there is no calibration of a belt.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BeltError {
    /// A camera has no model.
    #[error("camera {} has no model", camera + 1)]
    NoModel {
        /// Index of the camera.
        camera: usize,
    },
    /// A pair of pictures has another number of lasers than the rig.
    #[error("{picture}: spots of {found} lasers, expected {expected} as in the rig")]
    Lasers {
        /// Name of the pair.
        picture: String,
        /// Lasers of the picture.
        found: usize,
        /// Lasers of the rig.
        expected: usize,
    },
    /// Too few spots on a beam.
    #[error(
        "laser {laser}: {found} of {pictures} pairs of pictures show its spot on one beam, expected at least \
         {MIN_SPOTS}: more pictures needed, or the laser is out or not where the drawing has it"
    )]
    TooFewSpots {
        /// Index of the laser.
        laser: usize,
        /// Spots on one beam.
        found: usize,
        /// Pairs of pictures.
        pictures: usize,
    },
    /// All spots of a beam are at one distance.
    #[error(
        "laser {laser}: all spots are {:.0} to {:.0} mm away: the direction of the beam cannot be observed; add pictures of walls at \
         other distances, the farthest at least {MIN_SPAN} times as far as the nearest", range_mm[0], range_mm[1]
    )]
    OneDistance {
        /// Index of the laser.
        laser: usize,
        /// Distance of the nearest and of the farthest spot along the beam, mm.
        range_mm: [f64; 2],
    },
    /// The equations of a beam have no solution.
    #[error("laser {laser}: no line explains its spots")]
    NoLine {
        /// Index of the laser.
        laser: usize,
    },
}

/// Calibrates the beams of a rig whose cameras are calibrated, from pictures of the spots on walls at different, unknown
/// distances.
///
/// The spots of one laser lie on one line: of all candidate pairs, those are taken whose rays meet and which lie on the
/// line that most pictures agree with. Then line and distances are fitted to the image positions (least squares through
/// tube and water), and spots that are off are named. Of each laser in the rig only the rough direction is used.
pub fn calibrate_belt(rig: &Rig, pictures: &[BeltPicture]) -> Result<CalibratedBelt, BeltError> {
    let optics = [0, 1].map(|camera| measuring_optics(rig, camera).ok_or(BeltError::NoModel { camera }));
    let [first, second] = optics;
    let optics = [first?, second?];
    for picture in pictures {
        let (found, expected) = (picture.spots.len(), rig.lasers.len());
        if found != expected {
            return Err(BeltError::Lasers { picture: picture.name.clone(), found, expected });
        }
    }
    let mut rejected = Vec::new();
    let mut beams = Vec::new();
    for (index, laser) in rig.lasers.iter().enumerate() {
        beams.push(Beam::find(&optics, (index, laser), rig.reconstruction.range_mm, pictures, &mut rejected)?);
    }
    let floor = rig.detector.sigma_floor_px;
    for beam in &mut beams {
        beam.refine(&optics, 0.0)?;
    }
    let extra = loop {
        let extra = extra_variance(&beams);
        let mut complete = true;
        for beam in &mut beams {
            if let Some(outlier) = beam.reject_worst(GATE_CHI2, extra, pictures) {
                rejected.push(outlier);
                beam.check(pictures.len())?;
                beam.refine(&optics, extra)?;
                complete = false;
            }
        }
        if complete {
            break extra;
        }
    };
    let lasers: Vec<CalibratedLaser> = beams
        .iter()
        .map(|beam| beam.result(&optics, extra, rig.reconstruction.range_mm, pictures))
        .collect::<Result<_, _>>()?;
    let freedom: usize = lasers.iter().map(|laser| laser.freedom).sum();
    let residuals = lasers.iter().flat_map(|laser| &laser.spots).flat_map(|spot| spot.residual_px.as_flattened());
    let (sum, count) = residuals.fold((0.0, 0_u32), |(sum, count), residual| (sum + residual * residual, count + 1));
    Ok(CalibratedBelt {
        sigma_floor_px: (floor * floor + extra).sqrt(),
        chi2_per_dof: lasers.iter().map(|laser| laser.chi2).sum::<f64>() / freedom.max(1) as f64,
        rms_px: (sum / f64::from(count.max(1))).sqrt(),
        lasers,
        rejected,
    })
}

/// A camera as the reconstruction uses it: a model in the water, where the rig has one, goes before the traced camera.
fn measuring_optics(rig: &Rig, index: usize) -> Option<CameraOptics> {
    let camera = rig.cameras.get(index)?;
    match (&camera.water, rig.tube) {
        (Some(model), Some(_)) => {
            Some(CameraOptics::Model { model: model.clone(), max_radius_px: camera.mirror_radius_px })
        }
        _ => rig.camera_optics(index),
    }
}

/// Variance per axis that has to be added to that of the spots for chi squared to be what it should be, px². Zero if
/// they are nearer to their beams than expected. By the median: rough walls give a few spots large residuals.
fn extra_variance(beams: &[Beam]) -> f64 {
    let freedom: usize = beams.iter().map(Beam::freedom).sum();
    let pairs: usize = beams.iter().map(|beam| beam.pairs.len()).sum();
    // The fit of the beams takes up some of the three degrees of freedom of each pair.
    let expected = MEDIAN_CHI2 * freedom as f64 / (3 * pairs.max(1)) as f64;
    let excess = |extra: f64| median(beams.iter().flat_map(|beam| beam.chi2s(extra)).collect()) > expected;
    let (mut low, mut high) = (0.0, 1.0);
    if !excess(low) {
        return low;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if excess(middle) { low = middle } else { high = middle }
    }
    low
}

/// A pair of spots that may be on a beam.
#[derive(Debug, Clone)]
struct Pair {
    picture: usize,
    spots: [BeltSpot; 2],
    /// Where the rays are nearest to each other, mm.
    point: Point3<f64>,
    /// Distance along the beam, mm.
    along: f64,
    /// Found minus expected, px.
    residuals: [Vector2<f64>; 2],
}

/// A line through two spots, and the pairs that agree with it.
struct Line {
    point: Point3<f64>,
    direction: Vector3<f64>,
    /// One of each picture at most.
    pairs: Vec<usize>,
    /// Sum of their squared distances from the line, mm².
    square: f64,
}

/// A beam while it is fitted: a line in a frame of its own.
#[derive(Debug, Clone)]
struct Beam {
    index: usize,
    laser: Laser,
    origin: Point3<f64>,
    direction: Vector3<f64>,
    pairs: Vec<Pair>,
}

impl Beam {
    /// The line that the spots of most pictures agree with.
    fn find(
        optics: &[CameraOptics; 2],
        (index, laser): (usize, &Laser),
        range_mm: [f64; 2],
        pictures: &[BeltPicture],
        rejected: &mut Vec<RejectedSpot>,
    ) -> Result<Self, BeltError> {
        let drawn = laser.direction();
        let along = |point: &Point3<f64>| (point - Point3::from(laser.origin_mm)).dot(&drawn);
        let mut pairs = Vec::new();
        for (number, picture) in pictures.iter().enumerate() {
            let [first, second] = &picture.spots[index];
            let candidates = first.iter().flat_map(|a| second.iter().map(move |b| [*a, *b]));
            pairs.extend(candidates.filter_map(|spots| {
                let point = meet(optics, &spots)?;
                let along = along(&point);
                (range_mm[0]..=range_mm[1]).contains(&along).then_some(Pair {
                    picture: number,
                    spots,
                    point,
                    along,
                    residuals: [Vector2::zeros(); 2],
                })
            }));
        }
        let near = |origin: &Point3<f64>, direction: &Vector3<f64>, pair: &Pair| {
            let offset = (pair.point - origin).cross(direction).norm();
            (offset <= COARSE_GATE[0] + COARSE_GATE[1] * pair.along).then_some(offset)
        };
        // Of each picture the pair nearest to the line.
        let supporters = |origin: &Point3<f64>, direction: &Vector3<f64>| {
            let mut best: Vec<Option<(f64, usize)>> = vec![None; pictures.len()];
            for (number, pair) in pairs.iter().enumerate() {
                if let Some(offset) = near(origin, direction, pair)
                    && best[pair.picture].is_none_or(|(least, _)| offset < least)
                {
                    best[pair.picture] = Some((offset, number));
                }
            }
            best.into_iter().flatten().collect::<Vec<_>>()
        };
        let mut best: Option<Line> = None;
        for (i, a) in pairs.iter().enumerate() {
            for b in pairs[i + 1..].iter().filter(|b| b.picture != a.picture) {
                // Two spots at one distance define no line: the beam's drawn direction then has to do.
                let apart = (a.along - b.along).abs() > 0.1 * a.along;
                let sense = (b.along - a.along).signum();
                let direction = if apart { (sense * (b.point - a.point)).normalize() } else { drawn };
                if direction.angle(&drawn).to_degrees() > MAX_TURN_DEG {
                    continue;
                }
                let support = supporters(&a.point, &direction);
                let square = support.iter().map(|(offset, _)| offset * offset).sum();
                let better = best.as_ref().is_none_or(|best| {
                    let count = best.pairs.len();
                    support.len() > count || (support.len() == count && square < best.square)
                });
                if better {
                    let pairs = support.iter().map(|(_, number)| *number).collect();
                    best = Some(Line { point: a.point, direction, pairs, square });
                }
            }
        }
        let too_few = |found| BeltError::TooFewSpots { laser: index, found, pictures: pictures.len() };
        let Line { point, direction, pairs: chosen, .. } = best.ok_or(too_few(pairs.len().min(1)))?;
        for (number, picture) in pictures.iter().enumerate() {
            if !chosen.iter().any(|&pair| pairs[pair].picture == number) {
                let found = picture.spots[index].iter().all(|spots| !spots.is_empty());
                let reason = if found { SpotReason::OffTheBeam } else { SpotReason::NotFound };
                rejected.push(RejectedSpot { picture: picture.name.clone(), laser: index, reason });
            }
        }
        // Distances count from where the drawing has the origin.
        let origin = point - along(&point) / direction.dot(&drawn) * direction;
        let mut pairs: Vec<Pair> = chosen.into_iter().map(|pair| pairs[pair].clone()).collect();
        for pair in &mut pairs {
            pair.along = (pair.point - origin).dot(&direction);
        }
        let beam = Self { index, laser: *laser, origin, direction, pairs };
        beam.check(pictures.len())?;
        Ok(beam)
    }

    /// Whether the spots define a line.
    fn check(&self, pictures: usize) -> Result<(), BeltError> {
        let (laser, found) = (self.index, self.pairs.len());
        if found < MIN_SPOTS {
            return Err(BeltError::TooFewSpots { laser, found, pictures });
        }
        let range_mm = self
            .pairs
            .iter()
            .fold([f64::INFINITY, 0.0], |[least, most], pair| [pair.along.min(least), pair.along.max(most)]);
        if range_mm[1] < MIN_SPAN * range_mm[0] {
            return Err(BeltError::OneDistance { laser, range_mm });
        }
        Ok(())
    }

    /// Degrees of freedom: four image coordinates and one distance each, four for the line.
    fn freedom(&self) -> usize {
        (3 * self.pairs.len()).saturating_sub(4)
    }

    /// Chi squared of each pair, with some variance added to that of the spots (px²).
    fn chi2s(&self, extra: f64) -> impl Iterator<Item = f64> {
        self.pairs.iter().map(move |pair| pair.chi2(extra))
    }

    /// Two directions across the beam: up (towards the rig's z), and to the side.
    fn across(&self) -> [Vector3<f64>; 2] {
        let side = Vector3::z().cross(&self.direction).normalize();
        [self.direction.cross(&side), side]
    }

    /// Takes out the pair that is farthest off the beam, if its chi squared is above a limit. One at a time: it pulls the
    /// beam away from the others.
    fn reject_worst(&mut self, limit: f64, extra: f64, pictures: &[BeltPicture]) -> Option<RejectedSpot> {
        let worst = (0..self.pairs.len()).max_by(|&a, &b| {
            let chi2 = |pair: usize| self.pairs[pair].chi2(extra);
            chi2(a).total_cmp(&chi2(b))
        })?;
        if self.pairs[worst].chi2(extra) <= limit {
            return None;
        }
        let pair = self.pairs.remove(worst);
        let distance_px = pair.residuals.iter().map(Vector2::norm_squared).sum::<f64>().sqrt();
        let picture = pictures[pair.picture].name.clone();
        Some(RejectedSpot { picture, laser: self.index, reason: SpotReason::Outlier { distance_px } })
    }

    /// Least squares in the pictures: the line, and the distance of each spot. With the normal matrix of the line, the
    /// distances eliminated.
    fn refine(&mut self, optics: &[CameraOptics; 2], extra: f64) -> Result<Matrix4<f64>, BeltError> {
        let no_line = BeltError::NoLine { laser: self.index };
        let size = 4 + self.pairs.len();
        for _ in 0..STEPS {
            let [up, side] = self.across();
            let mut matrix = DMatrix::<f64>::zeros(size, size);
            let mut right = DVector::<f64>::zeros(size);
            for (number, pair) in self.pairs.iter_mut().enumerate() {
                let point = self.origin + pair.along * self.direction;
                for (camera, spot) in optics.iter().zip(pair.spots).enumerate().map(|(i, (o, s))| ((i, o), s)) {
                    let (camera, optics) = camera;
                    let image = |step: Vector3<f64>| optics.project(point + step).ok_or(no_line.clone());
                    let expected = image(Vector3::zeros())?;
                    let by = |direction: Vector3<f64>| -> Result<Vector2<f64>, BeltError> {
                        Ok((image(DERIVATIVE_STEP_MM * direction)? - image(-DERIVATIVE_STEP_MM * direction)?)
                            / (2.0 * DERIVATIVE_STEP_MM))
                    };
                    let residual = Vector2::from(spot.pixel) - expected;
                    pair.residuals[camera] = residual;
                    let weight = 1.0 / (spot.sigma_px * spot.sigma_px + extra);
                    let (by_up, by_side) = (by(up)?, by(side)?);
                    let terms = [
                        (0, by_up),
                        (1, by_side),
                        (2, pair.along * by_up),
                        (3, pair.along * by_side),
                        (4 + number, by(self.direction)?),
                    ];
                    for (i, a) in terms {
                        right[i] += weight * a.dot(&residual);
                        for (j, b) in terms {
                            matrix[(i, j)] += weight * a.dot(&b);
                        }
                    }
                }
            }
            let factor = Cholesky::new(matrix.clone()).ok_or(no_line.clone())?;
            let step = factor.solve(&right);
            self.origin += step[0] * up + step[1] * side;
            self.direction = (self.direction + step[2] * up + step[3] * side).normalize();
            for (pair, change) in self.pairs.iter_mut().zip(&step.as_slice()[4..]) {
                pair.along += change;
            }
            if step.iter().any(|value| !value.is_finite()) {
                return Err(no_line);
            }
            if step.norm() < CONVERGED_MM {
                return Ok(factor.inverse().fixed_view::<4, 4>(0, 0).into_owned());
            }
        }
        Err(no_line)
    }

    fn result(
        &self,
        optics: &[CameraOptics; 2],
        extra: f64,
        range_mm: [f64; 2],
        pictures: &[BeltPicture],
    ) -> Result<CalibratedLaser, BeltError> {
        let mut beam = self.clone();
        let covariance = beam.refine(optics, extra)?;
        let [origin_sigma_mm, direction_sigma] = sigmas(&covariance, range_mm);
        let spots = beam.pairs.iter().map(|pair| BeamSpot {
            picture: pictures[pair.picture].name.clone(),
            along_mm: pair.along,
            pixel: pair.spots.map(|spot| spot.pixel),
            residual_px: pair.residuals.map(Into::into),
        });
        Ok(CalibratedLaser {
            laser: Laser {
                origin_sigma_mm,
                direction_sigma_mrad: 1e3 * direction_sigma,
                ..self.laser.with_beam(beam.origin, beam.direction)
            },
            covariance,
            spots: spots.collect(),
            chi2: beam.chi2s(extra).sum(),
            freedom: beam.freedom(),
        })
    }
}

impl Pair {
    /// Chi squared with 3 degrees of freedom, with some variance added to that of the spots (px²).
    fn chi2(&self, extra: f64) -> f64 {
        let of = |spot: &BeltSpot, residual: &Vector2<f64>| {
            residual.norm_squared() / (spot.sigma_px * spot.sigma_px + extra)
        };
        self.spots.iter().zip(&self.residuals).map(|(spot, residual)| of(spot, residual)).sum()
    }
}

/// Where the rays of two spots meet, if they do.
fn meet(optics: &[CameraOptics; 2], spots: &[BeltSpot; 2]) -> Option<Point3<f64>> {
    let [a, b] = [0, 1].map(|i| optics[i].ray(spots[i].pixel.into()));
    let (a, b) = (a?, b?);
    let base = b.origin - a.origin;
    let cosine = a.direction.dot(&b.direction);
    let (p, q) = (base.dot(&a.direction), base.dot(&b.direction));
    let sine2 = 1.0 - cosine * cosine;
    let [s, t] = [(p - cosine * q) / sine2, (cosine * p - q) / sine2];
    let [end_a, end_b] = [a.origin + s * a.direction, b.origin + t * b.direction];
    let apart = (end_a - end_b).norm();
    // A comparison that also fails for parallel rays.
    let meet = s > 0.0 && t > 0.0 && apart <= COARSE_GATE[0] + COARSE_GATE[1] * s.max(t);
    meet.then(|| nalgebra::center(&end_a, &end_b))
}

/// Standard uncertainties of origin (mm) and direction (rad) across the beam as the rig file has them, independent of
/// each other. In truth they are not: the beam is best known where its spots were. Both ends of the working range get
/// the variance that they have, which makes it too large rather than too small in between.
fn sigmas(covariance: &Matrix4<f64>, [near, far]: [f64; 2]) -> [f64; 2] {
    let variance = |along: f64| {
        let across = |i: usize| {
            covariance[(i, i)] + 2.0 * along * covariance[(i, i + 2)] + along * along * covariance[(i + 2, i + 2)]
        };
        0.5 * (across(0) + across(1))
    };
    let (at_near, at_far) = (variance(near), variance(far));
    let direction = ((at_far - at_near) / (far * far - near * near)).max(0.0);
    // The rig file's smallest uncertainties.
    [(at_near - direction * near * near).max(1e-6).sqrt(), direction.max(1e-12).sqrt()]
}
