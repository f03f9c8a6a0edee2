//! The plywave command.
fn main() {}
