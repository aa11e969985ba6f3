//! Corners of a checkerboard in a picture, however bent by mirror, lens and water.
//!
//! An inner corner is a saddle of brightness: two dark and two bright quadrants. Saddles are found at several scales, joined
//! to a grid step by step (each next corner where the ones before lead, with dark and bright exchanged), and placed to a
//! fraction of a pixel: there, every gradient in the neighbourhood points along an edge through the corner.

use std::collections::HashMap;

use image::{GrayImage, ImageBuffer, Luma, imageops};
use imageproc::filter::gaussian_blur_f32;
use karst_rig::Board;
use nalgebra::{Matrix2, Vector2};

use crate::Corner;

/// Magnifications of the picture at which corners are sought: small squares need a larger picture, blurred ones a smaller.
const SCALES: [f32; 3] = [1.0, 2.0, 0.5];
/// Smoothing before saddles are sought, px at the scale of the search.
const SADDLE_SIGMA_PX: f32 = 1.2;
/// Radius of the ring around a saddle on which dark and bright quadrants are looked at, px at the scale of the search.
const RING_PX: f32 = 3.0;
/// Points on the ring.
const RING_POINTS: usize = 24;
/// Part of the variance on the ring that two dark and two bright quadrants make up at least.
const QUADRANTS: f32 = 0.6;
/// Difference between dark and bright at least, grey levels: more than noise.
const MIN_CONTRAST: f32 = 6.0;
/// Saddles that are looked at, the strongest first.
const MAX_SADDLES: usize = 4000;
/// Saddles from which a grid is tried to grow.
const MAX_SEEDS: usize = 60;
/// How far the next corner may be from where the ones before lead, as part of the step.
const STEP_TOLERANCE: f32 = 0.35;
/// Part of the board's corners that have to be found.
const MIN_SHARE: f64 = 0.8;
/// Corners that the right part of a grid has more than any other.
const MIN_LEAD: usize = 2;
/// Passes of the placement of a corner, and the step at which it is complete, px.
const PLACE_PASSES: usize = 20;
const PLACED_PX: f64 = 1e-3;
/// How far a corner may be placed from where the saddle was, as part of the window's radius.
const MOST_MOVED: f64 = 0.5;
/// Window of the placement as part of the distance to the next corner, and its limits, px.
const WINDOW_PART: f64 = 0.45;
const WINDOW_PX: [f64; 2] = [2.0, 7.0];

/// Why the corners of the board were not found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NotFound {
    /// Nothing that looks like a board.
    #[error("no checkerboard found ({saddles} places look like corners)")]
    NoBoard {
        /// Saddles of brightness.
        saddles: usize,
    },
    /// A board of another size, or a part of the board.
    #[error(
        "found {found} corners in a grid of {columns} x {rows}, expected {} x {} corners: another board, or partly hidden",
        board.0, board.1
    )]
    OtherGrid {
        /// Corners of the largest grid.
        found: usize,
        /// Its longer side.
        columns: usize,
        /// Its shorter side.
        rows: usize,
        /// Columns and rows of the board.
        board: (usize, usize),
    },
}

/// Finds the inner corners of a board. At least four fifths of them must be seen, among them some of each outer row and
/// column.
///
/// Pictures must not be mirrored: x right and y down on the board appear in this order. A board with an odd sum of columns
/// and rows gets the numbers of [`Board`] by its colours; of any other, either end may become the origin.
pub fn find_corners(picture: &GrayImage, board: &Board) -> Result<Vec<Corner>, NotFound> {
    let mut best = Err(NotFound::NoBoard { saddles: 0 });
    for scale in SCALES {
        let scaled = rescaled(picture, scale);
        let saddles = Saddles::find(&scaled);
        let result = match saddles.largest_grid(board) {
            Some(grid) => saddles.number(&grid, board),
            None => Err(NotFound::NoBoard { saddles: saddles.list.len() }),
        };
        match result {
            Ok(corners) => {
                let scale = f64::from(scale);
                let seen = corners.into_iter().map(|(index, place)| {
                    let place = place.map(f64::from);
                    // Pixel centres of both pictures: whole numbers at the middle of each pixel.
                    (index, ((place + Vector2::repeat(0.5)) / scale) - Vector2::repeat(0.5))
                });
                return Ok(placed(picture, board, seen.collect()));
            }
            Err(error) => best = further(best, error),
        }
    }
    best
}

