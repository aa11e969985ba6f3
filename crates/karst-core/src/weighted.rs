//! The weighted method: least squares of two rays and an uncertain laser beam.
//!
//! In the beam's frame the problem separates, to second order in the few milliradians between the rays and the beam's
//! own plane, into the plane of *along* and *up*, where the two rays cross, and the direction *across*:
//!
//! * Up: the crossing of the rays misses the beam by `up`; its variance is v = b2^2 v1 + b1^2 v2, with v1, v2 the
//!   variances of the rays' heights and b1 + b2 = 1 the shares of the crossing. The beam, with variance L, pulls the
//!   point back by the gain of a Kalman filter: up L / (L + v). The distance along moves with it, by their covariance.
//! * Across: the inverse-variance mean of the rays, pulled back likewise.
//! * chi squared: up^2 / (L + v) + (difference of the rays across)^2 / (their variances' sum)
//!   + across^2 / (L + variance of the mean): three degrees of freedom.
//!
//! The plain three-dimensional solve that this replaces is the oracle of a test in karst-reference.

use karst_math::{div_round, round_shift, sqrt_round};

use crate::calibration::LaserCalibration;
use crate::fusion::{self, BeamRay, in_reach, mono};
use crate::reconstruct::NoPoint;

/// A point in the beam's frame with its uncertainty.
pub(crate) struct Fused {
    /// Along, up, across, mm in Q.16.
    pub beam: [i64; 3],
    /// Standard deviation along the beam, mm in Q.16.
    pub sigma: i64,
    /// chi squared, Q.12.
    pub chi2: i64,
}

/// Offsets from the beam beyond this are inconsistent whatever the variances: 512 mm in Q.16.
const MAX_OFFSET: i64 = 512 << 16;

/// Largest pull of the beam on the height difference of the rays, in units of the miss, Q.16: 16. Only rays of very
/// different variance and a beam without any reach it.
const MAX_GAIN: i64 = (16 << 16) - 1;

/// `offset^2 / variance` in Q.12, for an offset in mm Q.16 up to [`MAX_OFFSET`] and a variance in mm^2 Q.32. A variance
/// that rounds to zero counts as its last bit, here and below.
fn chi2(offset: i64, variance: i64) -> i64 {
    div_round((offset * offset) << 12, variance.max(1))
}

/// `part / whole` in Q.16, for two variances in mm^2 Q.32 below 2^47.
fn ratio(part: i64, whole: i64) -> i64 {
    div_round(part << 16, whole.max(1))
}

/// Two cameras and the laser.
pub(crate) fn stereo(laser: &LaserCalibration, rays: &[BeamRay; 2], variances: [u32; 2]) -> Result<Fused, NoPoint> {
    let crossing = fusion::stereo(rays).ok_or(NoPoint::NoIntersection)?;
    let along = crossing.along;
    let beam_variance = laser.variance_at(along);

    // Up. Shares of the two rays' heights in the height of the crossing, Q.16
    let share = |slope: i32| round_shift(i64::from(slope) * crossing.inverse_slope, 40);
    let (b1, b2) = (share(rays[0].up_slope), -share(rays[1].up_slope));
    if b1.abs().max(b2.abs()) > 2 << 16 {
        return Err(NoPoint::NoIntersection);
    }
    let up = round_shift(rays[0].up_at(along), 4);
    if up.abs() > MAX_OFFSET {
        return Err(NoPoint::Inconsistent);
    }
    let [v1, v2] = [0, 1].map(|i| rays[i].up_variance_at(along, variances[i]));
    let up_variance = round_shift(((b2 * b2) >> 16) * v1 + ((b1 * b1) >> 16) * v2, 16);
    let up_total = beam_variance + up_variance;
    // Covariance of along and up over the lever 1 / slope difference
    let covariance = round_shift(b1 * v2 - b2 * v1, 16);
    let gain = div_round(covariance << 16, up_total.max(1)).clamp(-MAX_GAIN, MAX_GAIN);
    // The beam can pull a crossing that misses it by much out of reach
    let corrected = in_reach(along - crossing.lever(round_shift(gain * up, 16))).ok_or(NoPoint::OutOfRange)?;
    let along_variance = (v1 + v2 - round_shift(gain * covariance, 16)).max(0);
    let sigma = crossing.lever(sqrt_round(along_variance as u64).into()).abs();

    // Across. The variances are those at the crossing, as above
    let offsets = [0, 1].map(|i| rays[i].across_at(corrected));
    let difference = offsets[0] - offsets[1];
    if offsets.iter().any(|o| o.abs() > MAX_OFFSET / 2) {
        return Err(NoPoint::Inconsistent);
    }
    let [w1, w2] = [0, 1].map(|i| rays[i].across_variance_at(along, variances[i]));
    let share1 = ratio(w2, w1 + w2);
    let across = offsets[1] + round_shift(difference * share1, 16);
    let across_total = beam_variance + round_shift(w1 * share1, 16);

    Ok(Fused {
        beam: [
            corrected,
            round_shift(up * ratio(beam_variance, up_total), 16),
            round_shift(across * ratio(beam_variance, across_total), 16),
        ],
        sigma,
        // Each is below 2^63; a beam without any uncertainty may bring all three close to it
        chi2: chi2(up, up_total).saturating_add(chi2(difference, w1 + w2)).saturating_add(chi2(across, across_total)),
    })
}

/// One camera and the laser: the beam's uncertainty is the point's.
pub(crate) fn single(laser: &LaserCalibration, ray: &BeamRay, variance: u32) -> Result<Fused, NoPoint> {
    let crossing = mono(ray).ok_or(NoPoint::NoIntersection)?;
    let along = crossing.along;
    let beam_variance = laser.variance_at(along);
    let up_total = beam_variance + ray.up_variance_at(along, variance);
    let sigma = crossing.lever(sqrt_round(up_total as u64).into()).abs();
    let across = ray.across_at(along);
    if across.abs() > MAX_OFFSET {
        return Err(NoPoint::Inconsistent);
    }
    let across_total = beam_variance + ray.across_variance_at(along, variance);
    Ok(Fused {
        beam: [along, 0, round_shift(across * ratio(beam_variance, across_total), 16)],
        sigma,
        chi2: chi2(across, across_total),
    })
}
