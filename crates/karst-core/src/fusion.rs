//! A ray in the frame of a laser beam, and the three single estimates of the paper.
//!
//! In the frame of a beam (along, up, across) the ray of a camera is two straight lines over the distance `along`:
//! up = `up` + `up_slope` along, across = `across` + `across_slope` along. The beam itself is up = across = 0. All three
//! estimates of the paper and their weighted fusion are then scalar arithmetic, for any misalignment of the rig.

use fixed::types::I18F14;
use karst_math::{
    high_product, high_product_of_signed, high_product_signed, normalise, reciprocal, saturate_bits,
    sqrt_floor_normalised,
};

use crate::calibration::LaserFrame;
use crate::camera::{CameraCalibration, CameraRay, Short};

/// A camera's ray in the frame of a laser beam.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BeamRay {
    /// Slope d up / d along, Q4.28.
    pub up_slope: i32,
    /// Height over the beam at along = 0, mm in Q.16, up to 2048 mm.
    pub up: i32,
    /// Slope d across / d along, Q4.28.
    pub across_slope: i32,
    /// Offset across the beam at along = 0, mm in Q.16, up to 2048 mm.
    pub across: i32,
    /// 1 / rho in 1/px, Q.22: at most 2^16.
    pub(crate) inverse_radius: u32,
    /// d(slope f / rho) / ds, Q.11: at most 32 in magnitude, which is enough for a variance.
    pub(crate) slope_derivative: i32,
    /// d(start) / ds, mm in Q24.8.
    pub(crate) start_derivative: i32,
}

/// Smallest component of a ray along the beam, px in Q.18: 64 px. Spots nearer to the image centre are inside the
/// instrument.
const LEAST_ALONG: i32 = 64 << 18;

/// Bits of the largest derivative of a slope that counts, Q.11: 32.
const SLOPE_DERIVATIVE_BITS: u32 = 17;

/// Bits of the largest start of a ray on its camera's axis that counts, mm in Q18.14: 8192 mm.
const START_BITS: u32 = 28;

/// Bits of the largest height or offset at along = 0 that counts, mm in Q.16: 2048 mm.
const HEIGHT_BITS: u32 = 28;

impl BeamRay {
    /// The ray of an image position in the frame of a beam: [`Self::new`] of [`CameraCalibration::ray`].
    #[inline(never)]
    pub fn of_position(camera: &CameraCalibration, frame: &LaserFrame, position: &[I18F14; 2]) -> Option<Self> {
        if cfg!(target_pointer_width = "32")
            && let Some(ray) = camera.ray_by::<Short>(position)
        {
            return Self::new(&ray, frame);
        }
        Self::of_any_position(camera, frame, position)
    }

