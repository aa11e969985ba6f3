//! Integer square root and hypotenuse.

use core::num::NonZeroU16;

use crate::words::leading_zeros;

/// The largest integer whose square is not above `n`. Exact for every input; no overflow.
///
/// A digit-by-digit root with one result bit per pipeline stage gives the same bits in hardware.
#[inline]
pub const fn sqrt_floor(n: u64) -> u32 {
    if cfg!(target_pointer_width = "64") { n.isqrt() as u32 } else { floor_by_words(n) }
}

/// The square root of `n` rounded to the nearest integer. Exact for every input (a tie cannot occur); the one result
/// beyond 32 bits, for n > (2^32 - 1/2)^2, saturates.
#[cfg_attr(target_pointer_width = "32", inline(never))]
#[cfg_attr(not(target_pointer_width = "32"), inline)]
pub const fn sqrt_round(n: u64) -> u32 {
    if cfg!(target_pointer_width = "64") { round(n, n.isqrt() as u32) } else { round_by_words(n) }
}

/// The root to the nearest integer, from the one rounded down.
const fn round(n: u64, root: u32) -> u32 {
    // (root + 1/2)^2 = root^2 + root + 1/4
    let rest = n - root as u64 * root as u64;
    root.saturating_add((rest > root as u64) as u32)
}

/// `sqrt(x^2 + y^2)`, correctly rounded, in the fixed-point format of its inputs (Q18.14 among them).
///
/// * Input: any `x`, `y` (two raw values of one Q format). Output: 0 to 2^31 * sqrt 2, which fits `u32`.
/// * Error: at most 1/2 unit in the last place. No overflow.
#[inline]
pub const fn hypot(x: i32, y: i32) -> u32 {
    let (x, y) = (x as i64, y as i64);
    sqrt_round((x * x) as u64 + (y * y) as u64)
}

/// [`hypot`] for a CPU of 32 bits, where it is from 2^26 up to 2^29, else None: a third of the instructions, as nothing has
/// to be normalised. The root of the leading bits by one step of Newton's method, the lower ones by another.
#[inline(always)]
pub const fn hypot_short(x: i32, y: i32) -> Option<u32> {
    let (x, y) = (x as i64, y as i64);
    round_of_58_bits((x * x) as u64 + (y * y) as u64)
}

/// [`sqrt_round`] from 2^52 up to 2^58, else None.
#[inline(always)]
const fn round_of_58_bits(n: u64) -> Option<u32> {
    let high = (n >> 32) as u32;
    if high < 1 << 20 || high >= 1 << 26 {
        return None;
    }
    // From 2^26 on; its root is within 1 of `upper`, which is from 2^13 to 2^16
    let leading = (n >> 26) as u32;
    let start = ROOTS[(high >> 16 & 0x3ff) as usize].get() as u32;
    let upper = (start + leading / start) >> 1;
    // With n = upper^2 2^26 + rest 2^26 + ...: the next step adds rest 2^26 / (2 upper 2^13). That is within 1 of the root to
    // the nearest integer, because what it leaves out is at most 1/2, and so is its own error
    let rest = leading.wrapping_sub(upper.wrapping_mul(upper)) as i32;
    let Some(step) = (rest << 12).checked_div(upper as i32) else { return None };
    let root = (upper << 13).wrapping_add_signed(step) as i32;
    // n - root^2, which is at most 3 root, in the lower word alone; root is nearest from -root + 1 to root
    let rest = (n as u32).wrapping_sub((root as u32).wrapping_mul(root as u32)) as i32;
    Some((root + (rest > root) as i32 - (rest + root <= 0) as i32) as u32)
}

/// Roots of words from 2^26 on by their upper 10 bits, in the middle of their range. Those below 16 are not needed.
static ROOTS: [NonZeroU16; 1024] = {
    let mut roots = [NonZeroU16::MIN; 1024];
    let mut top = 16_u64;
    while top < 1024 {
        if let Some(root) = NonZeroU16::new(((top << 22) + (1 << 21)).isqrt() as u16) {
            roots[top as usize] = root;
        }
        top += 1;
    }
    roots
};

