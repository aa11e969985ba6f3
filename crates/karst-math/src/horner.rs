//! Polynomials in the normalised radius.

use crate::{high_product_signed, saturate_i32};

/// Fraction bits of the coefficients and of the result: Q6.26, -32 to 32.
pub const COEFFICIENT_FRAC_BITS: u32 = 26;

/// Fraction bits of the argument: Q3.29, -4 to 4.
pub const RADIUS_FRAC_BITS: u32 = 29;

/// `c[0] + c[1] s + c[2] s^2 + ...` by Horner's rule.
///
/// * Input: coefficients in Q6.26, constant term first; `s` in Q3.29. Output: Q6.26.
/// * Rounding: every product is rounded down to Q6.26 before the next coefficient is added.
/// * Error against the exact polynomial: at most 2^-26 (1 + |s| + |s|^2 + ...), one term per multiplication: below
///   2^-26 * n for n multiplications and |s| <= 1.
/// * Overflow: each step saturates at the ends of Q6.26.
///
/// In hardware: one multiply-add stage per coefficient.
#[inline]
pub fn horner(coefficients: &[i32], s: i32) -> i32 {
    coefficients.iter().rev().fold(0, |sum, &c| saturate_i32(product(sum, s) + i64::from(c)))
}

/// A value times the radius, rounded down.
#[inline]
fn product(value: i32, s: i32) -> i64 {
    (i64::from(value) * i64::from(s)) >> RADIUS_FRAC_BITS
}

/// Fraction bits of a derivative: Q12.20, -2048 to 2048.
pub const DERIVATIVE_FRAC_BITS: u32 = 20;

/// [`horner`] together with the derivative d/ds of the polynomial.
///
/// * Input and first output: as [`horner`]. Second output: Q12.20.
/// * Rounding: in each step the derivative's product and the partial sum are rounded down to Q12.20. Error of the
///   derivative: at most 2 * 2^-20 per multiplication for |s| <= 1; meant for weights.
/// * Overflow: both saturate in each step.
#[cfg_attr(target_pointer_width = "32", inline(never))]
#[cfg_attr(not(target_pointer_width = "32"), inline)]
pub fn horner_with_derivative(coefficients: &[i32], s: i32) -> (i32, i32) {
    coefficients.iter().rev().fold((0, 0), |(sum, derivative), &c| {
        let step = |value: i32, add: i64| saturate_i32(product(value, s) + add);
        (step(sum, c.into()), step(derivative, (sum >> SLOPE_SHIFT).into()))
    })
}

/// From a value to what it adds to the derivative.
const SLOPE_SHIFT: u32 = COEFFICIENT_FRAC_BITS - DERIVATIVE_FRAC_BITS;

/// [`horner_with_derivative`] for a CPU of 32 bits, of up to 64 coefficients and 0 <= s < 1 where nothing saturates, else None:
/// a third of the instructions. With s < 1 no product is larger than what it is a product of, so only the sum with a
/// coefficient can be too large; and 63 slopes of at most 2^25 do not make a derivative that is.
#[inline(always)]
pub fn horner_with_derivative_short(coefficients: &[i32], s: i32) -> Option<(i32, i32)> {
    if !(0..1 << RADIUS_FRAC_BITS).contains(&s) {
        return None;
    }
    // In Q.32 the upper word of a product is the product
    let s = (s as u32) << (32 - RADIUS_FRAC_BITS);
    // The lengths that are usual, without a loop
    if let Ok(coefficients) = <&[i32; 8]>::try_from(coefficients) {
        steps(coefficients, s)
    } else if let Ok(coefficients) = <&[i32; 7]>::try_from(coefficients) {
        steps(coefficients, s)
    } else if coefficients.len() <= 64 {
        steps(coefficients, s)
    } else {
        None
    }
}