    /// [`Self::of_position`] by kernels that never give up. A function of its own, as a call in the middle would cost the short
    /// way most of its registers.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn of_any_position(camera: &CameraCalibration, frame: &LaserFrame, position: &[I18F14; 2]) -> Option<Self> {
        Self::new(&camera.ray(position), frame)
    }

    /// Turns a camera's ray into the frame of a beam. None when it does not point outwards along the beam, or is
    /// steeper than 2 : 1.
    #[inline(always)]
    pub fn new(ray: &CameraRay, frame: &LaserFrame) -> Option<Self> {
        let d = ray.direction;
        // Q.20 times Q.30, each product at Q.18: below 2^29
        let [along, up, across] = frame.rotation.map(|r| {
            high_product_of_signed(r[0], d[0]) + high_product_of_signed(r[1], d[1]) + high_product_of_signed(r[2], d[2])
        });
        // A rotation makes the length of three components below 2^29 at most 2^29 sqrt(3)
        // Of a length from -2 along to 2 along the sum with 2 along is at most 4 along
        let is_steep = |length: i32| (length as u32).wrapping_add(2 * along as u32) > 4 * along as u32;
        if !(LEAST_ALONG..1 << 30).contains(&along) || is_steep(up) || is_steep(across) {
            return None;
        }
        // Viewpoint plus the axial offset along the camera's z: Q.18 times Q.30, at Q.16
        let offset = saturate_bits(ray.start, START_BITS) << 4;
        let start: [i32; 3] =
            core::array::from_fn(|i| (frame.viewpoint[i] >> 4) + high_product_of_signed(frame.rotation[i][2], offset));
        // 2^63 over `along` shifted to the left by 2 to 7 bits. Neither up nor across are above twice along
        let (normalised, shift) = normalise(along as u32);
        let inverse = reciprocal(normalised);
        let slope = |length: i32| high_product_signed(length << (shift - 2), inverse) >> 1;
        let (up_slope, across_slope) = (slope(up), slope(across));
        // With p = f / 512 px, the slope is p / s: its derivative is (p' - p / s) / s. For this purpose rho is `along`
        let over = |value: i32| high_product_signed(value, inverse) >> (13 - shift);
        let slope_derivative = over(ray.direction_derivative.saturating_sub(over(d[2])));
        // Q.30 times Q.17, at Q.15
        let at_zero = |i: usize, slope: i32| {
            saturate_bits(start[i] - 2 * high_product_of_signed(slope << 2, start[0] << 1), HEIGHT_BITS)
        };
        Some(Self {
            up_slope,
            up: at_zero(1, up_slope),
            across_slope,
            across: at_zero(2, across_slope),
            inverse_radius: inverse >> (23 - shift),
            slope_derivative: saturate_bits(slope_derivative, SLOPE_DERIVATIVE_BITS),
            start_derivative: ray.start_derivative,
        })
    }

    /// Height over the beam at a distance `along` (mm, Q.16, below 2^29): mm in Q.16, below 2^31.
    pub(crate) fn up_at(&self, along: i32) -> i32 {
        at(self.up, self.up_slope, along)
    }

    /// Offset across the beam at a distance `along` (mm, Q.16, below 2^29): mm in Q.16, below 2^31.
    pub(crate) fn across_at(&self, along: i32) -> i32 {
        at(self.across, self.across_slope, along)
    }

    /// Variance of the height over the beam at a distance (mm, Q.2), mm^2 in Q.20, for a spot variance in px^2 Q8.24.
    pub(crate) fn up_variance_at(&self, quarters: u32, spot_variance: u32) -> u32 {
        // The slope's share grows with the distance, the viewpoint's does not. s is px / 512
        let grown = (self.slope_derivative * quarters as i32) >> 12;
        variance((grown + (self.start_derivative >> 7)).unsigned_abs(), spot_variance)
    }

    /// Variance of the offset across the beam at a distance (mm, Q.2), mm^2 in Q.20, for a spot variance in px^2 Q8.24.
    pub(crate) fn across_variance_at(&self, quarters: u32, spot_variance: u32) -> u32 {
        variance((self.inverse_radius * quarters) >> 14, spot_variance)
    }
}

/// A height or offset at a distance `along` (mm, Q.16, below 2^29) from that at zero (mm, Q.16) and a slope (Q4.28, at
/// most 2): mm in Q.16, rounded down to its last bit but one.
fn at(offset: i32, slope: i32, along: i32) -> i32 {
    offset + 2 * high_product_signed(slope, (along as u32) << 3)
}

/// Variance of a length, mm^2 in Q.20, that changes by `lever` (mm per px, Q.10, at most 32 mm per px count) with the
/// position of a spot of some variance (px^2, Q8.24). At most 256 mm^2 count.
fn variance(lever: u32, spot_variance: u32) -> u32 {
    let lever = lever.min((1 << 15) - 1);
    high_product(lever * lever, spot_variance.min(MAX_SPOT_VARIANCE) << 8).min(MAX_RAY_VARIANCE)
}

/// A distance (mm, Q.16, below 2^29) at Q.2: enough for a variance, and below 2^15.
pub(crate) fn quarters(along: i32) -> u32 {
    along as u32 >> 14
}

/// Largest variance of a spot position that counts, px^2 in Q8.24: 1 px^2, as the detector gives.
const MAX_SPOT_VARIANCE: u32 = (1 << 24) - 1;

