//! A ray in the frame of a laser beam, and the three single estimates of the paper.
//!
//! In the frame of a beam (along, up, across) the ray of a camera is two straight lines over the distance `along`:
//! up = `up` + `up_slope` along, across = `across` + `across_slope` along. The beam itself is up = across = 0. All three
//! estimates of the paper and their weighted fusion are then scalar arithmetic, for any misalignment of the rig.

use fixed::types::I18F14;
use karst_math::{div_round_unsigned, round_shift, saturate_i32};

use crate::calibration::LaserFrame;
use crate::camera::{CameraCalibration, CameraRay};

/// A camera's ray in the frame of a laser beam.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BeamRay {
    /// Slope d up / d along, Q4.28.
    pub up_slope: i32,
    /// Height over the beam at along = 0, mm in Q12.20.
    pub up: i32,
    /// Slope d across / d along, Q4.28.
    pub across_slope: i32,
    /// Offset across the beam at along = 0, mm in Q12.20.
    pub across: i32,
    /// 1 / rho in 1/px, Q.22: at most 2^16.
    pub(crate) inverse_radius: u32,
    /// d(slope f / rho) / ds, Q12.20.
    pub(crate) slope_derivative: i32,
    /// d(start) / ds, mm in Q24.8.
    pub(crate) start_derivative: i32,
}

/// Smallest component of a ray along the beam, px in Q12.20: 64 px. Spots nearer to the image centre are inside the
/// instrument.
const LEAST_ALONG: u32 = 64 << 20;

impl BeamRay {
    /// The ray of an image position in the frame of a beam: [`Self::new`] of [`CameraCalibration::ray`].
    #[inline(never)]
    pub fn of_position(camera: &CameraCalibration, frame: &LaserFrame, position: [I18F14; 2]) -> Option<Self> {
        Self::new(&camera.ray(position), frame)
    }

    /// Turns a camera's ray into the frame of a beam. None when it does not point outwards along the beam, or is
    /// steeper than 2 : 1.
    #[inline]
    pub fn new(ray: &CameraRay, frame: &LaserFrame) -> Option<Self> {
        let d = ray.direction.map(i64::from);
        let [along, up, across] = frame.rotation.map(|row| {
            let r = row.map(i64::from);
            round_shift(r[0] * d[0] + r[1] * d[1] + r[2] * d[2], 30)
        });
        // A rotation makes the length of three 32-bit components at most 2^32 / sqrt(4/3)
        let along = u32::try_from(along).ok().filter(|&along| along >= LEAST_ALONG)?;
        if up.unsigned_abs() > 2 * u64::from(along) || across.unsigned_abs() > 2 * u64::from(along) {
            return None;
        }
        // Viewpoint plus the axial offset along the camera's z: Q.14 times Q.30, kept at Q.20
        let start: [i64; 3] = core::array::from_fn(|i| {
            let offset = i64::from(frame.rotation[i][2]) * i64::from(ray.start);
            saturate_i32(i64::from(frame.viewpoint[i]) + round_shift(offset, 24)).into()
        });
        // 2^58 / along: 2^26 to 2^32 for 64 px and more. Neither up, across nor f are above 3 times along, so that
        // their products with it are below 2^60.
        let inverse = div_round_unsigned(1 << 58, along.into());
        let by_along = |length: i64, bits: u32| round_shift(length * inverse as i64, bits) as i32;
        let (up_slope, across_slope) = (by_along(up, 30), by_along(across, 30));
        // With p = f / 512 px, the slope is p / s: its derivative is (p' - p / s) / s. For this purpose rho is `along`,
        // so 1 / s is inverse / 2^29.
        let change = i64::from(ray.direction_derivative) - i64::from(by_along(d[2], 38));
        // Below 2^32 times at most 2^32. The quotient is rounded down, so that of a negative number away from zero
        let product = u64::from(change.unsigned_abs() as u32) * inverse;
        let slope_derivative = if change < 0 { !(product.wrapping_sub(1) >> 29) } else { product >> 29 } as i64;
        let at_zero = |i: usize, slope: i32| saturate_i32(start[i] - round_shift(start[0] * i64::from(slope), 28));
        Some(Self {
            up_slope,
            up: at_zero(1, up_slope),
            across_slope,
            across: at_zero(2, across_slope),
            inverse_radius: (inverse >> 16) as u32,
            slope_derivative: saturate_i32(slope_derivative),
            start_derivative: ray.start_derivative,
        })
    }