/// [`sqrt_floor`] for a CPU that divides 32-bit words: a quarter of the instructions of the general one in `core`.
const fn floor_by_words(n: u64) -> u32 {
    let (root, shift) = root_by_words(n);
    root >> shift
}

/// [`sqrt_round`] for a CPU that divides 32-bit words.
const fn round_by_words(n: u64) -> u32 {
    let (root, shift) = root_by_words(n);
    if shift == 0 {
        return round(n, root);
    }
    // The first bit behind the point decides, as there is no tie
    (root >> shift) + (root >> (shift - 1) & 1)
}

/// The root of `n` 4^shift, rounded down, and the shift, which makes the root at least 2^31; zero for zero.
const fn root_by_words(n: u64) -> (u32, u32) {
    let (n_high, n_low) = ((n >> 32) as u32, n as u32);
    let (high, low, words) = if n_high != 0 { (n_high, n_low, 0) } else { (n_low, 0, 16) };
    if high == 0 {
        return (0, 0);
    }
    // An even shift makes the top word large enough for the table
    let shift = leading_zeros(high) & !1;
    let (high, low) = (high << shift | low >> 1 >> (31 - shift), low << shift);
    // The upper half of the root's bits
    let half = root_normalised(high) | TOP_BIT;
    // With n = half^2 2^32 + rest 2^32 + low: the lower half is about (rest 2^16 + low / 2^16) / (2 half), never less
    // than right and at most one more
    let rest = high - half * half;
    let lower = (rest << 15 | low >> 17) / half;
    let root = (half << 16).saturating_add(lower);
    let too_large = root as u64 * root as u64 > (high as u64) << 32 | low as u64;
    (root - too_large as u32, words + shift / 2)
}

/// The root of a word of at least 2^30, rounded down. Exact for every such word; it has its top bit of 16 set.
///
/// In hardware: [`sqrt_floor`] of 32 bits.
#[inline]
pub const fn sqrt_floor_normalised(n: u32) -> u32 {
    if cfg!(target_pointer_width = "64") { n.isqrt() } else { root_normalised(n) }
}

/// Root of a word of at least 2^30, rounded down: one step of Newton's method, which starts within 2^-10 of the root,
/// so ends within one above it.
const fn root_normalised(n: u32) -> u32 {
    let start = ROOTS[(n >> 22) as usize].get() as u32;
    let root = (start + n / start) >> 1;
    // One step beyond 16 bits is one too many
    let root = root - (root >> 16);
    root - (root * root > n) as u32
}

