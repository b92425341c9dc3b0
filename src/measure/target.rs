//! A frame that motions lead to.

use crate::dic::Prepared;

/// A frame that motions lead to, made ready where the bodies of one block are.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target<'a> {
    pub(super) sequence: u64,
    pub(super) prepared: &'a Prepared,
    /// Whether it is ready only where the bodies are foretold to be, not as far as they are searched for.
    pub(super) is_narrow: bool,
}
