//! Writing one feature: type and range are checked before, and the value is read back.

use super::device::{Access, Device};
use crate::camera::feature_setting::{check_integer, setting_error};
use crate::camera::{CameraError, FeatureKind};
use crate::config::FeatureValue;

/// Maximum relative difference between a value and its read-back: cameras round to their own resolution.
const MAX_ROUNDING: f64 = 0.01;

/// A feature key: `Name`, or `Name[Selector=Entry]` for one of several features behind a selector.
struct Key<'a> {
    name: &'a str,
    selector: Option<Selector<'a>>,
}

/// A selector feature and the entry that it is set to.
#[derive(Clone, Copy)]
pub(super) struct Selector<'a> {
    pub(super) name: &'a str,
    pub(super) entry: &'a str,
}

impl<'a> Key<'a> {
    /// Parses a key of the configuration.
    ///
    /// # Errors
    ///
    /// The expected form.
    fn parse(key: &'a str) -> Result<Self, String> {
        let Some((name, rest)) = key.split_once('[') else { return Ok(Self { name: key, selector: None }) };
        let selector = rest.strip_suffix(']').and_then(|inner| inner.split_once('='));
        match selector {
            Some((selector, entry)) if !name.is_empty() => {
                Ok(Self { name, selector: Some(Selector { name: selector, entry }) })
            }
            _ => Err("write it Name or Name[Selector=Word]".into()),
        }
    }

    /// Runs `act` with the selector set to this key's entry, and restores the selector, even if `act` fails.
    ///
    /// Without a selector, only runs `act`.
    ///
    /// # Errors
    ///
    /// That of `act`, else the reason why the selector cannot be set or restored.
    fn with_selector<R>(&self, device: &Device, act: impl FnOnce() -> Result<R, String>) -> Result<R, String> {
        let Some(Selector { name: selector, entry }) = self.selector else { return act() };
        match device.kind(selector) {
            Some(FeatureKind::Enumeration) => {
                let before = device.text(selector)?;
                device.set_enumeration(selector, entry)?;
                let (result, restored) = (act(), device.set_text(selector, &before));
                result.and_then(|result| restored.map(|()| result))
            }
            Some(FeatureKind::Integer) => {
                let before = device.integer(selector)?;
                let value = entry.parse().map_err(|_| format!("the selector {selector} is an integer"))?;
                device.set_checked_integer(selector, value)?;
                let (result, restored) = (act(), device.set_integer(selector, before));
                result.and_then(|result| restored.map(|()| result))
            }
            Some(kind) => Err(format!("the selector {selector} is of type {}", kind.as_str())),
            None => Err(format!("the camera has no selector {selector}")),
        }
    }
}

impl Device {
    /// Sets a feature and reads it back.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] if the camera has no such feature, it has another type, it is not writable now, the
    /// value is outside its range, or the camera keeps another value.
    pub fn set_feature(&self, key: &str, value: &FeatureValue) -> Result<(), CameraError> {
        let set = || {
            let key = Key::parse(key)?;
            key.with_selector(self, || self.set_and_verify(key.name, value))
        };
        set().map_err(|reason| setting_error(key, value, reason))
    }

    /// Checks that a feature still has the value it was set to, since another setting may have changed it.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] if it has another value, or cannot be read.
    pub fn verify_feature(&self, key: &str, value: &FeatureValue) -> Result<(), CameraError> {
        let verify = || {
            let key = Key::parse(key)?;
            key.with_selector(self, || self.verify(key.name, value))
        };
        verify().map_err(|reason| setting_error(key, value, reason))
    }

    /// Returns the value of a boolean behind a selector, which is set for that moment.
    pub(super) fn selected_boolean(&self, name: &str, selector: Selector<'_>) -> Result<bool, String> {
        Key { name, selector: Some(selector) }.with_selector(self, || self.boolean(name))
    }

