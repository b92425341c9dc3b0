//! What a person runs and waits for, one file a command.

pub mod bench;
pub mod field;
