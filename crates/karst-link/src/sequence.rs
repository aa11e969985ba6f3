//! Sequence numbers: what was lost, came late or came twice.

/// Frames that are remembered.
const WINDOW: u16 = 64;

/// How a frame's number stands to those before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arrival {
    /// The next one after this many missing ones.
    New { missing: u16 },
    /// One that was missing.
    Late,
    /// One that was there already.
    Duplicate,
    /// Far behind: the other end has started again.
    Restart,
}

/// The numbers of the last frames.
#[derive(Debug, Clone)]
pub(crate) struct Sequence {
    seen: Option<Seen>,
}

#[derive(Debug, Clone)]
struct Seen {
    newest: u16,
    /// Bit i: whether `newest - i` was there. What was sent before the first frame is not waited for.
    window: u64,
}

impl Sequence {
    /// Nothing has come.
    pub const NONE: Self = Self { seen: None };

    /// Starts to count at `number`.
    pub fn restart(&mut self, number: u16) {
        self.seen = Some(Seen { newest: number, window: u64::MAX });
    }

    pub fn arrival(&mut self, number: u16) -> Arrival {
        let Some(seen) = &mut self.seen else {
            self.restart(number);
            return Arrival::New { missing: 0 };
        };
        let ahead = number.wrapping_sub(seen.newest);
        let behind = seen.newest.wrapping_sub(number);
        if ahead > 0 && ahead < 1 << 15 {
            seen.window = seen.window.checked_shl(ahead.into()).unwrap_or(0) | 1;
            seen.newest = number;
            Arrival::New { missing: ahead - 1 }
        } else if behind >= WINDOW {
            self.restart(number);
            Arrival::Restart
        } else if seen.window & (1 << behind) == 0 {
            seen.window |= 1 << behind;
            Arrival::Late
        } else {
            Arrival::Duplicate
        }
    }
}
