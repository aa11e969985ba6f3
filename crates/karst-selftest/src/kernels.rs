//! The kernels of karst-math on random operands.

use core::fmt::Write;

use karst_link::{Log, LogLevel, LogText};
use karst_math::{azimuth, div_round, horner, horner_with_derivative, hypot, sqrt_floor, sqrt_round};

/// Operands per kernel.
const OPERANDS: u32 = 2000;

/// Pseudo-random numbers (xorshift) of random length, so that small ones are not rare.
pub(crate) struct Random(u32);

impl Random {
    pub fn new() -> Self {
        Self(0x9e37_79b9)
    }

    fn word(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }

    pub fn u64(&mut self) -> u64 {
        let bits = u64::from(self.word()) << 32 | u64::from(self.word());
        bits >> (self.word() >> 26)
    }

    pub fn i64(&mut self) -> i64 {
        let magnitude = self.u64() as i64;
        if self.word() & 1 == 0 { magnitude } else { magnitude.wrapping_neg() }
    }

    pub fn i32(&mut self) -> i32 {
        let bits = self.word();
        bits as i32 >> (self.word() >> 27)
    }
}

/// Sends a digest of the results of each kernel.
pub(crate) fn check(mut send: impl FnMut(Log)) {
    let mut digest = |name: &str, kernel: fn(&mut Random) -> u64| {
        let mut random = Random::new();
        let digest = (0..OPERANDS)
            .fold(0_u64, |digest, _| (digest.rotate_left(7) ^ kernel(&mut random)).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let mut text = LogText::new();
        // All names fit
        let _ = write!(text, "{name} {digest:016x}");
        send(Log { level: LogLevel::Info, text });
    };
    digest("sqrt_floor", |random| sqrt_floor(random.u64()).into());
    digest("sqrt_round", |random| sqrt_round(random.u64()).into());
    digest("hypot", |random| hypot(random.i32(), random.i32()).into());
    digest("div_round", |random| div_round(random.i64(), random.i64()) as u64);
    digest("horner", |random| {
        let coefficients: [i32; 5] = core::array::from_fn(|_| random.i32());
        horner(&coefficients, random.i32()) as u64
    });
    digest("horner_with_derivative", |random| {
        let coefficients: [i32; 5] = core::array::from_fn(|_| random.i32());
        let (value, derivative) = horner_with_derivative(&coefficients, random.i32());
        value as u64 ^ (derivative as u64).rotate_left(32)
    });
    digest("azimuth", |random| azimuth(random.i32(), random.i32()).into());
}
