//! OpenCV's `FileStorage`, in XML or YAML.

use std::{mem, path::Path};

use karst_rig::Place;
use saphyr_parser::{Event, Parser};

use crate::file::{FileError, excerpt, finite};

/// First line of OpenCV's YAML. It looks like a directive, but no YAML has such a one.
const YAML_HEADER: &str = "%YAML:1.0";
/// Nodes within nodes: OpenCV's have a handful.
const MAX_DEPTH: usize = 16;

/// Whether a file has the name of an OpenCV file: it ends in `.xml`, `.yml` or `.yaml`.
pub fn is_opencv(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    ["xml", "yml", "yaml"].iter().any(|name| extension.eq_ignore_ascii_case(name))
}

/// A node of a file, with what is in it: words and further nodes.
#[derive(Debug)]
pub(crate) struct Node {
    name: String,
    place: Place,
    words: Vec<String>,
    children: Vec<Node>,
}

impl Node {
    /// The root of a file: of XML if the text begins with `<`, else of YAML. `file_name` is for the messages.
    pub fn parse(text: &str, file_name: &str) -> Result<Self, FileError> {
        let text = text.trim_start_matches('\u{feff}');
        if text.trim_start().starts_with('<') {
            Self::from_xml(text, file_name)
        } else {
            Self::from_yaml(text, file_name)
        }
    }

    fn from_xml(text: &str, file_name: &str) -> Result<Self, FileError> {
        let syntax = |line, message| FileError::Syntax { place: Place { file: file_name.to_owned(), line }, message };
        let document =
            roxmltree::Document::parse(text).map_err(|error| syntax(error.pos().row as usize, error.to_string()))?;
        let line_ends: Vec<usize> = text.match_indices('\n').map(|(at, _)| at).collect();
        let line = |element: roxmltree::Node| line_ends.partition_point(|end| *end < element.range().start) + 1;

        fn node(element: roxmltree::Node, depth: usize, new: &impl Fn(roxmltree::Node) -> Node) -> Option<Node> {
            let inside = element.children().filter(roxmltree::Node::is_element);
            let children = inside.map(|inside| node(inside, depth.checked_sub(1)?, new)).collect::<Option<_>>()?;
            Some(Node { children, ..new(element) })
        }
        let new = |element: roxmltree::Node| Self {
            name: element.tag_name().name().to_owned(),
            place: Place { file: file_name.to_owned(), line: line(element) },
            words: element.text().unwrap_or_default().split_whitespace().map(str::to_owned).collect(),
            children: Vec::new(),
        };
        let root = document.root_element();
        node(root, MAX_DEPTH, &new).ok_or_else(|| syntax(line(root), too_deep()))
    }

    fn from_yaml(text: &str, file_name: &str) -> Result<Self, FileError> {
        /// A node whose end was not read yet.
        struct Open {
            node: Node,
            mapping: bool,
            /// The entry of a mapping whose value was not read yet.
            entry: Option<Node>,
        }
        let place = |line| Place { file: file_name.to_owned(), line };
        let syntax = |line, message| FileError::Syntax { place: place(line), message };
        let new = |name, line| Node { name, place: place(line), words: Vec::new(), children: Vec::new() };
        let open = |node, mapping| Open { node, mapping, entry: None };

        let mut inner = open(new(String::new(), 1), false);
        let mut outer: Vec<Open> = Vec::new();
        // The line of the header stays, for the numbers of the others.
        for event in Parser::new_from_str(text.strip_prefix(YAML_HEADER).unwrap_or(text)) {
            let (event, span) = event.map_err(|error| syntax(error.marker().line(), error.info().to_owned()))?;
            let line = span.start.line();
            match event {
                Event::Scalar(name, ..) if inner.mapping && inner.entry.is_none() => {
                    inner.entry = Some(new(name.into_owned(), line));
                }
                Event::Scalar(word, ..) => match inner.entry.take() {
                    Some(entry) => inner.node.children.push(Node { words: vec![word.into_owned()], ..entry }),
                    None => inner.node.words.push(word.into_owned()),
                },
                Event::MappingStart(..) | Event::SequenceStart(..) => {
                    let node = match inner.entry.take() {
                        None if inner.mapping => return Err(syntax(line, "found a key that is no name".to_owned())),
                        entry => entry.unwrap_or_else(|| new(String::new(), line)),
                    };
                    if outer.len() > MAX_DEPTH {
                        return Err(syntax(line, too_deep()));
                    }
                    let mapping = matches!(event, Event::MappingStart(..));
                    outer.push(mem::replace(&mut inner, open(node, mapping)));
                }
                Event::MappingEnd | Event::SequenceEnd => {
                    if let Some(parent) = outer.pop() {
                        let ended = mem::replace(&mut inner, parent);
                        inner.node.children.push(ended.node);
                    }
                }
                Event::Alias(_) => return Err(syntax(line, "found an alias, expected a value".to_owned())),
                Event::DocumentEnd => break,
                Event::Nothing | Event::StreamStart | Event::StreamEnd | Event::DocumentStart(_) => {}
            }
        }
        // The only node of the file, if there is one.
        Ok(inner.node.children.pop().unwrap_or(inner.node))
    }

    pub fn invalid(&self, what: &'static str, found: String, expected: String) -> FileError {
        FileError::Invalid { place: self.place.clone(), what, found, expected }
    }

    /// The words, as messages quote them.
    pub fn excerpt(&self) -> String {
        excerpt(&self.words.join(" "))
    }

