//! Cartesian to polar coordinates by CORDIC vectoring.

use crate::round_shift;

/// Rotations by atan(2^-i) = `ANGLES[i]` of a turn, in units of 2^-24 turn.
const ANGLES: [i32; ITERATIONS] = [
    2_097_152, 1_238_021, 654_136, 332_050, 166_669, 83_416, 41_718, 20_860, 10_430, 5_215, 2_608, 1_304, 652, 326,
    163, 81, 41, 20,
];
const ITERATIONS: usize = 18;

/// Guard bits of x and y: they keep the truncated shifts out of the result.
const GUARD_BITS: u32 = 12;

/// 1 / (CORDIC gain of 18 rotations), in units of 2^-20.
const INVERSE_GAIN: i64 = 636_751;
const INVERSE_GAIN_BITS: u32 = 20;

/// Largest magnitude of a coordinate.
const MAX_COORDINATE: i32 = 1 << 17;

/// A point in polar coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Polar {
    /// Distance from the origin, in the unit of the input.
    pub radius: u32,
    /// Angle from the x axis towards the y axis, in 2^-16 turn.
    pub angle: u16,
}

/// Radius and angle (atan2, in turns) of `(x, y)`.
///
/// * Input: |x| and |y| up to 2^17 (larger ones are clamped), in any one unit. At (0, 0) the angle means nothing.
/// * Rounding: both results are rounded to the nearest unit from internal values with 12 (radius) and 8 (angle) more bits.
/// * Error: radius within 0.6 unit; angle within 0.6 * 2^-16 turn (58 microradians) for radii of 256 units and more,
///   within 1.0 * 2^-16 turn from 16 units on.
///
/// Eighteen shift-and-add rotations and one multiplication by a constant: in hardware one stage per rotation and one
/// result per clock, in firmware no division.
#[inline]
pub fn polar(x: i32, y: i32) -> Polar {
    let x = x.clamp(-MAX_COORDINATE, MAX_COORDINATE);
    let y = y.clamp(-MAX_COORDINATE, MAX_COORDINATE);
    // Rotate the left half-plane by half a turn: CORDIC converges within a quarter turn of the x axis.
    let (x, y, start) = if x < 0 { (-x, -y, 1 << 23) } else { (x, y, 0) };
    let (mut x, mut y, mut angle) = (x << GUARD_BITS, y << GUARD_BITS, start);
    for (i, &step) in ANGLES.iter().enumerate() {
        let (dx, dy) = (y >> i, x >> i);
        (x, y, angle) = if y < 0 { (x - dx, y + dy, angle - step) } else { (x + dx, y - dy, angle + step) };
    }
    Polar {
        radius: round_shift(i64::from(x) * INVERSE_GAIN, INVERSE_GAIN_BITS + GUARD_BITS) as u32,
        angle: round_shift(i64::from(angle), 8) as u16,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;
    use proptest::prelude::*;

    /// Errors (radius in units, angle in 2^-16 turn) against f64.
    fn errors(x: i32, y: i32) -> (f64, f64) {
        let p = polar(x, y);
        let (xf, yf) = (f64::from(x), f64::from(y));
        let angle = yf.atan2(xf) / TAU * 65536.0;
        let difference = f64::from(p.angle) - angle;
        ((f64::from(p.radius) - xf.hypot(yf)).abs(), (difference - (difference / 65536.0).round() * 65536.0).abs())
    }

    #[test]
    fn constants_are_those_of_eighteen_rotations() {
        let mut gain = 1.0;
        for (i, &step) in ANGLES.iter().enumerate() {
            let t = 0.5_f64.powi(i as i32);
            assert_eq!(step, (t.atan() / TAU * f64::from(1 << 24)).round() as i32);
            gain *= (1.0 + t * t).sqrt();
        }
        assert_eq!(INVERSE_GAIN, (f64::from(1 << INVERSE_GAIN_BITS) / gain).round() as i64);
    }

    #[test]
    fn errors_are_within_bounds_at_every_whole_pixel_of_the_sensor() {
        // The detector's unit: 1/16 px, here with a centre off the pixel grid.
        let (mut worst_radius, mut worst_angle) = (0.0_f64, 0.0_f64);
        for row in -384..384 {
            for column in -512..512 {
                let (x, y) = (16 * column + 3, 16 * row - 5);
                let (radius, angle) = errors(x, y);
                worst_radius = worst_radius.max(radius);
                if x * x + y * y >= 256 * 256 {
                    worst_angle = worst_angle.max(angle);
                }
            }
        }
        assert!(worst_radius <= 0.6, "radius: {worst_radius}");
        assert!(worst_angle <= 0.6, "angle: {worst_angle}");
    }

    #[test]
    fn errors_are_within_bounds_at_every_point_near_the_centre() {
        for y in -256..=256 {
            for x in -256..=256 {
                let (radius, angle) = errors(x, y);
                assert!(radius <= 0.6, "radius at {x}, {y}: {radius}");
                assert!(angle <= 1.0 || x * x + y * y < 16 * 16, "angle at {x}, {y}: {angle}");
            }
        }
    }

    proptest! {
        #[test]
        fn errors_are_within_bounds_over_the_whole_range(
            x in -MAX_COORDINATE..=MAX_COORDINATE,
            y in -MAX_COORDINATE..=MAX_COORDINATE,
        ) {
            prop_assume!(i64::from(x).pow(2) + i64::from(y).pow(2) >= 256 * 256);
            let (radius, angle) = errors(x, y);
            prop_assert!(radius <= 0.6 && angle <= 0.6, "{} {}", radius, angle);
        }

        #[test]
        fn half_a_turn_adds_half_a_turn(x in 1..=MAX_COORDINATE, y in -MAX_COORDINATE..=MAX_COORDINATE) {
            let (p, q) = (polar(x, y), polar(-x, -y));
            prop_assert_eq!(q, Polar { angle: p.angle.wrapping_add(1 << 15), ..p });
        }
    }
}
