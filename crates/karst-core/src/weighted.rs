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

use karst_math::{div_round, div_round_unsigned, round_shift, sqrt_round};

use crate::calibration::LaserCalibration;
use crate::fusion::{BeamRay, Crossing, in_reach, quarters_squared};
use crate::reconstruct::NoPoint;

/// A point in the beam's frame with its uncertainty.
pub(crate) struct Fused {
    /// Along, up, across, mm in Q.16.
    pub beam: [i32; 3],
    /// Standard deviation along the beam, mm in Q.16.
    pub sigma: i32,
    /// chi squared, Q.12; from 2^30 - 1 on it may be more.
    pub chi2: u32,
}

/// Offsets from the beam beyond this are inconsistent whatever the variances: 512 mm in Q.16.
const MAX_OFFSET: u32 = 512 << 16;

/// Largest pull of the beam on the height difference of the rays, in units of the miss, Q.16: 16. Only rays of very
/// different variance and a beam without any reach it.
const MAX_GAIN: i64 = (16 << 16) - 1;

/// Largest chi squared of one offset that counts, Q.12: more than any limit allows.
const MAX_CHI2: u64 = (1 << 30) - 1;

/// `offset^2 / variance` in Q.12, for an offset in mm Q.16 up to [`MAX_OFFSET`] and a variance in mm^2 Q.32. A variance
/// that rounds to zero counts as its last bit, here and below.
fn chi2(offset: i32, variance: u64) -> u32 {
    let square = (i64::from(offset) * i64::from(offset)) as u64;
    div_round_unsigned(square << 12, variance.max(1)).min(MAX_CHI2) as u32
}

/// `part / whole` in Q.16, for two variances in mm^2 Q.32 below 2^48, the first at most the second.
fn ratio(part: u64, whole: u64) -> i32 {
    div_round_unsigned(part << 16, whole.max(1)) as i32
}

/// `value` times a factor in Q.16, for a product below 2^47.
fn scaled(value: i32, factor: i32) -> i32 {
    round_shift(i64::from(value) * i64::from(factor), 16) as i32
}

/// Two cameras, whose rays cross, and the laser.
pub(crate) fn stereo(
    laser: &LaserCalibration,
    rays: &[BeamRay; 2],
    crossing: &Crossing,
    variances: [u32; 2],
) -> Result<Fused, NoPoint> {
    let along = crossing.along;
    let square = quarters_squared(along);
    let beam_variance = laser.variance_at(square);

    // Up. Shares of the two rays' heights in the height of the crossing, Q.16
    let share = |ray: &BeamRay| round_shift(i64::from(ray.up_slope) * crossing.inverse_slope, 40) as i32;
    let (b1, b2) = (share(&rays[0]), -share(&rays[1]));
    if b1.unsigned_abs().max(b2.unsigned_abs()) > 2 << 16 {
        return Err(NoPoint::NoIntersection);
    }
    let up = rays[0].up_at(along);
    if up.unsigned_abs() > MAX_OFFSET {
        return Err(NoPoint::Inconsistent);
    }
    let [v1, v2] = [0, 1].map(|i| rays[i].up_variance_at(along, variances[i]));
    let share_squared = |b: i32| ((i64::from(b) * i64::from(b)) >> 16) as u64;
    let up_variance = round_shift((share_squared(b2) * v1 + share_squared(b1) * v2) as i64, 16) as u64;
    let up_total = beam_variance + up_variance;
    // Covariance of along and up over the lever 1 / slope difference
    let covariance = round_shift(i64::from(b1) * v2 as i64 - i64::from(b2) * v1 as i64, 16);
    let gain = div_round(covariance << 16, up_total.max(1) as i64).clamp(-MAX_GAIN, MAX_GAIN);
    // The beam can pull a crossing that misses it by much out of reach
    let pull = crossing.lever(scaled(up, gain as i32));
    let corrected = in_reach(i64::from(along) - pull).ok_or(NoPoint::OutOfRange)?;
    let along_variance = ((v1 + v2) as i64 - round_shift(gain * covariance, 16)).max(0);
    let sigma = crossing.lever(sqrt_round(along_variance as u64) as i32).abs() as i32;

    // Across. The variances are those at the crossing, as above
    let offsets = [0, 1].map(|i| rays[i].across_at(corrected));
    if offsets.iter().any(|o| o.unsigned_abs() > MAX_OFFSET / 2) {
        return Err(NoPoint::Inconsistent);
    }
    let difference = offsets[0] - offsets[1];
    let [w1, w2] = [0, 1].map(|i| rays[i].across_variance_at(square, variances[i]));
    let share1 = ratio(w2, w1 + w2);
    let across = offsets[1] + scaled(difference, share1);
    let across_total = beam_variance + round_shift(w1 as i64 * i64::from(share1), 16) as u64;

    Ok(Fused {
        beam: [
            corrected,
            scaled(up, ratio(beam_variance, up_total)),
            scaled(across, ratio(beam_variance, across_total)),
        ],
        sigma,
        chi2: chi2(up, up_total) + chi2(difference, w1 + w2) + chi2(across, across_total),
    })
}

/// One camera, whose ray meets the beam, and the laser: the beam's uncertainty is the point's.
pub(crate) fn single(
    laser: &LaserCalibration,
    ray: &BeamRay,
    crossing: &Crossing,
    variance: u32,
) -> Result<Fused, NoPoint> {
    let along = crossing.along;
    let square = quarters_squared(along);
    let beam_variance = laser.variance_at(square);
    let up_total = beam_variance + ray.up_variance_at(along, variance);
    let sigma = crossing.lever(sqrt_round(up_total) as i32).abs() as i32;
    let across = ray.across_at(along);
    if across.unsigned_abs() > MAX_OFFSET {
        return Err(NoPoint::Inconsistent);
    }
    let across_total = beam_variance + ray.across_variance_at(square, variance);
    Ok(Fused {
        beam: [along, 0, scaled(across, ratio(beam_variance, across_total))],
        sigma,
        chi2: chi2(across, across_total),
    })
}
