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
//! Variances are words of 32 bits, and a quotient by one is a product with its reciprocal, which is right to 2^-14: an offset
//! moves by no more of itself.
//!
//! The plain three-dimensional solve that this replaces is the oracle of a test in karst-reference.

use karst_math::{high_product, high_product_signed, normalise, reciprocal_coarse};

use crate::calibration::LaserCalibration;
use crate::fusion::{BeamRay, Crossing, in_reach, quarters, with_sign};
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

/// Largest pull of the beam on the height difference of the rays, in units of the miss, Q.27: 16. Only rays of very
/// different variance and a beam without any reach it.
const MAX_GAIN: u32 = (1 << 31) - 1;

/// Largest chi squared of one offset that counts, Q.12: more than any limit allows.
const MAX_CHI2: u32 = (1 << 30) - 1;

/// 1 as a share of the height of a crossing, Q.14.
const ONE_SHARE: i32 = 1 << 14;

/// A variance to divide by. One that rounds to zero counts as its last bit.
struct Divisor {
    /// The variance, mm^2 in Q.20.
    variance: u32,
    /// Its [`reciprocal_coarse`] when it is shifted to the left until its top bit is set.
    inverse: u32,
    /// By how many bits that is.
    shift: u32,
}

impl Divisor {
    fn new(variance: u32) -> Self {
        let (normalised, shift) = normalise(variance);
        Self { variance, inverse: reciprocal_coarse(normalised), shift }
    }

    /// `part` over this variance, Q.31, for a part that is not larger.
    fn ratio(&self, part: u32) -> u32 {
        high_product(part << self.shift, self.inverse)
    }

    /// `part` over this variance, Q.27, at most [`MAX_GAIN`].
    fn gain(&self, part: u32) -> u32 {
        if part >> 4 >= self.variance {
            return MAX_GAIN;
        }
        // The part over 16 is less than the variance: with the same shift it has no more bits
        let shifted = if self.shift >= 4 { part << (self.shift - 4) } else { part >> (4 - self.shift) };
        high_product(shifted, self.inverse)
    }

    /// `offset^2` over this variance in Q.12, for an offset in mm Q.16.
    fn chi2(&self, offset: i32) -> u32 {
        // The root of the shift for the offset: a bit is left over where the shift is odd
        let (magnitude, half) = (offset.unsigned_abs(), self.shift >> 1);
        let offset = magnitude << half;
        if offset >> 31 != 0 || offset >> half != magnitude {
            return MAX_CHI2;
        }
        let product = high_product(high_product(offset, self.inverse), offset << 1);
        (product << (self.shift & 1)).min(MAX_CHI2)
    }
}

/// `value` times a factor in Q.31 of at most 1, for a value below 2^30.
fn scaled(value: i32, factor: u32) -> i32 {
    high_product_signed(value << 1, factor)
}

