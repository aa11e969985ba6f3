//! A ray in the frame of a laser beam, and the three single estimates of the paper.
//!
//! In the frame of a beam (along, up, across) the ray of a camera is two straight lines over the distance `along`:
//! up = `up` + `up_slope` along, across = `across` + `across_slope` along. The beam itself is up = across = 0. All three
//! estimates of the paper and their weighted fusion are then scalar arithmetic, for any misalignment of the rig.

use fixed::types::I18F14;
use karst_math::{div_round, round_shift, saturate_i32};

use crate::calibration::LaserFrame;
use crate::camera::CameraRay;

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
    /// 1 / rho in 1/px, Q.22.
    pub(crate) inverse_radius: i64,
    /// d(slope f / rho) / ds, Q12.20.
    pub(crate) slope_derivative: i32,
    /// d(start) / ds, mm in Q24.8.
    pub(crate) start_derivative: i32,
}

/// Smallest component of a ray along the beam, px in Q12.20: 64 px. Spots nearer to the image centre are inside the
/// instrument.
const LEAST_ALONG: i32 = 64 << 20;

impl BeamRay {
    /// Turns a camera's ray into the frame of a beam. None when it does not point outwards along the beam, or is
    /// steeper than 2 : 1.
    pub fn new(ray: &CameraRay, frame: &LaserFrame) -> Option<Self> {
        let d = ray.direction.map(i64::from);
        let [along, up, across] = frame.rotation.map(|row| {
            let r = row.map(i64::from);
            round_shift(r[0] * d[0] + r[1] * d[1] + r[2] * d[2], 30)
        });
        if along < i64::from(LEAST_ALONG) || up.abs() > 2 * along || across.abs() > 2 * along {
            return None;
        }
        // Viewpoint plus the axial offset along the camera's z: Q.14 times Q.30, kept at Q.20
        let start: [i64; 3] = core::array::from_fn(|i| {
            let offset = i64::from(frame.rotation[i][2]) * i64::from(ray.start);
            saturate_i32(i64::from(frame.viewpoint[i]) + round_shift(offset, 24)).into()
        });
        // 2^58 / along: 2^26 to 2^32 for 64 px and more. Neither up, across nor f are above 3 times along, so that
        // their products with it are below 2^60.
        let inverse = div_round(1 << 58, along);
        let up_slope = round_shift(up * inverse, 30);
        let across_slope = round_shift(across * inverse, 30);
        // With p = f / 512 px, the slope is p / s: its derivative is (p' - p / s) / s. For this purpose rho is `along`,
        // so 1 / s is inverse / 2^29.
        let slope = round_shift(d[2] * inverse, 38);
        let slope_derivative = (i64::from(ray.direction_derivative) - slope).saturating_mul(inverse) >> 29;
        Some(Self {
            up_slope: saturate_i32(up_slope),
            up: saturate_i32(start[1] - round_shift(start[0] * up_slope, 28)),
            across_slope: saturate_i32(across_slope),
            across: saturate_i32(start[2] - round_shift(start[0] * across_slope, 28)),
            inverse_radius: inverse >> 16,
            slope_derivative: saturate_i32(slope_derivative),
            start_derivative: ray.start_derivative,
        })
    }

    /// Height over the beam at a distance `along` (mm, Q.16): mm in Q.20.
    pub(crate) fn up_at(&self, along: i64) -> i64 {
        i64::from(self.up) + round_shift(i64::from(self.up_slope) * along, 24)
    }

    /// Offset across the beam at a distance `along` (mm, Q.16): mm in Q.16.
    pub(crate) fn across_at(&self, along: i64) -> i64 {
        round_shift(i64::from(self.across), 4) + round_shift(i64::from(self.across_slope) * along, 28)
    }

    /// Variance of the height over the beam at a distance, mm^2 in Q.32, for a spot variance in px^2 Q8.24.
    pub(crate) fn up_variance_at(&self, along: i64, spot_variance: u32) -> i64 {
        // mm per unit of s at Q.4: the slope's share grows with the distance, the viewpoint's does not
        let lever = ((i64::from(self.slope_derivative) * along) >> 32) + (i64::from(self.start_derivative) >> 4);
        let lever = lever.clamp(-(1 << 18), 1 << 18);
        (lever * lever * i64::from(spot_variance.min(MAX_SPOT_VARIANCE))) >> 18
    }

