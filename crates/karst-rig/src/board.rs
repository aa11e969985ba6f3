//! The board that cameras are calibrated with.

use serde::{Deserialize, Serialize};

/// A plane checkerboard, described by its inner corners: the points where four squares meet.
///
/// In the board's frame x runs along the rows of corners and y along the columns, right and down for who looks at its
/// front; z points away from the viewer, into the board. The origin is corner 0, and the square between the origin and
/// the board's edge, at negative x and y, is dark. A board with an odd sum of columns and rows can be told from itself
/// turned by 180 degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// Inner corners along x.
    pub columns: usize,
    /// Inner corners along y.
    pub rows: usize,
    /// Side of a square, mm.
    pub square_mm: f64,
}

impl Board {
    /// Number of inner corners.
    pub fn corners(&self) -> usize {
        self.columns * self.rows
    }

    /// Position of inner corner `index` on the board, mm. Corners count along x, row by row.
    pub fn corner_mm(&self, index: usize) -> [f64; 2] {
        [index % self.columns, index / self.columns].map(|step| step as f64 * self.square_mm)
    }

    /// Whether a point of the board (mm) is in a dark square. The pattern goes on beyond the outer squares.
    pub fn is_dark(&self, [x, y]: [f64; 2]) -> bool {
        let square = |value: f64| (value / self.square_mm).floor() as i64;
        (square(x) + square(y)).rem_euclid(2) == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOARD: Board = Board { columns: 9, rows: 6, square_mm: 60.0 };

    #[test]
    fn corners_count_along_x_row_by_row() {
        assert_eq!(BOARD.corners(), 54);
        assert_eq!(BOARD.corner_mm(0), [0.0, 0.0]);
        assert_eq!(BOARD.corner_mm(8), [480.0, 0.0]);
        assert_eq!(BOARD.corner_mm(9), [0.0, 60.0]);
    }

    #[test]
    fn the_square_outside_of_corner_0_is_dark_and_colours_alternate() {
        assert!(BOARD.is_dark([-1.0, -1.0]) && BOARD.is_dark([1.0, 1.0]));
        assert!(!BOARD.is_dark([1.0, -1.0]) && !BOARD.is_dark([-1.0, 1.0]));
    }

    #[test]
    fn a_board_of_9_by_6_turned_by_180_degrees_has_other_colours() {
        let [x, y] = BOARD.corner_mm(BOARD.corners() - 1);
        assert_ne!(BOARD.is_dark([-1.0, -1.0]), BOARD.is_dark([x + 1.0, y + 1.0]));
    }
}
