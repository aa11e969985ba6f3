//! Pixel to ray (eq. 4 of the paper, with affine and decentring terms and the axial offset).

use fixed::types::I18F14;
use heapless::Vec;
use karst_math::{horner_with_derivative, hypot, round_product, round_shift, saturate_i32};

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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
    pub fn ray(&self, position: [I18F14; 2]) -> CameraRay {
        let [dx, dy] = [0, 1].map(|i| i64::from(position[i].saturating_sub(self.centre[i]).to_bits()));
        let a = self.inverse_affine.map(i64::from);
        // Q.14 times Q.30, kept at Q.20
        let u = saturate_i32(round_shift((a[0] * dx).saturating_add(a[1] * dy), 24));
        let v = saturate_i32(round_shift((a[2] * dx).saturating_add(a[3] * dy), 24));
        let [u, v] = self.decentre(u, v);
        // rho in px Q.20 is s in Q.29
        let s = saturate_i32(hypot(u, v).into());
        // Q6.26 in units of 512 px is Q.17 in px
        let (f, direction_derivative) = horner_with_derivative(&self.polynomial, s);
        let f = saturate_i32(i64::from(f) << 3);
        // Q6.26 in units of 4096 mm is Q.14 in mm, and Q12.20 is Q.8
        let (start, start_derivative) = horner_with_derivative(&self.axial, s);
        CameraRay { direction: [u, v, f], start, direction_derivative, start_derivative }
    }

    /// (u, v) + 512 px * decentring of (x, y) = (u, v) / 512 px:
    /// dx = 2 p1 x y + p2 (r^2 + 2 x^2), dy = p1 (r^2 + 2 y^2) + 2 p2 x y.
    fn decentre(&self, u: i32, v: i32) -> [i32; 2] {
        if self.decentring == [0, 0] {
            return [u, v];
        }
        let [p1, p2] = self.decentring.map(i64::from);
        // x and y in Q.29 are u and v in Q.20; their products, at most 16, are kept at Q.26
        let product = |a: i32, b: i32| round_product(a, b, 32) as i32;
        let (xx, yy, xy) = (product(u, u), product(v, v), product(u, v));
        let square = i64::from(xx as u32 + yy as u32);
        let [xx, yy, xy] = [xx, yy, xy].map(i64::from);
        // Q.26 times Q.30 in units of 512 px is Q.47 in px
        let du = round_shift(2 * (p1 * xy + p2 * xx) + p2 * square, 27);
        let dv = round_shift(2 * (p1 * yy + p2 * xy) + p1 * square, 27);
        [saturate_i32(i64::from(u) + du), saturate_i32(i64::from(v) + dv)]
    }
}