/// The error of the search that got further.
fn further(best: Result<Vec<Corner>, NotFound>, error: NotFound) -> Result<Vec<Corner>, NotFound> {
    let got = |error: &NotFound| match error {
        NotFound::NoBoard { saddles } => (0, *saddles),
        NotFound::OtherGrid { found, .. } => (1, *found),
    };
    match best {
        Err(before) if got(&before) >= got(&error) => Err(before),
        _ => Err(error),
    }
}

type Float = ImageBuffer<Luma<f32>, Vec<f32>>;

fn rescaled(picture: &GrayImage, scale: f32) -> Float {
    let size = |length: u32| ((length as f32 * scale).round() as u32).max(1);
    let float = Float::from_fn(picture.width(), picture.height(), |x, y| Luma([f32::from(picture.get_pixel(x, y)[0])]));
    if scale == 1.0 {
        return float;
    }
    imageops::resize(&float, size(picture.width()), size(picture.height()), imageops::FilterType::CatmullRom)
}

/// A place with two dark and two bright quadrants.
#[derive(Debug, Clone, Copy)]
struct Saddle {
    place: Vector2<f32>,
    strength: f32,
    /// Twice the angle of the bright axis, as a unit vector.
    bright: Vector2<f32>,
}

struct Saddles {
    list: Vec<Saddle>,
    /// Indices by cell of `CELL_PX`, for the search around a place.
    cells: HashMap<(i32, i32), Vec<usize>>,
}

/// Side of a cell, px.
const CELL_PX: f32 = 16.0;

fn cell(place: Vector2<f32>) -> (i32, i32) {
    ((place.x / CELL_PX).floor() as i32, (place.y / CELL_PX).floor() as i32)
}

/// Corners by column and row of a grid that started anywhere.
type Grid = HashMap<(i32, i32), usize>;

