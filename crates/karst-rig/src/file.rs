//! Reading and writing rig files.

use std::{fmt, fs, io, ops::Range, path::Path};

use serde::Serialize;
use toml::{
    Spanned,
    de::{DeArray, DeTable, DeValue},
};

use crate::{Camera, CameraModel, DetectorSettings, Laser, Pose, Problem, ReconstructionSettings, Rig, Tube, Water};

/// Version of the file format.
const FORMAT: i64 = 1;
/// Longest excerpt of the file in a message, characters.
const EXCERPT: usize = 40;

/// Where in which file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// File name as given.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.file, self.line)
    }
}

/// Why a rig file was not accepted.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// The file cannot be read.
    #[error("{file}: {source}")]
    Read {
        /// File name.
        file: String,
        /// Reason.
        source: io::Error,
    },
    /// Not TOML, or a field or section given twice.
    #[error("{place}: {message}")]
    Syntax {
        /// Where.
        place: Place,
        /// What is wrong, and the text there.
        message: String,
    },
    /// A field that rig files do not have.
    #[error("{place}: unknown field `{key}`, expected {expected}")]
    Unknown {
        /// Where.
        place: Place,
        /// Path of the field.
        key: String,
        /// The field with the nearest name, or all there are.
        expected: String,
    },
    /// A field that is not there.
    #[error("{place}: missing field `{key}`, expected {expected}")]
    Missing {
        /// The section.
        place: Place,
        /// Path of the field.
        key: String,
        /// What the field holds.
        expected: String,
    },
    /// A value of the wrong type, out of range, or in contradiction to others.
    #[error("{place}: {problem}")]
    Invalid {
        /// Where.
        place: Place,
        /// Which field, what was found and what was expected.
        problem: Problem,
    },
}

impl Rig {
    /// Reads and checks a rig file.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, RigError> {
        let path = path.as_ref();
        let file = path.display().to_string();
        match fs::read_to_string(path) {
            Ok(text) => Self::from_toml(&text, &file),
            Err(source) => Err(RigError::Read { file, source }),
        }
    }

    /// Reads and checks the text of a rig file. `file_name` is for the messages.
    pub fn from_toml(text: &str, file_name: &str) -> Result<Self, RigError> {
        let source = Source { text, file_name };
        let root = DeTable::parse(text).map_err(|error| {
            let span = error.span().unwrap_or_default();
            let mut message = error.message().to_owned();
            let found = source.excerpt(&span);
            if !found.is_empty() {
                message += &format!(" at `{found}`");
            }
            RigError::Syntax { place: source.place(&span), message }
        })?;
        let rig = read_rig(&Section::new(source, String::new(), 0..0, root.get_ref(), &RIG_FIELDS)?)?;
        rig.check()
            .map_err(|problem| RigError::Invalid { place: source.place(&locate(&root, &problem.key)), problem })?;
        Ok(rig)
    }

    /// The text of a rig file that reads back as this rig.
    pub fn to_toml(&self) -> String {
        #[derive(Serialize)]
        struct File<'a> {
            format: i64,
            #[serde(flatten)]
            rig: &'a Rig,
        }
        let file = File { format: FORMAT, rig: self };
        toml::to_string(&file).expect("TOML has every type that a rig is made of")
    }
}

const RIG_FIELDS: [&str; 8] = ["format", "name", "water", "tube", "camera", "laser", "detector", "reconstruction"];

