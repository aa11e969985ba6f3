//! Cycle model.
#![forbid(unsafe_code)]

mod detector;
mod stream;
mod timing;
mod top;

pub use detector::{Detector, Early, Generics, Mask, Record};
pub use stream::{Beat, Pixels, Row, rows_of};
pub use top::{Reconstruction, Top, TopGenerics};
