//! The output folder.

use std::io;
use std::path::{Path, PathBuf};

/// Why a folder cannot take output.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// The path names something else.
    #[error("output folder {}: this is a file, expected a folder", .0.display())]
    NotAFolder(PathBuf),
    /// The folder does not exist and could not be created.
    #[error("output folder {}: cannot create it: {source}", .path.display())]
    Create {
        /// The folder.
        path: PathBuf,
        /// What the operating system says.
        source: io::Error,
    },
    /// The folder exists but no file can be created in it.
    #[error("output folder {}: cannot write into it: {source}", .path.display())]
    NotWritable {
        /// The folder.
        path: PathBuf,
        /// What the operating system says.
        source: io::Error,
    },
}

/// Creates the folder and its parents where missing, and checks that files can be created in it: better before the
/// computation than after.
pub fn prepare(path: &Path) -> Result<(), FolderError> {
    if path.exists() && !path.is_dir() {
        return Err(FolderError::NotAFolder(path.to_owned()));
    }
    std::fs::create_dir_all(path).map_err(|source| FolderError::Create { path: path.to_owned(), source })?;
    // Permission bits say too little (root, read-only mounts, full disks): try.
    tempfile::NamedTempFile::new_in(path)
        .map(drop)
        .map_err(|source| FolderError::NotWritable { path: path.to_owned(), source })
}