/// The steps of [`horner_with_derivative_short`], for s in Q.32.
#[inline(always)]
fn steps(coefficients: &[i32], s: u32) -> Option<(i32, i32)> {
    let times_s = |value: i32| high_product_signed(value, s);
    let Some((&last, rest)) = coefficients.split_last() else { return Some((0, 0)) };
    let (mut sum, mut derivative) = (last, 0);
    for &c in rest.iter().rev() {
        derivative = times_s(derivative) + (sum >> SLOPE_SHIFT);
        sum = times_s(sum).checked_add(c)?;
    }
    Some((sum, derivative))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn exact(coefficients: &[i32], s: i32) -> f64 {
        let s = f64::from(s) / f64::from(1 << RADIUS_FRAC_BITS);
        coefficients.iter().rev().fold(0.0, |sum, &c| sum * s + f64::from(c))
    }

    #[test]
    fn an_empty_polynomial_is_zero_and_a_constant_is_itself() {
        assert_eq!(horner(&[], 1 << 28), 0);
        assert_eq!(horner(&[-77], i32::MIN), -77);
    }

    #[test]
    fn saturates_at_both_ends() {
        assert_eq!(horner(&[i32::MAX, i32::MAX], 1 << 29), i32::MAX);
        assert_eq!(horner(&[i32::MIN, i32::MIN], 1 << 29), i32::MIN);
    }

    #[test]
    fn short_way_gives_up_where_something_could_saturate_and_nowhere_else() {
        let one = 1 << RADIUS_FRAC_BITS;
        assert_eq!(horner_with_derivative_short(&[1, 2], -1), None);
        assert_eq!(horner_with_derivative_short(&[1, 2], one), None);
        assert!(horner_with_derivative_short(&[1, 2], one - 1).is_some());
        // 2^31 s is 2^31 - 4
        assert_eq!(horner_with_derivative_short(&[5, i32::MAX], one - 1), None);
        assert_eq!(horner_with_derivative_short(&[4, i32::MAX], one - 1), Some((i32::MAX, i32::MAX >> 6)));
        assert_eq!(horner_with_derivative_short(&[-5, i32::MIN], one - 1), None);
        assert_eq!(horner_with_derivative_short(&[-4, i32::MIN], one - 1), Some((i32::MIN, i32::MIN >> 6)));
        assert_eq!(horner_with_derivative_short(&[0; 65], 1), None);
        assert_eq!(horner_with_derivative_short(&[], 1), Some((0, 0)));
    }

    #[test]
    fn largest_derivative_of_the_most_terms_is_right_the_short_way() {
        let s = (1 << RADIUS_FRAC_BITS) - 1;
        for (end, step) in [(i32::MIN, -4), (i32::MAX, 4)] {
            // The value stays at the end of its range, and so does each slope
            let coefficients: [i32; 64] = core::array::from_fn(|i| if i == 63 { end } else { step });
            let values = horner_with_derivative_short(&coefficients, s);
            assert!(values.is_some_and(|(_, derivative)| derivative.abs() > 62 << 25), "{values:?}");
            assert_eq!(values, Some(horner_with_derivative(&coefficients, s)));
        }
    }

    proptest! {
        #[test]
        fn short_way_gives_what_the_general_one_does(
            coefficients in prop::collection::vec(any::<i32>(), 0..9),
            shorter in 0..32_u32,
            s in 0..1_i32 << 29,
        ) {
            let coefficients: std::vec::Vec<i32> = coefficients.iter().map(|c| c >> shorter).collect();
            let values = horner_with_derivative_short(&coefficients, s);
            prop_assert!(values.is_none_or(|values| values == horner_with_derivative(&coefficients, s)));
            // A sum that stays far from the ends is no reason to give up
            prop_assert!(values.is_some() || shorter < 3);
        }

        #[test]
        fn error_is_below_an_ulp_per_multiplication_and_never_above_zero(
            coefficients in prop::collection::vec(-(1 << 27)..1_i32 << 27, 1..9),
            s in 0..=1_i32 << 29,
        ) {
            let multiplications = coefficients.len() as f64 - 1.0;
            let error = exact(&coefficients, s) - f64::from(horner(&coefficients, s));
            // 1e-3: rounding of the f64 oracle itself
            prop_assert!(error <= multiplications + 1e-3 && error >= -1e-3, "{} ulp", error);
        }

        #[test]
        fn derivative_is_within_its_bound_and_the_value_is_that_of_horner(
            coefficients in prop::collection::vec(-(1 << 30)..1_i32 << 30, 0..9),
            s in 0..=1_i32 << 29,
        ) {
            let (value, derivative) = horner_with_derivative(&coefficients, s);
            prop_assert_eq!(value, horner(&coefficients, s));
            // Where the value saturates on the way the derivative is not that of the polynomial
            let bound = coefficients.iter().map(|&c| i64::from(c).abs()).sum::<i64>();
            prop_assume!(bound < i64::from(i32::MAX));
            let x = f64::from(s) / f64::from(1 << RADIUS_FRAC_BITS);
            let exact = coefficients.iter().enumerate().skip(1).rev().fold(0.0, |sum, (power, &c)| sum * x + power as f64 * f64::from(c));
            let error = (f64::from(derivative) - exact / 64.0).abs();
            let multiplications = coefficients.len().saturating_sub(1) as f64;
            prop_assert!(error <= 2.0 * multiplications + 1e-3, "{} units", error);
        }
    }
}