impl Saddles {
    fn find(picture: &Float) -> Self {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let smooth = gaussian_blur_f32(picture, SADDLE_SIGMA_PX);
        let at = |x: usize, y: usize| smooth.as_raw()[y * width + x];
        let mut strengths = vec![0.0_f32; width * height];
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                let xx = at(x + 1, y) + at(x - 1, y) - 2.0 * at(x, y);
                let yy = at(x, y + 1) + at(x, y - 1) - 2.0 * at(x, y);
                let xy = 0.25 * (at(x + 1, y + 1) + at(x - 1, y - 1) - at(x + 1, y - 1) - at(x - 1, y + 1));
                strengths[y * width + x] = (xy * xy - xx * yy).max(0.0);
            }
        }
        let mut list = Vec::new();
        let margin = RING_PX.ceil() as usize + 1;
        for y in margin..height.saturating_sub(margin) {
            for x in margin..width.saturating_sub(margin) {
                let strength = strengths[y * width + x];
                let peak = strength > 0.0
                    && (y - 2..=y + 2).all(|v| {
                        // Of equal neighbours the first one counts.
                        (x - 2..=x + 2).all(|u| {
                            let other = strengths[v * width + u];
                            if (v, u) < (y, x) { strength > other } else { strength >= other }
                        })
                    });
                if peak && let Some(bright) = quadrants(&smooth, x as f32, y as f32) {
                    list.push(Saddle { place: Vector2::new(x as f32, y as f32), strength, bright });
                }
            }
        }
        list.sort_by(|a, b| b.strength.total_cmp(&a.strength));
        list.truncate(MAX_SADDLES);
        let mut cells: HashMap<_, Vec<usize>> = HashMap::new();
        for (index, saddle) in list.iter().enumerate() {
            cells.entry(cell(saddle.place)).or_default().push(index);
        }
        Self { list, cells }
    }

    /// Saddles within a distance of a place.
    fn around(&self, place: Vector2<f32>, distance: f32) -> impl Iterator<Item = usize> {
        let (from, to) = (cell(place - Vector2::repeat(distance)), cell(place + Vector2::repeat(distance)));
        let cells = (from.1..=to.1).flat_map(move |y| (from.0..=to.0).map(move |x| (x, y)));
        let inside = move |index: &usize| (self.list[*index].place - place).norm() <= distance;
        cells.filter_map(|cell| self.cells.get(&cell)).flatten().copied().filter(inside)
    }

    /// The grid with the most corners, among those that grow from the strongest saddles. None: none grows.
    fn largest_grid(&self, board: &Board) -> Option<Grid> {
        let mut best: Option<Grid> = None;
        let mut used = vec![false; self.list.len()];
        let mut seeds = 0;
        for seed in 0..self.list.len() {
            if used[seed] || seeds >= MAX_SEEDS {
                continue;
            }
            let Some(grid) = self.start(seed).map(|grid| self.grow(grid, board)) else { continue };
            seeds += 1;
            for &member in grid.values() {
                used[member] = true;
            }
            if best.as_ref().is_none_or(|best| grid.len() > best.len()) {
                best = Some(grid);
            }
            if best.as_ref().is_some_and(|best| best.len() >= board.corners()) {
                break;
            }
        }
        best
    }

    /// A saddle and its neighbours along both edges through it: three of the four at least.
    fn start(&self, seed: usize) -> Option<Grid> {
        let Saddle { place, bright, .. } = self.list[seed];
        // Edges run between bright and dark: 45 degrees off the bright axis, if the squares are square. They hardly ever
        // are: the nearest saddles of the other kind tell.
        let mut others: Vec<(f32, usize)> = self
            .around(place, 8.0 * CELL_PX)
            .filter(|&other| other != seed && self.list[other].bright.dot(&bright) < 0.0)
            .map(|other| ((self.list[other].place - place).norm(), other))
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0));
        let offset = |other: usize| self.list[other].place - place;
        let (_, first) = *others.first()?;
        let x = offset(first);
        // Across the first step: the nearest that is not along it.
        let angle = |a: Vector2<f32>, b: Vector2<f32>| a.angle(&b).to_degrees();
        let second =
            others.iter().map(|(_, other)| *other).find(|&other| (40.0..140.0).contains(&angle(x, offset(other))))?;
        let y = offset(second);
        if y.norm() > 3.0 * x.norm() {
            return None;
        }
        let opposite = |step: Vector2<f32>| {
            let expected = place - step;
            let near = self.around(expected, STEP_TOLERANCE * step.norm());
            let near = near.filter(|&other| self.list[other].bright.dot(&bright) < 0.0);
            near.min_by(|&a, &b| self.miss(a, expected).total_cmp(&self.miss(b, expected)))
        };
        let mut grid = Grid::from([((0, 0), seed), ((1, 0), first), ((0, 1), second)]);
        let (left, up) = (opposite(x), opposite(y));
        grid.extend(left.map(|left| ((-1, 0), left)));
        grid.extend(up.map(|up| ((0, -1), up)));
        (grid.len() >= 4).then_some(grid)
    }

    fn miss(&self, saddle: usize, expected: Vector2<f32>) -> f32 {
        (self.list[saddle].place - expected).norm()
    }

    /// Adds corner after corner where the ones before lead.
    fn grow(&self, mut grid: Grid, board: &Board) -> Grid {
        let mut taken: Vec<bool> = vec![false; self.list.len()];
        for &member in grid.values() {
            taken[member] = true;
        }
        // A lattice without end (tiles, noise) is no board.
        let longest = board.columns.max(board.rows) as i32 + 1;
        loop {
            let mut open: Vec<(i32, i32)> = grid
                .keys()
                .flat_map(|&(i, j)| [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)])
                .filter(|place| !grid.contains_key(place))
                .collect();
            open.sort_unstable();
            open.dedup();
            let [columns, rows] = limits(&grid);
            let mut added = Vec::new();
            for place in open {
                let (i, j) = place;
                let beyond = |limits: (i32, i32), at: i32| (limits.1.max(at) - limits.0.min(at)) >= longest;
                if beyond(columns, i) || beyond(rows, j) {
                    continue;
                }
                let Some((expected, step, bright)) = self.expected(&grid, place) else { continue };
                let near = self.around(expected, STEP_TOLERANCE * step);
                let near = near.filter(|&other| !taken[other] && self.list[other].bright.dot(&bright) > 0.0);
                let best = near.min_by(|&a, &b| self.miss(a, expected).total_cmp(&self.miss(b, expected)));
                if let Some(best) = best {
                    taken[best] = true;
                    added.push((place, best));
                }
            }
            if added.is_empty() {
                return grid;
            }
            grid.extend(added);
        }
    }

    /// Where a corner of the grid is expected from its neighbours, with the step to it and its bright axis. None: too few
    /// neighbours.
    fn expected(&self, grid: &Grid, (i, j): (i32, i32)) -> Option<(Vector2<f32>, f32, Vector2<f32>)> {
        let at = |i: i32, j: i32| grid.get(&(i, j)).map(|&index| self.list[index].place);
        let mut sum = Vector2::zeros();
        let (mut count, mut step) = (0.0, f32::INFINITY);
        let mut add = |place: Vector2<f32>, length: f32, weight: f32| {
            sum += weight * place;
            count += weight;
            step = step.min(length);
        };
        let mut bright = None;
        for (di, dj) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
            let (one, two, three) = (at(i - di, j - dj), at(i - 2 * di, j - 2 * dj), at(i - 3 * di, j - 3 * dj));
            if one.is_some() && bright.is_none() {
                bright = grid.get(&(i - di, j - dj)).map(|&index| -self.list[index].bright);
            }
            match (one, two, three) {
                (Some(one), Some(two), Some(three)) => add(3.0 * one - 3.0 * two + three, (one - two).norm(), 2.0),
                (Some(one), Some(two), None) => add(2.0 * one - two, (one - two).norm(), 1.0),
                _ => {}
            }
            // The fourth corner of a square.
            for side in [-1, 1] {
                let (si, sj) = (side * dj, side * di);
                if let (Some(one), Some(beside), Some(corner)) = (one, at(i + si, j + sj), at(i - di + si, j - dj + sj))
                {
                    add(one + beside - corner, (beside - corner).norm(), 0.5);
                }
            }
        }
        // At least a straight line, or two squares.
        (count >= 1.0).then_some((sum / count, step, bright?))
    }

    /// The corners of a grid in the numbers of the board, if it is that board.
    fn number(&self, grid: &Grid, board: &Board) -> Result<Vec<(usize, Vector2<f32>)>, NotFound> {
        let wanted = (board.columns as i32, board.rows as i32);
        let [columns, rows] = limits(grid);
        let size = [columns, rows].map(|(first, last)| last - first + 1);
        let Some((swap, window)) = window(grid, wanted) else {
            return Err(NotFound::OtherGrid {
                found: grid.len(),
                columns: size[0].max(size[1]) as usize,
                rows: size[0].min(size[1]) as usize,
                board: (board.columns, board.rows),
            });
        };
        // Columns and rows from 0, x along the columns of the board.
        let mut cells: Vec<(i32, i32, usize)> = grid
            .iter()
            .map(|(&(i, j), &saddle)| {
                let (i, j) = (i - window.0, j - window.1);
                if swap { (j, i, saddle) } else { (i, j, saddle) }
            })
            .filter(|&(i, j, _)| (0..wanted.0).contains(&i) && (0..wanted.1).contains(&j))
            .collect();
        cells.sort_unstable();
        let places: HashMap<(i32, i32), usize> = cells.iter().map(|&(i, j, saddle)| ((i, j), saddle)).collect();
        // Not mirrored: y is clockwise from x, as rows of the picture run down.
        let turns: f32 = cells
            .iter()
            .filter_map(|&(i, j, saddle)| {
                let place = self.list[saddle].place;
                let [x, y] = [(i + 1, j), (i, j + 1)].map(|next| places.get(&next).map(|&next| self.list[next].place));
                Some((x? - place).perp(&(y? - place)).signum())
            })
            .sum();
        if turns < 0.0 {
            cells.iter_mut().for_each(|cell| cell.1 = wanted.1 - 1 - cell.1);
        }
        if (board.columns + board.rows) % 2 == 1 && self.first_is_bright(&cells) {
            cells.iter_mut().for_each(|cell| (cell.0, cell.1) = (wanted.0 - 1 - cell.0, wanted.1 - 1 - cell.1));
        }
        let mut corners: Vec<(usize, Vector2<f32>)> =
            cells.iter().map(|&(i, j, saddle)| ((j * wanted.0 + i) as usize, self.list[saddle].place)).collect();
        corners.sort_unstable_by_key(|(index, _)| *index);
        Ok(corners)
    }

    /// Whether the square outside of the first corner, against x and y, is bright.
    fn first_is_bright(&self, cells: &[(i32, i32, usize)]) -> bool {
        let places: HashMap<(i32, i32), usize> = cells.iter().map(|&(i, j, saddle)| ((i, j), saddle)).collect();
        let votes: f32 = cells
            .iter()
            .filter_map(|&(i, j, saddle)| {
                let Saddle { place, bright, .. } = self.list[saddle];
                let [x, y] = [(i + 1, j), (i, j + 1)].map(|next| places.get(&next).map(|&next| self.list[next].place));
                // Between x and y, and opposite, is the same colour as outside of the first corner where i + j is even.
                let between = (x? - place).normalize() + (y? - place).normalize();
                let twice = Vector2::new(between.x * between.x - between.y * between.y, 2.0 * between.x * between.y);
                let sign = if (i + j) % 2 == 0 { 1.0 } else { -1.0 };
                Some(sign * twice.dot(&bright).signum())
            })
            .sum();
        votes > 0.0
    }
}

