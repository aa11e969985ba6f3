//! Rounding shifts and saturating conversions.

/// `value / 2^bits`, rounded to the nearest integer, halves towards plus infinity: floor(v / 2^bits + 1/2).
///
/// * Input: any `value`, `bits` 1 to 62. Error: at most 1/2 unit of the result. No overflow.
///
/// In hardware: one addition and wires.
#[inline]
pub const fn round_shift(value: i64, bits: u32) -> i64 {
    // The bit below the point is the half: to add it after the shift needs no carry between words, and cannot overflow
    (value >> bits) + ((value >> (bits - 1)) & 1)
}

/// [`round_shift`] of a product, for `bits` 1 to 62.
#[inline]
pub const fn round_product(a: i32, b: i32, bits: u32) -> i64 {
    let product = a as i64 * b as i64;
    if cfg!(target_pointer_width = "32") {
        return round_shift(product, bits);
    }
    // A product is never so large that to add the half first overflows, which is one step less on a CPU of 64 bits
    (product + (1 << (bits - 1))) >> bits
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
    fn round_shift_does_not_overflow_at_the_ends() {
        assert_eq!(round_shift(i64::MAX, 1), 1 << 62);
        assert_eq!(round_shift(i64::MAX, 62), 2);
        assert_eq!(round_shift(i64::MIN, 1), -1 << 62);
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
