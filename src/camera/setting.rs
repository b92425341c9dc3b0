//! What setting a camera up has in common, whatever it is.

use super::CameraError;
use crate::config::FeatureValue;
use std::fmt;

/// For how long the taker of frames may be late at the camera's rate, s.
const LATE_S: f64 = 0.05;

/// The error for a setting that was refused.
pub fn setting(feature: &str, value: impl fmt::Display, reason: impl Into<String>) -> CameraError {
    CameraError::Setting { feature: feature.into(), value: value.to_string(), reason: reason.into() }
}

/// Sets what is left, over and over while one more succeeds: that may be what the next one waits for.
///
/// # Errors
///
/// The first refusal of a round in which all were refused.
pub fn set_until_none_is_left<'a>(
    pending: impl IntoIterator<Item = (&'a String, &'a FeatureValue)>,
    set: impl Fn(&str, &FeatureValue) -> Result<(), CameraError>,
) -> Result<(), CameraError> {
    let mut pending: Vec<_> = pending.into_iter().collect();
    loop {
        let before = pending.len();
        let mut refused = None;
        pending.retain(|(name, value)| match set(name, value) {
            Ok(()) => false,
            Err(error) => {
                refused.get_or_insert(error);
                true
            }
        });
        match refused {
            None => return Ok(()),
            Some(error) if pending.len() == before => return Err(error),
            Some(_) => {}
        }
    }
}

/// Refuses a whole number that is out of range or between two steps.
///
/// # Errors
///
/// What is allowed.
pub fn check_whole(value: i64, least: i64, most: i64, step: u64) -> Result<(), String> {
    if (least..=most).contains(&value) && value.abs_diff(least).is_multiple_of(step.max(1)) {
        return Ok(());
    }
    Err(format!("allowed {}", whole_range(least, most, step)))
}

/// A range of whole numbers for a person.
pub fn whole_range(least: i64, most: i64, step: u64) -> String {
    let steps = if step > 1 { format!(" in steps of {step}") } else { String::new() };
    format!("{least} to {most}{steps}")
}

/// Slots that a camera of this rate holds at once.
pub fn slots_at(frame_rate_hz: f64, least: usize, most: usize) -> usize {
    (least + (frame_rate_hz * LATE_S).ceil() as usize).min(most)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::collections::BTreeMap;

    fn wanted(names: &[&str]) -> BTreeMap<String, FeatureValue> {
        names.iter().map(|name| ((*name).to_owned(), FeatureValue::Bool(true))).collect()
    }

    #[test]
    fn what_another_setting_unlocks_is_set_after_it() {
        let done = RefCell::new(Vec::new());
        // Each waits for the one behind it in the alphabet.
        let set = |name: &str, _: &FeatureValue| {
            if name != "c" && done.borrow().last().is_none_or(|last: &String| last.as_str() != next(name)) {
                return Err(setting(name, true, "locked"));
            }
            done.borrow_mut().push(name.to_owned());
            Ok(())
        };
        set_until_none_is_left(&wanted(&["a", "b", "c"]), set).unwrap();
        assert_eq!(*done.borrow(), ["c", "b", "a"]);
    }

    fn next(name: &str) -> &'static str {
        if name == "a" { "b" } else { "c" }
    }

    #[test]
    fn the_first_of_those_that_nothing_unlocks_is_told() {
        let set = |name: &str, _: &FeatureValue| match name {
            "b" => Ok(()),
            _ => Err(setting(name, true, "locked")),
        };
        let error = set_until_none_is_left(&wanted(&["a", "b", "c"]), set).unwrap_err();
        assert_eq!(error.to_string(), "set camera feature a to true: locked");
    }

    #[test]
    fn a_whole_number_keeps_to_range_and_steps() {
        assert_eq!(check_whole(32, 16, 64, 16), Ok(()));
        assert_eq!(check_whole(-3, -3, 3, 0), Ok(()));
        assert_eq!(check_whole(40, 16, 64, 16), Err("allowed 16 to 64 in steps of 16".into()));
        assert_eq!(check_whole(4, -3, 3, 1), Err("allowed -3 to 3".into()));
        assert!(check_whole(i64::MAX, i64::MIN, i64::MAX, 1).is_ok());
    }

    #[test]
    fn slots_hold_fifty_milliseconds_more_than_the_least() {
        assert_eq!(slots_at(2000.0, 16, 256), 116);
        assert_eq!((slots_at(0.0, 16, 256), slots_at(20_000.0, 16, 256)), (16, 256));
    }
}
