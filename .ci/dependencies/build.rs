//! Nothing: with it, Cargo compiles the dependencies of builds.
fn main() {}
