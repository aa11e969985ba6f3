//! The sub-pixel position of a checkerboard's corner.
//!
//! A model of the corner is fitted to the grey values around it. The neighbours in the grid say how the board is bent in
//! the picture there, to second order: on straight edges the fit would be off towards the inside of the bend.

use image::GrayImage;
use libm::erf;
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

/// Half of the window: within this part of a square from the corner, along both sides.
const WINDOW_SQUARES: f64 = 0.45;
/// And within this many pixels, along rows and columns.
const WINDOW_PX: f64 = 10.0;
/// A corner is within this part of a square from where it was believed.
const SHIFT_SQUARES: f64 = 0.35;
/// Part of the grey values' variance that the fit may leave.
const UNEXPLAINED_PART: f64 = 0.3;
/// Range of the blur, px.
const BLUR_PX: (f64, f64) = (0.25, 4.0);
/// Steps of the fit.
const STEPS: usize = 30;
/// The fit is done when a step is shorter than this, squares.
const SHORT_STEP: f64 = 1e-5;
/// Unknowns: position, blur, grey value at the corner and contrast, and a slope of the grey value.
const UNKNOWNS: usize = 7;

/// A refined corner.
pub(crate) struct Refined {
    pub pixel: Vector2<f64>,
    /// Half of the difference of the colours, grey levels. Above 0: bright towards lower x and y.
    pub contrast: f64,
}

/// Position in the grid as a polynomial of second order in the offset from a pixel.
struct Bend {
    terms: SMatrix<f64, 6, 2>,
}

fn powers(d: Vector2<f64>) -> SVector<f64, 6> {
    SVector::from([1.0, d.x, d.y, d.x * d.x, d.x * d.y, d.y * d.y])
}

impl Bend {
    /// From the corner and the eight next to it; at the rim of the board, from those on the inner side.
    fn new(pixels: &[Vector2<f64>], width: usize, index: usize) -> Option<Self> {
        let (x, y) = (index % width, index / width);
        let middle = |at: usize, count: usize| at.clamp(1, count.saturating_sub(2).max(1));
        let (middle_x, middle_y) = (middle(x, width), middle(y, pixels.len() / width));
        let mut rows = SMatrix::<f64, 9, 6>::zeros();
        let mut cells = SMatrix::<f64, 9, 2>::zeros();
        for (row, (j, i)) in (0..3).flat_map(|j| (0..3).map(move |i| (j, i))).enumerate() {
            let (i, j) = (middle_x + i - 1, middle_y + j - 1);
            rows.set_row(row, &powers(pixels.get(j * width + i)? - pixels[index]).transpose());
            cells.set_row(row, &nalgebra::RowVector2::new(i as f64 - x as f64, j as f64 - y as f64));
        }
        let terms = rows.svd(true, true).solve(&cells, 1e-12).ok()?;
        terms.iter().all(|term| term.is_finite()).then_some(Self { terms })
    }

    /// Position in the grid against that of offset 0, squares.
    fn at(&self, d: Vector2<f64>) -> Vector2<f64> {
        let mut powers = powers(d);
        powers[0] = 0.0;
        self.terms.tr_mul(&powers)
    }

    /// Derivatives of [`Self::at`], squares per px.
    fn slope(&self, d: Vector2<f64>) -> Matrix2<f64> {
        let row = |term: usize| self.terms.row(term).transpose();
        let (xx, xy, yy) = (row(3), row(4), row(5));
        Matrix2::from_columns(&[row(1) + 2.0 * d.x * xx + d.y * xy, row(2) + d.x * xy + 2.0 * d.y * yy])
    }

    /// The offset of a position in the grid.
    fn offset(&self, position: Vector2<f64>) -> Option<Vector2<f64>> {
        let mut d = Vector2::zeros();
        for _ in 0..10 {
            d += self.slope(d).try_inverse()? * (position - self.at(d));
        }
        ((self.at(d) - position).norm() < 1e-6).then_some(d)
    }
}

