//! Exposures.

use embedded_hal::digital::OutputPin;

/// How long the trigger stays high, microseconds.
const PULSE_US: u64 = 100;

/// Gives a pulse per period.
pub(crate) struct Trigger<P> {
    pin: P,
    period_us: u32,
    next_us: u64,
    low_at_us: Option<u64>,
}

impl<P: OutputPin> Trigger<P> {
    pub fn new(pin: P) -> Self {
        Self { pin, period_us: 0, next_us: 0, low_at_us: None }
    }

    /// Zero: no pulses.
    pub fn set_period(&mut self, period_us: u32, now_us: u64) {
        if period_us != self.period_us {
            self.period_us = period_us;
            self.next_us = now_us;
        }
    }

    /// Switches the pin when it is time.
    pub fn poll(&mut self, now_us: u64) -> Result<(), P::Error> {
        if self.low_at_us.is_some_and(|time| now_us >= time) {
            self.pin.set_low()?;
            self.low_at_us = None;
        }
        if self.period_us != 0 && now_us >= self.next_us {
            self.pin.set_high()?;
            self.low_at_us = Some(now_us + PULSE_US);
            // Exposures that were missed are not made up for
            self.next_us = (self.next_us + u64::from(self.period_us)).max(now_us);
        }
        Ok(())
    }

    /// When it is time again.
    pub fn wake_us(&self) -> Option<u64> {
        let next = (self.period_us != 0).then_some(self.next_us);
        [next, self.low_at_us].into_iter().flatten().min()
    }
}
