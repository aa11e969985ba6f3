//! Pixel to ray (eq. 4 of the paper, with affine and decentring terms and the axial offset).

use fixed::types::I18F14;
use heapless::Vec;
use karst_math::{
    horner_with_derivative, horner_with_derivative_short, hypot, hypot_short, round_product, round_shift,
    round_transform, round_transform_short, saturate_i32,
};

/// Most coefficients of a camera polynomial.
pub const MAX_COEFFICIENTS: usize = 8;

/// One camera's model in water, in the camera's own frame: x along image rows, y along columns, z the viewing
/// direction at the image centre.
///
/// With s = rho / 512 px, the ray of a pixel is (u, v, f(s)) px and starts at (0, 0, z_v(s)) mm. A compact
/// (single-viewpoint) model has an empty `axial`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CameraCalibration {
    /// Image centre (column, row), px.
    pub centre: [I18F14; 2],
    /// Inverse of the affine matrix, row by row, Q2.30.
    pub inverse_affine: [i32; 4],
    /// Decentring terms p1, p2 in the normalised radius, Q2.30, at most 1 in magnitude.
    pub decentring: [i32; 2],
    /// f / 512 px, constant term first, Q6.26.
    pub polynomial: Vec<i32, MAX_COEFFICIENTS>,
    /// z_v / 4096 mm, constant term first, Q6.26.
    pub axial: Vec<i32, MAX_COEFFICIENTS>,
}

/// The ray of a pixel in the camera's frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CameraRay {
    /// Direction (u, v, f), px in Q12.20, not normalised.
    pub direction: [i32; 3],
    /// Start on the camera's axis, mm in Q18.14.
    pub start: i32,
    /// d(f / 512 px) / ds, Q12.20.
    pub direction_derivative: i32,
    /// d(start) / ds, mm in Q24.8.
    pub start_derivative: i32,
}

impl CameraCalibration {
    /// The ray through an image position.
    ///
    /// Valid up to 2048 px from the image centre; beyond, values saturate. Rounding: u and v are rounded once to 2^-20
    /// px, rho is the correctly rounded hypotenuse of those, f and z_v are Horner values.
    #[inline]
    pub fn ray(&self, position: &[I18F14; 2]) -> CameraRay {
        // Always some
        self.ray_by::<General>(position).unwrap_or_default()
    }

    /// [`Self::ray`] by kernels that may give up.
    #[inline(always)]
    pub(crate) fn ray_by<K: Kernels>(&self, position: &[I18F14; 2]) -> Option<CameraRay> {
        let offset = [0, 1].map(|i| position[i].saturating_sub(self.centre[i]).to_bits());
        // Q.14 times Q.30, kept at Q.20
        let [u, v] = self.decentre::<K>(K::round_transform(self.inverse_affine, offset, 24)?)?;
        // rho in px Q.20 is s in Q.29
        let s = K::hypot(u, v)?.min(i32::MAX as u32) as i32;
        // Q6.26 in units of 512 px is Q.17 in px
        let (f, direction_derivative) = K::horner_with_derivative(&self.polynomial, s)?;
        let f = shl_saturated(f);
        // Q6.26 in units of 4096 mm is Q.14 in mm, and Q12.20 is Q.8
        let (start, start_derivative) = K::horner_with_derivative(&self.axial, s)?;
        Some(CameraRay { direction: [u, v, f], start, direction_derivative, start_derivative })
    }

    /// (u, v) + 512 px * decentring of (x, y) = (u, v) / 512 px:
    /// dx = 2 p1 x y + p2 (r^2 + 2 x^2), dy = p1 (r^2 + 2 y^2) + 2 p2 x y.
    #[inline(always)]
    fn decentre<K: Kernels>(&self, [u, v]: [i32; 2]) -> Option<[i32; 2]> {
        if self.decentring == [0, 0] {
            return Some([u, v]);
        }
        // x and y in Q.29 are u and v in Q.20; their products, at most 16, are kept at Q.26
        let product = |a: i32, b: i32| round_product(a, b, 32) as i32;
        let (xx, yy, xy) = (product(u, u) as u32, product(v, v) as u32, product(u, v));
        K::decentre([u, v], self.decentring, [xx, yy], xy)
    }
}

/// `value` 2^3, saturated.
#[inline(always)]
fn shl_saturated(value: i32) -> i32 {
    let shifted = value << 3;
    if shifted >> 3 == value { shifted } else { saturate_i32(i64::from(value) << 3) }
}

/// The kernels of a ray. Those that are short on a CPU of 32 bits give up on operands that no ordinary ray has.
pub(crate) trait Kernels {
    fn round_transform(matrix: [i32; 4], vector: [i32; 2], bits: u32) -> Option<[i32; 2]>;
    /// (u, v) in Q.20 px, moved by decentring terms in Q.30; the squares and the product of x and y in Q.26.
    fn decentre(position: [i32; 2], terms: [i32; 2], squares: [u32; 2], product: i32) -> Option<[i32; 2]>;
    fn hypot(x: i32, y: i32) -> Option<u32>;
    fn horner_with_derivative(coefficients: &[i32], s: i32) -> Option<(i32, i32)>;
}

/// Kernels for all operands.
pub(crate) struct General;

impl Kernels for General {
    fn round_transform(matrix: [i32; 4], vector: [i32; 2], bits: u32) -> Option<[i32; 2]> {
        Some(round_transform(matrix, vector, bits))
    }

