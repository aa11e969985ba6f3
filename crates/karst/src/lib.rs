//! Library of the `karst` command.

pub mod result;
