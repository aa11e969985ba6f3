//! The sensor's SoC: its peripherals, and the only unsafe code of the firmware.
#![allow(unsafe_code)]

use core::convert::Infallible;
use core::ptr::{read_volatile, write_volatile};

use embedded_hal::digital::{ErrorType as PinErrorType, OutputPin};
use embedded_io::{ErrorType, Read, ReadReady, Write, WriteReady};
use karst_regs::soc::*;
use karst_regs::{Mmio, RegisterBus};
use riscv::interrupt::Interrupt;
use riscv::register::mie;

fn read(register: u32) -> u32 {
    // The peripherals are there in every build of the SoC, and any access of 32 bits to them is defined
    unsafe { read_volatile((PERIPHERALS_BASE + register) as *const u32) }
}

fn write(register: u32, value: u32) {
    // As for reading
    unsafe { write_volatile((PERIPHERALS_BASE + register) as *mut u32, value) }
}

/// What is on the chip.
pub struct Soc {
    /// The karst IP.
    pub ip: Ip,
    /// The serial line.
    pub uart: Uart,
    /// Switches the lasers.
    pub lasers: Pin,
    /// Triggers the cameras.
    pub trigger: Pin,
    /// Time, and what wakes the CPU.
    pub clock: Clock,
    /// Resets all if the program hangs.
    pub watchdog: Watchdog,
}

impl Soc {
    /// Everything there is. To be called once, at the start: two owners would take each other's bytes.
    pub fn new() -> Self {
        write(UART_INTERRUPT, UART_INTERRUPT_RECEIVED.mask());
        // Interrupts only wake the CPU: there is no handler, they stay disabled in mstatus
        unsafe {
            mie::enable(Interrupt::MachineTimer);
            mie::enable(Interrupt::MachineExternal);
            // VexRiscv's mask of external interrupts
            core::arch::asm!("csrw 0xbc0, {}", in(reg) 0b11);
        }
        Self {
            // The map is the IP's, and nobody else has it
            ip: Ip { registers: unsafe { Mmio::new(KARST_BASE as *mut u32) } },
            uart: Uart,
            lasers: Pin { mask: PINS_LASERS.mask() },
            trigger: Pin { mask: PINS_TRIGGER.mask() },
            clock: Clock,
            watchdog: Watchdog,
        }
    }
}

impl Default for Soc {
    fn default() -> Self {
        Self::new()
    }
}

/// The registers of the karst IP. The processor takes no notice of an access that fails: the SoC remembers it.
pub struct Ip {
    registers: Mmio,
}

impl RegisterBus for Ip {
    type Error = Infallible;

    fn read32(&mut self, address: u32) -> Result<u32, Infallible> {
        self.registers.read32(address)
    }

    fn write32(&mut self, address: u32, value: u32) -> Result<(), Infallible> {
        self.registers.write32(address, value)
    }

    fn has_failed(&mut self) -> bool {
        let failed = BUS_ERROR_FAILED.is_set(read(BUS_ERROR));
        if failed {
            write(BUS_ERROR, BUS_ERROR_FAILED.mask());
        }
        failed
    }
}

/// The serial line.
pub struct Uart;

impl ErrorType for Uart {
    type Error = Infallible;
}

impl ReadReady for Uart {
    fn read_ready(&mut self) -> Result<bool, Infallible> {
        Ok(UART_STATUS_RECEIVED.is_set(read(UART_STATUS)))
    }
}

impl Read for Uart {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        let mut count = 0;
        for place in buffer {
            let data = read(UART_DATA);
            if !UART_DATA_VALID.is_set(data) {
                break;
            }
            *place = UART_DATA_DATA.get(data) as u8;
            count += 1;
        }
        Ok(count)
    }
}

impl WriteReady for Uart {
    fn write_ready(&mut self) -> Result<bool, Infallible> {
        Ok(UART_STATUS_ROOM.is_set(read(UART_STATUS)))
    }
}

impl Write for Uart {
    fn write(&mut self, buffer: &[u8]) -> Result<usize, Infallible> {
        let mut count = 0;
        for &byte in buffer {
            if !UART_STATUS_ROOM.is_set(read(UART_STATUS)) {
                break;
            }
            write(UART_DATA, byte.into());
            count += 1;
        }
        Ok(count)
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// An output.
pub struct Pin {
    mask: u32,
}

impl PinErrorType for Pin {
    type Error = Infallible;
}

impl OutputPin for Pin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        write(PINS, read(PINS) & !self.mask);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        write(PINS, read(PINS) | self.mask);
        Ok(())
    }
}

/// Time since the reset.
pub struct Clock;

impl Clock {
    /// Microseconds since the reset.
    pub fn now_us(&self) -> u64 {
        let low = read(TIME_LOW);
        u64::from(read(TIME_HIGH)) << 32 | u64::from(low)
    }

    /// Sleeps until then, or until another interrupt.
    pub fn sleep_until(&mut self, us: u64) {
        write(COMPARE_HIGH, u32::MAX);
        write(COMPARE_LOW, us as u32);
        write(COMPARE_HIGH, (us >> 32) as u32);
        riscv::asm::wfi();
    }
}

/// Resets the SoC unless it is told in time not to.
pub struct Watchdog;

impl Watchdog {
    /// Keeps it quiet for this long.
    pub fn feed(&mut self, us: u32) {
        write(WATCHDOG, us);
    }

    /// Whether it has reset the SoC; the next call says no.
    pub fn take_bite(&mut self) -> bool {
        let bitten = RESET_CAUSE_WATCHDOG.is_set(read(RESET_CAUSE));
        write(RESET_CAUSE, RESET_CAUSE_WATCHDOG.mask());
        bitten
    }
}
