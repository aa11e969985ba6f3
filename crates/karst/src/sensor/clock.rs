//! The time that a sensor lives in.

use std::cell::Cell;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// The time in which a sensor's answers are waited for: that of this computer, or that of a simulation, which is slower.
#[derive(Debug, Clone)]
pub struct Clock(Source);

#[derive(Debug, Clone)]
enum Source {
    Computer(Instant),
    Simulation(Rc<Cell<Duration>>),
}

impl Clock {
    /// That of this computer.
    pub fn of_computer() -> Self {
        Self(Source::Computer(Instant::now()))
    }

    /// One that stands still until it is told what time it is; its clones show the same time.
    pub(super) fn of_simulation() -> Self {
        Self(Source::Simulation(Rc::default()))
    }

    /// Time since the clock was made, or since the start of the simulation.
    pub fn now(&self) -> Duration {
        match &self.0 {
            Source::Computer(start) => start.elapsed(),
            Source::Simulation(time) => time.get(),
        }
    }

    pub(super) fn set(&self, now: Duration) {
        if let Source::Simulation(time) = &self.0 {
            time.set(now);
        }
    }
}
