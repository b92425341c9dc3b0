//! Controls of a driver by name: listed, set within their range, read back.

use super::device::{Device, text};
use super::modes::MAX_LIST;
use super::sys;
use crate::camera::feature_setting::{IntegerRange, check_integer, setting_error};
use crate::camera::{CameraError, FeatureKind, FeatureLine};
use crate::config::FeatureValue;
use std::io;

/// Maximum length of a text control, bytes.
const MAX_TEXT_BYTES: u64 = 4096;
/// Maximum number of controls of a device.
const MAX_CONTROLS: usize = 1024;

/// One control of a driver.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Control {
    /// `V4L2_CID_...`.
    pub id: u32,
    /// The name under `features` in the configuration: lower-case, `_` between words.
    pub name: String,
    /// `V4L2_CTRL_TYPE_...`.
    kind: u32,
    range: IntegerRange,
    /// `V4L2_CTRL_FLAG_...`.
    flags: u32,
}

impl Control {
    /// Whether any of these flags is set.
    fn has_flag(&self, flags: u32) -> bool {
        self.flags & flags != 0
    }

    /// Returns the reason why it cannot be set now, if there is one.
    fn lock_reason(&self) -> Option<&'static str> {
        let locks = [
            (sys::V4L2_CTRL_FLAG_DISABLED, "the camera has disabled it"),
            (sys::V4L2_CTRL_FLAG_READ_ONLY, "it can only be read"),
            (sys::V4L2_CTRL_FLAG_GRABBED, "another program, or the running stream, locks it"),
            (sys::V4L2_CTRL_FLAG_INACTIVE, "another control, usually an automatic one, overrides it"),
        ];
        locks.iter().find(|(flag, _)| self.has_flag(*flag)).map(|(_, reason)| *reason)
    }
}

