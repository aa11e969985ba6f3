//! OCamCalib `calib_results.txt` files.

use std::{f64::consts::FRAC_PI_2, fmt::Write, fs, io, path::Path};

use karst_rig::{CameraModel, NORMAL_RADIUS_PX, Place, Pose};
use nalgebra::{DMatrix, DVector};

/// Radii at which the inverse polynomial is fitted.
const INVERSE_SAMPLES: usize = 400;
/// Most coefficients of an exported inverse polynomial: beyond, they grow so large that a reader in `f32` loses more
/// than is gained.
const MAX_INVERSE_COEFFICIENTS: usize = 14;
/// The inverse polynomial is long enough when its worst error is below this, px.
const INVERSE_TOLERANCE_PX: f64 = 0.005;

/// A camera as OCamCalib describes it (Scaramuzza, Martinelli, Siegwart, IROS 2006), exactly as in its text file.
///
/// ```text
/// (row, col) = [c d; e 1] (x, y) + centre           row first: x runs down a column, y along a row
/// rho = |(x, y)|,  ray = (x, y, f(rho)),  f = sum polynomial[i] rho^i
/// theta = atan(f / rho),  rho = sum inverse_polynomial[i] theta^i
/// ```
///
/// The z axis points away from the scene: f is negative at the image centre. The pixel origin is the centre of the top
/// left pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct OcamModel {
    /// f in px as a polynomial in rho in px, constant term first.
    pub polynomial: Vec<f64>,
    /// rho in px as a polynomial in theta in radians, constant term first. A rounded inverse of `polynomial`, kept for
    /// other readers; karst inverts `polynomial` itself.
    pub inverse_polynomial: Vec<f64>,
    /// Image centre (row, column), px.
    pub centre_row_col: [f64; 2],
    /// Affine terms c, d, e.
    pub affine: [f64; 3],
    /// Width and height, px. The file has the height first.
    pub image_size_px: [u32; 2],
}

/// Why an OCamCalib file or model cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum OcamError {
    /// The file cannot be read.
    #[error("{file}: {source}")]
    Read {
        /// File name.
        file: String,
        /// Reason.
        source: io::Error,
    },
    /// A record has the wrong number of values or one that makes no sense.
    #[error("{place}: {record}: found {found}, expected {expected}")]
    Invalid {
        /// Where.
        place: Place,
        /// Which record.
        record: &'static str,
        /// What is there.
        found: String,
        /// What would be right.
        expected: &'static str,
    },
    /// The file ends early.
    #[error("{file}: no {record}, expected {expected}")]
    Missing {
        /// File name.
        file: String,
        /// The first record that is not there.
        record: &'static str,
        /// What the record holds.
        expected: &'static str,
    },
    /// OCamCalib has no such term.
    #[error("the OCamCalib format has no {term}, but the camera has")]
    NotRepresentable {
        /// The term.
        term: &'static str,
    },
    /// The rays do not turn away from the viewing direction with growing radius: nothing to invert.
    #[error("rays turn back at {radius_px:.1} px from the centre, expected beyond {expected_px:.1} px")]
    NotMonotonic {
        /// Radius where they do, px.
        radius_px: f64,
        /// Radius up to which they must not, px.
        expected_px: f64,
    },
}

