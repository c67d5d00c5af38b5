//! The `sonoweave` command.

fn main() {}
