//! The `karst` command.
fn main() {}
