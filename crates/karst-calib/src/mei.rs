//! Import of OpenCV's omnidirectional (Mei) camera model.

use std::{f64::consts::TAU, fs, path::Path};

use karst_rig::{CameraModel, NORMAL_RADIUS_PX, Pose};
use nalgebra::{Isometry3, Point3, Vector2, Vector3};

use crate::file::FileError;
use crate::opencv::Node;
use crate::refine::{Loss, Observation, Scene, Unknowns};

/// Steps of the angle from the axis, and of the azimuth, at which a conversion is fitted.
const ANGLES: u32 = 90;
/// See `ANGLES`.
const AZIMUTHS: u32 = 24;

/// OpenCV's omnidirectional camera (Mei, Rives, ICRA 2007): points go to the unit sphere, from there, seen from `xi` behind
/// its centre, to the plane z = 1, are distorted and mapped to pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct MeiModel {
    /// Distance of the projection centre from that of the sphere, from 0.
    pub xi: f64,
    /// Focal lengths fx, fy, px.
    pub focal_px: [f64; 2],
    /// Skew, px.
    pub skew_px: f64,
    /// Image centre cx, cy, px.
    pub centre_px: [f64; 2],
    /// Radial terms k1, k2 and tangential terms p1, p2.
    pub distortion: [f64; 4],
    /// Width and height of the pictures, px.
    pub image_size_px: [u32; 2],
}

/// A camera model converted from another kind of model.
#[derive(Debug, Clone, PartialEq)]
pub struct Converted {
    /// The compact model; its pose is zero.
    pub model: CameraModel,
    /// RMS distance between the pixels of the same ray in both models, px.
    pub rms_px: f64,
    /// Largest distance, px.
    pub worst_px: f64,
    /// Radius up to which the models were compared: that of the farthest ray in the picture, px.
    pub radius_px: f64,
}

/// Why a camera could not be converted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ConversionError {
    /// The degree is out of range.
    #[error("degree is {0}, expected 2 to 7")]
    Degree(usize),
    /// Hardly any ray has a pixel inside the picture.
    #[error("hardly any ray falls into the picture: wrong camera matrix or image size?")]
    NoRays,
    /// No polynomial comes near the camera.
    #[error("no polynomial fits this camera")]
    NoFit,
}

