//! The tagged blocks of a CINE file, with the time and the exposure of each image, and the profile of its rate.

use super::{Cine, u16_at, u32_at};
use std::collections::BTreeMap;
use std::fmt;

/// The type of the block with the times of the images.
const IMAGE_TIMES: u16 = 1002;
/// The type of the block with the exposures of the images.
const EXPOSURES: u16 = 1003;
/// Maximum number of blocks.
const MAX_BLOCKS: usize = 64;
/// Size of the head of a block: its size and its type.
const HEAD_BYTES: u64 = 8;
/// The lowest two bits of a time are flags of the synchronisation and of the event input.
const FLAGS: u32 = 3;
/// Resolution of a time: 2^-30 s, and as much for the clock of the camera, ns.
pub(super) const RESOLUTION_NS: f64 = 2.0;

/// Converts seconds and a fraction in units of 2^-32 s to ns.
pub(super) fn ns_of(seconds: u32, fraction: u32) -> u64 {
    u64::from(seconds) * 1_000_000_000 + ((u64::from(fraction) * 1_000_000_000) >> 32)
}

/// Values per image.
pub(super) struct Blocks {
    /// Time of each image, ns since the Unix epoch.
    pub(super) times_ns: Option<Vec<i64>>,
    /// Shortest and longest exposure, us.
    exposures_us: Option<[f64; 2]>,
}

impl Blocks {
    /// Reads the blocks from byte `at` of the file, behind the set-up, to the table of offsets. Damaged blocks end the
    /// search.
    pub(super) fn read(cine: &Cine, mut at: u64) -> Self {
        let mut blocks = Self { times_ns: None, exposures_us: None };
        for _ in 0..MAX_BLOCKS {
            if at + HEAD_BYTES > cine.offsets {
                break;
            }
            let Ok(head) = cine.read(at, HEAD_BYTES as usize) else { break };
            let bytes = u64::from(u32_at(&head, 0));
            if bytes < HEAD_BYTES || at + bytes > cine.offsets {
                break;
            }
            let values = |value_bytes: u64| {
                let wanted = u64::from(cine.count) * value_bytes;
                let fits = bytes - HEAD_BYTES >= wanted;
                fits.then(|| cine.read(at + HEAD_BYTES, wanted as usize).ok()).flatten()
            };
            match u16_at(&head, 4) {
                IMAGE_TIMES => blocks.times_ns = values(8).map(|values| image_times(&values)),
                EXPOSURES => blocks.exposures_us = values(4).map(|values| extreme_exposures_us(&values)),
                _ => {}
            }
            at += bytes;
        }
        blocks
    }

    /// Adds the shortest exposure of the images to the properties of the camera, and the longest if it differs.
    pub(super) fn describe(&self, entries: &mut BTreeMap<String, String>) {
        let Some([shortest_us, longest_us]) = self.exposures_us.filter(|exposures| exposures[0] > 0.0) else { return };
        entries.insert("exposure_us".into(), format!("{shortest_us:.3}"));
        // The exposures of an automatic control differ by more than their resolution.
        if longest_us > 1.001 * shortest_us {
            entries.insert("exposure_max_us".into(), format!("{longest_us:.3}"));
        }
    }
}

/// Converts times of 32.32 bits to ns since the Unix epoch, without their flags.
fn image_times(values: &[u8]) -> Vec<i64> {
    values.chunks_exact(8).map(|time| ns_of(u32_at(time, 4), u32_at(time, 0) & !FLAGS) as i64).collect()
}

/// Returns the shortest and the longest of exposures, us, which are stored in units of 2^-32 s.
fn extreme_exposures_us(values: &[u8]) -> [f64; 2] {
    let exposures = values.chunks_exact(4).map(|value| f64::from(u32_at(value, 0)) / 2_f64.powi(32) * 1e6);
    exposures
        .fold([f64::INFINITY, 0.0], |[shortest, longest], exposure| [exposure.min(shortest), exposure.max(longest)])
}

/// A rate that changes at given images: their numbers, counted from the trigger, and the rates from there on, Hz.
pub(super) struct Profile(pub(super) Vec<(i64, u32)>);

impl Profile {
    /// Integrates the periods from the trigger to an image, ns, negative for an image before it. `before_hz` is the
    /// rate up to the first change.
    pub(super) fn since_trigger_ns(&self, image: i64, before_hz: f64) -> f64 {
        let (from, to) = (image.min(0), image.max(0));
        let ends = self.0.iter().map(|(end, _)| *end).chain([i64::MAX]);
        let rates = std::iter::once(before_hz).chain(self.0.iter().map(|(_, hz)| f64::from(*hz)));
        let (mut start, mut since_ns) = (i64::MIN, 0.0);
        for (end, rate_hz) in ends.zip(rates) {
            since_ns += (end.min(to).saturating_sub(start.max(from))).max(0) as f64 * 1e9 / rate_hz;
            start = end;
        }
        if image < 0 { -since_ns } else { since_ns }
    }
}

impl fmt::Display for Profile {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("the frame rate changes")?;
        self.0.iter().try_for_each(|(image, hz)| write!(formatter, ", at image {image} to {hz} frames/s"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 100 Hz up to image 10, 1000 Hz from there to image 30, then 10 Hz.
    #[test]
    fn a_profile_adds_up_its_periods() {
        let profile = Profile(vec![(10, 1000), (30, 10)]);
        let since_ms = |image| profile.since_trigger_ns(image, 100.0) * 1e-6;
        let expected = [(-5, -50.0), (0, 0.0), (5, 50.0), (10, 100.0), (20, 110.0), (30, 120.0), (31, 220.0)];
        for (image, ms) in expected {
            assert!((since_ms(image) - ms).abs() < 1e-9, "{image}: {}", since_ms(image));
        }
    }
}