/// Largest variance of a ray's height or offset that counts, mm^2 in Q.20: 256 mm^2.
const MAX_RAY_VARIANCE: u32 = (1 << 28) - 1;

/// Largest distance that is represented, mm in Q.16: 8192 mm.
const MAX_ALONG: i32 = 8192 << 16;

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
pub(crate) fn in_reach(along: i32) -> Option<i32> {
    (along > 0 && along < MAX_ALONG).then_some(along)
}

/// Where two straight lines in the plane of along and up meet.
pub(crate) struct Crossing {
    /// Distance along the beam, mm in Q.16.
    pub along: i32,
    /// Sign of the difference of the slopes: 0 or -1.
    pub sign: i32,
    /// [`reciprocal`] of the magnitude of that difference, normalised.
    inverse: u32,
    /// By how many bits that was shifted: 1 to 9.
    shift: u32,
}

impl Crossing {
    /// Lines whose slopes differ by `slope` (Q4.28, below 2^31) and whose heights at along = 0 by `rise` (mm, Q.16, the
    /// other way round). None if they meet behind the instrument or beyond reach, or if the slopes differ by less than
    /// `least`.
    #[inline(always)]
    fn new(slope: i32, rise: i32, least: u32) -> Option<Self> {
        let sign = slope >> 31;
        let (magnitude, rise) = (with_sign(slope, sign) as u32, with_sign(rise, sign));
        // Beyond reach the height is more than 8192 mm times the slope, and would overflow below
        if magnitude < least || rise <= 0 || rise as u32 > magnitude << 1 {
            return None;
        }
        let (normalised, shift) = normalise(magnitude);
        let crossing = Self { along: 0, sign, inverse: reciprocal(normalised), shift };
        in_reach(crossing.over_slope(rise as u32) as i32).map(|along| Self { along, ..crossing })
    }

    /// `length` over the magnitude of the difference of the slopes, in the format of `length`, which is at most twice
    /// that difference in Q.28: below 2^30.
    fn over_slope(&self, length: u32) -> u32 {
        high_product(length << (self.shift - 1), self.inverse) >> 2
    }

    /// [`Self::over_slope`] of any length; None from 2^30 on.
    pub fn lever(&self, length: u32) -> Option<u32> {
        (length >> (33 - self.shift) == 0).then(|| self.over_slope(length))
    }

    /// Standard deviation over the magnitude of the difference of the slopes, mm in Q.16, for a variance in mm^2 Q.20.
    pub fn sigma(&self, variance: u32) -> i32 {
        if variance == 0 {
            return 0;
        }
        let (normalised, zeros) = normalise(variance);
        // An even shift leaves the lowest bit of an odd number of zeros clear
        let root = sqrt_floor_normalised(normalised >> (zeros & 1));
        (high_product(root << 16, self.inverse) >> (13 + zeros / 2 - self.shift)) as i32
    }

    /// Share of a slope (Q4.28) in the difference of the slopes, Q.14.
    pub fn share(&self, slope: i32) -> i32 {
        high_product_signed(with_sign(slope, self.sign), self.inverse) >> (17 - self.shift)
    }

    /// The distance as Q18.14, mm.
    pub fn estimate(&self) -> I18F14 {
        to_q14(self.along)
    }
}

/// `value`, or with the other sign where `sign` is -1, not 0.
pub(crate) fn with_sign(value: i32, sign: i32) -> i32 {
    (value ^ sign) - sign
}

/// Least slope of a ray that meets the beam, Q4.28: 1/64.
const LEAST_SLOPE: u32 = 1 << 22;

/// Least difference of the slopes of two rays that meet, Q4.28: 1/32.
const LEAST_SLOPE_DIFFERENCE: u32 = 1 << 23;

/// Camera and laser: where the ray's height over the beam is zero.
pub(crate) fn mono(ray: &BeamRay) -> Option<Crossing> {
    Crossing::new(ray.up_slope, -ray.up, LEAST_SLOPE)
}

