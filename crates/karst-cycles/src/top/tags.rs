//! `frame_tags.vhd`.

/// A frame: its bank, and whether it is one of a pair.
#[derive(Debug, Clone, Copy, Default)]
pub struct Tag {
    pub bank: usize,
    pub is_paired: bool,
}

#[derive(Debug)]
pub struct Tags {
    tags: [Tag; 2],
    /// Places of the frame that went in last, of the one that masks come of, and of the one that records come of.
    newest: usize,
    masks: usize,
    records: usize,
    unmasked: u32,
    unrecorded: u32,
}

impl Tags {
    pub fn new() -> Self {
        Self { tags: [Tag::default(); 2], newest: 1, masks: 0, records: 0, unmasked: 0, unrecorded: 0 }
    }

    /// `room`.
    pub fn has_room(&self) -> bool {
        self.unmasked < 2 && self.unrecorded < 2
    }

    pub fn of_masks(&self) -> Tag {
        self.tags[self.masks]
    }

    pub fn of_records(&self) -> Tag {
        self.tags[self.records]
    }

    pub fn clock(&mut self, start: Option<usize>, finish: Option<bool>, masked: bool, recorded: bool) {
        if let Some(is_paired) = finish {
            self.tags[self.newest].is_paired = is_paired;
        }
        if let Some(bank) = start {
            self.newest ^= 1;
            self.tags[self.newest].bank = bank;
        }
        self.masks ^= usize::from(masked);
        self.records ^= usize::from(recorded);
        let more = u32::from(start.is_some());
        self.unmasked = self.unmasked + more - u32::from(masked);
        self.unrecorded = self.unrecorded + more - u32::from(recorded);
    }
}
