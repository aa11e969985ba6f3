#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod budget;
mod detector;
mod firmware;
mod frames;
mod scene;
mod stream;
mod timing;
mod top;

pub use budget::{BudgetRow, MOST_LASERS, Scenario, detectors};
pub use detector::{Detector, Early, Generics, Mask, Record};
pub use firmware::{PROCESSOR, Processor, SensorClocks};
pub use frames::{Camera, FrameClocks, frames};
pub use karst_link::Mode;
pub use scene::Scene;
pub use stream::{Beat, Pixels, Row, rows_of};
pub use top::{Reconstruction, Top, TopGenerics};
