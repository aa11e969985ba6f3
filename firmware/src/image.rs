//! What the images share.

use core::fmt::Write;
use core::panic::PanicInfo;

use riscv_semihosting::debug::{self, EXIT_FAILURE, EXIT_SUCCESS};
use riscv_semihosting::hio;

/// A recording for the self-test, as `karst-fwcheck record` writes it.
pub static RECORDING: &[u8] = include_bytes!(env!("KARST_RECORDING"));

/// Ends the simulation.
pub fn exit_success() -> ! {
    loop {
        debug::exit(EXIT_SUCCESS);
    }
}

/// Ends the simulation as a failure.
pub fn exit_failure() -> ! {
    loop {
        debug::exit(EXIT_FAILURE);
    }
}

/// Says on standard error what went wrong, and ends the simulation.
pub fn panicked(info: &PanicInfo) -> ! {
    if let Ok(mut stream) = hio::hstderr() {
        // Without standard error there is still the exit status
        let _ = writeln!(stream, "{info}");
    }
    exit_failure()
}
