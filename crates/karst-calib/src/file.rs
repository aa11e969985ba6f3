//! What the readers of files share.

use std::io;

use karst_rig::Place;
use roxmltree::{Document, Node};

/// Numbers beyond this are no coordinates, px or mm.
const MAX_NUMBER: f64 = 1e6;
/// Longest excerpt of the file in a message, characters.
const EXCERPT: usize = 40;

/// Why a corner list or an OpenCV file was not accepted.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The file cannot be read.
    #[error("{file}: {source}")]
    Read {
        /// File name.
        file: String,
        /// Reason.
        source: io::Error,
    },
    /// Not CSV or XML.
    #[error("{place}: {message}")]
    Syntax {
        /// Where.
        place: Place,
        /// What is wrong.
        message: String,
    },
    /// A value that is missing, is no number or makes no sense.
    #[error("{place}: {what}: found {found}, expected {expected}")]
    Invalid {
        /// Where.
        place: Place,
        /// Which value.
        what: &'static str,
        /// What is there.
        found: String,
        /// What would be right.
        expected: String,
    },
}

impl FileError {
    pub(crate) fn xml(error: &roxmltree::Error, file_name: &str) -> Self {
        let place = Place { file: file_name.to_owned(), line: error.pos().row as usize };
        Self::Syntax { place, message: error.to_string() }
    }
}

/// An OpenCV `FileStorage` in XML.
pub(crate) struct XmlFile<'a> {
    pub xml: &'a Document<'a>,
    pub file_name: &'a str,
}

impl<'a> XmlFile<'a> {
    pub fn invalid(&self, node: Node, what: &'static str, found: String, expected: String) -> FileError {
        let line = self.xml.text_pos_at(node.range().start).row as usize;
        FileError::Invalid { place: Place { file: self.file_name.to_owned(), line }, what, found, expected }
    }

    pub fn child(&self, parent: Node<'a, 'a>, name: &'static str) -> Result<Node<'a, 'a>, FileError> {
        let child = parent.children().find(|node| node.has_tag_name(name));
        child.ok_or_else(|| {
            let found = format!("none in {}", excerpt(parent.tag_name().name()));
            self.invalid(parent, name, found, format!("<{name}>"))
        })
    }

    /// The matrices of a list, each as its node and its numbers, `channels` per point.
    pub fn matrices(
        &self,
        list: Node<'a, 'a>,
        what: &'static str,
        channels: usize,
    ) -> Result<Vec<(Node<'a, 'a>, Vec<f64>)>, FileError> {
        let matrices = list.children().filter(Node::is_element);
        matrices.map(|matrix| Ok((matrix, self.matrix(matrix, what, channels)?))).collect()
    }

    /// The numbers of a matrix, `channels` per element.
    pub fn matrix(&self, matrix: Node<'a, 'a>, what: &'static str, channels: usize) -> Result<Vec<f64>, FileError> {
        let data = self.child(matrix, "data")?;
        let words: Vec<&str> = data.text().unwrap_or_default().split_whitespace().collect();
        let numbers: Option<Vec<f64>> = words.iter().map(|word| finite(word)).collect();
        let Some(numbers) = numbers else {
            let wrong = words.iter().find(|word| finite(word).is_none()).copied().unwrap_or_default();
            let expected = "numbers up to a million in magnitude".to_owned();
            return Err(self.invalid(data, what, excerpt(wrong), expected));
        };
        let size = |name| -> Result<usize, FileError> {
            let node = self.child(matrix, name)?;
            let text = node.text().unwrap_or_default().trim();
            text.parse().map_err(|_| self.invalid(node, name, excerpt(text), "a whole number".to_owned()))
        };
        let points = size("rows")?.checked_mul(size("cols")?);
        let expected = points.and_then(|points| points.checked_mul(channels));
        if expected != Some(numbers.len()) {
            let expected = format!("rows x cols x {channels}");
            return Err(self.invalid(data, what, format!("{} numbers", numbers.len()), expected));
        }
        Ok(numbers)
    }

    /// The number that an element holds.
    pub fn number(&self, node: Node) -> Option<f64> {
        finite(node.text().unwrap_or_default().trim())
    }

    pub fn image_size(&self, node: Node<'a, 'a>) -> Result<[u32; 2], FileError> {
        let text = node.text().unwrap_or_default();
        let size: Result<Vec<u32>, _> = text.split_whitespace().map(str::parse).collect();
        let size = size.ok().and_then(|size| <[u32; 2]>::try_from(size).ok()).filter(|size| !size.contains(&0));
        size.ok_or_else(|| self.invalid(node, "imageSize", excerpt(text.trim()), "width and height, px".to_owned()))
    }
}

/// A number that can be a coordinate.
pub(crate) fn finite(text: &str) -> Option<f64> {
    text.parse().ok().filter(|value: &f64| value.abs() <= MAX_NUMBER)
}

/// Text as messages quote it.
pub(crate) fn excerpt(text: &str) -> String {
    let mut characters = text.chars();
    let cut: String = characters.by_ref().take(EXCERPT).collect();
    if characters.next().is_some() { format!("'{cut}...'") } else { format!("'{cut}'") }
}
