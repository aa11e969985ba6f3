//! Division with defined rounding.

use crate::words::leading_zeros;

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
    let magnitude = div_round_unsigned(numerator.unsigned_abs(), denominator.unsigned_abs());
    let magnitude = if magnitude > i64::MAX as u64 { i64::MAX } else { magnitude as i64 };
    if (numerator < 0) != (denominator < 0) { -magnitude } else { magnitude }
}

/// [`div_round`] of two magnitudes: what is known not to be negative needs no signs.
///
/// * Input: up to 2^63. Output: the exact quotient, rounded, halves up; error at most 1/2.
/// * Overflow: a zero denominator gives `u64::MAX`.
#[cfg_attr(target_pointer_width = "32", inline(never))]
#[cfg_attr(not(target_pointer_width = "32"), inline)]
pub const fn div_round_unsigned(numerator: u64, denominator: u64) -> u64 {
    // floor(n / d + 1/2), also for an odd d: the fraction of n / d is never between floor(d / 2) / d and 1/2
    let n = numerator.wrapping_add(denominator >> 1);
    if cfg!(target_pointer_width = "32") {
        return quotient_by_words(n, denominator);
    }
    match n.checked_div(denominator) {
        Some(quotient) => quotient,
        None => u64::MAX,
    }
}

/// `n / d` rounded down, `u64::MAX` for a zero divisor, on a CPU that divides 32-bit words: much shorter than the usual
/// run-time library, which has to go bit by bit where there is no such division.
const fn quotient_by_words(n: u64, d: u64) -> u64 {
    let (n_high, n_low, d_high, d_low) = ((n >> 32) as u32, n as u32, (d >> 32) as u32, d as u32);
    if d_high != 0 {
        return quotient_by_two_words(n, d) as u64;
    }
    let Some(first) = n_high.checked_div(d_low) else { return u64::MAX };
    let shift = leading_zeros(d_low);
    let rest = n_high - first * d_low;
    let second = quotient_normalised(upper(rest, n_low, shift), n_low << shift, d_low << shift);
    (first as u64) << 32 | second as u64
}

/// [`quotient_by_words`] for a divisor of at least 2^32. What the leading words give is a little too small; the same of the
/// rest is added, until the rest is smaller than the divisor. The error of each step is about the square of the one
/// before: one below 2^12 takes hardly ever more than one step, one below 2^18 two, none more than eight.
const fn quotient_by_two_words(n: u64, d: u64) -> u32 {
    let (mut quotient, mut rest) = (0, n);
    while rest >= d {
        let high = (rest >> 32) as u32;
        let shift = leading_zeros(high);
        // The divisor at the place of the rest's leading bit, rounded up. Where that is 2^32, the quotient is 1
        let leading = upper((d >> 32) as u32, d as u32, shift).wrapping_add(1);
        let step = match upper(high, rest as u32, shift).checked_div(leading) {
            Some(step) if step != 0 => step,
            _ => 1,
        };
        quotient += step;
        rest -= d * step as u64;
    }
    quotient
}

/// The upper word of `high` 2^32 + `low` after a shift to the left by 0 to 31 bits.
const fn upper(high: u32, low: u32, shift: u32) -> u32 {
    high << shift | low >> 1 >> (31 - shift)
}

/// Quotient of `high` 2^32 + `low` for a `high` below the divisor, whose top bit is set. Two digits of 16 bits: each is
/// estimated from the upper half of the divisor, and then at most two too large (Knuth, algorithm D).
const fn quotient_normalised(high: u32, low: u32, d: u32) -> u32 {
    let (first, rest) = digit(high, low >> 16, d);
    let (second, _) = digit(rest, low & 0xffff, d);
    first << 16 | second
}

/// One digit: quotient and remainder of `high` 2^16 + `low` for `high` below `d`.
const fn digit(high: u32, low: u32, d: u32) -> (u32, u32) {
    // The top bit is set: to say so spares the check for a division by zero
    let (d_high, d_low) = (d >> 16 | 1 << 15, d & 0xffff);
    let quotient = high / d_high;
    // What d_high leaves, less what d_low takes of it
    let (rest, too_large) = ((high - quotient * d_high) << 16 | low).overflowing_sub(quotient * d_low);
    if !too_large {
        return (quotient, rest);
    }
    let (rest, right) = rest.overflowing_add(d);
    if right { (quotient - 1, rest) } else { (quotient - 2, rest.wrapping_add(d)) }
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
                assert_eq!(quotient_by_words(n, d), n / d, "{n} / {d}");
            }
        }
    }

    #[test]
    fn estimated_digits_are_right_or_one_or_two_too_large() {
        let mut too_large = [0; 3];
        for d in [0x8000_0000_u32, 0x8000_0001, 0x8000_ffff, 0x8001_fffe, 0xffff_0000, 0xffff_ffff] {
            for high in [0, 1, d >> 16, (d >> 16) << 15, d / 3, d - 0x8000, d - 1] {
                for low in [0, 0x8000, 0xffff] {
                    let n = u64::from(high) << 16 | u64::from(low);
                    let (quotient, rest) = digit(high, low, d);
                    assert_eq!((u64::from(quotient), u64::from(rest)), (n / u64::from(d), n % u64::from(d)));
                    too_large[(high / (d >> 16) - quotient) as usize] += 1;
                }
            }
        }
        assert!(too_large.iter().all(|&cases| cases > 0), "{too_large:?}");
    }

    /// Steps that a quotient takes.
    fn steps(n: u64, d: u64) -> u32 {
        let mut rest = u128::from(n);
        let mut steps = 0;
        while rest >= u128::from(d) {
            let shift = 96 - rest.leading_zeros();
            rest -= u128::from(d) * ((rest >> shift) / ((u128::from(d) >> shift) + 1)).max(1);
            steps += 1;
        }
        steps
    }

    #[test]
    fn quotients_by_two_words_take_up_to_eight_steps() {
        let mut taken = [0; 9];
        for d in (32..64).flat_map(|bits| [1 << bits, (1 << bits) + 1, (3 << (bits - 1)) - 1, u64::MAX >> (63 - bits)])
        {
            let multiples =
                [1, 2, 3, 1000, 1 << 15, u64::MAX / d / 3, u64::MAX / d - 1].map(|times| d.wrapping_mul(times));
            for n in multiples.into_iter().flat_map(|n| [n.wrapping_sub(1), n, n.wrapping_add(1)]).chain([u64::MAX]) {
                assert_eq!(u64::from(quotient_by_two_words(n, d)), n / d, "{n} / {d}");
                taken[steps(n, d) as usize] += 1;
            }
        }
        assert!(taken.iter().all(|&cases| cases > 0), "{taken:?}");
    }

    #[test]
    fn quotient_of_magnitudes_rounds_halves_up_over_all_small_operands_and_at_the_ends() {
        for n in 0..=600_u32 {
            for d in 1..=600_u32 {
                let exact = (f64::from(n) / f64::from(d)).round() as u64;
                assert_eq!(div_round_unsigned(n.into(), d.into()), exact, "{n} / {d}");
            }
        }
        let most = 1 << 63;
        assert_eq!(div_round_unsigned(most, most), 1);
        assert_eq!(div_round_unsigned(most, 1), most);
        assert_eq!(div_round_unsigned(most / 2, most), 1);
        assert_eq!(div_round_unsigned(most / 2 - 1, most), 0);
        assert_eq!(div_round_unsigned(7, 0), u64::MAX);
        assert_eq!(quotient_by_words(7, 0), u64::MAX);
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
            prop_assert_eq!(quotient_by_words(n, d), n / d);
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