/// The part of a grid that is a board of this size: whether its columns are the grid's rows, and the first column and row.
/// None: no part has enough corners, or two have almost as many, so that it is open which corner is which.
fn window(grid: &Grid, (wide, high): (i32, i32)) -> Option<(bool, (i32, i32))> {
    let [columns, rows] = limits(grid);
    let mut counts = Vec::new();
    for (swap, [width, height]) in [(false, [wide, high]), (true, [high, wide])] {
        for first_column in columns.0..=columns.1 - width + 1 {
            for first_row in rows.0..=rows.1 - height + 1 {
                let inside = grid.keys().filter(|(i, j)| {
                    (0..width).contains(&(i - first_column)) && (0..height).contains(&(j - first_row))
                });
                counts.push((inside.count(), swap, (first_column, first_row)));
            }
        }
        if wide == high {
            break;
        }
    }
    counts.sort_unstable();
    let &(most, swap, first) = counts.last()?;
    let next = counts.len().checked_sub(2).map_or(0, |second| counts[second].0);
    // Moved by one, a window loses a row of corners.
    let clear = most as f64 >= MIN_SHARE * f64::from(wide * high) && next + MIN_LEAD <= most;
    clear.then_some((swap, first))
}

/// First and last column, first and last row.
fn limits(grid: &Grid) -> [(i32, i32); 2] {
    let range = |of: fn(&(i32, i32)) -> i32| {
        grid.keys().map(of).fold((i32::MAX, i32::MIN), |(least, most), at| (least.min(at), most.max(at)))
    };
    [range(|place| place.0), range(|place| place.1)]
}

