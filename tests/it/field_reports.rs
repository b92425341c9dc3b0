//! Footage of kinds that users reported as measured wrongly, each measured against its right value, with variants of
//! other sizes, formats and values.

mod ball;
mod cameras;
mod films;
