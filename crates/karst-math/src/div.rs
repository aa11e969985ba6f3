//! Division with defined rounding.

/// `numerator / denominator`, rounded to the nearest integer, halves away from zero.
///
/// * Input: any two integers. Output: the exact quotient, rounded, from -`i64::MAX` to `i64::MAX`; error at most 1/2.
/// * Overflow: a zero denominator, and `i64::MIN` over 1 or -1, give the end of that range that has the quotient's sign
///   (0 / 0 counts as positive).
///
/// The result is defined by mathematics, not by an algorithm: a restoring divider on the magnitudes, whose last
/// remainder decides the rounding, gives the same bits in hardware.
#[inline]
pub const fn div_round(numerator: i64, denominator: i64) -> i64 {
    let negative = (numerator < 0) != (denominator < 0);
    let (n, d) = (numerator.unsigned_abs(), denominator.unsigned_abs());
    if d == 0 {
        return if numerator < 0 { -i64::MAX } else { i64::MAX };
    }
    let (quotient, remainder) = (n / d, n % d);
    let magnitude = quotient + (remainder >= d - remainder) as u64;
    let magnitude = if magnitude > i64::MAX as u64 { i64::MAX } else { magnitude as i64 };
    if negative { -magnitude } else { magnitude }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn quotient_is_the_nearest_integer_over_all_small_operands() {
        for n in -600_i64..=600 {
            for d in -600_i64..=600 {
                if d != 0 {
                    // f64::round takes halves away from zero, and these quotients are exact enough to decide
                    assert_eq!(div_round(n, d), (n as f64 / d as f64).round() as i64, "{n} / {d}");
                }
            }
        }
    }

    #[test]
    fn zero_denominator_and_overflow_saturate() {
        assert_eq!(div_round(5, 0), i64::MAX);
        assert_eq!(div_round(0, 0), i64::MAX);
        assert_eq!(div_round(-5, 0), -i64::MAX);
        assert_eq!(div_round(i64::MIN, -1), i64::MAX);
        assert_eq!(div_round(i64::MIN, 1), -i64::MAX);
        assert_eq!(div_round(i64::MIN, 0), -i64::MAX);
    }

    proptest! {
        #[test]
        fn error_is_at_most_one_half(n: i64, d: i64) {
            prop_assume!(d != 0 && (n != i64::MIN || d.unsigned_abs() > 1));
            let q = i128::from(div_round(n, d));
            let error = i128::from(n) - q * i128::from(d);
            prop_assert!(2 * error.abs() <= i128::from(d).abs());
        }

        #[test]
        fn sign_symmetric(n in -i64::MAX.., d in -i64::MAX..) {
            prop_assume!(d != 0);
            prop_assert_eq!(div_round(n, d), -div_round(-n, d));
            prop_assert_eq!(div_round(n, d), div_round(-n, -d));
        }
    }
}
