//! Rays in the frame of a laser beam, and their weighted fusion: the f64 twin of `karst_core`'s modules `fusion` and
//! `weighted`.

use karst_core::NoPoint;
use karst_rig::{Laser, WaterCamera};
use nalgebra::{Vector2, Vector3};

/// A camera's ray in the frame of a beam: up = `up` + `up_slope` along, across = `across` + `across_slope` along.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeamRay {
    /// Slope d up / d along.
    pub up_slope: f64,
    /// Height over the beam at along = 0, mm.
    pub up: f64,
    /// Slope d across / d along.
    pub across_slope: f64,
    /// Offset across the beam at along = 0, mm.
    pub across: f64,
}

/// Limits shared with the fixed-point crate: they say what a sensible ray or crossing is.
const MAX_SLOPE: f64 = 2.0;
const LEAST_SLOPE: f64 = 1.0 / 64.0;
const LEAST_SLOPE_DIFFERENCE: f64 = 1.0 / 32.0;
const MAX_ALONG_MM: f64 = 8192.0;
const MAX_SHARE: f64 = 2.0;
const MAX_OFFSET_MM: f64 = 512.0;

impl BeamRay {
    /// The ray of a pixel in the frame of a beam (laser index and laser). None when it does not point outwards, or is steeper than 2 : 1.
    pub fn new(camera: &WaterCamera, (index, laser): (usize, &Laser), pixel: Vector2<f64>) -> Option<Self> {
        let ray = camera.ray(index, pixel);
        let frame = laser.frame();
        let direction = frame * ray.direction;
        let start = frame * (ray.origin.coords - Vector3::from(laser.origin_mm));
        let [up_slope, across_slope] = [direction.y / direction.x, direction.z / direction.x];
        let sensible = direction.x > 0.0 && up_slope.abs() <= MAX_SLOPE && across_slope.abs() <= MAX_SLOPE;
        sensible.then_some(Self {
            up_slope,
            up: start.y - start.x * up_slope,
            across_slope,
            across: start.z - start.x * across_slope,
        })
    }

    /// Height over the beam and offset across it at a distance along it, mm.
    pub fn at(&self, along: f64) -> [f64; 2] {
        [self.up + self.up_slope * along, self.across + self.across_slope * along]
    }
}

/// How the height and the offset of a ray at a distance along the beam change with the image position, mm per px:
/// the height with a radial step, the offset with a tangential one.
pub(crate) fn sensitivity(
    camera: &WaterCamera,
    laser: (usize, &Laser),
    pixel: Vector2<f64>,
    along: f64,
) -> Option<[f64; 2]> {
    const STEP_PX: f64 = 0.01;
    let radial = (pixel - Vector2::from(camera.model.centre_px)).normalize() * STEP_PX;
    let tangential = Vector2::new(-radial.y, radial.x);
    let change = |step: Vector2<f64>, i: usize| {
        let [plus, minus] = [pixel + step, pixel - step].map(|p| BeamRay::new(camera, laser, p));
        Some((plus?.at(along)[i] - minus?.at(along)[i]) / (2.0 * STEP_PX))
    };
    Some([change(radial, 0)?, change(tangential, 1)?])
}

fn in_reach(along: f64) -> Option<f64> {
    (along > 0.0 && along < MAX_ALONG_MM).then_some(along)
}

/// Camera and laser: distance along the beam, mm, at which the ray's height over the beam is zero.
pub fn mono(ray: &BeamRay) -> Option<f64> {
    if ray.up_slope.abs() < LEAST_SLOPE { None } else { in_reach(-ray.up / ray.up_slope) }
}

/// Camera 1 and camera 2: distance along the beam, mm, at which their heights over the beam are equal.
pub fn stereo(rays: &[BeamRay; 2]) -> Option<f64> {
    let slope = rays[0].up_slope - rays[1].up_slope;
    if slope.abs() < LEAST_SLOPE_DIFFERENCE { None } else { in_reach((rays[1].up - rays[0].up) / slope) }
}

/// A fused point in the beam's frame.
pub(crate) struct Fused {
    /// Along, up, across, mm.
    pub beam: [f64; 3],
    /// Standard deviation along the beam, mm.
    pub sigma: f64,
    /// chi squared.
    pub chi2: f64,
}

/// Variances of a fusion, mm^2, as functions of the distance along the beam.
pub(crate) struct Variances<'a> {
    /// Of the beam's position across itself.
    pub beam: &'a dyn Fn(f64) -> f64,
    /// Of the height and the offset of each ray.
    pub rays: &'a dyn Fn(usize, f64) -> Option<[f64; 2]>,
}

/// Two rays and the beam.
pub(crate) fn fuse_stereo(rays: &[BeamRay; 2], variances: &Variances) -> Result<Fused, NoPoint> {
    let along = stereo(rays).ok_or(NoPoint::NoIntersection)?;
    let slope = rays[0].up_slope - rays[1].up_slope;
    let (b1, b2) = (rays[0].up_slope / slope, -rays[1].up_slope / slope);
    if b1.abs().max(b2.abs()) > MAX_SHARE {
        return Err(NoPoint::NoIntersection);
    }
    let up = rays[0].at(along)[0];
    if up.abs() > MAX_OFFSET_MM {
        return Err(NoPoint::Inconsistent);
    }
    let beam_variance = (variances.beam)(along);
    let variance = |camera| (variances.rays)(camera, along).ok_or(NoPoint::NoIntersection);
    let ([v1, w1], [v2, w2]) = (variance(0)?, variance(1)?);
    let up_total = beam_variance + b2 * b2 * v1 + b1 * b1 * v2;
    let covariance = b1 * v2 - b2 * v1;
    let corrected = along - covariance / up_total * up / slope;
    let sigma = (v1 + v2 - covariance * covariance / up_total).max(0.0).sqrt() / slope.abs();

    let corrected = in_reach(corrected).ok_or(NoPoint::OutOfRange)?;
    let offsets = rays.map(|ray| ray.at(corrected)[1]);
    if offsets.iter().any(|o| o.abs() > MAX_OFFSET_MM / 2.0) {
        return Err(NoPoint::Inconsistent);
    }
    let across = (offsets[0] * w2 + offsets[1] * w1) / (w1 + w2);
    let across_total = beam_variance + w1 * w2 / (w1 + w2);
    Ok(Fused {
        beam: [corrected, up * beam_variance / up_total, across * beam_variance / across_total],
        sigma,
        chi2: up * up / up_total + (offsets[0] - offsets[1]).powi(2) / (w1 + w2) + across * across / across_total,
    })
}

/// One ray and the beam.
pub(crate) fn fuse_single(camera: usize, ray: &BeamRay, variances: &Variances) -> Result<Fused, NoPoint> {
    let along = mono(ray).ok_or(NoPoint::NoIntersection)?;
    let beam_variance = (variances.beam)(along);
    let [up_variance, across_variance] = (variances.rays)(camera, along).ok_or(NoPoint::NoIntersection)?;
    let across = ray.at(along)[1];
    if across.abs() > MAX_OFFSET_MM {
        return Err(NoPoint::Inconsistent);
    }
    let across_total = beam_variance + across_variance;
    Ok(Fused {
        beam: [along, 0.0, across * beam_variance / across_total],
        sigma: (beam_variance + up_variance).sqrt() / ray.up_slope.abs(),
        chi2: across * across / across_total,
    })
}
