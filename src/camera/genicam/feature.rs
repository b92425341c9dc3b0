//! One feature set to one value: type and range checked before, read back after.

use super::device::{Access, Device, Kind};
use crate::camera::CameraError;
use crate::camera::setting::{check_whole, setting, whole_range};
use crate::config::FeatureValue;

/// Cameras round what they cannot keep: a read-back this near, relative, is what was set.
const ROUNDING: f64 = 0.01;

/// Which feature: `Name`, or `Name[Selector=Word]` for one of several behind a selector.
struct Key<'a> {
    name: &'a str,
    selector: Option<(&'a str, &'a str)>,
}

impl<'a> Key<'a> {
    fn parse(key: &'a str) -> Result<Self, String> {
        let Some((name, rest)) = key.split_once('[') else { return Ok(Self { name: key, selector: None }) };
        let selector = rest.strip_suffix(']').and_then(|inner| inner.split_once('='));
        match selector {
            Some(selector) if !name.is_empty() => Ok(Self { name, selector: Some(selector) }),
            _ => Err("write it Name or Name[Selector=Word]".into()),
        }
    }

    /// Does something with the selector turned to this key's feature, and turns it back.
    fn selected<R>(&self, device: &Device, act: impl FnOnce() -> Result<R, String>) -> Result<R, String> {
        let Some((selector, word)) = self.selector else { return act() };
        match device.kind(selector) {
            Some(Kind::Enumeration) => {
                let before = device.text(selector)?;
                device.set_enumeration(selector, word)?;
                act().and_then(|result| device.set_text(selector, &before).map(|()| result))
            }
            Some(Kind::Integer) => {
                let before = device.integer(selector)?;
                let value = word.parse().map_err(|_| format!("the selector {selector} is an integer"))?;
                device.set_whole(selector, value)?;
                act().and_then(|result| device.set_integer(selector, before).map(|()| result))
            }
            Some(kind) => Err(format!("the selector {selector} is of type {}", kind.word())),
            None => Err(format!("the camera has no selector {selector}")),
        }
    }
}

impl Device {
    /// Sets a feature and reads it back.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] when the camera has no such feature, it is of another
    /// type, not to be written now, the value is outside its range, or the camera
    /// keeps another value.
    pub fn set_feature(&self, key: &str, value: &FeatureValue) -> Result<(), CameraError> {
        let set = || {
            let key = Key::parse(key)?;
            key.selected(self, || self.set_and_verify(key.name, value))
        };
        set().map_err(|reason| setting(key, value, reason))
    }

    /// Checks that a feature still has the value it was set to.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] when another setting changed it.
    pub fn verify_feature(&self, key: &str, value: &FeatureValue) -> Result<(), CameraError> {
        let verify = || {
            let key = Key::parse(key)?;
            key.selected(self, || self.verify(key.name, value))
        };
        verify().map_err(|reason| setting(key, value, reason))
    }

    /// The value that a boolean has while its selector is turned to this word.
    pub(super) fn boolean_of(&self, name: &str, selector: &str, word: &str) -> Result<bool, String> {
        Key { name, selector: Some((selector, word)) }.selected(self, || self.boolean(name))
    }

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
            (Kind::Boolean, FeatureValue::Bool(value)) => self.set_boolean(name, *value)?,
            (Kind::Command, FeatureValue::Bool(true)) => return self.execute(name),
            (Kind::Command, FeatureValue::Text(word)) if word == "execute" => return self.execute(name),
            (Kind::Integer, FeatureValue::Integer(value)) => self.set_whole(name, *value)?,
            (Kind::Float, FeatureValue::Float(value)) => self.set_real(name, *value)?,
            (Kind::Float, FeatureValue::Integer(value)) => self.set_real(name, *value as f64)?,
            (Kind::Enumeration, FeatureValue::Text(value)) => self.set_enumeration(name, value)?,
            (Kind::Text, FeatureValue::Text(value)) => self.set_text(name, value)?,
            (Kind::Command, _) => return Err("it is a command: true executes it".into()),
            (kind, _) => {
                let allowed = self.allowed(name, kind);
                let allowed = if allowed.is_empty() { allowed } else { format!(", allowed {allowed}") };
                return Err(format!("it is of type {}{allowed}", kind.word()));
            }
        }
        self.verify(name, value)
    }

    /// What a feature can be set to, for a person; empty where there is no range.
    pub(super) fn allowed(&self, name: &str, kind: Kind) -> String {
        let range = match kind {
            Kind::Enumeration => self.words(name).map(|words| words.join(", ")),
            Kind::Integer => {
                self.integer_range(name).map(|(least, most, step)| whole_range(least, most, step.unsigned_abs()))
            }
            Kind::Float => self.float_range(name).map(|(least, most)| format!("{least} to {most}")),
            _ => Ok(String::new()),
        };
        range.unwrap_or_default()
    }

    fn set_whole(&self, name: &str, value: i64) -> Result<(), String> {
        let (least, most, step) = self.integer_range(name)?;
        check_whole(value, least, most, step.unsigned_abs())?;
        self.set_integer(name, value)
    }

    fn set_real(&self, name: &str, value: f64) -> Result<(), String> {
        let (least, most) = self.float_range(name)?;
        check_real(value, least, most)?;
        self.set_float(name, value)
    }

    fn set_enumeration(&self, name: &str, word: &str) -> Result<(), String> {
        let words = self.words(name)?;
        if !words.iter().any(|known| known == word) {
            return Err(format!("allowed {}", words.join(", ")));
        }
        self.set_text(name, word)
    }

    fn verify(&self, name: &str, wanted: &FeatureValue) -> Result<(), String> {
        let kind = self.kind(name);
        if kind == Some(Kind::Command) || self.access(name) == Some(Access::Write) {
            return Ok(());
        }
        let kept = match (wanted, kind) {
            (FeatureValue::Bool(_), _) => FeatureValue::Bool(self.boolean(name)?),
            (FeatureValue::Float(_), _) | (FeatureValue::Integer(_), Some(Kind::Float)) => {
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

/// Whether a camera's read-back is what was asked for, rounded to what it can keep.
pub(super) fn is_near(wanted: f64, kept: f64) -> bool {
    (wanted - kept).abs() <= ROUNDING * wanted.abs().max(f64::MIN_POSITIVE)
}

/// Refuses a number outside a range that was computed with rounding.
pub(super) fn check_real(value: f64, least: f64, most: f64) -> Result<(), String> {
    let slack = 1e-9 * least.abs().max(most.abs());
    if value.is_finite() && value >= least - slack && value <= most + slack {
        return Ok(());
    }
    Err(format!("allowed {least} to {most}"))
}