    pub fn optional(&self, name: &str) -> Option<&Self> {
        self.children.iter().find(|node| node.name == name)
    }

    pub fn child(&self, name: &'static str) -> Result<&Self, FileError> {
        self.optional(name).ok_or_else(|| self.invalid(name, "none".to_owned(), "one".to_owned()))
    }

    /// The matrices of a list, each as its node and its numbers, `channels` per point.
    pub fn matrices(&self, what: &'static str, channels: usize) -> Result<Vec<(&Self, Vec<f64>)>, FileError> {
        self.children.iter().map(|matrix| Ok((matrix, matrix.matrix(what, channels)?))).collect()
    }

    /// The numbers of a matrix, `channels` per element.
    pub fn matrix(&self, what: &'static str, channels: usize) -> Result<Vec<f64>, FileError> {
        let data = self.child("data")?;
        let number = |word: &String| {
            let expected = || "numbers up to a million in magnitude".to_owned();
            finite(word).ok_or_else(|| data.invalid(what, excerpt(word), expected()))
        };
        let numbers: Vec<f64> = data.words.iter().map(number).collect::<Result<_, _>>()?;
        let size = |name| -> Result<usize, FileError> {
            let node = self.child(name)?;
            let size = if let [word] = node.words.as_slice() { word.parse().ok() } else { None };
            size.ok_or_else(|| node.invalid(name, node.excerpt(), "a whole number".to_owned()))
        };
        let points = size("rows")?.checked_mul(size("cols")?);
        let expected = points.and_then(|points| points.checked_mul(channels));
        if expected != Some(numbers.len()) {
            let expected = format!("rows x cols x {channels}");
            return Err(data.invalid(what, format!("{} numbers", numbers.len()), expected));
        }
        Ok(numbers)
    }

    /// The number that this is. None: it is something else.
    pub fn number(&self) -> Option<f64> {
        if let [word] = self.words.as_slice() { finite(word) } else { None }
    }

    /// The number that this is, or the first of the matrix that this is: programs differ in what they write.
    pub fn number_or_matrix(&self, what: &'static str) -> Result<Option<f64>, FileError> {
        if self.children.is_empty() { Ok(self.number()) } else { Ok(self.matrix(what, 1)?.first().copied()) }
    }

    pub fn image_size(&self) -> Result<[u32; 2], FileError> {
        let size: Result<Vec<u32>, _> = self.words.iter().map(|word| word.parse()).collect();
        let size = size.ok().and_then(|size| <[u32; 2]>::try_from(size).ok()).filter(|size| !size.contains(&0));
        size.ok_or_else(|| self.invalid("imageSize", self.excerpt(), "width and height, px".to_owned()))
    }
}

fn too_deep() -> String {
    format!("nodes are nested deeper than {MAX_DEPTH}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn message(text: &str) -> String {
        Node::parse(text, "f").unwrap_err().to_string()
    }

    #[test]
    fn deep_nests_are_refused_with_the_line() {
        assert_eq!(
            message(&format!("<a>{}{}</a>", "<b>".repeat(17), "</b>".repeat(17))),
            "f:1: nodes are nested deeper than 16"
        );
        assert_eq!(message(&format!("\n{}", "- ".repeat(100_000))), "f:2: nodes are nested deeper than 16");
        let deepest = format!("<a>{}{}</a>", "<b>".repeat(16), "</b>".repeat(16));
        assert!(Node::parse(&deepest, "f").is_ok());
        let deepest = "- ".repeat(17);
        assert!(Node::parse(&deepest, "f").is_ok());
    }

    #[test]
    fn yaml_that_opencv_does_not_write_is_refused_with_the_line() {
        assert_eq!(message("a: 1\n? [b]\n: c\n"), "f:2: found a key that is no name");
        assert_eq!(message("a: &x 1\nb: *x\n"), "f:2: found an alias, expected a value");
        assert!(message("a: 1\nb: [ 1, 2\nc: 3\n").starts_with("f:3: "), "{}", message("a: 1\nb: [ 1, 2\nc: 3\n"));
    }

    #[test]
    fn files_begin_with_or_without_byte_order_mark_header_and_document_start() {
        for start in
            ["", "---\n", "%YAML:1.0\n", "%YAML:1.0\r\n---\r\n", "\u{feff}%YAML:1.0\n---\n", "%YAML 1.2\n---\n"]
        {
            let root = Node::parse(&format!("{start}xi: 1.5\n"), "f").unwrap();
            assert_eq!(root.child("xi").unwrap().number(), Some(1.5), "{start:?}");
        }
        let root =
            Node::parse("\u{feff}<?xml version=\"1.0\"?>\n<opencv_storage><xi>1.5</xi></opencv_storage>", "f").unwrap();
        assert_eq!(root.child("xi").unwrap().number(), Some(1.5));
    }

    #[test]
    fn a_file_without_nodes_lacks_every_node() {
        for text in ["", "%YAML:1.0\n---\n", "# nothing\n", "word", "[]", "- a\n- b\n"] {
            let error = Node::parse(text, "f").unwrap().child("xi").unwrap_err().to_string();
            assert!(error.ends_with(": xi: found none, expected one"), "{text:?}: {error}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "[-%&*!?\\[\\]{}:,.<>/'\"|#a1 \n]{0,60}") {
            let _ = Node::parse(&text, "f");
        }
    }
}