    /// Sets a feature and reads it back, or executes a command, without changing selectors.
    ///
    /// # Errors
    ///
    /// The reason; see [`set_feature`](Self::set_feature).
    fn set_and_verify(&self, name: &str, value: &FeatureValue) -> Result<(), String> {
        let kind = self.kind(name).ok_or("the camera has no such feature")?;
        if !self.has(name) {
            return Err("the camera does not offer it with its other settings".into());
        }
        if self.access(name) == Some(Access::Read) {
            return Err("it can only be read".into());
        }
        if self.is_locked(name) {
            return Err("another setting of the camera locks it".into());
        }
        match (kind, value) {
            (FeatureKind::Boolean, FeatureValue::Bool(value)) => {
                self.write(name, i32::from(*value), self.aravis.arv_device_set_boolean_feature_value)?;
            }
            (FeatureKind::Command, FeatureValue::Bool(true)) => return self.execute(name),
            (FeatureKind::Command, FeatureValue::Text(word)) if word == "execute" => return self.execute(name),
            (FeatureKind::Integer, FeatureValue::Integer(value)) => self.set_checked_integer(name, *value)?,
            (FeatureKind::Float, FeatureValue::Float(value)) => self.set_checked_float(name, *value)?,
            (FeatureKind::Float, FeatureValue::Integer(value)) => self.set_checked_float(name, *value as f64)?,
            (FeatureKind::Enumeration, FeatureValue::Text(value)) => self.set_enumeration(name, value)?,
            (FeatureKind::Text, FeatureValue::Text(value)) => self.set_text(name, value)?,
            (FeatureKind::Command, _) => return Err("it is a command: true executes it".into()),
            (kind, _) => {
                let allowed = self.allowed_values(name, kind);
                let allowed = if allowed.is_empty() { allowed } else { format!(", allowed {allowed}") };
                return Err(format!("it is of type {}{allowed}", kind.as_str()));
            }
        }
        self.verify(name, value)
    }

    /// Returns the allowed values of an enumeration or number as text; empty for other types, or if they are unknown.
    pub(super) fn allowed_values(&self, name: &str, kind: FeatureKind) -> String {
        let range = match kind {
            FeatureKind::Enumeration => self.enum_entries(name).map(|entries| entries.join(", ")),
            FeatureKind::Integer => self.integer_range(name).map(|range| range.to_string()),
            FeatureKind::Float => self.float_range(name).map(|range| range.to_string()),
            _ => Ok(String::new()),
        };
        range.unwrap_or_default()
    }

    /// Sets an integer after checking its range and increment.
    fn set_checked_integer(&self, name: &str, value: i64) -> Result<(), String> {
        check_integer(value, self.integer_range(name)?)?;
        self.set_integer(name, value)
    }

    /// Sets a real number after checking its range.
    fn set_checked_float(&self, name: &str, value: f64) -> Result<(), String> {
        self.float_range(name)?.check(value)?;
        self.set_float(name, value)
    }

    /// Selects an entry of an enumeration after checking that it exists.
    fn set_enumeration(&self, name: &str, entry: &str) -> Result<(), String> {
        check_entry(entry, &self.enum_entries(name)?)?;
        self.set_text(name, entry)
    }

    /// Reads a feature back and compares it with the requested value, a real number up to [`MAX_ROUNDING`].
    ///
    /// Commands and write-only features pass.
    ///
    /// # Errors
    ///
    /// The value that the camera keeps instead, or the library's message.
    fn verify(&self, name: &str, wanted: &FeatureValue) -> Result<(), String> {
        let kind = self.kind(name);
        if kind == Some(FeatureKind::Command) || self.access(name) == Some(Access::Write) {
            return Ok(());
        }
        let kept = match (wanted, kind) {
            (FeatureValue::Bool(_), _) => FeatureValue::Bool(self.boolean(name)?),
            (FeatureValue::Float(_), _) | (FeatureValue::Integer(_), Some(FeatureKind::Float)) => {
                FeatureValue::Float(self.float(name)?)
            }
            (FeatureValue::Integer(_), _) => FeatureValue::Integer(self.integer(name)?),
            (FeatureValue::Text(_), _) => FeatureValue::Text(self.text(name)?),
        };
        let same = match (wanted, &kept) {
            (FeatureValue::Float(wanted), FeatureValue::Float(kept)) => is_near(*wanted, *kept),
            (FeatureValue::Integer(wanted), FeatureValue::Float(kept)) => is_near(*wanted as f64, *kept),
            (wanted, kept) => wanted == kept,
        };
        if same { Ok(()) } else { Err(format!("the camera keeps {kept}")) }
    }
}

/// Whether a value that was read back equals the requested one to within [`MAX_ROUNDING`] of it.
pub(super) fn is_near(wanted: f64, kept: f64) -> bool {
    (wanted - kept).abs() <= MAX_ROUNDING * wanted.abs().max(f64::MIN_POSITIVE)
}

/// Checks that an enumeration has this entry.
///
/// # Errors
///
/// The allowed entries.
pub(super) fn check_entry(entry: &str, entries: &[String]) -> Result<(), String> {
    if entries.iter().any(|known| known == entry) { Ok(()) } else { Err(format!("allowed {}", entries.join(", "))) }
}