impl OcamModel {
    /// Reads a file.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, OcamError> {
        let file = path.as_ref().display().to_string();
        match fs::read_to_string(path) {
            Ok(text) => Self::from_text(&text, &file),
            Err(source) => Err(OcamError::Read { file, source }),
        }
    }

    /// Reads the text of a file. `file_name` is for the messages. Polynomials may have any length; text after the fifth
    /// record is ignored, as other readers do.
    pub fn from_text(text: &str, file_name: &str) -> Result<Self, OcamError> {
        let mut records = Records { file_name, lines: text.lines().enumerate() };
        let polynomial = records.polynomial("polynomial")?;
        let inverse_polynomial = records.polynomial("inverse polynomial")?;
        let centre_row_col = records.numbers("centre", "row and column, px", |_| true)?;
        // As karst's rig file does: a pixel is nearly square and rows are nearly at right angles to columns.
        let sane = |[c, d, e]: &[f64; 3]| (0.5..=2.0).contains(c) && d.abs() <= 0.25 && e.abs() <= 0.25;
        let affine = records.numbers("affine terms", "c (0.5 to 2), d and e (-0.25 to 0.25)", sane)?;
        let whole = |size: &[f64; 2]| size.iter().all(|v| v.fract() == 0.0 && (1.0..=65535.0).contains(v));
        let [height, width] = records.numbers("image size", "height and width, whole px", whole)?;
        Ok(Self {
            polynomial,
            inverse_polynomial,
            centre_row_col,
            affine,
            image_size_px: [width as u32, height as u32],
        })
    }

    /// The text of a file that reads back as this model, without loss.
    pub fn to_text(&self) -> String {
        let list = |values: &[f64]| {
            values.iter().fold(values.len().to_string(), |mut text, value| {
                // Writing to a string does not fail.
                let _ = write!(text, " {value:e}");
                text
            })
        };
        let [row, column] = self.centre_row_col;
        let [c, d, e] = self.affine;
        let [width, height] = self.image_size_px;
        format!(
            "# f in px by the radius in px, constant term first; negative: towards the scene (cam2world)\n\n{}\n\n\
             # radius in px by theta = atan(f / radius) in radians, constant term first (world2cam)\n\n{}\n\n\
             # centre: row and column, px, from 0\n\n{row:e} {column:e}\n\n\
             # affine terms c, d, e\n\n{c:e} {d:e} {e:e}\n\n\
             # image size: height and width, px\n\n{height} {width}\n",
            list(&self.polynomial),
            list(&self.inverse_polynomial),
        )
    }

    /// The same camera as karst describes it: column first, z towards the scene, the affine matrix with its 1 in the
    /// row of the image rows, radius and f in units of 512 px. Exact but for rounding; every term, a1 too, is kept.
    pub fn to_camera(&self) -> CameraModel {
        let [c, d, e] = self.affine;
        let [row, column] = self.centre_row_col;
        // With rows and columns exchanged A is [1 e; d c]. Divided by c its last element is 1, and (u', v') = c (y, x).
        let unit = NORMAL_RADIUS_PX / c;
        CameraModel {
            pose: Pose { position_mm: [0.0; 3], rotation_deg: [0.0; 3] },
            centre_px: [column, row],
            affine: [1.0 / c, e / c, d / c],
            tangential: [0.0; 2],
            polynomial: rescale(&self.polynomial, unit),
            axial: Vec::new(),
        }
    }

    /// A camera in OCamCalib's terms, and the worst error of the inverse polynomial that is made for it, px, up to
    /// `radius_px` from the centre (the mirror's rim, or the farthest calibrated pixel). The pose is not part of the
    /// format.
    pub fn from_camera(
        camera: &CameraModel,
        image_size_px: [u32; 2],
        radius_px: f64,
    ) -> Result<(Self, f64), OcamError> {
        if camera.tangential != [0.0; 2] {
            return Err(OcamError::NotRepresentable { term: "tangential terms" });
        }
        if camera.axial.iter().any(|&a| a != 0.0) {
            return Err(OcamError::NotRepresentable { term: "axial polynomial" });
        }
        let [c, d, e] = camera.affine;
        let [column, row] = camera.centre_px;
        let mut model = Self {
            polynomial: rescale(&camera.polynomial, 1.0 / (c * NORMAL_RADIUS_PX)),
            inverse_polynomial: Vec::new(),
            centre_row_col: [row, column],
            affine: [1.0 / c, e / c, d / c],
            image_size_px,
        };
        let error_px = model.fit_inverse(radius_px * c)?;
        Ok((model, error_px))
    }

    /// Fits the shortest inverse polynomial that is good enough, up to `radius_px`, and returns its worst error, px.
    fn fit_inverse(&mut self, radius_px: f64) -> Result<f64, OcamError> {
        let rho: Vec<f64> = (0..=INVERSE_SAMPLES).map(|i| radius_px * i as f64 / INVERSE_SAMPLES as f64).collect();
        // Towards the scene at the centre, as the format wants it: -pi/2 there.
        let theta: Vec<f64> = rho.iter().map(|&r| self.f(r).atan2(r)).collect();
        let turns_back = theta.windows(2).position(|pair| pair[0] >= pair[1] || pair[1].is_nan());
        if let Some(i) = turns_back.or_else(|| (self.f(0.0).atan2(0.0) != -FRAC_PI_2).then_some(0)) {
            return Err(OcamError::NotMonotonic { radius_px: rho[i], expected_px: radius_px });
        }
        let (middle, half) = (0.5 * (theta[0] + theta[INVERSE_SAMPLES]), 0.5 * (theta[INVERSE_SAMPLES] - theta[0]));
        let mut worst = f64::INFINITY;
        for terms in 4..=MAX_INVERSE_COEFFICIENTS {
            // Powers of theta on -1 to 1 keep the fit well-conditioned.
            let powers = DMatrix::from_fn(rho.len(), terms, |i, j| ((theta[i] - middle) / half).powi(j as i32));
            let qr = powers.qr();
            let Some(scaled) = qr.r().solve_upper_triangular(&(qr.q().transpose() * DVector::from_column_slice(&rho)))
            else {
                break;
            };
            let candidate = expand(scaled.as_slice(), middle, half);
            let error = |(r, t): (&f64, &f64)| (horner(&candidate, *t) - r).abs();
            let candidate_worst = rho.iter().zip(&theta).map(error).fold(0.0, f64::max);
            if candidate_worst < worst {
                worst = candidate_worst;
                self.inverse_polynomial = candidate;
            }
            if worst < INVERSE_TOLERANCE_PX {
                break;
            }
        }
        Ok(worst)
    }

    fn f(&self, rho: f64) -> f64 {
        horner(&self.polynomial, rho)
    }
}

