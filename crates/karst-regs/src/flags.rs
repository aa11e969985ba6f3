//! Sets of flags: registers in which every bit has a meaning of its own.

use crate::{Field, map};

macro_rules! flags {
    ($(#[$documentation:meta])* $name:ident: $($(#[$meaning:meta])* $function:ident = $field:ident,)*) => {
        $(#[$documentation])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub struct $name {
            bits: u32,
        }

        impl $name {
            /// From the register.
            pub const fn from_bits(bits: u32) -> Self {
                Self { bits }
            }

            /// As in the register.
            pub const fn bits(self) -> u32 {
                self.bits
            }

            /// Whether no flag is set.
            pub const fn is_empty(self) -> bool {
                self.bits == 0
            }

            $(
                $(#[$meaning])*
                pub const fn $function(self) -> bool {
                    map::$field.is_set(self.bits)
                }
            )*
        }
    };
}

flags! {
    /// Events that can raise the interrupt.
    Events:
    /// A frame's results were made ready.
    ready = INTERRUPT_STATUS_READY,
    /// A commit took effect.
    committed = INTERRUPT_STATUS_COMMITTED,
    /// A fault was found.
    fault = INTERRUPT_STATUS_FAULT,
}

impl Events {
    /// All of them.
    pub const ALL: Self = Self {
        bits: map::INTERRUPT_STATUS_READY.mask()
            | map::INTERRUPT_STATUS_COMMITTED.mask()
            | map::INTERRUPT_STATUS_FAULT.mask(),
    };
    /// A frame's results were made ready.
    pub const READY: Self = Self { bits: map::INTERRUPT_STATUS_READY.mask() };
}

flags! {
    /// What went wrong.
    Faults:
    /// Results were overwritten before they could be read.
    missed = FAULT_MISSED,
    /// A frame of one camera had no partner.
    unpaired = FAULT_UNPAIRED,
    /// A frame was not taken because a commit was under way.
    skipped = FAULT_SKIPPED,
    /// A write to the settings memory was ignored because a commit was under way.
    refused = FAULT_REFUSED,
}

/// Of camera 0 and camera 1.
const SHORT_ROW: [Field; 2] = [map::FAULT_SHORT_ROW_1, map::FAULT_SHORT_ROW_2];
const LONG_ROW: [Field; 2] = [map::FAULT_LONG_ROW_1, map::FAULT_LONG_ROW_2];
const TRUNCATED: [Field; 2] = [map::FAULT_TRUNCATED_1, map::FAULT_TRUNCATED_2];
const STRAY_ROW: [Field; 2] = [map::FAULT_STRAY_ROW_1, map::FAULT_STRAY_ROW_2];
const OVERFLOW: [Field; 2] = [map::FAULT_OVERFLOW_1, map::FAULT_OVERFLOW_2];

impl Faults {
    /// A row of `camera` (0 or 1) ended before the width.
    pub fn short_row(self, camera: usize) -> bool {
        SHORT_ROW[camera].is_set(self.bits)
    }

    /// A row of `camera` (0 or 1) went on beyond the width.
    pub fn long_row(self, camera: usize) -> bool {
        LONG_ROW[camera].is_set(self.bits)
    }

    /// A frame of `camera` (0 or 1) ended before its last row.
    pub fn truncated(self, camera: usize) -> bool {
        TRUNCATED[camera].is_set(self.bits)
    }

    /// A row of `camera` (0 or 1) came outside a frame: after the last one, or the start of frame is missing.
    pub fn stray_row(self, camera: usize) -> bool {
        STRAY_ROW[camera].is_set(self.bits)
    }

    /// Hits of `camera` (0 or 1) were lost because a sector had more clusters than slots.
    pub fn overflow(self, camera: usize) -> bool {
        OVERFLOW[camera].is_set(self.bits)
    }
}
