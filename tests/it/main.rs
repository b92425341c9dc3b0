//! The integration tests, in one binary.
#![expect(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::float_cmp,
    clippy::print_stdout,
    reason = "a test fails by panicking, compares floats to the bit and prints figures"
)]

mod import;
mod recording;