/// Coefficients of -f(rho) / unit as a polynomial in rho / unit.
fn rescale(polynomial: &[f64], unit: f64) -> Vec<f64> {
    // Subtracted from 0, so that a missing term stays 0 and not -0.
    (-1..).zip(polynomial).map(|(power, a)| 0.0 - a * unit.powi(power)).collect()
}

/// Coefficients in x of a polynomial in (x - middle) / half.
fn expand(scaled: &[f64], middle: f64, half: f64) -> Vec<f64> {
    let mut expanded = Vec::with_capacity(scaled.len());
    for &a in scaled.iter().rev() {
        // Horner's rule with a polynomial for a value: multiply by (x - middle) / half, add a.
        expanded.push(0.0);
        for i in (0..expanded.len()).rev() {
            let below = if i > 0 { expanded[i - 1] } else { 0.0 };
            expanded[i] = (below - middle * expanded[i]) / half;
        }
        expanded[0] += a;
    }
    expanded
}

/// Horner's rule, constant term first.
fn horner(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// The lines of a file that hold numbers.
struct Records<'a> {
    file_name: &'a str,
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
}

impl<'a> Records<'a> {
    fn next(&mut self, record: &'static str, expected: &'static str) -> Result<(Place, Vec<&'a str>), OcamError> {
        let file = self.file_name.to_owned();
        match self.lines.find(|(_, line)| !line.trim().is_empty() && !line.trim_start().starts_with('#')) {
            Some((index, line)) => Ok((Place { file, line: index + 1 }, line.split_whitespace().collect())),
            None => Err(OcamError::Missing { file, record, expected }),
        }
    }

