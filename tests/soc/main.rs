//! The sensor as it is built, firmware and gateware, clock by clock. `tests/README.md` says how to run it.

mod faults;
mod frames;