    /// Height over the beam at a distance `along` (mm, Q.16): mm in Q.16, below 2^31.
    pub(crate) fn up_at(&self, along: i32) -> i32 {
        let rise = round_shift(i64::from(self.up_slope) * i64::from(along), 24);
        round_shift(i64::from(self.up) + rise, 4) as i32
    }

    /// Offset across the beam at a distance `along` (mm, Q.16): mm in Q.16, below 2^31.
    pub(crate) fn across_at(&self, along: i32) -> i32 {
        (round_shift(self.across.into(), 4) + round_shift(i64::from(self.across_slope) * i64::from(along), 28)) as i32
    }

    /// Variance of the height over the beam at a distance, mm^2 in Q.32 below 2^43, for a spot variance in px^2 Q8.24.
    pub(crate) fn up_variance_at(&self, along: i32, spot_variance: u32) -> u64 {
        // mm per unit of s at Q.4: the slope's share grows with the distance, the viewpoint's does not
        let grown = (i64::from(self.slope_derivative) * i64::from(along)) >> 32;
        let lever = (grown as i32 + (self.start_derivative >> 4)).clamp(-(1 << 18), 1 << 18);
        let square = (i64::from(lever) * i64::from(lever)) as u64;
        (square * u64::from(spot_variance.min(MAX_SPOT_VARIANCE))) >> 18
    }

    /// Variance of the offset across the beam at a distance, mm^2 in Q.32 below 2^47, for a spot variance in px^2 Q8.24
    /// and the square of the distance from [`quarters_squared`].
    pub(crate) fn across_variance_at(&self, square: u32, spot_variance: u32) -> u64 {
        let azimuth = (u64::from(self.inverse_radius) * u64::from(self.inverse_radius))
            * u64::from(spot_variance.min(MAX_SPOT_VARIANCE));
        ((azimuth >> 24) * u64::from(square)) >> 16
    }
}

/// Square of a distance (mm, Q.16, below 2^29) at Q.2: enough for a variance, and keeps its products within 63 bits.
pub(crate) fn quarters_squared(along: i32) -> u32 {
    let distance = (along as u32) >> 14;
    distance * distance
}

/// Largest variance of a spot position that counts, px^2 in Q8.24: 1 px^2, as the detector gives.
const MAX_SPOT_VARIANCE: u32 = 1 << 24;

/// Largest distance that is represented, mm in Q.16: 8192 mm.
const MAX_ALONG: i64 = 8192 << 16;

/// The three single estimates of a laser spot's distance along its beam, mm. None: that estimate does not
/// exist, because of a missing ray or rays that do not meet in front of the cameras within 8 m.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Estimates {
    /// Camera 1 and laser, camera 2 and laser (eq. 5 and 6).
    pub mono: [Option<I18F14>; 2],
    /// Camera 1 and camera 2 (eq. 7).
    pub stereo: Option<I18F14>,
}

/// A distance along the beam that the formats hold: positive, and below 8192 mm.
pub(crate) fn in_reach(along: i64) -> Option<i32> {
    (along > 0 && along < MAX_ALONG).then_some(along as i32)
}

/// Where two straight lines in the plane of along and up meet.
pub(crate) struct Crossing {
    /// Distance along the beam, mm in Q.16.
    pub along: i32,
    /// 1 / (difference of the slopes), Q.28.
    pub inverse_slope: i64,
}

impl Crossing {
    /// Lines whose slopes differ by `slope` (Q4.28) and whose heights at along = 0 by `rise` (mm, Q12.20, the other way
    /// round), differences of two words each. None if they meet behind the instrument or beyond reach, or if the slopes
    /// differ by less than `least`.
    #[inline(never)]
    fn new(slope: i64, rise: i64, least: u32) -> Option<Self> {
        let magnitude = slope.unsigned_abs() as u32;
        // A meeting point beyond reach would overflow the product below
        if magnitude < least || rise.unsigned_abs() > u64::from(magnitude) << 5 {
            return None;
        }
        // 2^56 / slope: magnitude 2^24 to 2^34
        let inverse = div_round_unsigned(1 << 56, magnitude.into()) as i64;
        let inverse_slope = if slope < 0 { -inverse } else { inverse };
        // Q.20 times Q.28, kept at Q.16
        let along = in_reach(round_shift(rise * inverse_slope, 32))?;
        Some(Self { along, inverse_slope })
    }

