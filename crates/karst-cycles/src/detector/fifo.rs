//! `fifo.vhd`.

use std::collections::VecDeque;

#[derive(Debug)]
pub struct Fifo<T> {
    depth: usize,
    margin: usize,
    words: VecDeque<T>,
    fetched: Option<T>,
    output: Option<T>,
    room: bool,
}

impl<T> Fifo<T> {
    pub fn new(depth: usize, margin: usize) -> Self {
        Self { depth, margin, words: VecDeque::new(), fetched: None, output: None, room: true }
    }

    /// The oldest word.
    pub fn first(&self) -> Option<&T> {
        self.output.as_ref()
    }

    /// `room`: at least the margin fits.
    pub fn has_room(&self) -> bool {
        self.room
    }

    pub fn clock(&mut self, word: Option<T>, is_taken: bool) {
        self.room = self.words.len() + self.margin <= self.depth;
        let moves = is_taken || self.output.is_none();
        let reads = !self.words.is_empty() && (moves || self.fetched.is_none());
        if moves {
            self.output = self.fetched.take();
        }
        if reads {
            self.fetched = self.words.pop_front();
        }
        self.words.extend(word);
    }
}
