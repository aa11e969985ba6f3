//! The corners of a checkerboard in an omnidirectional picture.
//!
//! Candidates come from a detector of isolated corners. What makes them a board is written for pictures in which nothing
//! is straight: the grid grows cell by cell, each predicted from its neighbours only.

use std::collections::HashMap;
use std::ops::RangeInclusive;

use chess_corners::{ChessError, CornerDescriptor, Detector, DetectorConfig, UpscaleConfig};
use image::GrayImage;
use karst_rig::Board;
use nalgebra::Vector2;

use crate::{Corner, initial::median, saddle::refine};

/// Corners along a side of a board.
const SIDE: RangeInclusive<usize> = 3..=200;
/// Smallest picture with a board, px.
const LEAST_PICTURE_PX: u32 = 16;
/// Candidates looked at: this many for each corner of the board, the strongest.
const CANDIDATES_PER_CORNER: usize = 10;
/// A neighbour of a seed lies within this angle of one of its edges: sine.
const SEED_ANGLE_SIN: f64 = 0.42;
/// Dark sectors of neighbours are across one another: least sine of the angle between them.
const ACROSS_SIN: f64 = 0.7;
/// The four neighbours of a seed are about as far: largest ratio.
const SEED_RATIO: f64 = 2.5;
/// A corner is within this part of the step to it from where its neighbours predict it.
const PREDICTION_PART: f64 = 0.35;
/// An outer row of which less than this part was found is not one.
const ROW_PART: f64 = 0.6;
/// Part of the board's corners that may be missing.
const MISSING_PART: f64 = 0.1;
/// Corners have at least this part of the median contrast of the eight around them.
const CONTRAST_PART: f64 = 0.25;

/// Why a board was not found.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NotFound {
    /// The board has too few or too many corners along a side.
    #[error("a board of {columns} x {rows} corners, expected 3 to 200 along each side")]
    BoardSize {
        /// Corners along x.
        columns: usize,
        /// Corners along y.
        rows: usize,
    },
    /// Nothing in the picture looks like a checkerboard.
    #[error("no checkerboard among {candidates} candidates for corners")]
    NoBoard {
        /// Candidates.
        candidates: usize,
    },
    /// There is a checkerboard, but not with these corners.
    #[error(
        "{found} corners of a grid of {} x {}, expected all of {} x {} (of {candidates} candidates)",
        grid[0], grid[1], expected[0], expected[1]
    )]
    OtherGrid {
        /// Candidates.
        candidates: usize,
        /// Corners found.
        found: usize,
        /// Corners along both sides of the largest grid found, the more first.
        grid: [usize; 2],
        /// Those of the board, the more first.
        expected: [usize; 2],
    },
    /// Corners of the grid do not look like corners of a checkerboard.
    #[error("a grid of {} x {} corners, of which {unclear} are unclear: hidden, glare or blur?", grid[0], grid[1])]
    Unclear {
        /// Corners along both sides, the more first.
        grid: [usize; 2],
        /// How many corners.
        unclear: usize,
    },
}

impl NotFound {
    /// Corners it got to, to tell the best of several attempts.
    fn progress(&self) -> usize {
        match self {
            Self::BoardSize { .. } | Self::NoBoard { .. } => 0,
            Self::OtherGrid { found, .. } => *found,
            Self::Unclear { grid, .. } => grid[0] * grid[1],
        }
    }
}

/// Finds the corners of a board in a picture, to a few hundredths of a pixel where the picture is sharp. Squares must be at
/// least about 6 px across, the board at least 3 x 3 corners, and nine tenths of the corners in sight, among them most of
/// each outer row and column: the others are left out.
///
/// Corners come in the order of [`Board`], as if the picture were not mirrored: the board's x turns into its y clockwise.
/// Of the numberings that this leaves, the one with the dark square outside of corner 0 counts. Where that does not decide
/// (even sum of columns and rows), corner 0 is the one nearest to the top left of the picture (least column + row).
pub fn find_corners(picture: &GrayImage, board: &Board) -> Result<Vec<Corner>, NotFound> {
    let (columns, rows) = (board.columns, board.rows);
    if !(SIDE.contains(&columns) && SIDE.contains(&rows)) {
        return Err(NotFound::BoardSize { columns, rows });
    }
    let mut best = NotFound::NoBoard { candidates: 0 };
    // No room for a board, and the detector of candidates (2.1.0) would panic.
    if picture.width().min(picture.height()) < LEAST_PICTURE_PX {
        return Err(best);
    }
    // Twice enlarged, small squares are found; as it is, blurred ones.
    for upscale in [UpscaleConfig::Disabled, UpscaleConfig::Fixed(2)] {
        let mut config = DetectorConfig::chess();
        config.upscale = upscale;
        // Errors are those of the configuration: it has none.
        let candidates = candidates(picture, config).unwrap_or_default();
        match find_among(picture, candidates, board) {
            Ok(corners) => return Ok(corners),
            Err(error) if error.progress() >= best.progress() => best = error,
            Err(_) => {}
        }
    }
    Err(best)
}

