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

/// A matrix of 2 by 2, row by row, times a vector: [`round_shift`] of the sums of products, saturated, for `bits` 1 to 31.
#[inline]
pub const fn round_transform(matrix: [i32; 4], vector: [i32; 2], bits: u32) -> [i32; 2] {
    let [a, b, c, d] = matrix;
    [round_sum([a, b], vector, bits), round_sum([c, d], vector, bits)]
}

/// One coordinate of [`round_transform`].
const fn round_sum(row: [i32; 2], vector: [i32; 2], bits: u32) -> i32 {
    let [x, y] = [row[0] as i64 * vector[0] as i64, row[1] as i64 * vector[1] as i64];
    // Their sum is at most 2^63: where that is too much by one, the result saturates all the more
    saturate_i32(round_shift(x.saturating_add(y), bits))
}

/// [`round_transform`] for a CPU of 32 bits, of a vector that can be shifted to the left by 32 - `bits`, else None: the
/// result is then in the upper words, and below 2^31, as not both coordinates are -2^31.
#[inline(always)]
pub const fn round_transform_short(matrix: [i32; 4], vector: [i32; 2], bits: u32) -> Option<[i32; 2]> {
    let half = 1 << (bits - 1);
    let [x, y] = [vector[0] << (32 - bits), vector[1] << (32 - bits)];
    // Both in `bits` bits with sign
    let outside = (vector[0].wrapping_add(half) | vector[1].wrapping_add(half)) as u32 >> bits != 0;
    if outside || y == i32::MIN {
        return None;
    }
    let [a, b, c, d] = matrix;
    let (u, v) = (a as i64 * x as i64 + b as i64 * y as i64, c as i64 * x as i64 + d as i64 * y as i64);
    Some([(u >> 32) as i32 + (u as u32 >> 31) as i32, (v >> 32) as i32 + (v as u32 >> 31) as i32])
}

/// The nearest number of `bits` bits with sign, 1 to 32: exact in range, the end of the range beyond.
///
/// What shifts the value by the rest of the word afterwards has the shift of the check for nothing.
#[inline]
pub const fn saturate_bits(value: i32, bits: u32) -> i32 {
    let spare = 32 - bits;
    if (value << spare) >> spare == value {
        value
    } else if value < 0 {
        i32::MIN >> spare
    } else {
        i32::MAX >> spare
    }
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
        fn transform_is_the_rounded_and_saturated_product_and_the_short_one_too_or_none(
            (matrix, vector) in (any::<[i32; 4]>(), any::<[i32; 2]>()),
            bits in 1..32_u32,
            shorter in 0..32_u32,
            ends: [bool; 3],
        ) {
            let matrix = if ends[0] { [i32::MIN; 4] } else { matrix };
            let least = i32::MIN >> (32 - bits);
            let vector = [0, 1].map(|i| if ends[1 + i] { least } else { vector[i] >> shorter });
            let exact = [0, 2].map(|row| {
                let sum = (0..2).map(|i| i128::from(matrix[row + i]) * i128::from(vector[i])).sum::<i128>();
                ((sum + (1 << (bits - 1))) >> bits).clamp(i32::MIN.into(), i32::MAX.into()) as i32
            });
            prop_assert_eq!(round_transform(matrix, vector, bits), exact);
            let short = round_transform_short(matrix, vector, bits);
            prop_assert!(short.is_none_or(|product| product == exact));
            let fits = vector.iter().all(|x| x.unsigned_abs() < 1 << (bits - 1));
            prop_assert!(short.is_some() || !fits);
        }

        #[test]
        fn saturation_to_bits_is_a_clamp(value: i32, shorter in 0..32_u32, bits in 1..33_u32) {
            let (value, end) = (value >> shorter, 1_i64 << (bits - 1));
            prop_assert_eq!(i64::from(saturate_bits(value, bits)), i64::from(value).clamp(-end, end - 1));
        }

        #[test]
        fn saturate_is_a_clamp(value: i64) {
            prop_assert_eq!(i64::from(saturate_i32(value)), value.clamp(i32::MIN.into(), i32::MAX.into()));
        }
    }
}