impl MeiModel {
    /// Reads an OpenCV file, XML or YAML, as the omnidirectional calibration sample writes it: `image_width`,
    /// `image_height`, `camera_matrix` (3 x 3), `distortion_coefficients` (k1, k2, p1, p2) and `xi`.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, FileError> {
        let file = path.as_ref().display().to_string();
        match fs::read_to_string(path) {
            Ok(text) => Self::from_opencv(&text, &file),
            Err(source) => Err(FileError::Read { file, source }),
        }
    }

    /// Reads the text of such a file. `file_name` is for the messages.
    pub fn from_opencv(text: &str, file_name: &str) -> Result<Self, FileError> {
        let root = Node::parse(text, file_name)?;
        let matrix_node = root.child("camera_matrix")?;
        let matrix = matrix_node.matrix("camera_matrix", 1)?;
        let &[fx, skew, cx, zero_1, fy, cy, zero_2, zero_3, one] = matrix.as_slice() else {
            let found = format!("{} numbers", matrix.len());
            return Err(matrix_node.invalid("camera_matrix", found, "9".to_owned()));
        };
        if !(fx > 0.0 && fy > 0.0 && [zero_1, zero_2, zero_3, one] == [0.0, 0.0, 0.0, 1.0]) {
            let expected = "[fx s cx; 0 fy cy; 0 0 1] with fx and fy above 0".to_owned();
            return Err(matrix_node.invalid("camera_matrix", format!("{matrix:?}"), expected));
        }
        let distortion_node = root.child("distortion_coefficients")?;
        let distortion = distortion_node.matrix("distortion_coefficients", 1)?;
        let distortion = <[f64; 4]>::try_from(distortion).map_err(|found| {
            let found = format!("{} numbers", found.len());
            distortion_node.invalid("distortion_coefficients", found, "4: k1, k2, p1, p2".to_owned())
        })?;
        let xi_node = root.child("xi")?;
        let xi = xi_node.number_or_matrix("xi")?.filter(|xi| *xi >= 0.0);
        let xi = xi.ok_or_else(|| xi_node.invalid("xi", xi_node.excerpt(), "a number from 0".to_owned()))?;
        let size = |name| {
            let node = root.child(name)?;
            let size = node.number().filter(|size| (1.0..=65535.0).contains(size) && size.fract() == 0.0);
            size.map(|size| size as u32)
                .ok_or_else(|| node.invalid(name, node.excerpt(), "1 to 65535, whole px".to_owned()))
        };
        let image_size_px = [size("image_width")?, size("image_height")?];
        Ok(Self { xi, focal_px: [fx, fy], skew_px: skew, centre_px: [cx, cy], distortion, image_size_px })
    }

    /// Pixel of a direction, z along the viewing direction. None: behind the projection centre.
    pub fn project(&self, direction: Vector3<f64>) -> Option<Vector2<f64>> {
        let on_sphere = direction.normalize();
        let depth = on_sphere.z + self.xi;
        // Where the sphere is tangential to lines through the projection centre, pixels turn back.
        if !(depth > 0.0 && (self.xi <= 1.0 || on_sphere.z * self.xi > -1.0)) {
            return None;
        }
        let (x, y) = (on_sphere.x / depth, on_sphere.y / depth);
        let [k1, k2, p1, p2] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * k2);
        let distorted = Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        Some(Vector2::new(
            self.focal_px[0] * distorted.x + self.skew_px * distorted.y + self.centre_px[0],
            self.focal_px[1] * distorted.y + self.centre_px[1],
        ))
    }

    /// The rays whose pixels are in the picture, as points at 1000 mm.
    fn rays(&self) -> Vec<Observation> {
        let inside = |pixel: &Vector2<f64>| {
            (0..2).all(|axis| (0.0..=f64::from(self.image_size_px[axis]) - 1.0).contains(&pixel[axis]))
        };
        let mut rays = Vec::new();
        for azimuth in (0..AZIMUTHS).map(|i| TAU * f64::from(i) / f64::from(AZIMUTHS)) {
            let mut last = 0.0;
            for angle in (1..=ANGLES).map(|i| std::f64::consts::PI * f64::from(i) / f64::from(ANGLES + 1)) {
                let direction = Vector3::new(angle.sin() * azimuth.cos(), angle.sin() * azimuth.sin(), angle.cos());
                let Some(pixel) = self.project(direction).filter(inside) else { break };
                let radius = (pixel - Vector2::from(self.centre_px)).norm();
                // Distortion polynomials turn back somewhere outside of the pictures they were fitted to.
                if radius <= last {
                    break;
                }
                last = radius;
                rays.push(Observation { index: rays.len(), board: Point3::from(1000.0 * direction), pixel });
            }
        }
        rays
    }

    /// The nearest compact model with a polynomial of this degree (2 to 7) and tangential terms, by least squares over the
    /// rays whose pixels are in the picture.
    pub fn to_camera(&self, degree: usize) -> Result<Converted, ConversionError> {
        if !(2..=7).contains(&degree) {
            return Err(ConversionError::Degree(degree));
        }
        let rays = vec![self.rays()];
        let centre = Vector2::from(self.centre_px);
        let radius = |ray: &Observation| (ray.pixel - centre).norm();
        let farthest = rays[0].iter().max_by(|a, b| radius(a).total_cmp(&radius(b)));
        let farthest = farthest.filter(|_| rays[0].len() >= 100).ok_or(ConversionError::NoRays)?;
        // f at the centre and at the rim make a parabola.
        let scale = 0.5 * (self.focal_px[0] + self.focal_px[1]) / (1.0 + self.xi) / NORMAL_RADIUS_PX;
        let s = radius(farthest) / NORMAL_RADIUS_PX;
        let rim = s * farthest.board.z / farthest.board.coords.xy().norm();
        let model = CameraModel {
            pose: Pose { position_mm: [0.0; 3], rotation_deg: [0.0; 3] },
            centre_px: self.centre_px,
            affine: [self.focal_px[0] / self.focal_px[1], self.skew_px / self.focal_px[1], 0.0],
            tangential: [0.0; 2],
            polynomial: vec![scale, 0.0, (rim - scale) / (s * s)],
            axial: Vec::new(),
        };
        let mut scene = Scene { model, poses: vec![Isometry3::identity()] };
        for degree in [2, degree] {
            let unknowns = Unknowns { poses: false, ..Unknowns::of_degree(degree, degree > 2) };
            scene.refine(&rays, &unknowns, Loss::Huber(f64::INFINITY));
        }
        let residuals: Option<Vec<f64>> =
            rays[0].iter().map(|ray| scene.residual(0, ray).map(|residual| residual.norm())).collect();
        let residuals = residuals.ok_or(ConversionError::NoFit)?;
        let mean = residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64;
        Ok(Converted {
            rms_px: mean.sqrt(),
            worst_px: residuals.iter().copied().fold(0.0, f64::max),
            radius_px: rays[0].iter().map(|ray| scene.model.corrected(ray.pixel).norm()).fold(0.0, f64::max),
            model: scene.model,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const XML: &str = "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_width>1280</image_width>\n\
        <image_height>960</image_height>\n<camera_matrix type_id=\"opencv-matrix\">\n<rows>3</rows><cols>3</cols>\
        <dt>d</dt>\n<data>930. 0.3 640. 0. 931. 480. 0. 0. 1.</data></camera_matrix>\n\
        <distortion_coefficients type_id=\"opencv-matrix\"><rows>1</rows><cols>4</cols><dt>d</dt>\n\
        <data>-0.15 0.02 1e-3 -5e-4</data></distortion_coefficients>\n<xi>1.2</xi>\n</opencv_storage>\n";

    /// The same camera as the calibration sample writes it.
    const YAML: &str = "%YAML:1.0\n---\ncalibration_time: \"Sun Nov  1 12:00:00 2026\"\nnframes: 15\n\
        image_width: 1280\nimage_height: 960\nboard_width: 9\nboard_height: 6\nsquare_size: 3.\n\
        # flags: +fix_skew\nflags: 2\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n\
        \x20  data: [ 9.3e+02, 3.0e-01, 640., 0., 931., 480., 0.,\n       0., 1. ]\n\
        distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 4\n   dt: d\n\
        \x20  data: [ -0.15, 0.02, 1e-3, -5e-4 ]\nxi: 1.2\navg_reprojection_error: 2.9e-01\n";

    fn read(text: &str) -> Result<MeiModel, FileError> {
        MeiModel::from_opencv(text, "mei")
    }

    fn message(text: &str, from: &str, to: &str) -> String {
        assert!(text.contains(from));
        read(&text.replacen(from, to, 1)).unwrap_err().to_string()
    }

    #[test]
    fn yaml_is_the_same_camera_as_xml() {
        let mei = read(YAML).unwrap();
        assert_eq!(mei, read(XML).unwrap());
        assert_eq!((mei.xi, mei.skew_px, mei.image_size_px), (1.2, 0.3, [1280, 960]));
        let matrix = "xi: !!opencv-matrix\n   rows: 1\n   cols: 1\n   dt: d\n   data: [ 1.2 ]";
        assert_eq!(mei, read(&YAML.replace("xi: 1.2", matrix)).unwrap());
        assert_eq!(mei, read(&YAML.replace('\n', "\r\n")).unwrap());
    }

    #[test]
    fn conversion_leaves_at_most_30_millipixels_rms() {
        let mei = read(XML).unwrap();
        let converted = mei.to_camera(7).unwrap();
        println!("{converted:?}");
        assert!(converted.rms_px < 0.03, "{} px", converted.rms_px);
        assert!(converted.worst_px < 0.2, "{} px", converted.worst_px);
        // The residual is that of the rays themselves.
        let direction = Vector3::new(0.5, -0.2, 0.4);
        let pixel = converted.model.project(Point3::from(1e3 * direction), 1.05 * converted.radius_px).unwrap();
        assert!((pixel - mei.project(direction).unwrap()).norm() <= converted.worst_px);
    }

    #[test]
    fn conversion_of_a_plain_sphere_with_xi_1_is_an_exact_parabola() {
        let mut mei = read(XML).unwrap();
        (mei.xi, mei.skew_px, mei.distortion) = (1.0, 0.0, [0.0; 4]);
        // xi = 1 is the parabolic mirror: f = F / 2 - rho^2 / (2 F) with F = focal length
        mei.focal_px = [512.0; 2];
        let converted = mei.to_camera(2).unwrap();
        let expected = [0.5, 0.0, -0.5];
        for (found, expected) in converted.model.polynomial.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{converted:?}");
        }
        assert!(converted.worst_px < 1e-6);
    }

    #[test]
    fn cameras_that_cannot_be_converted_are_refused() {
        let mut mei = read(XML).unwrap();
        assert_eq!(mei.to_camera(1), Err(ConversionError::Degree(1)));
        mei.centre_px = [-1e5, 0.0];
        assert_eq!(mei.to_camera(4), Err(ConversionError::NoRays));
    }

    #[test]
    fn xml_errors_name_file_line_found_and_expected() {
        assert_eq!(message(XML, "<xi>1.2", "<xi>-1"), "mei:10: xi: found '-1', expected a number from 0");
        assert_eq!(
            message(XML, "-0.15 0.02 1e-3 -5e-4", "-0.15"),
            "mei:9: distortion_coefficients: found 1 numbers, expected rows x cols x 1"
        );
        assert_eq!(
            message(XML, "image_width>1280</image_width", "width>1280</width"),
            "mei:2: image_width: found none, expected one"
        );
        assert!(message(XML, "930.", "-930.").starts_with("mei:5: camera_matrix: found [-930.0"));
        assert!(MeiModel::load("no/such.xml").unwrap_err().to_string().starts_with("no/such.xml: "));
    }

    #[test]
    fn yaml_errors_name_file_line_found_and_expected() {
        for (from, to, expected) in [
            ("xi: 1.2", "xi: -1", "mei:23: xi: found '-1', expected a number from 0"),
            ("xi: 1.2\n", "", "mei:3: xi: found none, expected one"),
            ("cols: 3", "columns: 3", "mei:12: cols: found none, expected one"),
            ("rows: 1", "rows: 2", "mei:22: distortion_coefficients: found 4 numbers, expected rows x cols x 1"),
            (
                "cols: 4\n   dt: d\n   data: [ -0.15,",
                "cols: 3\n   dt: d\n   data: [",
                "mei:18: distortion_coefficients: found 3 numbers, expected 4: k1, k2, p1, p2",
            ),
            ("931.", "nine", "mei:16: camera_matrix: found 'nine', expected numbers up to a million in magnitude"),
            ("1280", "1280.5", "mei:5: image_width: found '1280.5', expected 1 to 65535, whole px"),
            ("960", ".Nan", "mei:6: image_height: found '.Nan', expected 1 to 65535, whole px"),
        ] {
            assert_eq!(message(YAML, from, to), expected);
        }
        assert!(message(YAML, " ]", "").starts_with("mei:18: "), "{}", message(YAML, " ]", ""));
    }

    #[test]
    fn a_truncated_yaml_is_refused() {
        // Up to the last value that counts, of which a digit may be cut unnoticed.
        for end in 0..=YAML.find("1.2\n").unwrap() {
            assert!(read(&YAML[..end]).is_err(), "{}", &YAML[..end]);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn a_damaged_xml_is_read_and_converted_or_refused(at in 0..XML.len(), with in "[<>/0-9. ]{0,3}") {
            let mut text = XML.to_owned();
            text.replace_range(at..=at, &with);
            if let Ok(mei) = read(&text) {
                let _ = mei.to_camera(4);
            }
        }

        #[test]
        fn a_damaged_yaml_is_read_and_converted_or_refused(
            at in 0..YAML.len(), length in 0_usize..20, with in "[-!&*?\\[\\]{}:,#'0-9.e \n\"]{0,4}",
        ) {
            let mut text = YAML.to_owned();
            text.replace_range(at..(at + length).min(YAML.len()), &with);
            if let Ok(mei) = read(&text) {
                let _ = mei.to_camera(4);
            }
        }
    }
}
