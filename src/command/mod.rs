//! What a person runs and waits for, one file a command.

pub mod export;
pub mod import;

pub mod info;

pub mod recover;
