//! The integration tests, in one binary.

mod bounce;
mod impact;
mod motion;
