//! Counts the instructions of each step, with the counter of the CPU, and prints them: `"step" = number`.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use karst_firmware::{RECORDING, exit_success, panicked};
use riscv::register::minstret;
use riscv_rt::entry;
use riscv_semihosting::hprintln;

#[entry]
fn main() -> ! {
    // The low half: no step takes 2^32 instructions
    let instructions = || minstret::read() as u32;
    karst_selftest::costs(RECORDING, instructions, |step, count| hprintln!("\"{}\" = {}", step, count));
    exit_success()
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panicked(info)
}
