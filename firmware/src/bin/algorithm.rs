//! The algorithm alone, from pixels to points, on operands that the compiler does not know: its code size, and that
//! nothing in it can panic.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;

use karst_core::{Calibration, DetectorConfig, Method, Spot, SpotDetector, reconstruct};
use karst_firmware::{exit_failure, exit_success};
use riscv_rt::entry;

const LASERS: usize = 12;

/// Something that is only known at run time.
fn unknown<T>() -> &'static T {
    black_box(None).unwrap_or_else(|| exit_failure())
}

#[entry]
fn main() -> ! {
    let config: &DetectorConfig<LASERS> = unknown();
    let Ok(mut detector) = SpotDetector::<LASERS>::new(config.clone()) else { exit_failure() };
    detector.start_frame();
    let _ = black_box(detector.row(unknown::<&[u8]>()));
    black_box(detector.end_frame());
    black_box(detector.spots(*unknown()));
    let calibration: &Calibration<LASERS> = unknown();
    let spots: &[&[Spot]; 2] = unknown();
    let method: &Method = unknown();
    let _ = black_box(reconstruct(calibration, *unknown(), *spots, *method));
    exit_success()
}

/// Never called: there is no way here, or the check for one has failed.
#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    exit_failure()
}