/// Fits corner `index` of a grid of `width` columns. None: it does not look like a corner.
pub(crate) fn refine(picture: &GrayImage, pixels: &[Vector2<f64>], width: usize, index: usize) -> Option<Refined> {
    let start = pixels[index];
    let bend = Bend::new(pixels, width, index)?;
    let samples = samples(picture, start, &bend);
    if samples.len() < 3 * UNKNOWNS {
        return None;
    }
    let slope = bend.slope(Vector2::zeros());
    // Squares per px across the edges.
    let per_px = Vector2::new(slope.row(0).norm(), slope.row(1).norm());
    let mut fit = SVector::<f64, UNKNOWNS>::zeros();
    fit[2] = 0.8;
    let mean = samples.iter().map(|sample| sample.1).sum::<f64>() / samples.len() as f64;
    let contrast = samples.iter().map(|(at, grey)| (grey - mean) * (at.x * at.y).signum()).sum::<f64>();
    (fit[3], fit[4]) = (mean, contrast / samples.len() as f64);

    let mut damping = 1e-3;
    let (mut normal, mut gradient, mut cost) = equations(&samples, &fit, per_px);
    for _ in 0..STEPS {
        let mut damped = normal;
        for i in 0..UNKNOWNS {
            damped[(i, i)] *= 1.0 + damping;
        }
        let step = damped.cholesky()?.solve(&gradient);
        let mut next = fit + step;
        next[2] = next[2].clamp(BLUR_PX.0, BLUR_PX.1);
        let equations = equations(&samples, &next, per_px);
        if equations.2 <= cost {
            (fit, damping) = (next, damping * 0.1);
            (normal, gradient, cost) = equations;
        } else {
            damping *= 10.0;
        }
        if step.fixed_rows::<2>(0).norm() < SHORT_STEP {
            break;
        }
    }
    let variance: f64 = samples.iter().map(|(_, grey)| (grey - mean).powi(2)).sum();
    if cost > UNEXPLAINED_PART * variance {
        return None;
    }
    let position = fit.fixed_rows::<2>(0).into_owned();
    let pixel = start + bend.offset(position).filter(|_| position.norm() <= SHIFT_SQUARES)?;
    Some(Refined { pixel, contrast: fit[4] })
}

/// The pixels of the window: position in the grid, and grey value.
fn samples(picture: &GrayImage, centre: Vector2<f64>, bend: &Bend) -> Vec<(Vector2<f64>, f64)> {
    let range = |axis: usize, size: u32| {
        let first = (centre[axis] - WINDOW_PX).ceil().max(0.0) as u32;
        let last = (centre[axis] + WINDOW_PX).floor().min(f64::from(size) - 1.0);
        first..if last < 0.0 { first } else { last as u32 + 1 }
    };
    let (columns, rows) = (range(0, picture.width()), range(1, picture.height()));
    let pixels = rows.flat_map(|v| columns.clone().map(move |u| (u, v)));
    let samples = pixels.map(|(u, v)| {
        let at = bend.at(Vector2::new(f64::from(u), f64::from(v)) - centre);
        (at, f64::from(picture.get_pixel(u, v).0[0]))
    });
    samples.filter(|(at, _)| at.amax() <= WINDOW_SQUARES).collect()
}

/// Normal equations of the fit, and its sum of squares.
fn equations(
    samples: &[(Vector2<f64>, f64)],
    fit: &SVector<f64, UNKNOWNS>,
    per_px: Vector2<f64>,
) -> (SMatrix<f64, UNKNOWNS, UNKNOWNS>, SVector<f64, UNKNOWNS>, f64) {
    let mut normal = SMatrix::zeros();
    let mut gradient = SVector::zeros();
    let mut cost = 0.0;
    let (position, blur, contrast) = (fit.fixed_rows::<2>(0), fit[2], fit[4]);
    for (at, grey) in samples {
        // A blurred edge, and its derivative by z.
        let z = (at - position).component_div(&(per_px * (blur * std::f64::consts::SQRT_2)));
        let edge = z.map(erf);
        let rise = z.map(|z| std::f64::consts::FRAC_2_SQRT_PI * (-z * z).exp());
        let by_z = contrast * Vector2::new(rise.x * edge.y, edge.x * rise.y);
        let by_position = -by_z.component_div(&(per_px * (blur * std::f64::consts::SQRT_2)));
        let product = edge.x * edge.y;
        let row = SVector::from([by_position.x, by_position.y, -by_z.dot(&z) / blur, 1.0, product, at.x, at.y]);
        let residual = grey - (fit[3] + contrast * product + fit[5] * at.x + fit[6] * at.y);
        normal += row * row.transpose();
        gradient += row * residual;
        cost += residual * residual;
    }
    (normal, gradient, cost)
}
