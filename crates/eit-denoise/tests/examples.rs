//! The example runs, and shows what it promises.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "../examples/image_stack.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod image_stack;

/// A number divided by itself is one exactly.
#[test]
fn image_stack_example() {
    assert_eq!(image_stack::run().unwrap(), 1.0);
}
