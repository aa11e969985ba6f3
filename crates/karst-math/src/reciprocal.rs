//! Reciprocals of normalised words, and the upper words of products: what a quotient costs where few bits of it count.

use crate::words::leading_zeros;

/// A word shifted until its top bit is set, and by how many bits.
///
/// * Input: from 1 on; 0 counts as 1. Output: 2^31 and above, and 0 to 31.
///
/// In hardware: five levels of multiplexers.
#[inline]
pub const fn normalise(word: u32) -> (u32, u32) {
    if word == 0 {
        return (1 << 31, 31);
    }
    let shift = leading_zeros(word);
    (word << shift, shift)
}

/// 2^63 / `normalised`, at most 2^-14 of it too small and never too large; a multiple of 2^15.
///
/// * Input: a word of at least 2^31, as [`normalise`] gives it. Output: 2^30 to 2^32.
/// * Definition: 2^15 (2^32 - 1) / (1 + the upper 16 bits), rounded down before the shift.
///
/// In hardware: a quotient of 17 bits by 17 bits.
#[inline]
pub const fn reciprocal_coarse(normalised: u32) -> u32 {
    (u32::MAX / ((normalised >> 16) + 1)) << 15
}

/// 2^63 / `normalised`, at most 2^-28 of it too small and never too large: [`reciprocal_coarse`] r and one step of Newton's
/// method, r + r (1 - r / (2^63 / `normalised`)).
///
/// * Input: a word of at least 2^31, as [`normalise`] gives it. Output: below 2^32.
///
/// In hardware: two products of 17 bits by 32 and by 19 more.
#[inline]
pub const fn reciprocal(normalised: u32) -> u32 {
    let coarse = reciprocal_coarse(normalised);
    // What is missing to 1, in units of 2^-31 and rounded down: below 2^17
    let missing = (u32::MAX >> 1) - high_product(normalised, coarse);
    coarse + high_product(coarse, missing << 1)
}

/// The upper word of a product, which is the product over 2^32 rounded down.
#[inline]
pub const fn high_product(a: u32, b: u32) -> u32 {
    ((a as u64 * b as u64) >> 32) as u32
}

/// The upper word of the product of a signed and an unsigned word, which is the product over 2^32 rounded down.
#[inline]
pub const fn high_product_signed(a: i32, b: u32) -> i32 {
    ((a as i64 * b as i64) >> 32) as i32
}

/// The upper word of the product of two signed words, which is the product over 2^32 rounded down.
#[inline]
pub const fn high_product_of_signed(a: i32, b: i32) -> i32 {
    ((a as i64 * b as i64) >> 32) as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// How much of 2^63 / `normalised` a reciprocal is too small.
    fn too_small(normalised: u32, reciprocal: u32) -> f64 {
        // Exact: the product has up to 64 bits
        let missing = (1_u128 << 63) - u128::from(normalised) * u128::from(reciprocal);
        missing as f64 / 2_f64.powi(63)
    }

    #[test]
    fn coarse_reciprocals_are_at_most_2_to_the_minus_14_too_small() {
        let mut worst = 0.0_f64;
        for upper in 1_u32 << 15..1 << 16 {
            // Both ends of the words that have one reciprocal
            for word in [upper << 16, upper << 16 | 0xffff] {
                let error = too_small(word, reciprocal_coarse(word));
                assert!(error > 0.0, "{word:#x}");
                worst = worst.max(error);
            }
        }
        assert!(worst < 2_f64.powi(-14) && worst > 2_f64.powi(-15), "{worst:e}");
    }

    #[test]
    fn reciprocals_are_at_most_2_to_the_minus_28_too_small_at_both_ends_of_each_coarse_one() {
        for upper in 1_u32 << 15..1 << 16 {
            for word in [upper << 16, upper << 16 | 0xffff] {
                let error = too_small(word, reciprocal(word));
                assert!(error > 0.0 && error < 2_f64.powi(-28), "{word:#x}: {error:e}");
            }
        }
    }

    #[test]
    fn normalised_words_have_their_top_bit() {
        assert_eq!(normalise(0), (1 << 31, 31));
        assert_eq!(normalise(1), (1 << 31, 31));
        assert_eq!(normalise(u32::MAX), (u32::MAX, 0));
        assert_eq!(normalise(5), (5 << 29, 29));
    }

    proptest! {
        #[test]
        fn reciprocals_are_at_most_2_to_the_minus_28_too_small(word in 1_u32 << 31..) {
            let error = too_small(word, reciprocal(word));
            prop_assert!(error > 0.0 && error < 2_f64.powi(-28), "{:e}", error);
        }

        #[test]
        fn upper_words_are_products_rounded_down(a: i32, b: u32) {
            prop_assert_eq!(i128::from(high_product_signed(a, b)), (i128::from(a) * i128::from(b)).div_euclid(1 << 32));
            let signed = b as i32;
            prop_assert_eq!(i64::from(high_product_of_signed(a, signed)), (i64::from(a) * i64::from(signed)).div_euclid(1 << 32));
            let unsigned = a as u32;
            prop_assert_eq!(u128::from(high_product(unsigned, b)), (u128::from(unsigned) * u128::from(b)) >> 32);
        }
    }
}
