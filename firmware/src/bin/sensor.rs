//! The firmware of the sensor: `karst_sensor` on the SoC.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use karst_firmware::soc::Soc;
use karst_firmware::{LASERS, PROGRAM, SPOTS, WATCHDOG_US};
use karst_sensor::{Parts, Sensor, Start};
use riscv_rt::entry;

#[entry]
fn main() -> ! {
    let Soc { ip, uart, lasers, trigger, mut clock, mut watchdog } = Soc::new();
    // The start itself can hang
    watchdog.feed(WATCHDOG_US);
    let start = Start { watchdog: watchdog.take_bite(), program: PROGRAM };
    let mut sensor = Sensor::<_, _, _, _, LASERS, SPOTS>::new(Parts { bus: ip, serial: uart, lasers, trigger }, start);
    loop {
        watchdog.feed(WATCHDOG_US);
        if !sensor.poll(clock.now_us()) {
            clock.sleep_until(sensor.wake_us());
        }
    }
}

/// The watchdog starts the sensor again and tells.
#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    loop {
        riscv::asm::wfi();
    }
}