    /// Variance of the offset across the beam at a distance, mm^2 in Q.32, for a spot variance in px^2 Q8.24.
    pub(crate) fn across_variance_at(&self, along: i64, spot_variance: u32) -> i64 {
        let azimuth =
            (i64::from(spot_variance.min(MAX_SPOT_VARIANCE)) * (self.inverse_radius * self.inverse_radius)) >> 24;
        let distance = along >> 14;
        (azimuth * (distance * distance)) >> 16
    }
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
pub(crate) fn in_reach(along: i64) -> Option<i64> {
    (along > 0 && along < MAX_ALONG).then_some(along)
}

/// Where two straight lines in the plane of along and up meet.
pub(crate) struct Crossing {
    /// Distance along the beam, mm in Q.16.
    pub along: i64,
    /// 1 / (difference of the slopes), Q.28.
    pub inverse_slope: i64,
}

impl Crossing {
    /// Lines whose slopes differ by `slope` (Q4.28) and whose heights at along = 0 by `rise` (mm, Q12.20, the other way
    /// round). None if they meet behind the instrument or beyond reach, or if the slopes differ by less than `least`.
    fn new(slope: i64, rise: i64, least: i64) -> Option<Self> {
        // A meeting point beyond reach would overflow the product below
        if slope.abs() < least || rise.abs() > slope.abs() << 5 {
            return None;
        }
        // 2^56 / slope: magnitude 2^26 to 2^34
        let inverse_slope = div_round(1 << 56, slope);
        // Q.20 times Q.28, kept at Q.16
        let along = in_reach(round_shift(rise * inverse_slope, 32))?;
        Some(Self { along, inverse_slope })
    }

    /// `length` over the difference of the slopes, in the format of `length`: below 2^29, or 2^28 if that difference may
    /// be below 1/32.
    pub fn lever(&self, length: i64) -> i64 {
        round_shift(length * self.inverse_slope, 28)
    }
}

/// Least slope of a ray that meets the beam, Q4.28: 1/64.
const LEAST_SLOPE: i64 = 1 << 22;

/// Least difference of the slopes of two rays that meet, Q4.28: 1/32.
const LEAST_SLOPE_DIFFERENCE: i64 = 1 << 23;

/// Camera and laser: where the ray's height over the beam is zero.
pub(crate) fn mono(ray: &BeamRay) -> Option<Crossing> {
    Crossing::new(ray.up_slope.into(), -i64::from(ray.up), LEAST_SLOPE)
}

/// Camera 1 and camera 2: where their heights over the beam are equal.
pub(crate) fn stereo(rays: &[BeamRay; 2]) -> Option<Crossing> {
    let [a, b] = rays;
    let slope = i64::from(a.up_slope) - i64::from(b.up_slope);
    Crossing::new(slope, i64::from(b.up) - i64::from(a.up), LEAST_SLOPE_DIFFERENCE)
}

/// A length in Q.16 as Q18.14.
pub(crate) fn to_q14(length: i64) -> I18F14 {
    I18F14::from_bits(saturate_i32(round_shift(length, 2)))
}

impl Estimates {
    /// The estimates that two, one or no rays allow.
    pub fn new(rays: &[Option<BeamRay>; 2]) -> Self {
        let both = if let [Some(a), Some(b)] = *rays { Some([a, b]) } else { None };
        Self {
            mono: rays.map(|ray| ray.as_ref().and_then(mono).map(|c| to_q14(c.along))),
            stereo: both.as_ref().and_then(stereo).map(|c| to_q14(c.along)),
        }
    }
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
        assert!(stereo(&[falling(1 << 23), ray(0, 0)]).is_some_and(|c| c.along == 320 << 16));
        assert!(stereo(&[falling((1 << 23) - 1), ray(0, 0)]).is_none());
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
                (stereo(&[a, b]), exact(difference, i64::from(b.up) - i64::from(a.up))),
            ];
            for (crossing, exact) in crossings {
                if let Some(crossing) = crossing {
                    let error = crossing.along as f64 / 65536.0 - exact;
                    prop_assert!(error.abs() < 1e-3, "{} mm at {} mm", error, exact);
                }
            }
        }
    }
}