fn read_rig(root: &Section) -> Result<Rig, RigError> {
    root.read("format", "the version of the file format, 1", |value| (integer(value)? == FORMAT).then_some(()))?;
    let name = root.read("name", "a text", |value| value.as_str().map(str::to_owned))?;
    let water = root.section("water", &["temperature_c", "salinity", "wavelength_nm"])?;
    let water = Water {
        temperature_c: water.number("temperature_c")?,
        salinity: water.number("salinity")?,
        wavelength_nm: water.number("wavelength_nm")?,
    };
    let tube_fields = ["position_mm", "rotation_deg", "inner_radius_mm", "wall_mm", "index"];
    let tube = root.optional_section("tube", &tube_fields)?;
    let tube = tube.map(|tube| read_tube(&tube)).transpose()?;
    let camera_fields = ["image_size_px", "mirror_radius_px", "inner_radius_px", "air", "water"];
    let cameras = root.sections("camera", &camera_fields)?;
    let [first, second] = cameras.as_slice() else {
        let span = root.required("camera", "")?.span();
        let found = format!("a list of {}", cameras.len());
        return Err(root.invalid("camera", &span, found, "two sections [[camera]]"));
    };
    let cameras = [read_camera(first)?, read_camera(second)?];
    let laser_fields = ["origin_mm", "azimuth_deg", "elevation_deg", "origin_sigma_mm", "direction_sigma_mrad"];
    let lasers = root.sections("laser", &laser_fields)?;
    Ok(Rig {
        name,
        water,
        tube,
        cameras,
        lasers: lasers.iter().map(read_laser).collect::<Result<_, _>>()?,
        detector: read_detector(root)?,
        reconstruction: read_reconstruction(root)?,
    })
}

fn read_pose(section: &Section) -> Result<Pose, RigError> {
    Ok(Pose { position_mm: section.numbers("position_mm")?, rotation_deg: section.numbers("rotation_deg")? })
}

fn read_tube(section: &Section) -> Result<Tube, RigError> {
    Ok(Tube {
        pose: read_pose(section)?,
        inner_radius_mm: section.number("inner_radius_mm")?,
        wall_mm: section.number("wall_mm")?,
        index: section.number("index")?,
    })
}

fn read_camera(section: &Section) -> Result<Camera, RigError> {
    let model = |key| {
        let fields = ["position_mm", "rotation_deg", "centre_px", "affine", "tangential", "polynomial", "axial"];
        let section = section.optional_section(key, &fields)?;
        section.map(|model| read_model(&model)).transpose()
    };
    Ok(Camera {
        image_size_px: section.read("image_size_px", "a list of 2 whole numbers", |value| list(value, whole))?,
        mirror_radius_px: section.number("mirror_radius_px")?,
        inner_radius_px: section.number("inner_radius_px")?,
        air: model("air")?,
        water: model("water")?,
    })
}

fn read_model(section: &Section) -> Result<CameraModel, RigError> {
    let coefficients = |key| {
        section.read(key, "a list of numbers", |value| {
            value.as_array()?.iter().map(|item| number(item.get_ref())).collect()
        })
    };
    Ok(CameraModel {
        pose: read_pose(section)?,
        centre_px: section.numbers("centre_px")?,
        affine: section.numbers("affine")?,
        tangential: section.numbers("tangential")?,
        polynomial: coefficients("polynomial")?,
        axial: coefficients("axial")?,
    })
}

fn read_laser(section: &Section) -> Result<Laser, RigError> {
    Ok(Laser {
        origin_mm: section.numbers("origin_mm")?,
        azimuth_deg: section.number("azimuth_deg")?,
        elevation_deg: section.number("elevation_deg")?,
        origin_sigma_mm: section.number("origin_sigma_mm")?,
        direction_sigma_mrad: section.number("direction_sigma_mrad")?,
    })
}

fn read_detector(root: &Section) -> Result<DetectorSettings, RigError> {
    let fields = [
        "green_min",
        "excess_min",
        "saturation_min",
        "clip_min",
        "clipped_weight",
        "cluster_gap_px",
        "min_pixels",
        "sector_half_width_deg",
        "sigma_floor_px",
        "noise_dn",
    ];
    let section = root.section("detector", &fields)?;
    Ok(DetectorSettings {
        green_min: section.read("green_min", "a list of 2 whole numbers from 0 to 255", |value| list(value, whole))?,
        excess_min: section
            .read("excess_min", "a list of 2 whole numbers from 0 to 510", |value| list(value, whole))?,
        saturation_min: section.read("saturation_min", "a whole number from 0 to 255", whole)?,
        clip_min: section.read("clip_min", "a whole number from 0 to 255", whole)?,
        clipped_weight: section.read("clipped_weight", "a whole number from 1 to 500", whole)?,
        cluster_gap_px: section.number("cluster_gap_px")?,
        min_pixels: section.read("min_pixels", "a whole number from 1 to 65535", whole)?,
        sector_half_width_deg: section.number("sector_half_width_deg")?,
        sigma_floor_px: section.number("sigma_floor_px")?,
        noise_dn: section.number("noise_dn")?,
    })
}

