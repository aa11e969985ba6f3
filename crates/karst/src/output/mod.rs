//! What the commands write: point clouds, tables, recordings, pictures and reports.

pub mod csv;
pub mod folder;
pub mod mcap;
pub mod overlay;
pub mod page;
pub mod plot;
pub mod ply;
pub mod report;
pub mod summary;
pub mod terminal;

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

/// The viridis colour map at five equal steps: monotonic in brightness and safe for the colour-blind.
const VIRIDIS: [[f64; 3]; 5] =
    [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];

/// Viridis at a fraction of its scale. A single point has no scale (NaN) and gets the dark end.
fn viridis(fraction: f64) -> [u8; 3] {
    let position = if fraction.is_nan() { 0.0 } else { fraction.clamp(0.0, 1.0) * 4.0 };
    let step = (position as usize).min(3);
    let weight = position - step as f64;
    std::array::from_fn(|i| ((1.0 - weight) * VIRIDIS[step][i] + weight * VIRIDIS[step + 1][i]).round() as u8)
}