/// Camera 1 and camera 2: where their heights over the beam are equal.
pub(crate) fn stereo([a, b]: [&BeamRay; 2]) -> Option<Crossing> {
    Crossing::new(a.up_slope - b.up_slope, b.up - a.up, LEAST_SLOPE_DIFFERENCE)
}

/// A length in Q.16, below 2^30, as Q18.14.
pub(crate) fn to_q14(length: i32) -> I18F14 {
    // The half fits
    I18F14::from_bits((length + 2) >> 2)
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

    /// Distance at which a height in Q.16 and a slope in Q.28 meet zero, mm.
    fn exact(slope: i64, rise: i64) -> f64 {
        rise as f64 / slope as f64 * 4096.0
    }

    #[test]
    fn a_ray_meets_the_beam_from_a_slope_of_one_in_64_on_and_two_rays_each_other_from_one_in_32_on() {
        // 10 mm over the beam
        let falling = |slope: i32| ray(-slope, 10 << 16);
        assert!(mono(&falling(1 << 22)).is_some_and(|c| (640 << 16) - c.along <= 1));
        assert!(mono(&falling((1 << 22) - 1)).is_none());
        assert!(stereo([&falling(1 << 23), &ray(0, 0)]).is_some_and(|c| (320 << 16) - c.along <= 1));
        assert!(stereo([&falling((1 << 23) - 1), &ray(0, 0)]).is_none());
    }

    #[test]
    fn rays_that_meet_behind_the_instrument_or_beyond_8192_mm_do_not_cross() {
        assert!(mono(&ray(1 << 24, 10 << 16)).is_none());
        assert!(mono(&ray(-(1 << 23), (256 << 16) + 1)).is_none());
        // A last bit of the height less, mm in Q.16
        assert!(mono(&ray(-(1 << 23), (256 << 16) - 1)).is_some());
    }

    #[test]
    fn a_ray_may_be_as_steep_as_2_to_1_and_no_steeper_up_or_across_either_way() {
        let frame = LaserFrame { rotation: [[1 << 30, 0, 0], [0, 1 << 30, 0], [0, 0, 1 << 30]], viewpoint: [0; 3] };
        let is_ray = |along: i32, up: i32, across: i32| {
            let direction = [along, up, across].map(|component| component << 2);
            let ray = CameraRay { direction, ..CameraRay::default() };
            BeamRay::new(&ray, &frame).is_some()
        };
        for along in [64_i32 << 18, 100 << 18, 1023 << 18] {
            for most in [2 * along, -2 * along] {
                let more = most + most.signum();
                assert!(is_ray(along, most, 0) && is_ray(along, 0, most), "{along}");
                assert!(!is_ray(along, more, 0) && !is_ray(along, 0, more), "{along}");
            }
        }
        assert!(!is_ray((64 << 18) - 1, 0, 0) && !is_ray(-(64 << 18), 0, 0));
    }

    proptest! {
        #[test]
        fn variances_are_the_squared_lever_times_that_of_the_spot_to_a_thousandth(
            lever in 200..1_u32 << 15,
            spot_variance in 1000..1_u32 << 24,
        ) {
            let millimetres = f64::from(lever) / 1024.0;
            let exact = millimetres * millimetres * f64::from(spot_variance) / f64::from(1 << 24) * f64::from(1 << 20);
            let variance = f64::from(variance(lever, spot_variance));
            let most = f64::from(MAX_RAY_VARIANCE);
            prop_assert!(variance <= exact && variance >= (exact * 0.999 - 1.0).min(most), "{} for {}", variance, exact);
        }

        #[test]
        fn crossings_are_within_a_thousandth_of_a_millimetre(
            slopes: [i32; 2],
            ups in prop::array::uniform2(-(600_i32 << 16)..600 << 16),
        ) {
            let [a, b] = slopes.map(|slope| slope >> 2);
            let [a, b] = [ray(a, ups[0]), ray(b, ups[1])];
            let difference = i64::from(a.up_slope) - i64::from(b.up_slope);
            let crossings = [
                (mono(&a), exact(a.up_slope.into(), -i64::from(a.up))),
                (stereo([&a, &b]), exact(difference, i64::from(b.up) - i64::from(a.up))),
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