/// Every root here has this bit. To say so costs an instruction, and spares the check for a division by zero.
const TOP_BIT: u32 = 1 << 15;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn is_floor_root(n: u64) -> bool {
        let r = u128::from(sqrt_floor(n));
        r * r <= u128::from(n) && u128::from(n) < (r + 1) * (r + 1)
    }

    #[test]
    fn sqrt_is_exact_for_all_24_bit_integers() {
        for n in 0..1_u64 << 24 {
            assert!(is_floor_root(n), "{n}");
            let nearest = (n as f64).sqrt().round() as u32; // exact: f64 roots are correctly rounded
            assert_eq!(sqrt_round(n), nearest, "{n}");
        }
    }

    #[test]
    fn roots_by_words_are_exact_around_every_square_of_a_grid_and_at_both_ends() {
        let exact = |n: u64| {
            let root = n.isqrt() as u32;
            assert_eq!((floor_by_words(n), round_by_words(n)), (root, round(n, root)), "{n}");
        };
        for root in (0..1_u64 << 32).step_by(9973).chain((1 << 32) - 1000..1 << 32).chain(0..1000) {
            let square = root * root;
            (square.saturating_sub(2)..=square.saturating_add(2)).for_each(exact);
            // Where the root to the nearest integer changes
            (square + root..=square + root + 1).for_each(exact);
        }
        (0..100_000).for_each(exact);
        (u64::MAX - 100_000..=u64::MAX).for_each(exact);
    }

    #[test]
    fn first_step_of_a_short_root_ends_within_one_of_the_root_of_the_leading_bits() {
        for top in 16..1024_u32 {
            let start = u32::from(ROOTS[top as usize].get());
            // A step's error grows with the distance from the middle
            for leading in [top << 22, top << 22 | 1 << 21, top << 22 | ((1 << 22) - 1)] {
                let error = f64::from((start + leading / start) >> 1) - f64::from(leading).sqrt();
                assert!(error.abs() < 1.0, "{error} for {leading}");
            }
        }
    }

    #[test]
    fn short_roots_are_exact_around_squares_at_the_ends_of_every_segment_and_of_a_grid() {
        let exact = |n: u64| {
            let root = ((1 << 52)..1 << 58).contains(&n).then(|| round(n, n.isqrt() as u32));
            assert_eq!(round_of_58_bits(n), root, "{n}");
        };
        let ends = (16..1025_u64).map(|top| (top << 48).isqrt()).flat_map(|root| root - 20..root + 20);
        for root in ends.chain((1 << 26..1 << 29).step_by(997)) {
            let square = root * root;
            // Where the root to the nearest integer changes, and the farthest from there
            [square - root, square - root + 1, square, square + root, square + root + 1].into_iter().for_each(exact);
        }
    }

    #[test]
    fn roots_of_normalised_words_are_exact_around_every_square() {
        for root in 1_u32 << 15..1 << 16 {
            for n in [root * root, root * root + root, root * root + 2 * root] {
                assert_eq!((root_normalised(n), sqrt_floor_normalised(n)), (root, root), "{n}");
            }
        }
    }

    #[test]
    fn sqrt_is_exact_around_every_power_of_two_and_at_the_top() {
        for root in (0..32).map(|b| 1_u64 << b).chain([u64::from(u32::MAX)]) {
            for n in (root * root).saturating_sub(3)..=(root * root).saturating_add(3) {
                assert!(is_floor_root(n), "{n}");
            }
        }
        assert_eq!(sqrt_round(u64::MAX), u32::MAX);
    }

    #[test]
    fn hypot_is_within_half_an_ulp_over_the_sensor_range() {
        // Every Q18.14 pair is too many: about every half pixel of a quarter of a 1024 x 1024 sensor, in odd steps so that
        // all fraction bits take part.
        let mut worst = 0.0_f64;
        for i in (0..512 << 14).step_by((1 << 13) + 37) {
            for j in (0..512 << 14).step_by((1 << 13) + 91) {
                let exact = f64::from(i).hypot(f64::from(j));
                worst = worst.max((f64::from(hypot(i, j)) - exact).abs());
            }
        }
        assert!(worst <= 0.5 + 1e-6, "{worst} ulp");
        assert!(worst > 0.49, "the grid must reach the rounding boundary: {worst}");
    }

    proptest! {
        #[test]
        fn floor_root_of_any_integer(n: u64, shorter in 0..64_u32) {
            prop_assert!(is_floor_root(n));
            let (n, root) = (n >> shorter, (n >> shorter).isqrt() as u32);
            prop_assert_eq!((floor_by_words(n), round_by_words(n)), (root, round(n, root)));
        }

        #[test]
        fn hypot_is_correctly_rounded_and_symmetric(x: i32, y: i32) {
            let (r, n) = (u128::from(hypot(x, y)), u128::from(x.unsigned_abs()).pow(2) + u128::from(y.unsigned_abs()).pow(2));
            // (r - 1/2)^2 <= n <= (r + 1/2)^2, times 4
            prop_assert!(r == 0 || (2 * r - 1).pow(2) <= 4 * n);
            prop_assert!(4 * n <= (2 * r + 1).pow(2));
            prop_assert_eq!(hypot(x, y), hypot(y, x));
            prop_assert!(hypot_short(x, y).is_none_or(|short| short == hypot(x, y)));
            prop_assert!(x == i32::MIN || hypot(x, y) == hypot(-x, y));
        }
    }
}