    /// `length` over the difference of the slopes, in the format of `length`: below 2^29, or 2^28 if that difference may
    /// be below 1/32.
    pub fn lever(&self, length: i32) -> i64 {
        round_shift(i64::from(length) * self.inverse_slope, 28)
    }

    /// The distance as Q18.14, mm.
    pub fn estimate(&self) -> I18F14 {
        to_q14(self.along)
    }
}

/// Least slope of a ray that meets the beam, Q4.28: 1/64.
const LEAST_SLOPE: u32 = 1 << 22;

/// Least difference of the slopes of two rays that meet, Q4.28: 1/32.
const LEAST_SLOPE_DIFFERENCE: u32 = 1 << 23;

/// Camera and laser: where the ray's height over the beam is zero.
pub(crate) fn mono(ray: &BeamRay) -> Option<Crossing> {
    Crossing::new(ray.up_slope.into(), -i64::from(ray.up), LEAST_SLOPE)
}

/// Camera 1 and camera 2: where their heights over the beam are equal.
pub(crate) fn stereo(a: &BeamRay, b: &BeamRay) -> Option<Crossing> {
    let slope = i64::from(a.up_slope) - i64::from(b.up_slope);
    Crossing::new(slope, i64::from(b.up) - i64::from(a.up), LEAST_SLOPE_DIFFERENCE)
}

/// A length in Q.16 as Q18.14.
pub(crate) fn to_q14(length: i32) -> I18F14 {
    I18F14::from_bits(round_shift(length.into(), 2) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ray(up_slope: i32, up: i32) -> BeamRay {
        BeamRay {
            up_slope,
            up,
            across_slope: 0,
            across: 0,
            inverse_radius: 0,
            slope_derivative: 0,
            start_derivative: 0,
        }
    }

    /// Distance at which a height in Q.20 and a slope in Q.28 meet zero, mm.
    fn exact(slope: i64, rise: i64) -> f64 {
        rise as f64 / slope as f64 * 256.0
    }

    #[test]
    fn a_ray_meets_the_beam_from_a_slope_of_one_in_64_on_and_two_rays_each_other_from_one_in_32_on() {
        // 10 mm over the beam
        let falling = |slope: i32| ray(-slope, 10 << 20);
        assert!(mono(&falling(1 << 22)).is_some_and(|c| c.along == 640 << 16));
        assert!(mono(&falling((1 << 22) - 1)).is_none());
        assert!(stereo(&falling(1 << 23), &ray(0, 0)).is_some_and(|c| c.along == 320 << 16));
        assert!(stereo(&falling((1 << 23) - 1), &ray(0, 0)).is_none());
    }

    #[test]
    fn rays_that_meet_behind_the_instrument_or_beyond_8192_mm_do_not_cross() {
        assert!(mono(&ray(1 << 24, 10 << 20)).is_none());
        assert!(mono(&ray(-(1 << 23), 256 << 20)).is_none());
        assert!(mono(&ray(-(1 << 23), (256 << 20) - 1)).is_some());
    }

    proptest! {
        #[test]
        fn crossings_are_within_a_thousandth_of_a_millimetre(
            slopes: [i32; 2],
            ups in prop::array::uniform2(-(600_i32 << 20)..600 << 20),
        ) {
            let [a, b] = slopes.map(|slope| slope >> 2);
            let [a, b] = [ray(a, ups[0]), ray(b, ups[1])];
            let difference = i64::from(a.up_slope) - i64::from(b.up_slope);
            let crossings = [
                (mono(&a), exact(a.up_slope.into(), -i64::from(a.up))),
                (stereo(&a, &b), exact(difference, i64::from(b.up) - i64::from(a.up))),
            ];
            for (crossing, exact) in crossings {
                if let Some(crossing) = crossing {
                    let error = f64::from(crossing.along) / 65536.0 - exact;
                    prop_assert!(error.abs() < 1e-3, "{} mm at {} mm", error, exact);
                }
            }
        }
    }
}
