//! The angle of a point, by two tables.

use crate::words::leading_zeros;

/// Largest magnitude of a coordinate.
const MAX_COORDINATE: i32 = (1 << 16) - 1;

/// Segments of each table, of equal length.
const SEGMENTS: usize = 256;

/// 2^33 / h at the ends of the segments of h, from 2^15 to 2^16. Two less than the quotient rounded down: the chord above
/// the curve then never gives a ratio of 1.
static RECIPROCALS: [u32; SEGMENTS + 1] = {
    let mut table = [0; SEGMENTS + 1];
    let mut i = 0;
    while i <= SEGMENTS {
        table[i] = (1 << 26) / (SEGMENTS + i) as u32 - 2;
        i += 1;
    }
    table
};

/// Angles of the ratios at the ends of the segments, from 0 to 1, in 2^-21 turn.
static ARCTANGENTS: [u32; SEGMENTS + 1] = {
    let mut table = [0; SEGMENTS + 1];
    let mut i = 0;
    while i <= SEGMENTS {
        table[i] = arctangent(i as u64);
        i += 1;
    }
    table
};

/// Added before the last rounding: a half, and a little for what the steps before it cut off.
const ROUNDING: u32 = 18;

/// Angle of the ratio `i` / [`SEGMENTS`] in 2^-21 turn, by Euler's series, whose terms shrink at least by half.
const fn arctangent(i: u64) -> u32 {
    /// 1 / pi in units of 2^-40: 2^20 of our units are half a turn.
    const SCALE: u128 = 349_985_421_095;
    let square = (SEGMENTS * SEGMENTS) as u64 + i * i;
    // In 2^-40 rad
    let mut term = ((i * SEGMENTS as u64) << 40) / square;
    let (mut sum, mut n) = (0, 0);
    while term > 0 {
        sum += term;
        n += 1;
        term = term * (i * i) / square * (2 * n) / (2 * n + 1);
    }
    ((sum as u128 * SCALE + (1 << 59)) >> 60) as u32
}

/// The values of a table at both ends of a segment.
#[inline]
fn ends(table: &[u32; SEGMENTS + 1], segment: u32) -> [u32; 2] {
    let i = (segment as usize) & (SEGMENTS - 1);
    match table.get(i..) {
        Some([start, end, ..]) => [*start, *end],
        // Never: without it a compiler that optimises for size leaves a check that can panic
        _ => [0; 2],
    }
}

