//! What the driver needs of a bus.

/// Access to the registers of one IP. Addresses are bytes from its first register, multiples of 4.
pub trait RegisterBus {
    /// Why an access failed.
    type Error;

    /// Reads a register.
    fn read32(&mut self, address: u32) -> Result<u32, Self::Error>;

    /// Writes a register.
    fn write32(&mut self, address: u32, value: u32) -> Result<(), Self::Error>;
}

impl<B: RegisterBus> RegisterBus for &mut B {
    type Error = B::Error;

    fn read32(&mut self, address: u32) -> Result<u32, B::Error> {
        (**self).read32(address)
    }

    fn write32(&mut self, address: u32, value: u32) -> Result<(), B::Error> {
        (**self).write32(address, value)
    }
}
