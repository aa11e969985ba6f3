//! Fields of a register.

/// Some neighbouring bits of a register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Field {
    low: u32,
    width: u32,
}

impl Field {
    /// `width` bits (1 to 31) from bit `low` up.
    pub(crate) const fn new(low: u32, width: u32) -> Self {
        Self { low, width }
    }

    /// The largest value.
    pub const fn max(self) -> u32 {
        (1 << self.width) - 1
    }

    /// The field of a register's value.
    pub const fn get(self, register: u32) -> u32 {
        (register >> self.low) & self.max()
    }

    /// Whether any bit of the field is set.
    pub const fn is_set(self, register: u32) -> bool {
        self.get(register) != 0
    }

    /// A register's value with the field alone. Bits of `value` beyond the width are dropped.
    pub const fn of(self, value: u32) -> u32 {
        (value & self.max()) << self.low
    }

    /// [`Field::of`], but a value beyond the width becomes the largest one.
    pub const fn saturating(self, value: u32) -> u32 {
        self.of(if value > self.max() { self.max() } else { value })
    }

    /// All bits of the field.
    pub const fn mask(self) -> u32 {
        self.of(self.max())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_is_put_and_found_where_it_lies() {
        let field = Field::new(4, 3);
        assert_eq!((field.max(), field.mask()), (7, 0x70));
        assert_eq!((field.of(5), field.get(0xFFFF_FF5F)), (0x50, 5));
        assert_eq!((field.of(9), field.saturating(9), field.saturating(6)), (0x10, 0x70, 0x60));
        assert!(field.is_set(0x40) && !field.is_set(0x80));
    }
}