/// Angle (atan2, in turns) of `(x, y)` from the x axis towards the y axis, in 2^-16 turn.
///
/// * Input: |x| and |y| up to 65535 (larger ones are clamped), in any one unit. At (0, 0) the result is 0.
/// * Rounding: to the nearest unit, from an internal value with 5 more bits.
/// * Error: within 0.6 * 2^-16 turn (58 microradians) everywhere but at (0, 0).
///
/// The ratio of the smaller coordinate to the larger one is a product with a reciprocal; reciprocal and arctangent come
/// from a table of 257 words each and a straight line between two of them. In hardware that is two small memories and
/// one result per clock, in firmware no division.
#[inline]
pub fn azimuth(x: i32, y: i32) -> u16 {
    let x = x.clamp(-MAX_COORDINATE, MAX_COORDINATE);
    let y = y.clamp(-MAX_COORDINATE, MAX_COORDINATE);
    let (larger, smaller) =
        if y.abs() > x.abs() { (y.unsigned_abs(), x.unsigned_abs()) } else { (x.unsigned_abs(), y.unsigned_abs()) };
    // Both shifted until the larger one has its highest of 16 bits set
    let shift = leading_zeros(larger.max(1)) - 16;
    let (larger, smaller) = (larger << shift, smaller << shift);
    let [start, end] = ends(&RECIPROCALS, larger >> 7);
    let reciprocal = start - (((start - end) * (larger & 0x7f)) >> 7);
    // Below 1, in units of 2^-18
    let ratio = ((u64::from(smaller) * u64::from(reciprocal)) >> 15) as u32;
    let [start, end] = ends(&ARCTANGENTS, ratio >> 10);
    let eighth = (start + ROUNDING + (((end - start) * (ratio & 0x3ff)) >> 10)) >> 5;
    // The angle of the first eighth of a turn in that of the point
    let eighth = eighth as u16;
    let quarter = if y.abs() > x.abs() { (1 << 14) - eighth } else { eighth };
    let half = if x < 0 { (1 << 15) - quarter } else { quarter };
    if y < 0 { half.wrapping_neg() } else { half }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;
    use proptest::prelude::*;

    /// Error against f64 in 2^-16 turn.
    fn error(x: i32, y: i32) -> f64 {
        let exact = f64::from(y).atan2(f64::from(x)) / TAU * 65536.0;
        let difference = f64::from(azimuth(x, y)) - exact;
        (difference - (difference / 65536.0).round() * 65536.0).abs()
    }

    #[test]
    fn arctangents_are_the_nearest_integers() {
        for (i, &angle) in ARCTANGENTS.iter().enumerate() {
            assert_eq!(angle, ((i as f64 / SEGMENTS as f64).atan() / TAU * f64::from(1 << 21)).round() as u32);
        }
    }

    #[test]
    fn no_ratio_reaches_one() {
        for larger in 1 << 15..1 << 16_u32 {
            let [start, end] = ends(&RECIPROCALS, larger >> 7);
            let reciprocal = start - (((start - end) * (larger & 0x7f)) >> 7);
            assert!(reciprocal < 1 << 18 && u64::from(larger) * u64::from(reciprocal) < 1 << 33, "{larger}");
        }
    }

    #[test]
    fn errors_are_within_bounds_at_every_whole_pixel_of_the_sensor() {
        // The detector's unit: 1/16 px, here with a centre off the pixel grid
        for row in -384..384 {
            for column in -512..512 {
                let error = error(16 * column + 3, 16 * row - 5);
                assert!(error <= 0.6, "{error} at {column}, {row}");
            }
        }
    }

    #[test]
    fn errors_are_within_bounds_at_every_point_near_the_centre() {
        for y in -300..=300 {
            for x in -300..=300 {
                let error = error(x, y);
                assert!((x, y) == (0, 0) || error <= 0.6, "{error} at {x}, {y}");
            }
        }
    }

    #[test]
    fn the_eight_directions_are_exact_and_the_origin_has_none() {
        for size in [1, 5, 100, 32767, 32768, MAX_COORDINATE] {
            for (eighth, [x, y]) in
                [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]].iter().enumerate()
            {
                assert_eq!(azimuth(size * x, size * y), (eighth as u16) << 13, "{size}: {x}, {y}");
            }
        }
        assert_eq!(azimuth(0, 0), 0);
    }

    #[test]
    fn larger_coordinates_are_clamped() {
        assert_eq!(azimuth(i32::MIN, i32::MAX), azimuth(-MAX_COORDINATE, MAX_COORDINATE));
        assert_eq!(azimuth(1 << 16, 1000), azimuth(MAX_COORDINATE, 1000));
    }

    proptest! {
        #[test]
        fn errors_are_within_bounds_over_the_whole_range(
            x in -MAX_COORDINATE..=MAX_COORDINATE,
            y in -MAX_COORDINATE..=MAX_COORDINATE,
        ) {
            prop_assume!((x, y) != (0, 0));
            prop_assert!(error(x, y) <= 0.6, "{}", error(x, y));
        }

        #[test]
        fn half_a_turn_adds_half_a_turn(x in 1..=MAX_COORDINATE, y in -MAX_COORDINATE..=MAX_COORDINATE) {
            prop_assert_eq!(azimuth(-x, -y), azimuth(x, y).wrapping_add(1 << 15));
        }
    }
}