fn read_reconstruction(root: &Section) -> Result<ReconstructionSettings, RigError> {
    let section = root.section("reconstruction", &["range_mm", "chi2_max", "single_camera"])?;
    Ok(ReconstructionSettings {
        range_mm: section.numbers("range_mm")?,
        chi2_max: section.number("chi2_max")?,
        single_camera: section.read("single_camera", "true or false", DeValue::as_bool)?,
    })
}

/// A file and its name.
#[derive(Clone, Copy)]
struct Source<'a> {
    text: &'a str,
    file_name: &'a str,
}

impl Source<'_> {
    fn place(&self, span: &Range<usize>) -> Place {
        let before = self.text.as_bytes().iter().take(span.start);
        Place { file: self.file_name.to_owned(), line: 1 + before.filter(|&&byte| byte == b'\n').count() }
    }

    /// The first line of a span, cut where it is long.
    fn excerpt(&self, span: &Range<usize>) -> String {
        let text = self.text.get(span.clone()).unwrap_or_default();
        let mut line = text.lines().next().unwrap_or_default().chars();
        let mut excerpt: String = line.by_ref().take(EXCERPT).collect();
        if line.next().is_some() {
            excerpt.push_str("...");
        }
        excerpt
    }
}

/// A table of the file, all of whose keys are known.
struct Section<'a> {
    source: Source<'a>,
    /// Path of the table, empty for the file.
    path: String,
    span: Range<usize>,
    table: &'a DeTable<'a>,
}

impl<'a> Section<'a> {
    fn new(
        source: Source<'a>,
        path: String,
        span: Range<usize>,
        table: &'a DeTable<'a>,
        fields: &[&str],
    ) -> Result<Self, RigError> {
        let section = Section { source, path, span, table };
        // Before anything is found missing: a misspelt field is both unknown and missing.
        for key in table.keys() {
            if !fields.contains(&key.get_ref().as_ref()) {
                return Err(RigError::Unknown {
                    place: source.place(&key.span()),
                    key: section.path_of(key.get_ref()),
                    expected: suggestion(key.get_ref(), fields),
                });
            }
        }
        Ok(section)
    }

    fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    fn required(&self, key: &str, expected: &str) -> Result<&'a Spanned<DeValue<'a>>, RigError> {
        self.table.get(key).ok_or_else(|| RigError::Missing {
            place: self.source.place(&self.span),
            key: self.path_of(key),
            expected: expected.to_owned(),
        })
    }

    fn invalid(&self, key: &str, span: &Range<usize>, found: impl ToString, expected: &str) -> RigError {
        RigError::Invalid { place: self.source.place(span), problem: Problem::new(self.path_of(key), found, expected) }
    }

    /// The value of a field, None from `convert` being a value of the wrong kind.
    fn read<T>(
        &self,
        key: &str,
        expected: &str,
        convert: impl Fn(&'a DeValue<'a>) -> Option<T>,
    ) -> Result<T, RigError> {
        let value = self.required(key, expected)?;
        let span = value.span();
        convert(value.get_ref()).ok_or_else(|| self.invalid(key, &span, self.source.excerpt(&span), expected))
    }

    fn number(&self, key: &str) -> Result<f64, RigError> {
        self.read(key, "a number", number)
    }

    fn numbers<const N: usize>(&self, key: &str) -> Result<[f64; N], RigError> {
        self.read(key, &format!("a list of {N} numbers"), |value| list(value, number))
    }

