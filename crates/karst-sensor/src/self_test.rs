//! What is tried before the first frame.

use karst_link::LogLevel;
use karst_math::{div_round, horner, hypot, sqrt_round};
use karst_regs::{Events, Karst, RegisterBus, map};

use crate::report::Report;

/// Digest of the kernels' results, as a PC computes it.
const KERNELS: u32 = 0x016c_fb25;

/// Operands per kernel.
const OPERANDS: u32 = 64;

/// Digest of the results of the kernels on known operands.
fn kernels() -> u32 {
    let mut state = 0x9e37_79b9_u32;
    let mut word = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state
    };
    let mut digest = 0_u32;
    let mut take = |value: u32| digest = (digest.rotate_left(5) ^ value).wrapping_mul(0x9e37_79b9);
    for _ in 0..OPERANDS {
        let (a, b) = (word() as i32 >> 4, word() as i32 >> 12);
        take(sqrt_round(u64::from(word()) << 20));
        take(hypot(a, b));
        take(div_round(i64::from(a) << 20, i64::from(b)) as u32);
        take(horner(&[a, b, a >> 3], b << 8) as u32);
    }
    digest
}

/// Tries everything, tells what fails, and gets the IP ready.
pub(crate) fn run<B: RegisterBus>(ip: Option<&mut Karst<B>>, report: &mut Report) {
    let mut failed = |text| {
        report.status.errors.self_test = true;
        report.outbox.log(LogLevel::Error, text);
    };
    if kernels() != KERNELS {
        failed("self-test: the arithmetic is wrong");
    }
    let Some(ip) = ip else {
        return failed("self-test: no IP with the register map of this program");
    };
    let tested = ip
        .set_enabled(false)
        .and_then(|()| ip.reset())
        .and_then(|()| ip.clear_counters())
        // From here on an interrupt wakes the caller
        .and_then(|()| ip.set_interrupts(Events::ALL))
        .and_then(|()| memory_holds(ip));
    match (tested, ip.bus().has_failed()) {
        (Ok(true), false) => {}
        (Ok(false), false) => failed("self-test: the settings memory does not hold"),
        (Ok(_), true) | (Err(_), _) => failed("self-test: no access to the registers"),
    }
}

/// Whether the settings memory holds what is written to it. Only before the first calibration: it overwrites a laser's.
fn memory_holds<B: RegisterBus>(ip: &mut Karst<B>) -> Result<bool, B::Error> {
    let pattern = |word: u32, round: u32| (word + round).wrapping_mul(0x9e37_79b9);
    let address = |word| map::settings_laser_origin(0, 0) + 4 * word;
    // The words of a laser's origin and axes
    let words = 0..12;
    for round in 0..2 {
        for word in words.clone() {
            ip.bus().write32(address(word), pattern(word, round))?;
        }
        for word in words.clone() {
            if ip.bus().read32(address(word))? != pattern(word, round) {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_digest_of_the_kernels_is_that_of_this_pc() {
        assert_eq!(kernels(), KERNELS, "{:#010x}", kernels());
    }
}
