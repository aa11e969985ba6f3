//! The bus of a processor that has the registers in its address space: the only unsafe code of the crate.
#![allow(unsafe_code)]

use core::convert::Infallible;

use crate::RegisterBus;

/// Registers at fixed addresses.
#[derive(Debug)]
pub struct Mmio {
    base: *mut u32,
}

impl Mmio {
    /// The registers from `base` on.
    ///
    /// # Safety
    ///
    /// The whole map (1 MiB from `base`, a multiple of 4) belongs to the IP and to this value alone, for as long as the
    /// value lives, and any access of 32 bits to it is defined.
    pub const unsafe fn new(base: *mut u32) -> Self {
        Self { base }
    }

    /// Where a register is. Beyond the map the address wraps around, so that it always belongs to the IP.
    fn at(&self, address: u32) -> *mut u32 {
        const WORDS: usize = 1 << 18;
        self.base.wrapping_add((address / 4) as usize % WORDS)
    }
}

// SAFETY: by the contract of `new` no one else uses these registers, whichever thread this value is in
unsafe impl Send for Mmio {}

impl RegisterBus for Mmio {
    type Error = Infallible;

    fn read32(&mut self, address: u32) -> Result<u32, Infallible> {
        // SAFETY: `at` stays within the map, which is ours by the contract of `new`
        Ok(unsafe { self.at(address).read_volatile() })
    }

    fn write32(&mut self, address: u32, value: u32) -> Result<(), Infallible> {
        // SAFETY: as in `read32`
        unsafe { self.at(address).write_volatile(value) };
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn registers_are_words_from_the_base() {
        let mut words = vec![0_u32; 1 << 18];
        words[3] = 7;
        // SAFETY: the vector is as large as the map and not used while `bus` is
        let mut bus = unsafe { Mmio::new(words.as_mut_ptr()) };
        assert_eq!(bus.read32(12), Ok(7));
        assert_eq!(bus.write32(0xFFFFC, 9), Ok(()));
        assert_eq!(bus.read32(0x10000C), Ok(7));
        assert_eq!(words[(1 << 18) - 1], 9);
    }
}
