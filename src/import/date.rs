//! The date on which a file states that it was filmed.

/// Exif tag of the date and time at which a picture was taken; it lies in the Exif directory.
const DATE_TIME_ORIGINAL: u64 = 0x9003;
/// TIFF tag of the date and time of a picture.
const DATE_TIME: u64 = 0x0132;
/// TIFF tag of the place of the Exif directory.
const EXIF_DIRECTORY: u64 = 0x8769;
/// The length of an Exif date.
const DATE_LETTERS: usize = 19;
/// Bytes of an entry of a directory.
const ENTRY_BYTES: usize = 12;

/// Converts an Exif date, `2024:05:01 12:00:00`, to ISO 8601 without a time zone, which it does not state. `None` for
/// another text, and for a clock that was never set.
pub(super) fn from_exif_text(text: &str) -> Option<String> {
    let text = text.trim_matches(['\0', ' ']);
    let (date, time) = text.split_once(' ')?;
    let is_plain =
        text.len() == DATE_LETTERS && text.bytes().all(|byte| byte.is_ascii_digit() || b": ".contains(&byte));
    is_plain.then(|| format!("{}T{time}", date.replace(':', "-"))).filter(|date| is_set(date))
}

/// Returns a date in ISO 8601 as the container of a film states it; `None` for another text, and for a clock that was
/// never set.
pub(super) fn from_iso_text(text: &str) -> Option<String> {
    let text = text.trim();
    let is_date = text.len() >= 10
        && text.len() <= 40
        && text
            .bytes()
            .zip(*b"dddd-dd-dd")
            .all(|(byte, kind)| if kind == b'd' { byte.is_ascii_digit() } else { byte == kind })
        && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-:+. ".contains(&byte));
    is_date.then(|| text.replacen(' ', "T", 1)).filter(|date| is_set(date))
}

/// Whether a date is later than those that clocks begin with: 1904 (QuickTime), 1970 (Unix), 1980 (DOS).
fn is_set(date: &str) -> bool {
    !["0000-", "1904-", "1970-", "1980-01-01"].iter().any(|unset| date.starts_with(unset))
}

/// Returns the date of a picture from its Exif block, a TIFF file of its own: that of the exposure, else that of the
/// picture. `None` if it states none.
pub(super) fn from_exif(block: &[u8]) -> Option<String> {
    let block = ExifBlock { bytes: block, is_big_endian: block.starts_with(b"MM") };
    let first = block.number(4, 4)?;
    let taken = block.find_entry(first, EXIF_DIRECTORY).and_then(|entry| block.number(entry + 8, 4));
    let dates =
        [taken.and_then(|place| block.find_entry(place, DATE_TIME_ORIGINAL)), block.find_entry(first, DATE_TIME)];
    dates.into_iter().flatten().find_map(|entry| {
        let start = block.number(entry + 8, 4)?;
        let text = block.bytes.get(start..start.checked_add(DATE_LETTERS)?)?;
        from_exif_text(std::str::from_utf8(text).ok()?)
    })
}

/// The bytes of an Exif block.
struct ExifBlock<'a> {
    bytes: &'a [u8],
    is_big_endian: bool,
}

impl ExifBlock<'_> {
    /// Returns the whole number of `length` bytes at a place; `None` beyond the end.
    fn number(&self, at: usize, length: usize) -> Option<usize> {
        let bytes = self.bytes.get(at..at.checked_add(length)?)?;
        let fold = |value: usize, byte: &u8| value << 8 | usize::from(*byte);
        Some(if self.is_big_endian { bytes.iter().fold(0, fold) } else { bytes.iter().rev().fold(0, fold) })
    }

    /// Returns the place of the entry of a tag in the directory at a place; `None` without one.
    fn find_entry(&self, directory: usize, tag: u64) -> Option<usize> {
        let count = self.number(directory, 2)?;
        let mut entries = (0..count).map(|index| directory + 2 + index * ENTRY_BYTES);
        entries.find(|entry| self.number(*entry, 2) == Some(tag as usize))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A little-endian Exif block with a date of the picture and one of the exposure.
    fn block() -> Vec<u8> {
        let entry = |tag: u16, kind: u16, count: u32, value: u32| {
            [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &count.to_le_bytes(), &value.to_le_bytes()].concat()
        };
        let mut bytes = b"II*\0\x08\0\0\0\x02\0".to_vec();
        bytes.extend(entry(0x0132, 2, 20, 56));
        bytes.extend(entry(0x8769, 4, 1, 38));
        bytes.extend([0; 4]);
        bytes.extend([1, 0]);
        bytes.extend(entry(0x9003, 2, 20, 76));
        bytes.extend([0; 4]);
        bytes.extend(b"2025:01:02 03:04:05\0");
        bytes.extend(b"2024:05:06 07:08:09\0");
        bytes
    }

    #[test]
    fn the_exposure_dates_a_picture_and_a_cut_block_none() {
        assert_eq!(from_exif(&block()).as_deref(), Some("2024-05-06T07:08:09"));
        assert_eq!(from_exif(&block()[..80]).as_deref(), Some("2025-01-02T03:04:05"));
        for length in 0..50 {
            assert_eq!(from_exif(&block()[..length]), None);
        }
    }

    #[test]
    fn a_clock_that_was_never_set_states_no_date() {
        assert_eq!(from_iso_text("2024-05-01T12:00:00.000000Z").as_deref(), Some("2024-05-01T12:00:00.000000Z"));
        assert_eq!(from_iso_text("2024-05-01 12:00:00").as_deref(), Some("2024-05-01T12:00:00"));
        for unset in ["1970-01-01T00:00:00Z", "1904-01-01T00:00:00Z", "2024", "2024-05-0x", "yesterday at noon"] {
            assert_eq!(from_iso_text(unset), None, "{unset}");
        }
        assert_eq!(from_exif_text("0000:00:00 00:00:00"), None);
    }
}