/// Returns the name of a control as `v4l2-ctl` writes it: its ASCII letters and digits, lower-case, `_` between words.
pub(super) fn identifier(name: &str) -> String {
    let words = name.split(|letter: char| !letter.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    words.collect::<Vec<_>>().join("_").to_ascii_lowercase()
}

impl Device {
    /// Returns every control except headings, in the driver's order.
    pub(super) fn controls(&self) -> Vec<Control> {
        let mut controls = Vec::new();
        let mut raw = sys::v4l2_query_ext_ctrl::default();
        for _ in 0..MAX_CONTROLS {
            let after = raw.id;
            raw = sys::v4l2_query_ext_ctrl { id: after | sys::V4L2_CTRL_FLAG_NEXT_CTRL, ..Default::default() };
            // SAFETY: no pointers.
            if unsafe { self.call(sys::REQUEST_QUERY_EXT_CTRL, &mut raw) }.is_err() || raw.id <= after {
                break;
            }
            let name = raw.name.map(|letter| letter.cast_unsigned());
            controls.push(Control {
                id: raw.id,
                name: identifier(&text(&name)),
                kind: raw.type_,
                range: IntegerRange { min: raw.minimum, max: raw.maximum, step: raw.step },
                flags: raw.flags,
            });
        }
        controls.retain(|control| control.kind != sys::V4L2_CTRL_TYPE_CTRL_CLASS);
        controls
    }

    /// Sets a control and reads it back.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] with the allowed values if there is no such control, it is locked, the value has
    /// another type or is outside the range, or the camera keeps another value.
    pub(super) fn set_control(&self, name: &str, value: &FeatureValue) -> Result<(), CameraError> {
        let set = || {
            let control = self.find_control(name)?;
            if let Some(reason) = control.lock_reason() {
                return Err(reason.to_owned());
            }
            self.write(&control, value)?;
            self.verify(&control, value)
        };
        set().map_err(|reason| setting_error(name, value, reason))
    }

    /// Checks that a control still has the value it was set to, since another setting may have changed it.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] if it has another value, or there is no such control.
    pub(super) fn verify_control(&self, name: &str, value: &FeatureValue) -> Result<(), CameraError> {
        let verify = || self.verify(&self.find_control(name)?, value);
        verify().map_err(|reason| setting_error(name, value, reason))
    }

    /// Sets a menu to an index with a standard meaning, since drivers name the entries differently, and reads it back.
    ///
    /// # Errors
    ///
    /// The reason, with the entries that the menu has.
    pub(super) fn set_menu_index(&self, name: &str, index: u32) -> Result<(), String> {
        let control = self.find_control(name)?;
        let entries = self.menu(&control);
        let entry = entries.iter().find(|entry| entry.index == i64::from(index));
        let entry = entry.ok_or_else(|| format!("{name} offers only {}", entry_names(&entries)))?;
        self.write_integer(&control, entry.index).map_err(|error| format!("{name} to {}: {error}", entry.name))?;
        self.verify(&control, &FeatureValue::Text(entry.name.clone()))
    }

    /// Returns the control of this name, in any spelling of its words.
    ///
    /// # Errors
    ///
    /// The names of all controls, if there is none.
    fn find_control(&self, name: &str) -> Result<Control, String> {
        let wanted = identifier(name);
        let controls = self.controls();
        controls.iter().find(|control| control.name == wanted).cloned().ok_or_else(|| {
            let names: Vec<_> = controls.iter().map(|control| control.name.as_str()).collect();
            let names = if names.is_empty() { "none".into() } else { names.join(", ") };
            format!("the camera has no such control; it has {names}")
        })
    }

    /// Writes a value to a control of any type after checking its type and range.
    ///
    /// # Errors
    ///
    /// The expected type and the allowed values, or the driver's message.
    fn write(&self, control: &Control, value: &FeatureValue) -> Result<(), String> {
        let write = |value: i64| self.write_integer(control, value).map_err(|error| error.to_string());
        match (control.kind, value) {
            (sys::V4L2_CTRL_TYPE_BOOLEAN, FeatureValue::Bool(value)) => write(i64::from(*value)),
            (sys::V4L2_CTRL_TYPE_BUTTON, FeatureValue::Bool(true)) => write(1),
            (sys::V4L2_CTRL_TYPE_INTEGER | sys::V4L2_CTRL_TYPE_INTEGER64, FeatureValue::Integer(value)) => {
                check_integer(*value, control.range)?;
                write(*value)
            }
            (sys::V4L2_CTRL_TYPE_BITMASK, FeatureValue::Integer(value)) => {
                let bits = control.range.max & 0xffff_ffff;
                if *value < 0 || *value & !bits != 0 {
                    return Err(format!("allowed the bits of {bits:#x}"));
                }
                write(*value)
            }
            (sys::V4L2_CTRL_TYPE_MENU | sys::V4L2_CTRL_TYPE_INTEGER_MENU, _) => write(self.menu_index(control, value)?),
            (sys::V4L2_CTRL_TYPE_STRING, FeatureValue::Text(value)) => self.write_text(control, value),
            (sys::V4L2_CTRL_TYPE_BUTTON, _) => Err("it is a command: true executes it".into()),
            (kind, _) => {
                let allowed = self.allowed_values(control);
                let allowed = if allowed.is_empty() { allowed } else { format!(", allowed {allowed}") };
                Err(format!("it is of type {}{allowed}", type_name(kind)))
            }
        }
    }

    /// Returns the index of the menu entry with this name, or with this number in an integer menu.
    ///
    /// # Errors
    ///
    /// The names of all entries, if there is none.
    fn menu_index(&self, control: &Control, value: &FeatureValue) -> Result<i64, String> {
        let entries = self.menu(control);
        let name = value.to_string();
        let is_typed = matches!(value, FeatureValue::Text(_)) == (control.kind == sys::V4L2_CTRL_TYPE_MENU);
        let entry = entries.iter().find(|entry| is_typed && entry.name == name);
        entry.map(|entry| entry.index).ok_or_else(|| format!("allowed {}", entry_names(&entries)))
    }

    /// Returns the entries of a menu control; indices that the camera does not support are left out.
    fn menu(&self, control: &Control) -> Vec<MenuEntry> {
        let entry = |index: i64| {
            let mut raw =
                sys::v4l2_querymenu { id: control.id, index: u32::try_from(index).ok()?, ..Default::default() };
            // SAFETY: no pointers; the type of the control says which member is filled in, both are plain
            // bytes.
            unsafe {
                // Menus may skip indices that the camera does not support.
                self.call(sys::REQUEST_QUERYMENU, &mut raw).ok()?;
                let is_number = control.kind == sys::V4L2_CTRL_TYPE_INTEGER_MENU;
                let number = { raw.__bindgen_anon_1.value };
                let name = { raw.__bindgen_anon_1.name };
                Some(MenuEntry { index, name: if is_number { number.to_string() } else { text(&name) } })
            }
        };
        (control.range.min..=control.range.max.min(i64::from(MAX_LIST))).filter_map(entry).collect()
    }

    /// Writes the value of a control of any type but text, without a check; menus take an index, booleans 0 or 1.
    ///
    /// All but 64-bit integers are cut to 32 bits.
    fn write_integer(&self, control: &Control, value: i64) -> io::Result<()> {
        let mut one = sys::v4l2_ext_control { id: control.id, ..Default::default() };
        if control.kind == sys::V4L2_CTRL_TYPE_INTEGER64 {
            one.__bindgen_anon_1.value64 = value;
        } else {
            // A bit mask has 32 bits and no sign.
            one.__bindgen_anon_1.value = value as i32;
        }
        self.transfer(sys::REQUEST_S_EXT_CTRLS, &mut one)
    }

    /// Writes a text after checking its length.
    ///
    /// # Errors
    ///
    /// The allowed length, bytes, also for a text with a zero byte; or the driver's message.
    fn write_text(&self, control: &Control, value: &str) -> Result<(), String> {
        let length = i64::try_from(value.len()).unwrap_or(i64::MAX);
        if check_integer(length, control.range).is_err() || value.contains('\0') {
            return Err(format!("allowed {} bytes", control.range));
        }
        let mut bytes = value.as_bytes().to_vec();
        bytes.push(0);
        let mut one = sys::v4l2_ext_control { id: control.id, size: bytes.len() as u32, ..Default::default() };
        one.__bindgen_anon_1.string = bytes.as_mut_ptr().cast();
        self.transfer(sys::REQUEST_S_EXT_CTRLS, &mut one).map_err(|error| error.to_string())
    }

    /// Reads (`REQUEST_G_EXT_CTRLS`) or writes (`REQUEST_S_EXT_CTRLS`) one control.
    ///
    /// A text in it must live until this returns.
    fn transfer(&self, request: u64, one: &mut sys::v4l2_ext_control) -> io::Result<()> {
        let mut list = sys::v4l2_ext_controls { count: 1, controls: one, ..Default::default() };
        list.__bindgen_anon_1.which = sys::V4L2_CTRL_WHICH_CUR_VAL;
        // SAFETY: one entry, ours; its text, if it has one, is the caller's and has the stated length.
        unsafe { self.call(request, &mut list) }
    }

    /// Reads the value of a control, as written in a configuration: of a menu, the name of its entry.
    ///
    /// `None` if it cannot be read: a command, a write-only control, an array, or an index without an entry.
    fn value(&self, control: &Control) -> Option<String> {
        if control.kind == sys::V4L2_CTRL_TYPE_BUTTON || control.has_flag(sys::V4L2_CTRL_FLAG_WRITE_ONLY) {
            return None;
        }
        let mut one = sys::v4l2_ext_control { id: control.id, ..Default::default() };
        let mut letters = Vec::new();
        if control.kind == sys::V4L2_CTRL_TYPE_STRING {
            let size = u64::try_from(control.range.max).unwrap_or(0).min(MAX_TEXT_BYTES) + 1;
            letters.resize(size as usize, 0_u8);
            one.size = size as u32;
            one.__bindgen_anon_1.string = letters.as_mut_ptr().cast();
        } else if control.has_flag(sys::V4L2_CTRL_FLAG_HAS_PAYLOAD) {
            return None;
        }
        self.transfer(sys::REQUEST_G_EXT_CTRLS, &mut one).ok()?;
        // SAFETY: the type of the control says which member the kernel filled in; both are plain numbers.
        let (small, large) = unsafe { (one.__bindgen_anon_1.value, one.__bindgen_anon_1.value64) };
        Some(match control.kind {
            sys::V4L2_CTRL_TYPE_STRING => text(&letters),
            sys::V4L2_CTRL_TYPE_BOOLEAN => (small != 0).to_string(),
            sys::V4L2_CTRL_TYPE_INTEGER64 => large.to_string(),
            sys::V4L2_CTRL_TYPE_BITMASK => small.cast_unsigned().to_string(),
            sys::V4L2_CTRL_TYPE_MENU | sys::V4L2_CTRL_TYPE_INTEGER_MENU => {
                self.menu(control).into_iter().find(|entry| entry.index == i64::from(small))?.name
            }
            _ => small.to_string(),
        })
    }

    /// Reads the number of a control (`V4L2_CID_...`) of 32 bits, of a menu its index; `None` if it cannot be read.
    pub(super) fn number(&self, id: u32) -> Option<i64> {
        let mut one = sys::v4l2_ext_control { id, ..Default::default() };
        self.transfer(sys::REQUEST_G_EXT_CTRLS, &mut one).ok()?;
        // SAFETY: callers ask only for standard controls with 32 bits.
        Some(i64::from(unsafe { one.__bindgen_anon_1.value }))
    }

    /// Returns the names of active automatic adjustments that can be set.
    ///
    /// They are boolean controls with the word `auto` or `automatic` in the name, and an exposure that is not manual.
    pub(super) fn active_auto_controls(&self) -> Vec<String> {
        let is_on = |control: &Control| match control.kind {
            sys::V4L2_CTRL_TYPE_BOOLEAN => {
                control.name.split('_').any(|word| matches!(word, "auto" | "automatic"))
                    && self.value(control).is_some_and(|value| value == "true")
            }
            _ if control.id == sys::V4L2_CID_EXPOSURE_AUTO => {
                self.number(control.id).is_some_and(|mode| mode != i64::from(sys::V4L2_EXPOSURE_MANUAL))
            }
            _ => false,
        };
        let locked = sys::V4L2_CTRL_FLAG_DISABLED | sys::V4L2_CTRL_FLAG_READ_ONLY;
        let controls = self.controls().into_iter().filter(|control| !control.has_flag(locked) && is_on(control));
        controls.map(|control| control.name).collect()
    }

    /// Reads a control back and compares it with the requested value, as text without the spaces at its end.
    ///
    /// A control that cannot be read passes.
    ///
    /// # Errors
    ///
    /// The value that the camera keeps instead.
    fn verify(&self, control: &Control, wanted: &FeatureValue) -> Result<(), String> {
        match self.value(control) {
            Some(kept) if kept.trim_end() != wanted.to_string().trim_end() => Err(format!("the camera keeps {kept}")),
            _ => Ok(()),
        }
    }

    /// Returns the allowed values of a control as text; empty for booleans, commands and arrays.
    fn allowed_values(&self, control: &Control) -> String {
        match control.kind {
            sys::V4L2_CTRL_TYPE_INTEGER | sys::V4L2_CTRL_TYPE_INTEGER64 => control.range.to_string(),
            sys::V4L2_CTRL_TYPE_STRING => format!("{} bytes", control.range),
            sys::V4L2_CTRL_TYPE_BITMASK => format!("the bits of {:#x}", control.range.max & 0xffff_ffff),
            sys::V4L2_CTRL_TYPE_MENU | sys::V4L2_CTRL_TYPE_INTEGER_MENU => entry_names(&self.menu(control)),
            _ => String::new(),
        }
    }

    /// Returns every control as a line of text.
    pub(super) fn feature_lines(&self) -> Vec<FeatureLine> {
        let line = |control: Control| FeatureLine {
            depth: 0,
            kind: feature_kind(control.kind),
            value: self.value(&control),
            allowed: self.allowed_values(&control),
            unit: if control.id == sys::V4L2_CID_EXPOSURE_ABSOLUTE { "100 us".into() } else { String::new() },
            writable: control.lock_reason().is_none(),
            name: control.name,
        };
        self.controls().into_iter().map(line).collect()
    }
}

/// Returns the feature type of a `V4L2_CTRL_TYPE_...`; all but booleans, commands, menus and texts are integers.
fn feature_kind(control_type: u32) -> FeatureKind {
    match control_type {
        sys::V4L2_CTRL_TYPE_BOOLEAN => FeatureKind::Boolean,
        sys::V4L2_CTRL_TYPE_BUTTON => FeatureKind::Command,
        sys::V4L2_CTRL_TYPE_MENU => FeatureKind::Enumeration,
        sys::V4L2_CTRL_TYPE_STRING => FeatureKind::Text,
        _ => FeatureKind::Integer,
    }
}

/// One entry of a menu control.
struct MenuEntry {
    index: i64,
    name: String,
}

/// Returns the names of all entries of a menu, separated by commas.
fn entry_names(menu: &[MenuEntry]) -> String {
    menu.iter().map(|entry| entry.name.as_str()).collect::<Vec<_>>().join(", ")
}

/// Returns the name of a `V4L2_CTRL_TYPE_...` for messages.
fn type_name(control_type: u32) -> String {
    match control_type {
        sys::V4L2_CTRL_TYPE_INTEGER_MENU => "integer menu".into(),
        sys::V4L2_CTRL_TYPE_BITMASK => "bit mask".into(),
        compound if compound >= sys::V4L2_CTRL_COMPOUND_TYPES => "array, which cannot be set here".into(),
        other => feature_kind(other).as_str().into(),
    }
}
