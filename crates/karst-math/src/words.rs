//! What a CPU of 32 bits without an instruction for it does not have.

/// `u32::leading_zeros`, by a table where there is no instruction for it.
#[inline]
pub(crate) const fn leading_zeros(word: u32) -> u32 {
    if cfg!(all(target_arch = "riscv32", not(target_feature = "zbb"))) { by_table(word) } else { word.leading_zeros() }
}

/// A third of the instructions that it takes to count bits.
const fn by_table(word: u32) -> u32 {
    if word >> 24 != 0 {
        LEADING_ZEROS[(word >> 24) as usize] as u32
    } else if word >> 16 != 0 {
        LEADING_ZEROS[(word >> 16 & 0xff) as usize] as u32 + 8
    } else if word >> 8 != 0 {
        LEADING_ZEROS[(word >> 8 & 0xff) as usize] as u32 + 16
    } else {
        LEADING_ZEROS[(word & 0xff) as usize] as u32 + 24
    }
}

/// Leading zeros of a byte.
static LEADING_ZEROS: [u8; 256] = {
    let mut zeros = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        zeros[byte] = (byte as u8).leading_zeros() as u8;
        byte += 1;
    }
    zeros
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leading_zeros_are_right_around_every_power_of_two_and_for_all_small_words() {
        let words = (0..32).flat_map(|bits| (1_u32 << bits) - 1..=(1 << bits) + 1).chain(0..1 << 17).chain([u32::MAX]);
        for word in words {
            assert_eq!(by_table(word), word.leading_zeros(), "{word:#x}");
        }
    }
}