/// What may be a corner.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    pixel: Vector2<f64>,
    /// Unit vectors along its two edges; from the first to the second, clockwise in the picture, is dark.
    edges: [Vector2<f64>; 2],
}

impl Candidate {
    fn new(corner: &CornerDescriptor) -> Option<Self> {
        let direction = |angle: f32| Vector2::new(f64::from(angle).cos(), f64::from(angle).sin());
        let [first, second] = corner.axes?;
        let edges = [direction(first.angle), direction(second.angle)];
        Some(Self { pixel: Vector2::new(corner.x.into(), corner.y.into()), edges })
    }

    /// Whether the other one has dark where this one has bright, as neighbours do.
    fn is_across(&self, other: &Self) -> bool {
        let dark = |candidate: &Self| candidate.edges[0] + candidate.edges[1];
        let (a, b) = (dark(self), dark(other));
        a.perp(&b).abs() >= ACROSS_SIN * a.norm() * b.norm()
    }
}

/// The candidates, the strongest first.
fn candidates(picture: &GrayImage, config: DetectorConfig) -> Result<Vec<Candidate>, ChessError> {
    let mut corners = Detector::new(config)?.detect(picture)?;
    corners.sort_by(|a, b| b.response.total_cmp(&a.response));
    Ok(corners.iter().filter_map(Candidate::new).collect())
}

fn find_among(picture: &GrayImage, mut candidates: Vec<Candidate>, board: &Board) -> Result<Vec<Corner>, NotFound> {
    let count = candidates.len();
    candidates.truncate(CANDIDATES_PER_CORNER * board.corners());
    let mut best: Option<Grid> = None;
    let mut used = vec![false; candidates.len()];
    for seed in 0..candidates.len() {
        if used[seed] {
            continue;
        }
        let Some(mut grid) = Grid::seeded(&candidates, seed) else { continue };
        grid.grow(&candidates);
        for &cell in grid.cells.values() {
            used[cell] = true;
        }
        grid.drop_sparse_rows();
        if best.as_ref().is_none_or(|best| best.cells.len() < grid.cells.len()) {
            best = Some(grid);
        }
    }
    let grid = best.ok_or(NotFound::NoBoard { candidates: count })?;
    let size = grid.size();
    let sorted = |mut size: [usize; 2]| {
        size.sort_unstable_by(|a, b| b.cmp(a));
        size
    };
    let expected = sorted([board.columns, board.rows]);
    let missing = board.corners() as f64 - grid.cells.len() as f64;
    if sorted(size) != expected || missing > MISSING_PART * board.corners() as f64 {
        let (found, grid) = (grid.cells.len(), sorted(size));
        return Err(NotFound::OtherGrid { candidates: count, found, grid, expected });
    }
    let unclear = |unclear| NotFound::Unclear { grid: expected, unclear };
    let mut pixels = grid.pixels(&candidates).ok_or(unclear(board.corners() - grid.cells.len()))?;
    let mut contrasts = vec![0.0; pixels.len()];
    // The second time the shape of the grid comes from better corners.
    for _ in 0..2 {
        let refined: Vec<_> = (0..pixels.len()).map(|index| refine(picture, &pixels, size[0], index)).collect();
        for ((pixel, contrast), corner) in pixels.iter_mut().zip(&mut contrasts).zip(refined) {
            *contrast = corner.as_ref().map_or(0.0, |corner| corner.contrast);
            *pixel = corner.map_or(*pixel, |corner| corner.pixel);
        }
    }
    // As if every corner were bright towards lower x and y.
    for (index, contrast) in contrasts.iter_mut().enumerate() {
        *contrast *= if (index % size[0] + index / size[0]).is_multiple_of(2) { 1.0 } else { -1.0 };
    }
    let bright = contrasts.iter().sum::<f64>() > 0.0;
    if !bright {
        contrasts.iter_mut().for_each(|contrast| *contrast = -*contrast);
    }
    let clear: Vec<bool> = (0..pixels.len()).map(|index| is_clear(&contrasts, size[0], index)).collect();
    let lost = clear.iter().filter(|clear| !**clear).count();
    if lost as f64 > MISSING_PART * board.corners() as f64 {
        return Err(unclear(lost));
    }
    Ok(number(&pixels, &clear, bright, size, board))
}

