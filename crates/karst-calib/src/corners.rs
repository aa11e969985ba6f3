//! Corner lists: where the corners of a board are in each picture.

use std::{
    collections::{HashMap, HashSet},
    fs,
    path::Path,
};

use karst_rig::Place;

use crate::file::{FileError, excerpt, finite};
use crate::opencv::{Node, is_opencv};

/// Columns of a corner list in CSV.
const COLUMNS: [&str; 6] = ["image", "idx", "board_x_mm", "board_y_mm", "u_px", "v_px"];

/// One corner of the board in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Number of the corner on the board.
    pub index: usize,
    /// Position on the board, mm.
    pub board_mm: [f64; 2],
    /// Position in the picture (column, row), px; (0, 0) is the centre of the top left pixel.
    pub pixel: [f64; 2],
}

/// One picture of the board.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// File name of the picture, or `view 1` and so on where the list has no names.
    pub name: String,
    /// The corners found.
    pub corners: Vec<Corner>,
}

/// The corners of a plane board in the pictures of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CornerList {
    /// The pictures, in the order of the list.
    pub views: Vec<View>,
    /// Width and height of the pictures, px, where the list has them.
    pub image_size_px: Option<[u32; 2]>,
}

impl CornerList {
    /// Reads a list: OpenCV XML or YAML from files whose name ends in `.xml`, `.yml` or `.yaml`, CSV from all others.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, FileError> {
        let path = path.as_ref();
        let file = path.display().to_string();
        let text = match fs::read_to_string(path) {
            Ok(text) => text,
            Err(source) => return Err(FileError::Read { file, source }),
        };
        if is_opencv(path) { Self::from_opencv(&text, &file) } else { Self::from_csv(&text, &file) }
    }

    /// The list as [`CornerList::from_csv`] reads it, places to a ten thousandth of a pixel.
    pub fn to_csv(&self) -> String {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let corners = self.views.iter().flat_map(|view| view.corners.iter().map(move |corner| (&view.name, corner)));
        let lines = corners.map(|(name, Corner { index, board_mm: [x, y], pixel: [u, v] })| {
            [name.clone(), index.to_string(), x.to_string(), y.to_string(), format!("{u:.4}"), format!("{v:.4}")]
        });
        // Memory takes whatever is written, and all of it is text.
        let header = writer.write_record(COLUMNS);
        let written = header.and_then(|()| lines.into_iter().try_for_each(|line| writer.write_record(line)));
        let bytes = written.ok().and_then(|()| writer.into_inner().ok()).unwrap_or_default();
        String::from_utf8_lossy(&bytes).into_owned()
    }

    /// Reads `image,idx,board_x_mm,board_y_mm,u_px,v_px` lines under a header with these names. `file_name` is for the
    /// messages.
    pub fn from_csv(text: &str, file_name: &str) -> Result<Self, FileError> {
        let place = |line: u64| Place { file: file_name.to_owned(), line: line.max(1) as usize };
        let syntax = |error: csv::Error| {
            let line = error.position().map_or(1, |position| position.line());
            let message = match error.kind() {
                csv::ErrorKind::UnequalLengths { len, .. } => {
                    format!("found {len} values, expected the {} of the header", COLUMNS.len())
                }
                _ => error.to_string(),
            };
            FileError::Syntax { place: place(line), message }
        };
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
        let header = reader.headers().map_err(syntax)?;
        if header != COLUMNS.as_slice() {
            let found = excerpt(&header.iter().collect::<Vec<_>>().join(","));
            return Err(FileError::Invalid { place: place(1), what: "header", found, expected: COLUMNS.join(",") });
        }
        let mut views: Vec<View> = Vec::new();
        let mut view_of: HashMap<String, usize> = HashMap::new();
        let mut seen = HashSet::new();
        for record in reader.records() {
            let record = record.map_err(syntax)?;
            let line = record.position().map_or(1, csv::Position::line);
            let invalid = |column: usize, expected: &str| FileError::Invalid {
                place: place(line),
                what: COLUMNS[column],
                found: excerpt(&record[column]),
                expected: expected.to_owned(),
            };
            let number = |column: usize| {
                finite(&record[column]).ok_or_else(|| invalid(column, "a number up to a million in magnitude"))
            };
            let name = &record[0];
            if name.is_empty() {
                return Err(invalid(0, "the name of a picture"));
            }
            let index = record[1].parse().map_err(|_| invalid(1, "a whole number from 0"))?;
            let corner = Corner { index, board_mm: [number(2)?, number(3)?], pixel: [number(4)?, number(5)?] };
            let view = *view_of.entry(name.to_owned()).or_insert_with(|| {
                views.push(View { name: name.to_owned(), corners: Vec::new() });
                views.len() - 1
            });
            if !seen.insert((view, index)) {
                return Err(invalid(1, "each corner once per picture"));
            }
            views[view].corners.push(corner);
        }
        Ok(Self { views, image_size_px: None })
    }

    /// Reads OpenCV's `objectPoints` and `imagePoints`, XML or YAML, as the omnidirectional calibration sample writes
    /// them: one matrix per view in each, with the same number of points. Board coordinates are taken to be mm; their z
    /// must be 0. `file_name` is for the messages.
    pub fn from_opencv(text: &str, file_name: &str) -> Result<Self, FileError> {
        let root = Node::parse(text, file_name)?;
        let pictures_node = root.child("imagePoints")?;
        let boards = root.child("objectPoints")?.matrices("objectPoints", 3)?;
        let pictures = pictures_node.matrices("imagePoints", 2)?;
        if boards.len() != pictures.len() {
            let found = format!("{} views", pictures.len());
            return Err(pictures_node.invalid("imagePoints", found, format!("{} as in objectPoints", boards.len())));
        }
        let image_size_px = root.optional("imageSize").map(Node::image_size).transpose()?;
        let mut views = Vec::new();
        for (number, ((board_node, board), (picture_node, picture))) in boards.into_iter().zip(pictures).enumerate() {
            if board.len() / 3 != picture.len() / 2 {
                let (found, expected) = (picture.len() / 2, format!("{} as in objectPoints", board.len() / 3));
                return Err(picture_node.invalid("imagePoints", format!("{found} points"), expected));
            }
            if let Some(point) = board.chunks_exact(3).find(|point| point[2] != 0.0) {
                let expected = "0: a plane board".to_owned();
                return Err(board_node.invalid("z of objectPoints", point[2].to_string(), expected));
            }
            let points = board.chunks_exact(3).zip(picture.chunks_exact(2)).enumerate();
            let corners =
                points.map(|(index, (b, p))| Corner { index, board_mm: [b[0], b[1]], pixel: [p[0], p[1]] }).collect();
            views.push(View { name: format!("view {}", number + 1), corners });
        }
        Ok(Self { views, image_size_px })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CSV: &str =
        "image,idx,board_x_mm,board_y_mm,u_px,v_px\na.png,0,0,0,10.5,20\nb.png,0,0,0,11,21\na.png,1,30,0,12,20\n";
    const XML: &str = "<?xml version=\"1.0\"?>\n<opencv_storage>\n<objectPoints>\n<_ type_id=\"opencv-matrix\">\n\
        <rows>2</rows><cols>1</cols><dt>\"3d\"</dt>\n<data>0. 0. 0. 2.0e+001 0. 0.</data></_></objectPoints>\n\
        <imagePoints>\n<_ type_id=\"opencv-matrix\"><rows>2</rows><cols>1</cols><dt>\"2f\"</dt>\n\
        <data>6.75e+002 258. 656 273</data></_></imagePoints>\n<imageSize>\n  1280 960</imageSize>\n</opencv_storage>\n";
    const YAML: &str = "%YAML:1.0\n---\nobjectPoints:\n   - !!opencv-matrix\n      rows: 2\n      cols: 1\n      dt: \"3d\"\n\
        \x20     data: [ 0., 0., 0., 2.0e+001, 0., 0. ]\nimagePoints:\n   - !!opencv-matrix\n      rows: 2\n      cols: 1\n\
        \x20     dt: \"2f\"\n      data: [ 6.75e+002, 258.,\n          656, 273 ]\nimageSize: [ 1280, 960 ]\n";

    fn csv_message(from: &str, to: &str) -> String {
        assert!(CSV.contains(from));
        CornerList::from_csv(&CSV.replacen(from, to, 1), "c.csv").unwrap_err().to_string()
    }

    fn xml_message(from: &str, to: &str) -> String {
        assert!(XML.contains(from));
        CornerList::from_opencv(&XML.replacen(from, to, 1), "c.xml").unwrap_err().to_string()
    }

    #[test]
    fn csv_rows_are_grouped_by_picture() {
        let list = CornerList::from_csv(CSV, "c.csv").unwrap();
        assert_eq!(list.views.len(), 2);
        let expected = Corner { index: 1, board_mm: [30.0, 0.0], pixel: [12.0, 20.0] };
        assert_eq!((list.views[0].name.as_str(), list.views[0].corners[1]), ("a.png", expected));
    }

    #[test]
    fn csv_errors_name_file_line_found_and_expected() {
        assert_eq!(
            csv_message("idx", "id"),
            "c.csv:1: header: found 'image,id,board_x_mm,board_y_mm,u_px,v_px', \
             expected image,idx,board_x_mm,board_y_mm,u_px,v_px"
        );
        assert_eq!(
            csv_message("11,21", "NaN,21"),
            "c.csv:3: u_px: found 'NaN', expected a number up to a million in magnitude"
        );
        assert_eq!(csv_message("12,20", "12"), "c.csv:4: found 5 values, expected the 6 of the header");
        assert_eq!(csv_message("a.png,1", "a.png,0"), "c.csv:4: idx: found '0', expected each corner once per picture");
        assert_eq!(csv_message("b.png,0", "b.png,-1"), "c.csv:3: idx: found '-1', expected a whole number from 0");
        assert_eq!(csv_message("b.png", ""), "c.csv:3: image: found '', expected the name of a picture");
        assert!(CornerList::load("no/such.csv").unwrap_err().to_string().starts_with("no/such.csv: "));
    }

    #[test]
    fn opencv_xml_is_read() {
        let list = CornerList::from_opencv(XML, "c.xml").unwrap();
        assert_eq!(list.image_size_px, Some([1280, 960]));
        let expected = Corner { index: 1, board_mm: [20.0, 0.0], pixel: [656.0, 273.0] };
        assert_eq!((list.views[0].name.as_str(), list.views[0].corners[1]), ("view 1", expected));
    }

    #[test]
    fn opencv_yaml_is_the_same_list() {
        let list = CornerList::from_opencv(YAML, "c.yml").unwrap();
        assert_eq!(list, CornerList::from_opencv(XML, "c.xml").unwrap());
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in [("c.xml", XML), ("c.yml", YAML), ("c.YAML", YAML)] {
            fs::write(folder.path().join(name), text).unwrap();
            assert_eq!(CornerList::load(folder.path().join(name)).unwrap(), list);
        }
    }

    #[test]
    fn yaml_errors_name_file_line_found_and_expected() {
        let message = |from: &str, to: &str| {
            assert!(YAML.contains(from));
            CornerList::from_opencv(&YAML.replacen(from, to, 1), "c.yml").unwrap_err().to_string()
        };
        assert_eq!(
            message("656", ".inf"),
            "c.yml:14: imagePoints: found '.inf', expected numbers up to a million in magnitude"
        );
        assert_eq!(message("656, 273", "656"), "c.yml:14: imagePoints: found 3 numbers, expected rows x cols x 2");
        assert_eq!(message("imagePoints", "points"), "c.yml:3: imagePoints: found none, expected one");
        assert_eq!(message("1280, 960", "1280"), "c.yml:16: imageSize: found '1280', expected width and height, px");
    }

    #[test]
    fn xml_errors_name_file_line_found_and_expected() {
        assert_eq!(
            xml_message("656", "inf"),
            "c.xml:9: imagePoints: found 'inf', expected numbers up to a million in magnitude"
        );
        assert_eq!(xml_message("656 273", "656"), "c.xml:9: imagePoints: found 3 numbers, expected rows x cols x 2");
        assert_eq!(
            xml_message("imagePoints>", "points>").split(':').next(),
            Some("c.xml"),
            "an element that is not closed is a syntax error"
        );
        assert_eq!(
            xml_message("2.0e+001 0. 0.", "2.0e+001 0. 1."),
            "c.xml:4: z of objectPoints: found 1, expected 0: a plane board"
        );
        assert_eq!(xml_message("1280 960", "1280"), "c.xml:10: imageSize: found '1280', expected width and height, px");
        assert_eq!(xml_message("<rows>2", "<rows>x"), "c.xml:5: rows: found 'x', expected a whole number");
        let renamed = XML.replace("objectPoints>", "points>");
        let error = CornerList::from_opencv(&renamed, "c.xml").unwrap_err().to_string();
        assert_eq!(error, "c.xml:2: objectPoints: found none, expected one");
    }

    proptest! {
        #[test]
        fn any_csv_is_read_or_refused(text in "[-+0-9.e,\na\"]{0,200}") {
            let _ = CornerList::from_csv(&format!("{}\n{text}", COLUMNS.join(",")), "c.csv");
            let _ = CornerList::from_csv(&text, "c.csv");
        }

        #[test]
        fn a_damaged_csv_is_read_or_refused(at in 0..CSV.len(), with in any::<char>()) {
            let mut text = CSV.to_owned();
            text.replace_range(at..=at, &with.to_string());
            let _ = CornerList::from_csv(&text, "c.csv");
        }

        #[test]
        fn a_damaged_yaml_is_read_or_refused(
            at in 0..YAML.len(), length in 0_usize..30, with in "[-!&*?\\[\\]{}:,#'0-9a \n\"]{0,9}",
        ) {
            let mut text = YAML.to_owned();
            text.replace_range(at..(at + length).min(YAML.len()), &with);
            let _ = CornerList::from_opencv(&text, "c.yml");
        }

        #[test]
        fn a_damaged_xml_is_read_or_refused(at in 0..XML.len(), length in 0_usize..30, with in "[<>/_0-9a-z \"]{0,9}") {
            let mut text = XML.to_owned();
            text.replace_range(at..(at + length).min(XML.len()), &with);
            let _ = CornerList::from_opencv(&text, "c.xml");
        }
    }
}
