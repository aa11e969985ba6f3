//! What the commands write: point clouds, tables, recordings, pictures and reports.

pub mod csv;
pub mod folder;
pub mod mcap;
pub mod overlay;
pub mod plot;
pub mod ply;
pub mod report;
pub mod summary;

/// Why an output could not be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The file or stream refused the data.
    #[error("cannot write the output: {0}")]
    Io(#[from] std::io::Error),
    /// The CSV table could not be written.
    #[error("cannot write the CSV table: {0}")]
    Csv(#[from] ::csv::Error),
    /// The MCAP recording could not be written.
    #[error("cannot write the MCAP recording: {0}")]
    Mcap(#[from] ::mcap::McapError),
    /// A picture could not be encoded.
    #[error("cannot encode the picture: {0}")]
    Image(#[from] image::ImageError),
    /// A plot could not be drawn.
    #[error("cannot draw the plot: {0}")]
    Plot(String),
    /// A number that the file format cannot hold.
    #[error("{what} {value} does not fit the format (at most {max})")]
    TooLarge {
        /// What the number counts.
        what: &'static str,
        /// The number.
        value: usize,
        /// Largest number that fits.
        max: usize,
    },
}
