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
    let Some((quotient, remainder)) = div_rem(n, d) else {
        return if numerator < 0 { -i64::MAX } else { i64::MAX };
    };
    let magnitude = quotient + (remainder >= d - remainder) as u64;
    let magnitude = if magnitude > i64::MAX as u64 { i64::MAX } else { magnitude as i64 };
    if negative { -magnitude } else { magnitude }
}

/// Quotient and remainder; None for a zero divisor.
const fn div_rem(n: u64, d: u64) -> Option<(u64, u64)> {
    if cfg!(target_pointer_width = "32") {
        return div_rem_by_words(n, d);
    }
    match n.checked_div(d) {
        Some(quotient) => Some((quotient, n - quotient * d)),
        None => None,
    }
}

/// [`div_rem`] for a CPU that divides 32-bit words: much shorter than the usual run-time library, which has to go bit by
/// bit where there is no such division.
const fn div_rem_by_words(n: u64, d: u64) -> Option<(u64, u64)> {
    let (n_high, n_low, d_high, d_low) = ((n >> 32) as u32, n as u32, (d >> 32) as u32, d as u32);
    if d_high != 0 {
        // The leading word of d gives a quotient that is right or one too large; one less is never too large
        let shift = d_high.leading_zeros();
        let (estimate, _) = div_rem_normalised(n >> 1, ((d << shift) >> 32) as u32);
        let quotient = ((estimate >> (31 - shift)) as u64).saturating_sub(1);
        let remainder = n - quotient.wrapping_mul(d);
        return Some(if remainder >= d { (quotient + 1, remainder - d) } else { (quotient, remainder) });
    }
    match n_high.checked_div(d_low) {
        Some(high) => {
            let rest = n_high - high * d_low;
            let shift = d_low.leading_zeros();
            let (low, rest) = div_rem_normalised(((rest as u64) << 32 | n_low as u64) << shift, d_low << shift);
            Some(((high as u64) << 32 | low as u64, (rest >> shift) as u64))
        }
        None => None,
    }
}

/// Quotient and remainder for a divisor whose top bit is set, and a numerator below 2^32 times that. Two digits of 16
/// bits: each is estimated from the upper half of the divisor, and then at most two too large (Knuth, algorithm D).
const fn div_rem_normalised(n: u64, d: u32) -> (u32, u32) {
    let (high, rest) = digit((n >> 32) as u32, (n >> 16) as u32 & 0xffff, d);
    let (low, rest) = digit(rest, n as u32 & 0xffff, d);
    (high << 16 | low, rest)
}

/// One digit: quotient and remainder of `high` 2^16 + `low` for `high` below `d`.
const fn digit(high: u32, low: u32, d: u32) -> (u32, u32) {
    // The top bit is set: to say so spares the check for a division by zero
    let (d_high, d_low) = (d >> 16 | 1 << 15, d & 0xffff);
    let mut quotient = high / d_high;
    // What d_high leaves, less what d_low takes of it
    let left = (high % d_high) << 16 | low;
    let (mut remainder, mut too_large) = left.overflowing_sub(quotient * d_low);
    while too_large {
        quotient -= 1;
        let (next, positive) = remainder.overflowing_add(d);
        (remainder, too_large) = (next, !positive);
    }
    (quotient, remainder)
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

    #[test]
    fn division_by_words_is_exact_around_every_pair_of_powers_of_two() {
        let near = || (0..64).flat_map(|bits| (-2..=2).map(move |off: i64| (1_u64 << bits).wrapping_add_signed(off)));
        for n in near() {
            for d in near().filter(|&d| d != 0) {
                assert_eq!(div_rem_by_words(n, d), Some((n / d, n % d)), "{n} / {d}");
            }
        }
    }

    /// Words whose digits are at the ends of their range, where an estimated digit is wrong.
    fn awkward() -> impl Strategy<Value = u64> {
        let digit = || {
            prop_oneof![Just(0_u64), Just(1), Just(0x7fff), Just(0x8000), Just(0x8001), Just(0xffff), 0..=0xffff_u64]
        };
        [digit(), digit(), digit(), digit()].prop_map(|digits| digits.iter().fold(0, |word, digit| word << 16 | digit))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100_000))]

        #[test]
        fn division_by_words_is_exact(n in awkward(), d in awkward(), shorter in 0..64_u32) {
            let d = (d >> shorter).max(1);
            prop_assert_eq!(div_rem_by_words(n, d), Some((n / d, n % d)));
        }
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
