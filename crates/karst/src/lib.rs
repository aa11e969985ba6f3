//! Library of the `karst` command.

pub mod eval;
pub mod input;
pub mod instrument;
pub mod output;
pub mod result;