    fn polynomial(&mut self, record: &'static str) -> Result<Vec<f64>, OcamError> {
        let expected = "the number of coefficients (1 or more), then as many finite numbers";
        let (place, words) = self.next(record, expected)?;
        let parse = || {
            let (count, rest) = words.split_first()?;
            let count: usize = count.parse().ok()?;
            let values = finite(rest)?;
            (count > 0 && values.len() == count).then_some(values)
        };
        let found = || format!("{} and {} more", words[0], words.len() - 1);
        parse().ok_or_else(|| OcamError::Invalid { place, record, found: found(), expected })
    }

    fn numbers<const N: usize>(
        &mut self,
        record: &'static str,
        expected: &'static str,
        check: impl Fn(&[f64; N]) -> bool,
    ) -> Result<[f64; N], OcamError> {
        let (place, words) = self.next(record, expected)?;
        let values = finite(&words).and_then(|values| values.try_into().ok()).filter(check);
        values.ok_or_else(|| OcamError::Invalid { place, record, found: format!("'{}'", words.join(" ")), expected })
    }
}

fn finite(words: &[&str]) -> Option<Vec<f64>> {
    words.iter().map(|word| word.parse().ok().filter(|value: &f64| value.is_finite())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;
    use proptest::prelude::*;

    const TEXT: &str = "#polynomial\n\n5 -1.5e+02 0 1.0e-03 5.1e-06 -5.7e-09 \n\n#inverse\n3 275.7 217.9 71.1\n\
                        #centre\n382.8 456.3\n#affine\n1.0007 -0.0006 0.0004\n#size\n768 1024\n";

    fn read(text: &str) -> Result<OcamModel, OcamError> {
        OcamModel::from_text(text, "calib_results.txt")
    }

    fn message(from: &str, to: &str) -> String {
        assert!(TEXT.contains(from));
        read(&TEXT.replace(from, to)).unwrap_err().to_string()
    }

    #[test]
    fn conventions_are_row_first_z_away_from_the_scene_and_height_first() {
        let model = read(TEXT).unwrap();
        let camera = model.to_camera();
        assert_eq!(camera.centre_px, [456.3, 382.8]);
        assert_eq!(model.image_size_px, [1024, 768]);
        for pixel in [[456.3, 382.8], [600.0, 300.0], [20.0, 700.0]] {
            // cam2world by the definition of the format
            let [c, d, e] = model.affine;
            let (row, col) = (pixel[1] - 382.8, pixel[0] - 456.3);
            let x = (row - d * col) / (c - d * e);
            let y = (c * col - e * row) / (c - d * e);
            let rho = x.hypot(y);
            let z = -150.0 + 1.0e-3 * rho.powi(2) + 5.1e-6 * rho.powi(3) - 5.7e-9 * rho.powi(4);
            // Ours has x along the rows and z towards the scene.
            let expected = nalgebra::Vector3::new(y, x, -z).normalize();
            assert!((camera.ray(pixel.into()).direction - expected).norm() < 1e-14);
        }
    }

    #[test]
    fn a1_is_kept() {
        let camera = read(&TEXT.replace("02 0 1", "02 0.25 1")).unwrap().to_camera();
        assert_eq!(camera.polynomial[1], -0.25);
        let (back, _) = OcamModel::from_camera(&camera, [1024, 768], 380.0).unwrap();
        assert_eq!(back.polynomial[1], 0.25);
    }

    #[test]
    fn camera_and_back_is_the_same_model() {
        let model = read(TEXT).unwrap();
        let (back, inverse_error) = OcamModel::from_camera(&model.to_camera(), model.image_size_px, 380.0).unwrap();
        let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-14 * b.abs());
        assert!(close(&back.polynomial, &model.polynomial), "{back:?}");
        assert!(close(&back.centre_row_col, &model.centre_row_col) && close(&back.affine, &model.affine), "{back:?}");
        assert!(inverse_error < 0.01, "{inverse_error} px");
    }

    #[test]
    fn exported_inverse_polynomial_finds_the_pixel() {
        let camera = read(TEXT).unwrap().to_camera();
        let (model, inverse_error) = OcamModel::from_camera(&camera, [1024, 768], 380.0).unwrap();
        let read_back = read(&model.to_text()).unwrap();
        for pixel in [[300.0, 50.0], [456.0, 382.0], [800.0, 500.0]] {
            let pixel = Vector2::from(pixel);
            let ray = camera.ray(pixel).direction;
            // world2cam by the definition of the format
            let (x, y, z) = (ray.y, ray.x, -ray.z);
            let across = x.hypot(y);
            let rho = horner(&read_back.inverse_polynomial, (z / across).atan());
            let [c, d, e] = model.affine;
            let (x, y) = (x / across * rho, y / across * rho);
            let found = Vector2::new(e * x + y + model.centre_row_col[1], c * x + d * y + model.centre_row_col[0]);
            assert!((found - pixel).norm() < inverse_error * 1.1 + 1e-9, "{found} for {pixel}");
        }
    }

    #[test]
    fn what_the_format_cannot_hold_is_refused() {
        let mut camera = read(TEXT).unwrap().to_camera();
        camera.tangential = [0.0, 1e-4];
        assert!(matches!(OcamModel::from_camera(&camera, [1024, 768], 380.0), Err(OcamError::NotRepresentable { .. })));
        camera.tangential = [0.0; 2];
        camera.axial = vec![0.1];
        assert!(matches!(OcamModel::from_camera(&camera, [1024, 768], 380.0), Err(OcamError::NotRepresentable { .. })));
        camera.axial = vec![];
        camera.polynomial[2] = 5.0;
        let error = OcamModel::from_camera(&camera, [1024, 768], 380.0).unwrap_err();
        assert!(matches!(error, OcamError::NotMonotonic { .. }), "{error}");
        camera.polynomial[0] = f64::NAN;
        assert!(OcamModel::from_camera(&camera, [1024, 768], 380.0).is_err());
    }

    #[test]
    fn errors_name_file_line_found_and_expected() {
        let expected = "expected the number of coefficients (1 or more), then as many finite numbers";
        assert_eq!(
            message("5 -1.5", "6 -1.5"),
            format!("calib_results.txt:3: polynomial: found 6 and 5 more, {expected}")
        );
        assert_eq!(
            message("3 275.7", "99999999999 275.7"),
            format!("calib_results.txt:6: inverse polynomial: found 99999999999 and 3 more, {expected}")
        );
        assert_eq!(
            message("382.8 456.3", "382.8 NaN"),
            "calib_results.txt:8: centre: found '382.8 NaN', expected row and column, px"
        );
        assert_eq!(
            message("1.0007 -", "0 -"),
            "calib_results.txt:10: affine terms: found '0 -0.0006 0.0004', expected c (0.5 to 2), d and e (-0.25 to 0.25)"
        );
        assert_eq!(message("768 1024\n", ""), "calib_results.txt: no image size, expected height and width, whole px");
        assert!(OcamModel::load("no/such.txt").unwrap_err().to_string().starts_with("no/such.txt: "));
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "[-+0-9.e#\nNa inf]{0,200}") {
            let _ = read(&text);
        }

        #[test]
        fn a_damaged_file_is_read_or_refused(at in 0..TEXT.len(), with in any::<char>()) {
            let mut text = TEXT.to_owned();
            text.replace_range(at..=at, &with.to_string());
            if let Ok(model) = read(&text) {
                prop_assert_eq!(read(&model.to_text()).unwrap(), model);
            }
        }

        #[test]
        fn models_of_any_length_are_written_without_loss(
            polynomial in proptest::collection::vec(-1e30..1e30, 1..40),
            inverse_polynomial in proptest::collection::vec(-1e-30..1e30, 1..40),
            centre_row_col in [-1e4..1e4, -1e4..1e4],
            image_size_px in [1_u32..4000, 1_u32..4000],
        ) {
            let affine = [1.001, -1e-300, 0.1];
            let model = OcamModel { polynomial, inverse_polynomial, centre_row_col, affine, image_size_px };
            prop_assert_eq!(read(&model.to_text()).unwrap(), model);
        }
    }
}
