//! What the driver needs of a bus.

/// Access to the registers of one IP. Addresses are bytes from its first register, multiples of 4.
pub trait RegisterBus {
    /// Why an access failed.
    type Error;

    /// Reads a register.
    fn read32(&mut self, address: u32) -> Result<u32, Self::Error>;

    /// Writes a register.
    fn write32(&mut self, address: u32, value: u32) -> Result<(), Self::Error>;

    /// Whether an access since the last call of this has failed, although its own result did not say so. Only a bus that tells
    /// afterwards has something to say here.
    fn has_failed(&mut self) -> bool {
        false
    }
}

impl<B: RegisterBus> RegisterBus for &mut B {
    type Error = B::Error;

    fn read32(&mut self, address: u32) -> Result<u32, B::Error> {
        (**self).read32(address)
    }

    fn write32(&mut self, address: u32, value: u32) -> Result<(), B::Error> {
        (**self).write32(address, value)
    }

    fn has_failed(&mut self) -> bool {
        (**self).has_failed()
    }
}
