//! Times in file names: dates with a time of day, times since the Unix epoch, and numbers with a unit.

use super::names::Column;
use crate::import::timeline::FrameTimes;
use chrono::{Datelike, NaiveDateTime};

/// The digits of year, month, day, hour, minute and second, which one to six numbers hold.
const PARTS: [usize; 6] = [4, 2, 2, 2, 2, 2];
/// Seconds since the Unix epoch of the years 2000 and 2100.
const EPOCH_S: std::ops::Range<i128> = 946_684_800..4_102_444_800;
/// One second, ns.
const SECOND_NS: i128 = 1_000_000_000;

/// Dates with a time of day in names.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Dates {
    pub(super) times: FrameTimes,
    /// The places of the numbers that form them.
    pub(super) places: std::ops::Range<usize>,
}

impl Dates {
    /// Whether consecutive dates differ by more than their resolution, so that they can time the images.
    pub(super) fn are_distinct(times: &FrameTimes) -> bool {
        let mut sorted = times.times_ns.clone();
        sorted.sort_unstable();
        sorted.windows(2).all(|pair| pair[1].saturating_sub(pair[0]) as f64 > times.resolution_ns)
    }
}

/// Returns the dates with a time of day in the names, such as `2024-05-01_12-00-00.123456`, with the fraction of a
/// second behind them. `None` if the names have none, one is no date, or fractions differ in their digits.
pub(super) fn from_dates(columns: &[Column]) -> Option<Dates> {
    let start = (0..columns.len()).find(|start| date_length(&columns[*start..]).is_some())?;
    let columns = &columns[start..];
    let length = date_length(columns)?;
    let is_point = |before: &str| matches!(before, "." | ",");
    // Digits behind another sign are a fraction, too, unless they count the images.
    let is_fraction = |column: &&Column| column.varies() && (is_point(&column.before) || !column.counts());
    let fraction = columns.get(length).filter(is_fraction);
    let names = columns.first()?.values.len();
    let times_ns: Option<Vec<i64>> = (0..names)
        .map(|name| {
            let digits: String = columns[..length]
                .iter()
                .map(|column| format!("{:0width$}", column.values[name], width = column.digits[name]))
                .collect();
            let fraction_ns = fraction.map_or(Some(0), |fraction| {
                let places = u32::try_from(fraction.digits[name]).ok().filter(|places| *places <= 9)?;
                i64::try_from(fraction.values[name] * 10_i128.pow(9 - places)).ok()
            })?;
            epoch_ns(&digits)?.checked_add(fraction_ns)
        })
        .collect();
    let is_padded = fraction.is_none_or(Column::is_padded);
    let places = fraction.map_or(0, |fraction| fraction.digits[0] as i32);
    let resolution_ns = 10_f64.powi(9 - places);
    let end = start + length + usize::from(fraction.is_some());
    let times = FrameTimes { times_ns: times_ns.filter(|_| is_padded)?, resolution_ns };
    Some(Dates { times, places: start..end })
}

/// Returns the number of columns at the beginning that hold a date and a time of day; `None` without one.
fn date_length(columns: &[Column]) -> Option<usize> {
    let mut digits = 0;
    for (index, column) in columns.iter().take(PARTS.len()).enumerate() {
        digits += column.digits.first().filter(|_| column.is_padded())?;
        // Each number ends with one of the parts.
        let ends = PARTS.iter().scan(0, |sum, part| {
            *sum += part;
            Some(*sum)
        });
        if !ends.clone().any(|end| end == digits) {
            return None;
        }
        if digits == PARTS.iter().sum::<usize>() {
            let first: String = columns[..=index]
                .iter()
                .map(|column| format!("{:0width$}", column.values[0], width = column.digits[0]))
                .collect();
            return epoch_ns(&first).map(|_| index + 1);
        }
    }
    None
}

/// Returns the time since the Unix epoch of `20240501120000`, ns; `None` when it is no date from 1970 to 2199.
fn epoch_ns(digits: &str) -> Option<i64> {
    let time = NaiveDateTime::parse_from_str(digits, "%Y%m%d%H%M%S").ok()?;
    time.and_utc().timestamp_nanos_opt().filter(|_| (1970..2200).contains(&time.year()))
}

/// Returns the times of numbers that are times, ns: by a unit behind them, or since they count from the Unix epoch.
/// `None` for other numbers.
pub(super) fn from_numbers(column: &Column) -> Option<FrameTimes> {
    let unit_ns = match unit_ns(&column.after) {
        Some(unit_ns) => unit_ns,
        None => epoch_unit_ns(column)?,
    };
    let scale = 10_i128.checked_pow(column.decimals as u32)?;
    let times_ns = column.values.iter().map(|value| i64::try_from(value.checked_mul(unit_ns)? / scale).ok());
    let resolution_ns = (unit_ns as f64 / scale as f64).max(1.0);
    Some(FrameTimes { times_ns: times_ns.collect::<Option<_>>()?, resolution_ns })
}

/// Returns the unit of time at the beginning of the text behind a number, ns; `None` for other words.
fn unit_ns(after: &str) -> Option<i128> {
    let word: String = after.chars().take_while(|letter| letter.is_alphabetic()).collect();
    Some(match word.as_str() {
        "ns" => 1,
        "us" | "\u{b5}s" | "\u{3bc}s" => 1_000,
        "ms" => 1_000_000,
        "s" | "sec" => SECOND_NS,
        _ => return None,
    })
}

/// Returns the unit in which all numbers are times since the Unix epoch of the years 2000 to 2100, ns; `None` if there
/// is none, and for whole seconds.
fn epoch_unit_ns(column: &Column) -> Option<i128> {
    let scale = 10_i128.checked_pow(column.decimals as u32)?;
    let is_epoch = |per_s: i128| column.values.iter().all(|value| EPOCH_S.contains(&(value / scale / per_s)));
    // Whole seconds are no times of frames.
    let units = [(SECOND_NS, 1), (1_000_000, 1000), (1_000, 1_000_000), (1, SECOND_NS)];
    let found = units.into_iter().find(|(_, per_s)| is_epoch(*per_s))?;
    (found.0 < SECOND_NS || column.decimals > 0).then_some(found.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_of_the_calendar_count_from_1970() {
        let seconds = |digits: &str| epoch_ns(digits).map(|ns| ns / 1_000_000_000);
        assert_eq!(seconds("19700101000000"), Some(0));
        assert_eq!(seconds("20240229120000"), Some(1_709_208_000));
        assert_eq!(seconds("20240501120000"), Some(1_714_564_800));
        // A leap second has the number 60.
        assert_eq!(seconds("20161231235960"), Some(1_483_228_800));
        for no_date in ["20241301120000", "20240230120000", "20240501250000", "19691231235959", "22000101000000"] {
            assert_eq!(seconds(no_date), None, "{no_date}");
        }
    }
}