/// Two cameras, whose rays cross, and the laser.
pub(crate) fn stereo(
    laser: &LaserCalibration,
    rays: [&BeamRay; 2],
    crossing: &Crossing,
    variances: [u32; 2],
) -> Result<Fused, NoPoint> {
    let along = crossing.along;
    let quarters = quarters(along);
    let beam_variance = laser.variance_at(quarters);

    // Up. Shares of the two rays' heights in the height of the crossing, Q.14: below 2 in magnitude
    let b1 = crossing.share(rays[0].up_slope);
    let b2 = ONE_SHARE - b1;
    if b1 <= -ONE_SHARE || b1 >= 2 * ONE_SHARE {
        return Err(NoPoint::NoIntersection);
    }
    let up = rays[0].up_at(along);
    if up.unsigned_abs() > MAX_OFFSET {
        return Err(NoPoint::Inconsistent);
    }
    let [v1, v2] = [0, 1].map(|i| rays[i].up_variance_at(quarters, variances[i]));
    // Q.28 times Q.24
    let by_square = |b: i32, v: u32| high_product((b * b) as u32, v << 4);
    let up_total = Divisor::new(beam_variance + by_square(b2, v1) + by_square(b1, v2));
    // Covariance of along and up over the lever 1 / slope difference. Q.29 times Q.23
    let by_share = |b: i32, v: u32| high_product_signed(b << 15, v << 3);
    let covariance = by_share(b1, v2) - by_share(b2, v1);
    let gain = up_total.gain(covariance.unsigned_abs());
    // The beam can pull a crossing that misses it by much out of reach. Q.21 times Q.27
    let miss = high_product(up.unsigned_abs() << 5, gain);
    let pull = crossing.lever(miss).ok_or(NoPoint::OutOfRange)? as i32;
    let sign = (up ^ covariance) >> 31 ^ crossing.sign;
    let corrected = in_reach(along - with_sign(pull, sign)).ok_or(NoPoint::OutOfRange)?;
    let explained = ((u64::from(gain) * u64::from(covariance.unsigned_abs())) >> 27) as u32;
    let sigma = if explained >= v1 + v2 { 0 } else { crossing.sigma(v1 + v2 - explained) };

    // Across. The variances are those at the crossing, as above
    let offsets = [0, 1].map(|i| rays[i].across_at(corrected));
    if offsets.iter().any(|&o| o.wrapping_add(MAX_OFFSET as i32 / 2) as u32 > MAX_OFFSET) {
        return Err(NoPoint::Inconsistent);
    }
    let difference = offsets[0] - offsets[1];
    let [w1, w2] = [0, 1].map(|i| rays[i].across_variance_at(quarters, variances[i]));
    let across_difference = Divisor::new(w1 + w2);
    let share1 = across_difference.ratio(w2);
    let across = offsets[1] + scaled(difference, share1);
    let across_total = Divisor::new(beam_variance + high_product(w1 << 1, share1));

    Ok(Fused {
        beam: [corrected, scaled(up, up_total.ratio(beam_variance)), scaled(across, across_total.ratio(beam_variance))],
        sigma,
        chi2: up_total.chi2(up) + across_difference.chi2(difference) + across_total.chi2(across),
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
    let quarters = quarters(along);
    let beam_variance = laser.variance_at(quarters);
    let sigma = crossing.sigma(beam_variance + ray.up_variance_at(quarters, variance));
    let across = ray.across_at(along);
    if across.unsigned_abs() > MAX_OFFSET {
        return Err(NoPoint::Inconsistent);
    }
    let across_total = Divisor::new(beam_variance + ray.across_variance_at(quarters, variance));
    Ok(Fused {
        beam: [along, 0, scaled(across, across_total.ratio(beam_variance))],
        sigma,
        chi2: across_total.chi2(across),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Largest relative error of what a [`Divisor`] gives beside the last bit: that of its reciprocal.
    const PRECISION: f64 = 1.0 / 16384.0;

    fn near(value: u32, exact: f64) -> bool {
        f64::from(value) <= exact && f64::from(value) >= exact * (1.0 - PRECISION) - 3.0
    }

    #[test]
    fn a_variance_of_zero_counts_as_its_last_bit() {
        let zero = Divisor::new(0);
        assert!(near(zero.chi2(1), 1.0 / 65536.0_f64.powi(2) * f64::from(1 << 20) * 4096.0));
        assert_eq!(zero.gain(0), MAX_GAIN);
        assert_eq!(zero.ratio(0), 0);
    }

    #[test]
    fn an_offset_far_beyond_its_variance_has_the_largest_chi_squared() {
        // 512 mm and a variance of 0.1 mm^2, and of 4095 mm^2
        assert_eq!(Divisor::new(1 << 17).chi2(-(512 << 16)), MAX_CHI2);
        assert!(near(Divisor::new(u32::MAX).chi2(-(512 << 16)), 64.0 * 4096.0));
    }

    proptest! {
        #[test]
        fn shares_are_at_most_2_to_the_minus_14_too_small(whole: u32, smaller in 0..32_u32, part: u32) {
            let whole = (whole >> smaller).max(1);
            let part = part % (whole + u32::from(whole < u32::MAX));
            let exact = f64::from(part) / f64::from(whole) * f64::from(1_u32 << 31);
            prop_assert!(near(Divisor::new(whole).ratio(part), exact));
        }

        #[test]
        fn gains_are_at_most_2_to_the_minus_14_too_small_and_limited_to_16(
            (whole, part) in (any::<u32>(), any::<u32>()),
            smaller in prop::array::uniform2(0..32_u32),
        ) {
            let (whole, part) = ((whole >> smaller[0]).max(1), part >> smaller[1]);
            let exact = f64::from(part) / f64::from(whole) * f64::from(1 << 27);
            let gain = Divisor::new(whole).gain(part);
            if part >> 4 >= whole {
                prop_assert_eq!(gain, MAX_GAIN);
            } else {
                // Bits of the part that the shift to the right by up to 4 loses count less than 2^-27 of the whole
                prop_assert!(near(gain, exact) || whole >= 1 << 28 && near(gain + 16, exact), "{} for {}", gain, exact);
            }
        }

        #[test]
        fn chi_squared_is_at_most_2_to_the_minus_14_too_small(
            (offset, variance) in (any::<i32>(), any::<u32>()),
            smaller in prop::array::uniform2(0..32_u32),
        ) {
            let (offset, variance) = (offset >> 6 >> smaller[0].min(25), (variance >> smaller[1]).max(1));
            let millimetres = f64::from(offset) / 65536.0;
            let exact = millimetres * millimetres / (f64::from(variance) / f64::from(1 << 20)) * 4096.0;
            let chi2 = Divisor::new(variance).chi2(offset);
            prop_assert!(chi2 == MAX_CHI2 && exact * 1.001 >= f64::from(MAX_CHI2) || near(chi2, exact), "{} for {}", chi2, exact);
        }
    }
}
