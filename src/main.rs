//! The `sizeup` command.

fn main() {}
