//! Library of the `karst` command.

pub mod input;
pub mod output;
pub mod result;
