//! The jobs of the continuous integration.
fn main() {}
