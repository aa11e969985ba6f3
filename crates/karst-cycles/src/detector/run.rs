//! `run.vhd`.

use super::{Item, Joined, Placed};

/// Hits of one laser that follow each other in a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pixels {
    pub laser: u16,
    pub x_min: i32,
    pub x_max: i32,
    pub pixels: u32,
    pub green: u32,
}

#[derive(Debug)]
pub struct Run {
    /// The next hit.
    hit: Option<Placed<Joined>>,
    /// The hit behind it, if that has to wait.
    spare: Option<Placed<Joined>>,
    /// The run that is summed, or the end.
    open: Option<Item<Pixels>>,
    /// Of the last hit or news.
    y: i32,
    /// The end of the frame is on its way.
    ending: bool,
    output: Option<Item<Pixels>>,
    output_y: i32,
}

impl Run {
    pub fn new() -> Self {
        Self { hit: None, spare: None, open: None, y: 0, ending: false, output: None, output_y: 0 }
    }

    /// The run, until it is taken.
    pub fn output(&self) -> Option<Item<Pixels>> {
        self.output
    }

    /// Its row; without a run, no later run is above this row.
    pub fn row(&self) -> i32 {
        self.output_y
    }

    fn joins(&self) -> bool {
        matches!(self.hit, Some(Placed { item: Item::Part(Joined { joins: true, .. }), .. }))
    }

    /// The next hit enters a run.
    fn enters(&self, has_news: bool) -> bool {
        self.hit.is_some()
            && !has_news
            && !self.ending
            && (self.joins() || self.open.is_none() || self.output.is_none())
    }

    /// `in_ready`.
    pub fn takes_hit(&self) -> bool {
        self.spare.is_none()
    }

    /// `row_ready`.
    pub fn takes_row(&self, news: Option<i32>) -> bool {
        !self.ending && (self.open.is_none() || news == Some(self.y) || self.output.is_none())
    }

    pub fn clock(&mut self, hit: Option<Placed<Joined>>, news: Option<i32>, is_taken: bool) {
        let is_vacant = self.output.is_none();
        let enters = self.enters(news.is_some());
        let moves = enters || self.hit.is_none();
        let takes_row = self.takes_row(news);
        let is_complete = self.open == Some(Item::End)
            || match news {
                Some(row) => row != self.y,
                None => self.hit.is_some() && !self.joins(),
            };
        if is_vacant {
            self.output_y = self.y;
            if is_complete {
                self.output = self.open.take();
            }
        } else if is_taken {
            if self.output == Some(Item::End) {
                self.ending = false;
            }
            self.output = None;
        }
        if let Some(row) = news.filter(|_| takes_row) {
            self.y = row;
        }
        if let Some(Placed { row, item }) = self.hit.filter(|_| enters) {
            self.y = row;
            match item {
                Item::End => {
                    self.ending = true;
                    self.open = Some(Item::End);
                }
                Item::Part(Joined { hit, joins }) if hit.accepted => {
                    let x = i32::from(hit.x);
                    let one = Pixels { laser: hit.laser, x_min: x, x_max: x, pixels: 1, green: hit.green.into() };
                    self.open = Some(Item::Part(match self.open {
                        Some(Item::Part(run)) if joins => {
                            Pixels { x_max: x, pixels: run.pixels + 1, green: run.green + one.green, ..run }
                        }
                        _ => one,
                    }));
                }
                Item::Part(_) => {}
            }
        }
        if moves {
            self.hit = self.spare.take().or(hit);
        } else if self.takes_hit() {
            self.spare = hit;
        }
    }
}
