//! Shares of a list of films.

use std::str::FromStr;

/// The metadata of results that names the version and the settings that they were made with.
pub(super) const SETTINGS: &str = "batch_settings";

/// One share of the films of a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// The number of the share, from 1.
    pub(super) index: usize,
    /// The number of shares.
    pub(super) of: usize,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(index, of)| Some((index.parse().ok()?, of.parse().ok()?)));
        match numbers {
            Some((index, of)) if (1..=of).contains(&index) && of <= 100_000 => Ok(Self { index, of }),
            _ => Err("must be K/N with 1 <= K <= N <= 100000, such as 3/16".into()),
        }
    }
}
