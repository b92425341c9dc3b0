//! Application of settings and their ranges, shared by all kinds of cameras.

use super::CameraError;
use crate::config::{self, FeatureValue};
use std::fmt;

/// The delay of the consumer that the slots of a camera must absorb, s.
const MAX_CONSUMER_DELAY_S: f64 = 0.05;

/// Whether the configured tone curve is linear (`camera.gamma` is 1), so that a gamma in the camera is not corrected.
pub fn is_linear(settings: &config::Camera) -> bool {
    settings.gamma.total_cmp(&1.0).is_eq()
}

/// Returns the error for a refused setting.
pub fn setting_error(feature: &str, value: impl fmt::Display, reason: impl Into<String>) -> CameraError {
    CameraError::Setting { feature: feature.into(), value: value.to_string(), reason: reason.into() }
}

/// Sets features in rounds until all are set, because some can only be set after another one.
///
/// Each round calls `set` for the features that were refused in the round before, in the order of `pending`.
///
/// # Errors
///
/// The first refusal of a round that sets no feature.
pub fn set_in_dependency_order<'a>(
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

/// Checks that an integer lies within its range, and a multiple of the increment above the minimum.
///
/// # Errors
///
/// The allowed range as text.
pub fn check_integer(value: i64, range: IntegerRange) -> Result<(), String> {
    if (range.min..=range.max).contains(&value) && value.abs_diff(range.min).is_multiple_of(range.step.max(1)) {
        return Ok(());
    }
    Err(format!("allowed {range}"))
}

/// The allowed values of an integer setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IntegerRange {
    /// Minimum.
    pub min: i64,
    /// Maximum.
    pub max: i64,
    /// Increment from the minimum; 0 and 1 allow every integer.
    pub step: u64,
}

impl fmt::Display for IntegerRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} to {}", self.min, self.max)?;
        if self.step > 1 { write!(f, " in steps of {}", self.step) } else { Ok(()) }
    }
}

/// The allowed values of a real setting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloatRange {
    /// Minimum.
    pub min: f64,
    /// Maximum.
    pub max: f64,
}

impl FloatRange {
    /// Checks that a value is finite and lies within the range.
    ///
    /// The camera may have computed the range with rounding. It is therefore wider on both sides by 1e-9 of its larger
    /// bound.
    ///
    /// # Errors
    ///
    /// The allowed range as text.
    pub fn check(self, value: f64) -> Result<(), String> {
        let slack = 1e-9 * self.min.abs().max(self.max.abs());
        if value.is_finite() && value >= self.min - slack && value <= self.max + slack {
            return Ok(());
        }
        Err(format!("allowed {self}"))
    }
}

impl fmt::Display for FloatRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} to {}", self.min, self.max)
    }
}

/// Returns the number of slots that a camera of this frame rate (0 if unknown) holds at once.
///
/// It is `min` slots plus the frames of [`MAX_CONSUMER_DELAY_S`], rounded up, and at most `max` slots.
pub fn slot_count(frame_rate_hz: f64, min: usize, max: usize) -> usize {
    (min + (frame_rate_hz * MAX_CONSUMER_DELAY_S).ceil() as usize).min(max)
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
        // Each feature is unlocked by the next one in the alphabet.
        let set = |name: &str, _: &FeatureValue| {
            if name != "c" && done.borrow().last().is_none_or(|last: &String| last.as_str() != next(name)) {
                return Err(setting_error(name, true, "locked"));
            }
            done.borrow_mut().push(name.to_owned());
            Ok(())
        };
        set_in_dependency_order(&wanted(&["a", "b", "c"]), set).unwrap();
        assert_eq!(*done.borrow(), ["c", "b", "a"]);
    }

    fn next(name: &str) -> &'static str {
        if name == "a" { "b" } else { "c" }
    }

    #[test]
    fn the_first_feature_that_nothing_unlocks_is_reported() {
        let set = |name: &str, _: &FeatureValue| match name {
            "b" => Ok(()),
            _ => Err(setting_error(name, true, "locked")),
        };
        let error = set_in_dependency_order(&wanted(&["a", "b", "c"]), set).unwrap_err();
        assert_eq!(error.to_string(), "cannot set camera feature a to true: locked");
    }

    #[test]
    fn a_whole_number_keeps_to_range_and_steps() {
        let check = |value, min, max, step| check_integer(value, IntegerRange { min, max, step });
        assert_eq!(check(32, 16, 64, 16), Ok(()));
        assert_eq!(check(-3, -3, 3, 0), Ok(()));
        assert_eq!(check(40, 16, 64, 16), Err("allowed 16 to 64 in steps of 16".into()));
        assert_eq!(check(4, -3, 3, 1), Err("allowed -3 to 3".into()));
        assert!(check(i64::MAX, i64::MIN, i64::MAX, 1).is_ok());
    }

    #[test]
    fn slots_hold_fifty_milliseconds_more_than_the_minimum() {
        assert_eq!(slot_count(2000.0, 16, 256), 116);
        assert_eq!((slot_count(0.0, 16, 256), slot_count(20_000.0, 16, 256)), (16, 256));
    }
}