/// Whether a corner has about the contrast of those around it. Below 0 are the wrong colours.
fn is_clear(contrasts: &[f64], width: usize, index: usize) -> bool {
    let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
    let rows = near(index / width, contrasts.len() / width);
    let around = rows.flat_map(|y| near(index % width, width).map(move |x| contrasts[y * width + x]));
    let median = median(around.collect());
    contrasts[index] > 0.0 && contrasts[index] >= CONTRAST_PART * median
}

/// Where a corner of the board is in a grid whose last column and row are given.
type Turn = fn([usize; 2], [usize; 2]) -> [usize; 2];

/// The clear corners in the order of the board. `bright`: the square outside of the grid's first corner is.
fn number(
    pixels: &[Vector2<f64>],
    clear: &[bool],
    bright: bool,
    [width, height]: [usize; 2],
    board: &Board,
) -> Vec<Corner> {
    let turns: [Turn; 4] = [
        |[x, y], _| [x, y],
        |[x, y], last| [last[0] - x, last[1] - y],
        |[x, y], last| [y, last[1] - x],
        |[x, y], last| [last[0] - y, x],
    ];
    let turns = if width == height {
        &turns[..]
    } else if width == board.columns {
        &turns[..2]
    } else {
        &turns[2..]
    };
    let last = [width - 1, height - 1];
    // Dark comes first, then the top left.
    let rank = |turn: Turn| {
        let [x, y] = turn([0, 0], last);
        let quarter = turn([1, 0], last)[1] != y;
        // The colour outside of a corner changes with every step, and with every quarter turn.
        let dark = bright ^ (x + y).is_multiple_of(2) ^ quarter;
        (!dark, pixels[y * width + x].sum())
    };
    let turn = turns.iter().copied().fold(turns[0], |best, turn| if rank(turn) < rank(best) { turn } else { best });
    let corner = |index: usize| {
        let [x, y] = turn([index % board.columns, index / board.columns], last);
        let at = y * width + x;
        clear[at].then(|| Corner { index, board_mm: board.corner_mm(index), pixel: pixels[at].into() })
    };
    (0..board.corners()).filter_map(corner).collect()
}

/// Candidates in the cells of a grid whose x turns into its y clockwise in the picture.
struct Grid {
    cells: HashMap<[i32; 2], usize>,
}

