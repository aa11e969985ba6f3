//! Rounding shifts and saturating conversions.

/// `value / 2^bits`, rounded to the nearest integer, halves towards plus infinity: floor(v / 2^bits + 1/2).
///
/// * Input: any `value` below 2^63 - 2^(bits-1) (no overflow in the product sums it is meant for), `bits` 1 to 62.
/// * Error: at most 1/2 unit of the result. Overflow: the addition saturates, so the largest inputs round down.
///
/// In hardware: one addition of a constant and wires.
#[inline]
pub const fn round_shift(value: i64, bits: u32) -> i64 {
    value.saturating_add(1 << (bits - 1)) >> bits
}

/// [`round_shift`] of a product, for `bits` 1 to 62. A product cannot be large enough to saturate, which saves the
/// comparison.
#[inline]
pub const fn round_product(a: i32, b: i32, bits: u32) -> i64 {
    (a as i64 * b as i64 + (1 << (bits - 1))) >> bits
}

/// The nearest `i32`: exact in range, the end of the range beyond.
#[inline]
pub const fn saturate_i32(value: i64) -> i32 {
    // On a 32-bit CPU one comparison, not two
    if value as i32 as i64 == value {
        value as i32
    } else if value < 0 {
        i32::MIN
    } else {
        i32::MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn round_shift_rounds_halves_up_over_all_small_values() {
        for value in -4096_i64..4096 {
            for bits in 1..8 {
                let exact = (value as f64 / f64::from(1 << bits) + 0.5).floor() as i64;
                assert_eq!(round_shift(value, bits), exact, "{value} >> {bits}");
            }
        }
    }

    #[test]
    fn round_shift_saturates_at_the_top() {
        assert_eq!(round_shift(i64::MAX, 1), i64::MAX >> 1);
    }

    proptest! {
        #[test]
        fn round_product_is_round_shift_of_the_product(a: i32, b: i32, bits in 1..63_u32) {
            prop_assert_eq!(round_product(a, b, bits), round_shift(i64::from(a) * i64::from(b), bits));
            prop_assert_eq!(round_product(i32::MIN, i32::MIN, bits), round_shift(1 << 62, bits));
        }

        #[test]
        fn saturate_is_a_clamp(value: i64) {
            prop_assert_eq!(i64::from(saturate_i32(value)), value.clamp(i32::MIN.into(), i32::MAX.into()));
        }
    }
}
