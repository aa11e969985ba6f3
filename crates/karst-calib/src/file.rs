//! What the readers of files share.

use std::io;

use karst_rig::Place;

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
    /// Not CSV, XML or YAML.
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