/// The four directions of a grid.
const DIRECTIONS: [[i32; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

fn step([x, y]: [i32; 2], [dx, dy]: [i32; 2], times: i32) -> [i32; 2] {
    [x + times * dx, y + times * dy]
}

impl Grid {
    /// A candidate with a neighbour along each of its edges.
    fn seeded(candidates: &[Candidate], seed: usize) -> Option<Self> {
        let centre = &candidates[seed];
        let [a, b] = centre.edges;
        let b = if a.perp(&b) > 0.0 { b } else { -b };
        let mut cells = HashMap::from([([0, 0], seed)]);
        let (mut nearest, mut farthest) = (f64::INFINITY, 0.0_f64);
        for (cell, direction) in DIRECTIONS.into_iter().zip([a, b, -a, -b]) {
            let distance = |other: &Candidate| {
                let offset = other.pixel - centre.pixel;
                let along =
                    offset.dot(&direction) > 0.0 && offset.perp(&direction).abs() < SEED_ANGLE_SIN * offset.norm();
                (along && centre.is_across(other)).then(|| offset.norm())
            };
            let distances = candidates.iter().enumerate().filter_map(|(index, other)| Some((index, distance(other)?)));
            let (index, distance) = distances.min_by(|a, b| a.1.total_cmp(&b.1))?;
            (nearest, farthest) = (nearest.min(distance), farthest.max(distance));
            cells.insert(cell, index);
        }
        (farthest <= SEED_RATIO * nearest).then_some(Self { cells })
    }

    /// Where the neighbours in `direction` predict an empty cell, and how far the step to it is.
    fn predict_along(
        &self,
        pixel: &impl Fn([i32; 2]) -> Option<Vector2<f64>>,
        cell: [i32; 2],
        direction: [i32; 2],
    ) -> Option<(Vector2<f64>, f64)> {
        let back = |times: i32| pixel(step(cell, direction, -times));
        let first = back(1)?;
        let mut predictions = Vec::new();
        if let Some(second) = back(2) {
            predictions.push(match back(3) {
                Some(third) => 3.0 * (first - second) + third,
                None => 2.0 * first - second,
            });
        }
        for side in [[direction[1], direction[0]], [-direction[1], -direction[0]]] {
            if let (Some(beside), Some(before)) =
                (pixel(step(cell, side, 1)), pixel(step(step(cell, side, 1), direction, -1)))
            {
                predictions.push(first + beside - before);
            }
        }
        let mean = predictions.iter().sum::<Vector2<f64>>() / predictions.len() as f64;
        (!predictions.is_empty()).then(|| (mean, (mean - first).norm()))
    }

    /// Where the neighbours predict an empty cell, and how far the shortest step to it is.
    fn predict(
        &self,
        pixel: &impl Fn([i32; 2]) -> Option<Vector2<f64>>,
        cell: [i32; 2],
    ) -> Option<(Vector2<f64>, f64)> {
        let all: Vec<_> =
            DIRECTIONS.iter().filter_map(|&direction| self.predict_along(pixel, cell, direction)).collect();
        let mean = all.iter().map(|(prediction, _)| prediction).sum::<Vector2<f64>>() / all.len() as f64;
        let distance = all.iter().map(|(_, distance)| *distance).fold(f64::INFINITY, f64::min);
        (!all.is_empty()).then_some((mean, distance))
    }

    /// Adds candidates where the grid goes on.
    fn grow(&mut self, candidates: &[Candidate]) {
        let mut taken = vec![false; candidates.len()];
        for &index in self.cells.values() {
            taken[index] = true;
        }
        loop {
            let mut border: Vec<[i32; 2]> = self
                .cells
                .keys()
                .flat_map(|&cell| DIRECTIONS.map(|direction| step(cell, direction, 1)))
                .filter(|cell| !self.cells.contains_key(cell))
                .collect();
            border.sort_unstable();
            border.dedup();
            let pixel = |cell: [i32; 2]| self.cells.get(&cell).map(|&index| candidates[index].pixel);
            // The best one first: predictions get better with the neighbours they come from.
            let mut best: Option<(f64, [i32; 2], usize)> = None;
            for cell in border {
                let Some((prediction, distance)) = self.predict(&pixel, cell) else { continue };
                let neighbours = DIRECTIONS.map(|direction| self.cells.get(&step(cell, direction, 1)));
                for (index, candidate) in candidates.iter().enumerate().filter(|(index, _)| !taken[*index]) {
                    let off = (candidate.pixel - prediction).norm() / distance;
                    let fits = || neighbours.iter().flatten().all(|&&other| candidates[other].is_across(candidate));
                    if off < best.map_or(PREDICTION_PART, |(least, ..)| least) && fits() {
                        best = Some((off, cell, index));
                    }
                }
            }
            let Some((_, cell, index)) = best else { return };
            self.cells.insert(cell, index);
            taken[index] = true;
        }
    }

    /// First and last column, first and last row.
    fn range(&self, axis: usize) -> (i32, i32) {
        let start = (i32::MAX, i32::MIN);
        self.cells.keys().fold(start, |(least, most), cell| (least.min(cell[axis]), most.max(cell[axis])))
    }

    /// Columns and rows.
    fn size(&self) -> [usize; 2] {
        [0, 1].map(|axis| {
            let (first, last) = self.range(axis);
            (last - first + 1) as usize
        })
    }

    /// Drops what grew out of the board: outer rows and columns that are mostly empty.
    fn drop_sparse_rows(&mut self) {
        loop {
            let size = self.size();
            let ends = [0, 1].into_iter().flat_map(|axis| {
                let (first, last) = self.range(axis);
                [(axis, first), (axis, last)]
            });
            let part = |(axis, at): (usize, i32)| {
                let found = self.cells.keys().filter(|cell| cell[axis] == at).count();
                found as f64 / size[1 - axis] as f64
            };
            let sparsest = ends.map(|end| (part(end), end)).min_by(|a, b| a.0.total_cmp(&b.0));
            match sparsest {
                Some((part, (axis, at))) if part < ROW_PART && self.cells.len() > 1 => {
                    self.cells.retain(|cell, _| cell[axis] != at);
                }
                _ => return,
            }
        }
    }

    /// The pixels of all cells row by row, those of empty cells as predicted. None if one cannot be predicted.
    fn pixels(&self, candidates: &[Candidate]) -> Option<Vec<Vector2<f64>>> {
        let (left, right) = self.range(0);
        let (top, bottom) = self.range(1);
        let pixel = |cell: [i32; 2]| self.cells.get(&cell).map(|&index| candidates[index].pixel);
        let cells = (top..=bottom).flat_map(|y| (left..=right).map(move |x| [x, y]));
        cells.map(|cell| pixel(cell).or_else(|| Some(self.predict(&pixel, cell)?.0))).collect()
    }
}
