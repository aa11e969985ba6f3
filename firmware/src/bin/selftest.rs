//! Runs the self-test and writes its messages to standard output (semihosting), framed as on a serial line.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use karst_firmware::{RECORDING, exit_failure, exit_success, panicked};
use karst_link::{Encoder, MAX_FRAME};
use riscv_rt::entry;
use riscv_semihosting::hio;

#[entry]
fn main() -> ! {
    let Ok(mut output) = hio::hstdout() else { exit_failure() };
    let mut encoder = Encoder::new();
    karst_selftest::check(RECORDING, |message| {
        let mut buffer = [0; MAX_FRAME];
        let frame = encoder.encode(&message, &mut buffer);
        if !frame.is_ok_and(|frame| output.write_all(frame).is_ok()) {
            exit_failure();
        }
    });
    exit_success()
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panicked(info)
}