    fn decentre([u, v]: [i32; 2], terms: [i32; 2], squares: [u32; 2], product: i32) -> Option<[i32; 2]> {
        let ([p1, p2], [xx, yy], xy) = (terms.map(i64::from), squares.map(i64::from), i64::from(product));
        let square = xx + yy;
        // Q.26 times Q.30 in units of 512 px is Q.47 in px
        let du = round_shift(2 * (p1 * xy + p2 * xx) + p2 * square, 27);
        let dv = round_shift(2 * (p1 * yy + p2 * xy) + p1 * square, 27);
        Some([saturate_i32(i64::from(u) + du), saturate_i32(i64::from(v) + dv)])
    }

    fn hypot(x: i32, y: i32) -> Option<u32> {
        Some(hypot(x, y))
    }

    fn horner_with_derivative(coefficients: &[i32], s: i32) -> Option<(i32, i32)> {
        Some(horner_with_derivative(coefficients, s))
    }
}

/// Kernels for the operands of ordinary rays.
pub(crate) struct Short;

impl Kernels for Short {
    #[inline(always)]
    fn round_transform(matrix: [i32; 4], vector: [i32; 2], bits: u32) -> Option<[i32; 2]> {
        round_transform_short(matrix, vector, bits)
    }

    /// For terms up to 1/64 in magnitude and x^2 + y^2 below 16: the sums of the squares are below 2^32, and the moves at most
    /// 2^29.
    #[inline(always)]
    fn decentre([u, v]: [i32; 2], [p1, p2]: [i32; 2], [xx, yy]: [u32; 2], xy: i32) -> Option<[i32; 2]> {
        let square = xx + yy;
        let is_small = (p1.wrapping_add(1 << 24) | p2.wrapping_add(1 << 24)) as u32 >> 25 == 0;
        if !is_small || square >> 30 != 0 {
            return None;
        }
        // With the terms in Q.35 the upper word is Q.20 px
        let [p1, p2] = [p1 << 5, p2 << 5];
        let moved = |u: i32, (p, xy): (i32, i32), (q, xx): (i32, u32)| {
            let sum = i64::from(p) * i64::from(xy) + i64::from(q) * i64::from(xx);
            u.checked_add((sum >> 32) as i32 + (sum as u32 >> 31) as i32)
        };
        Some([moved(u, (p1, 2 * xy), (p2, square + 2 * xx))?, moved(v, (p2, 2 * xy), (p1, square + 2 * yy))?])
    }

    #[inline(always)]
    fn hypot(x: i32, y: i32) -> Option<u32> {
        hypot_short(x, y)
    }

    #[inline(always)]
    fn horner_with_derivative(coefficients: &[i32], s: i32) -> Option<(i32, i32)> {
        horner_with_derivative_short(coefficients, s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A camera like those of the default rig.
    fn camera() -> CameraCalibration {
        let coefficients = |values: &[i32]| Vec::from_slice(values).unwrap_or_default();
        CameraCalibration {
            centre: [I18F14::from_num(513.2), I18F14::from_num(382.1)],
            inverse_affine: [1_073_098_062, -321_929, -321_929, 1_073_741_921],
            decentring: [-266_392, -138_645],
            polynomial: coefficients(&[
                -2_355_693,
                126_823_467,
                -436_454_741,
                704_266_596,
                -749_911_806,
                461_002_878,
                -123_097_014,
            ]),
            axial: coefficients(&[
                5_417_989,
                -54_506_648,
                258_328_355,
                -712_804_970,
                1_206_491_599,
                -1_238_190_861,
                708_247_692,
                -173_372_620,
            ]),
        }
    }

    #[test]
    fn short_kernels_take_every_ray_of_an_ordinary_camera_from_65_to_505_px() {
        let camera = camera();
        for row in (0..768).step_by(5) {
            for column in (0..1024).step_by(5) {
                let position = [I18F14::from_num(column), I18F14::from_num(row)];
                let radius = (f64::from(column) - 513.2).hypot(f64::from(row) - 382.1);
                let short = camera.ray_by::<Short>(&position);
                assert!(short.is_some() || !(65.0..505.0).contains(&radius), "{position:?}");
                assert!(short.is_none_or(|ray| ray == camera.ray(&position)), "{position:?}");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn short_kernels_give_what_the_general_ones_do(
            (matrix, terms) in (any::<[i32; 4]>(), prop::array::uniform2(-(1_i32 << 30)..=1 << 30)),
            offset in any::<[i32; 2]>(),
            shorter in prop::array::uniform3(0..32_u32),
        ) {
            let calibration = CameraCalibration {
                inverse_affine: matrix.map(|m| m >> shorter[0].min(4)),
                decentring: terms.map(|p| p >> shorter[1]),
                ..camera()
            };
            let position = [0, 1].map(|i| {
                I18F14::from_bits((offset[i] >> shorter[2]).saturating_add(calibration.centre[i].to_bits()))
            });
            if let Some(ray) = calibration.ray_by::<Short>(&position) {
                prop_assert_eq!(ray, calibration.ray(&position));
            }
        }

        #[test]
        fn short_decentring_is_the_general_one_or_none(
            position in any::<[i32; 2]>(),
            terms in prop::array::uniform2(-(1_i32 << 30)..=1 << 30),
            shorter in prop::array::uniform2(0..12_u32),
        ) {
            let moved = |[u, v]: [i32; 2]| {
                let calibration = CameraCalibration { decentring: terms.map(|p| p >> shorter[1]), ..camera() };
                (calibration.decentre::<Short>([u, v]), calibration.decentre::<General>([u, v]))
            };
            for ends in [position.map(|x| x >> shorter[0]), [i32::MIN, position[1]], [i32::MIN; 2], [i32::MIN, -i32::MAX], [i32::MAX, i32::MIN]] {
                let (short, general) = moved(ends);
                prop_assert!(short.is_none() || short == general, "{:?} {:?}", short, general);
            }
        }
    }
}