/// Twice the angle of the bright axis, as a unit vector, if there are two dark and two bright quadrants around a place.
fn quadrants(picture: &Float, x: f32, y: f32) -> Option<Vector2<f32>> {
    let mut ring = [0.0_f32; RING_POINTS];
    let mut angles = [0.0_f32; RING_POINTS];
    for (i, (value, angle)) in ring.iter_mut().zip(&mut angles).enumerate() {
        *angle = std::f32::consts::TAU * i as f32 / RING_POINTS as f32;
        *value = interpolated(picture, x + RING_PX * angle.cos(), y + RING_PX * angle.sin());
    }
    let mean = ring.iter().sum::<f32>() / RING_POINTS as f32;
    let variance = ring.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / RING_POINTS as f32;
    let sum = |of: fn(f32) -> f32| ring.iter().zip(angles).map(|(value, angle)| value * of(2.0 * angle)).sum::<f32>();
    let wave = 2.0 / RING_POINTS as f32 * Vector2::new(sum(f32::cos), sum(f32::sin));
    // A wave of amplitude a has variance a² / 2.
    let strong = wave.norm() >= MIN_CONTRAST / 2.0 && 0.5 * wave.norm_squared() >= QUADRANTS * variance;
    strong.then(|| wave.normalize())
}