    fn subsection(&self, key: &str, value: &'a Spanned<DeValue<'a>>, fields: &[&str]) -> Result<Self, RigError> {
        let span = value.span();
        let table = value
            .get_ref()
            .as_table()
            .ok_or_else(|| self.invalid(key, &span, self.source.excerpt(&span), "a section"))?;
        Section::new(self.source, self.path_of(key), span, table, fields)
    }

    fn section(&self, key: &str, fields: &[&str]) -> Result<Self, RigError> {
        self.subsection(key, self.required(key, "a section")?, fields)
    }

    fn optional_section(&self, key: &str, fields: &[&str]) -> Result<Option<Self>, RigError> {
        let value = self.table.get(key);
        value.map(|value| self.subsection(key, value, fields)).transpose()
    }

    /// The sections of a list.
    fn sections(&self, key: &str, fields: &[&str]) -> Result<Vec<Self>, RigError> {
        let expected = format!("sections [[{key}]]");
        let items: &DeArray = self.read(key, &expected, DeValue::as_array)?;
        let item = |(index, value)| self.subsection(&format!("{key}[{index}]"), value, fields);
        items.iter().enumerate().map(item).collect()
    }
}

fn integer(value: &DeValue) -> Option<i64> {
    let integer = value.as_integer()?;
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

fn whole<T: TryFrom<i64>>(value: &DeValue) -> Option<T> {
    T::try_from(integer(value)?).ok()
}

/// Whole numbers need no decimal point.
fn number(value: &DeValue) -> Option<f64> {
    match value.as_float() {
        Some(float) => float.as_str().parse().ok(),
        None => integer(value).map(|integer| integer as f64),
    }
}

fn list<T, const N: usize>(value: &DeValue, item: impl Fn(&DeValue) -> Option<T>) -> Option<[T; N]> {
    let items = value.as_array()?.iter();
    let items: Option<Vec<T>> = items.map(|value| item(value.get_ref())).collect();
    items?.try_into().ok()
}

/// Span of the value at a path like `camera[0].air.centre_px[1]`, or of the section it should be in.
fn locate(root: &Spanned<DeTable>, path: &str) -> Range<usize> {
    let mut span = root.span();
    let mut steps = path.split(['.', '[']).map(|step| step.trim_end_matches(']'));
    let Some(mut value) = steps.next().and_then(|key| root.get_ref().get(key)) else {
        return span;
    };
    loop {
        span = value.span();
        let next = steps.next().and_then(|step| match step.parse::<usize>() {
            Ok(index) => value.get_ref().get(index),
            Err(_) => value.get_ref().get(step),
        });
        match next {
            Some(next) => value = next,
            None => return span,
        }
    }
}

/// The known field that is spelt most alike, or all fields if none is.
fn suggestion(key: &str, fields: &[&str]) -> String {
    let nearest = fields
        .iter()
        .map(|field| (edit_distance(key, field), field))
        .min()
        .filter(|(distance, field)| *distance <= field.len() / 3 + 1);
    match nearest {
        Some((_, field)) => format!("`{field}`"),
        None => format!("one of {}", fields.join(", ")),
    }
}

/// Fewest inserted, deleted or replaced characters between two words.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MAX_LASERS, fit_axial};
    use proptest::prelude::*;

    const DEFAULT: &str = include_str!("../rigs/default.toml");

    fn read(text: &str) -> Result<Rig, RigError> {
        Rig::from_toml(text, "my.toml")
    }

    /// The message for the default rig file with one text replaced where it first occurs.
    fn message(from: &str, to: &str) -> String {
        assert!(DEFAULT.contains(from));
        read(&DEFAULT.replacen(from, to, 1)).unwrap_err().to_string()
    }

    /// Line of the default rig file that begins with a text, the n-th from 0.
    fn line_of(start: &str, n: usize) -> usize {
        let mut lines = DEFAULT.lines().enumerate().filter(|(_, line)| line.starts_with(start));
        lines.nth(n).unwrap().0 + 1
    }

    #[test]
    fn rigs_read_back_as_written() {
        for mut rig in [Rig::default(), Rig::ideal()] {
            assert_eq!(read(&rig.to_toml()).unwrap(), rig);
            rig.tube = None;
            rig.cameras[0].water = rig.cameras[0].air.take();
            assert_eq!(read(&rig.to_toml()).unwrap(), rig);
        }
    }

    #[test]
    fn a_fitted_model_is_an_acceptable_water_model() {
        let mut rig = Rig::default();
        let traced = rig.traced_camera(0).unwrap();
        let (model, _) = fit_axial(&traced, [105.0, 364.0], [250.0, 6000.0]).unwrap();
        rig.cameras[0].water = Some(model);
        assert_eq!(read(&rig.to_toml()).unwrap(), rig);
        assert_eq!(Some(rig.water_camera(0).unwrap()), rig.cameras[0].water);
    }

    #[test]
    fn whole_numbers_need_no_decimal_point() {
        let text = DEFAULT.replacen("temperature_c = 12.0", "temperature_c = 12", 1);
        assert_eq!(read(&text).unwrap(), Rig::default());
    }

    #[test]
    fn a_missing_field_is_named_with_its_section() {
        let line = line_of("[[camera]]", 0);
        assert_eq!(
            message("inner_radius_px = 105.0", ""),
            format!("my.toml:{line}: missing field `camera[0].inner_radius_px`, expected a number")
        );
    }

    #[test]
    fn a_missing_section_is_named() {
        let text = DEFAULT.split("[detector]").next().unwrap();
        let error = read(text).unwrap_err().to_string();
        assert!(error.contains("missing field `laser`, expected sections [[laser]]"), "{error}");
    }

    #[test]
    fn a_misspelt_field_is_named_with_the_nearest_known_one() {
        let line = line_of("inner_radius_px", 0);
        assert_eq!(
            message("inner_radius_px = 105.0", "inner_radius = 105.0"),
            format!("my.toml:{line}: unknown field `camera[0].inner_radius`, expected `inner_radius_px`")
        );
    }

    #[test]
    fn an_unknown_field_is_named_with_all_known_ones() {
        let line = line_of("temperature_c", 0);
        assert_eq!(
            message("temperature_c = 12.0", "colour = 1"),
            format!(
                "my.toml:{line}: unknown field `water.colour`, \
                 expected one of temperature_c, salinity, wavelength_nm"
            )
        );
    }

    #[test]
    fn a_duplicate_field_is_named() {
        let line = line_of("temperature_c", 0) + 1;
        assert_eq!(
            message("temperature_c = 12.0", "temperature_c = 12.0\ntemperature_c = 13.0"),
            format!("my.toml:{line}: duplicate key at `temperature_c`")
        );
    }

    #[test]
    fn broken_toml_is_refused_with_its_line() {
        let line = line_of("[tube]", 0);
        assert!(message("[tube]", "[tube").starts_with(&format!("my.toml:{line}: unclosed table")));
    }

    #[test]
    fn a_value_of_the_wrong_type_is_quoted() {
        let line = line_of("image_size_px", 0);
        let at = |line| format!("my.toml:{line}: ");
        assert_eq!(
            message("image_size_px = [1024, 768]", "image_size_px = [1024, 768.5]"),
            at(line) + "`camera[0].image_size_px` is [1024, 768.5], expected a list of 2 whole numbers"
        );
        assert_eq!(
            message("saturation_min = 180", "saturation_min = 256"),
            at(line_of("saturation_min", 0))
                + "`detector.saturation_min` is 256, expected a whole number from 0 to 255"
        );
        assert_eq!(
            message("single_camera = false", "single_camera = \"no\""),
            at(line_of("single_camera", 0)) + "`reconstruction.single_camera` is \"no\", expected true or false"
        );
        assert_eq!(
            message("[detector]", "[[detector]]"),
            at(line_of("[detector]", 0)) + "`detector` is [[detector]], expected a section"
        );
    }

    #[test]
    fn another_format_is_refused() {
        let line = line_of("format", 0);
        assert_eq!(
            message("format = 1", "format = 2"),
            format!("my.toml:{line}: `format` is 2, expected the version of the file format, 1")
        );
    }

    #[test]
    fn a_third_camera_is_refused() {
        let error = message("[detector]", "[[camera]]\n[detector]");
        assert!(error.ends_with("`camera` is a list of 3, expected two sections [[camera]]"), "{error}");
    }

    #[test]
    fn a_value_out_of_range_is_named_with_line_and_limits() {
        let line = line_of("centre_px", 1);
        let text = DEFAULT.replacen("centre_px = [509.64, 385.02]", "centre_px = [509.64, 768.5]", 1);
        assert_eq!(
            read(&text).unwrap_err().to_string(),
            format!("my.toml:{line}: `camera[1].air.centre_px[1]` is 768.5, expected 0 to 768 px")
        );
        assert_eq!(
            message("salinity = 0.0", "salinity = nan"),
            format!("my.toml:{}: `water.salinity` is NaN, expected 0 to 45 per mille", line_of("salinity", 0))
        );
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = Rig::load("no/such/rig.toml").unwrap_err();
        assert!(matches!(error, RigError::Read { .. }));
        assert!(error.to_string().starts_with("no/such/rig.toml: "));
    }

    #[test]
    fn the_shipped_rigs_load_from_disk() {
        let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("rigs");
        assert_eq!(Rig::load(rigs.join("default.toml")).unwrap(), Rig::default());
        assert_eq!(Rig::load(rigs.join("ideal.toml")).unwrap(), Rig::ideal());
    }

    #[test]
    fn a_rig_of_720_lasers_is_accepted() {
        let mut rig = Rig::ideal();
        rig.detector.sector_half_width_deg = 0.25;
        rig.lasers = (0..MAX_LASERS).map(|index| Laser { azimuth_deg: 0.5 * index as f64, ..rig.lasers[0] }).collect();
        assert_eq!(read(&rig.to_toml()).unwrap(), rig);
    }

    proptest! {
        #[test]
        fn mutated_files_never_panic(
            edits in prop::collection::vec(
                (
                    any::<prop::sample::Index>(),
                    0..40_usize,
                    prop_oneof![
                        "\\PC{0,4}",
                        prop::sample::select(vec![
                            "[", "]", "[[laser]]\n", "=", "\n", "\"", "-", "nan", "inf", "1e308", "-1e308",
                            "0", "1e-308", "99999999999999999999", "0x10", "1979-05-27", "true", "{}", "[]",
                        ])
                        .prop_map(str::to_owned),
                    ],
                ),
                1..6,
            )
        ) {
            let mut text: Vec<char> = DEFAULT.chars().collect();
            for (at, length, replacement) in edits {
                let start = at.index(text.len() + 1);
                let end = (start + length).min(text.len());
                text.splice(start..end, replacement.chars());
            }
            let text: String = text.into_iter().collect();
            if let Err(error) = read(&text) {
                prop_assert!(error.to_string().starts_with("my.toml:"));
            }
        }

        /// Keeps the file's structure, so that odd values reach the checks and the optics.
        #[test]
        fn odd_numbers_never_panic(
            line in any::<prop::sample::Index>(),
            value in prop_oneof![
                any::<f64>(),
                -1000.0..1000.0_f64,
                prop::sample::select(vec![0.0, f64::NAN, f64::INFINITY, 1.0, -1.0]),
            ]
        ) {
            let mut lines: Vec<String> = DEFAULT.lines().map(str::to_owned).collect();
            let line = line.get_mut(&mut lines);
            let after_key = line.find('=').unwrap_or_default();
            let is_number = |c: char| c.is_ascii_digit() || "-.".contains(c);
            if let Some(start) = line[after_key..].find(is_number).map(|at| after_key + at) {
                let length = line[start..].find(|c| !is_number(c)).unwrap_or(line.len() - start);
                line.replace_range(start..start + length, &format!("{value:?}"));
            }
            if let Ok(rig) = read(&lines.join("\n")) {
                for index in 0..2 {
                    if let Ok(model) = rig.water_camera(index) {
                        let _ = rig.laser_poses(index, &model);
                    }
                }
            }
        }
    }
}