/// Bilinear interpolation; the border goes on outside.
fn interpolated(picture: &Float, x: f32, y: f32) -> f32 {
    let clamp = |value: f32, size: u32| value.clamp(0.0, size as f32 - 1.0);
    let (x, y) = (clamp(x, picture.width()), clamp(y, picture.height()));
    let (left, top) = (x.floor(), y.floor());
    let (u, v) = (x - left, y - top);
    let width = picture.width() as usize;
    let at = |dx: usize, dy: usize| {
        let column = (left as usize + dx).min(width - 1);
        let row = (top as usize + dy).min(picture.height() as usize - 1);
        picture.as_raw()[row * width + column]
    };
    (1.0 - v) * ((1.0 - u) * at(0, 0) + u * at(1, 0)) + v * ((1.0 - u) * at(0, 1) + u * at(1, 1))
}

/// The corners with their places in the picture to a fraction of a pixel.
fn placed(picture: &GrayImage, board: &Board, seen: Vec<(usize, Vector2<f64>)>) -> Vec<Corner> {
    let float = rescaled(picture, 1.0);
    let rough: HashMap<usize, Vector2<f64>> = seen.iter().copied().collect();
    seen.into_iter()
        .filter_map(|(index, place)| {
            let (i, j) = (index % board.columns, index / board.columns);
            let neighbours = [
                (i > 0).then(|| index - 1),
                (i + 1 < board.columns).then_some(index + 1),
                (j > 0).then(|| index - board.columns),
                (j + 1 < board.rows).then_some(index + board.columns),
            ];
            let distances =
                neighbours.into_iter().flatten().filter_map(|next| rough.get(&next)).map(|next| (next - place).norm());
            let nearest = distances.fold(f64::INFINITY, f64::min);
            let radius = (WINDOW_PART * nearest).clamp(WINDOW_PX[0], WINDOW_PX[1]);
            let pixel = place_corner(&float, place, radius)?.into();
            Some(Corner { index, board_mm: board.corner_mm(index), pixel })
        })
        .collect()
}

/// Where all gradients around point along edges: sum of w g gᵀ (p - q) = 0 over pixels q with gradient g (Förstner, Gülch,
/// ISPRS Intercommission Workshop 1987), p the corner. None: that is not near the rough place.
fn place_corner(picture: &Float, rough: Vector2<f64>, radius: f64) -> Option<Vector2<f64>> {
    let value = |x: f64, y: f64| f64::from(interpolated(picture, x as f32, y as f32));
    let reach = radius.ceil() as i32;
    let mut place = rough;
    for _ in 0..PLACE_PASSES {
        let mut matrix = Matrix2::<f64>::zeros();
        let mut right = Vector2::<f64>::zeros();
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let offset = Vector2::new(f64::from(dx), f64::from(dy));
                // Falls smoothly to the edge of the window: no pixel jumps in or out.
                let weight = (1.0 - offset.norm_squared() / ((radius + 1.0) * (radius + 1.0))).max(0.0).powi(2);
                let (x, y) = (place.x + offset.x, place.y + offset.y);
                let gradient =
                    0.5 * Vector2::new(value(x + 1.0, y) - value(x - 1.0, y), value(x, y + 1.0) - value(x, y - 1.0));
                let product = weight * gradient * gradient.transpose();
                matrix += product;
                right += product * offset;
            }
        }
        let step = matrix.try_inverse()? * right;
        place += step;
        if step.norm() < PLACED_PX {
            return Some(place);
        }
        // A step that is not a number is no short one either.
        let near = (place - rough).norm() <= MOST_MOVED * radius;
        if !near {
            return None;
        }
    }
    None
}
