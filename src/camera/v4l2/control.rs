//! Controls of a driver, by name: told, set within their range, read back.

use super::device::{Device, text};
use super::offer::LIST_MAX;
use super::sys;
use crate::camera::CameraError;
use crate::camera::genicam::{FeatureLine, Kind};
use crate::camera::setting::{check_whole, setting, whole_range};
use crate::config::FeatureValue;
use std::io;

/// Longest text of a control that is read.
const TEXT_MAX: u64 = 4096;
/// Most controls of one device.
const CONTROLS_MAX: usize = 1024;

/// One control of a driver.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Control {
    pub id: u32,
    /// As `features` of a configuration wants it: lower-case, `_` between words.
    pub name: String,
    kind: u32,
    least: i64,
    most: i64,
    step: u64,
    flags: u32,
}

impl Control {
    fn has(&self, flag: u32) -> bool {
        self.flags & flag != 0
    }

    /// Why it cannot be set now, if so.
    fn lock(&self) -> Option<&'static str> {
        let locks = [
            (sys::V4L2_CTRL_FLAG_DISABLED, "the camera has it switched off"),
            (sys::V4L2_CTRL_FLAG_READ_ONLY, "it can only be read"),
            (sys::V4L2_CTRL_FLAG_GRABBED, "another program, or the running stream, locks it"),
            (sys::V4L2_CTRL_FLAG_INACTIVE, "another control, mostly an automatic one, keeps it without effect"),
        ];
        locks.iter().find(|(flag, _)| self.has(*flag)).map(|(_, reason)| *reason)
    }

    fn range(&self) -> String {
        whole_range(self.least, self.most, self.step)
    }
}

/// The name of a control in one word, as `v4l2-ctl` spells it.
pub(super) fn spelled(name: &str) -> String {
    let words = name.split(|letter: char| !letter.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    words.collect::<Vec<_>>().join("_").to_ascii_lowercase()
}

impl Device {
    /// Every control with a value of its own, in the driver's order.
    pub(super) fn controls(&self) -> Vec<Control> {
        let mut controls = Vec::new();
        let mut raw = sys::v4l2_query_ext_ctrl::default();
        for _ in 0..CONTROLS_MAX {
            let after = raw.id;
            raw = sys::v4l2_query_ext_ctrl { id: after | sys::V4L2_CTRL_FLAG_NEXT_CTRL, ..Default::default() };
            // SAFETY: no pointers.
            if unsafe { self.call(sys::REQUEST_QUERY_EXT_CTRL, &mut raw) }.is_err() || raw.id <= after {
                break;
            }
            let name = raw.name.map(|letter| letter.cast_unsigned());
            controls.push(Control {
                id: raw.id,
                name: spelled(&text(&name)),
                kind: raw.type_,
                least: raw.minimum,
                most: raw.maximum,
                step: raw.step,
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
    /// [`CameraError::Setting`] with what is allowed when there is no such control,
    /// it is locked, the value is of another type or outside the range, or another
    /// value is kept.
    pub(super) fn set_control(&self, name: &str, value: &FeatureValue) -> Result<(), CameraError> {
        let set = || {
            let control = self.control(name)?;
            if let Some(reason) = control.lock() {
                return Err(reason.to_owned());
            }
            self.write(&control, value)?;
            self.verify(&control, value)
        };
        set().map_err(|reason| setting(name, value, reason))
    }

    /// Checks that a control still has the value it was set to.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] when another setting changed it.
    pub(super) fn verify_control(&self, name: &str, value: &FeatureValue) -> Result<(), CameraError> {
        let verify = || self.verify(&self.control(name)?, value);
        verify().map_err(|reason| setting(name, value, reason))
    }

    /// Turns a menu to a place whose meaning is fixed, whatever the driver calls it.
    pub(super) fn set_menu_place(&self, name: &str, place: u32) -> Result<(), String> {
        let control = self.control(name)?;
        let choices = self.choices(&control);
        let words: Vec<_> = choices.iter().map(|(_, word)| word.as_str()).collect();
        let choice = choices.iter().find(|(index, _)| *index == i64::from(place));
        let (index, word) = choice.ok_or_else(|| format!("{name} offers only {}", words.join(", ")))?;
        self.write_whole(&control, *index).map_err(|error| format!("{name} to {word}: {error}"))?;
        self.verify(&control, &FeatureValue::Text(word.clone()))
    }

    fn control(&self, name: &str) -> Result<Control, String> {
        let wanted = spelled(name);
        let controls = self.controls();
        controls.iter().find(|control| control.name == wanted).cloned().ok_or_else(|| {
            let names: Vec<_> = controls.iter().map(|control| control.name.as_str()).collect();
            let names = if names.is_empty() { "none".into() } else { names.join(", ") };
            format!("the camera has no such control; it has {names}")
        })
    }

    fn write(&self, control: &Control, value: &FeatureValue) -> Result<(), String> {
        let whole = |value: i64| self.write_whole(control, value).map_err(|error| error.to_string());
        match (control.kind, value) {
            (sys::V4L2_CTRL_TYPE_BOOLEAN, FeatureValue::Bool(value)) => whole(i64::from(*value)),
            (sys::V4L2_CTRL_TYPE_BUTTON, FeatureValue::Bool(true)) => whole(1),
            (sys::V4L2_CTRL_TYPE_INTEGER | sys::V4L2_CTRL_TYPE_INTEGER64, FeatureValue::Integer(value)) => {
                check_whole(*value, control.least, control.most, control.step)?;
                whole(*value)
            }
            (sys::V4L2_CTRL_TYPE_BITMASK, FeatureValue::Integer(value)) => {
                let bits = control.most & 0xffff_ffff;
                if *value < 0 || *value & !bits != 0 {
                    return Err(format!("allowed the bits of {bits:#x}"));
                }
                whole(*value)
            }
            (sys::V4L2_CTRL_TYPE_MENU | sys::V4L2_CTRL_TYPE_INTEGER_MENU, _) => whole(self.choice(control, value)?),
            (sys::V4L2_CTRL_TYPE_STRING, FeatureValue::Text(value)) => self.write_text(control, value),
            (sys::V4L2_CTRL_TYPE_BUTTON, _) => Err("it is a command: true executes it".into()),
            (kind, _) => {
                let allowed = self.allowed(control);
                let allowed = if allowed.is_empty() { allowed } else { format!(", allowed {allowed}") };
                Err(format!("it is of type {}{allowed}", kind_word(kind)))
            }
        }
    }

    /// The place in a menu that a word, or the number of an integer menu, means.
    fn choice(&self, control: &Control, value: &FeatureValue) -> Result<i64, String> {
        let choices = self.choices(control);
        let meant = value.to_string();
        let typed = matches!(value, FeatureValue::Text(_)) == (control.kind == sys::V4L2_CTRL_TYPE_MENU);
        let place = choices.iter().find(|(_, word)| typed && *word == meant);
        place.map(|(index, _)| *index).ok_or_else(|| {
            let words: Vec<_> = choices.iter().map(|(_, word)| word.as_str()).collect();
            format!("allowed {}", words.join(", "))
        })
    }

    /// Places and words of a menu.
    fn choices(&self, control: &Control) -> Vec<(i64, String)> {
        let choice = |index: i64| {
            let place = u32::try_from(index).ok()?;
            let mut raw = sys::v4l2_querymenu { id: control.id, index: place, ..Default::default() };
            // SAFETY: no pointers; the type of the control says which member is filled in, both are plain bytes.
            unsafe {
                // Menus have holes: what the camera at hand cannot do.
                self.call(sys::REQUEST_QUERYMENU, &mut raw).ok()?;
                let is_number = control.kind == sys::V4L2_CTRL_TYPE_INTEGER_MENU;
                let number = { raw.__bindgen_anon_1.value };
                let name = { raw.__bindgen_anon_1.name };
                Some((index, if is_number { number.to_string() } else { text(&name) }))
            }
        };
        (control.least..=control.most.min(i64::from(LIST_MAX))).filter_map(choice).collect()
    }

    fn write_whole(&self, control: &Control, value: i64) -> io::Result<()> {
        let mut one = sys::v4l2_ext_control { id: control.id, ..Default::default() };
        if control.kind == sys::V4L2_CTRL_TYPE_INTEGER64 {
            one.__bindgen_anon_1.value64 = value;
        } else {
            // A bit mask has 32 bits and no sign.
            one.__bindgen_anon_1.value = value as i32;
        }
        self.transfer(sys::REQUEST_S_EXT_CTRLS, &mut one)
    }

    fn write_text(&self, control: &Control, value: &str) -> Result<(), String> {
        let letters = i64::try_from(value.len()).unwrap_or(i64::MAX);
        let fits = check_whole(letters, control.least, control.most, control.step).is_ok();
        if !fits || value.contains('\0') {
            return Err(format!("allowed {} bytes", control.range()));
        }
        let mut bytes = value.as_bytes().to_vec();
        bytes.push(0);
        let mut one = sys::v4l2_ext_control { id: control.id, size: bytes.len() as u32, ..Default::default() };
        one.__bindgen_anon_1.string = bytes.as_mut_ptr().cast();
        self.transfer(sys::REQUEST_S_EXT_CTRLS, &mut one).map_err(|error| error.to_string())
    }

    /// Reads or writes one control; a text in it must live until this returns.
    fn transfer(&self, request: libc::c_ulong, one: &mut sys::v4l2_ext_control) -> io::Result<()> {
        let mut list = sys::v4l2_ext_controls { count: 1, controls: one, ..Default::default() };
        list.__bindgen_anon_1.which = sys::V4L2_CTRL_WHICH_CUR_VAL;
        // SAFETY: one entry, ours; its text, if it has one, is the caller's and as long as it says.
        unsafe { self.call(request, &mut list) }
    }

    /// The value of a control, in the words a configuration uses; none for what cannot be read.
    fn value(&self, control: &Control) -> Option<String> {
        if control.kind == sys::V4L2_CTRL_TYPE_BUTTON || control.has(sys::V4L2_CTRL_FLAG_WRITE_ONLY) {
            return None;
        }
        let mut one = sys::v4l2_ext_control { id: control.id, ..Default::default() };
        let mut letters = Vec::new();
        if control.kind == sys::V4L2_CTRL_TYPE_STRING {
            let size = u64::try_from(control.most).unwrap_or(0).min(TEXT_MAX) + 1;
            letters.resize(size as usize, 0_u8);
            one.size = size as u32;
            one.__bindgen_anon_1.string = letters.as_mut_ptr().cast();
        } else if control.has(sys::V4L2_CTRL_FLAG_HAS_PAYLOAD) {
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
                let choices = self.choices(control);
                choices.into_iter().find(|(index, _)| *index == i64::from(small))?.1
            }
            _ => small.to_string(),
        })
    }

    /// The value of a control that holds a number or a place in a menu; none where there is none.
    pub(super) fn number(&self, id: u32) -> Option<i64> {
        let mut one = sys::v4l2_ext_control { id, ..Default::default() };
        self.transfer(sys::REQUEST_G_EXT_CTRLS, &mut one).ok()?;
        // SAFETY: whoever asks by number knows that the control has 32 bits.
        Some(i64::from(unsafe { one.__bindgen_anon_1.value }))
    }

    /// Names of what the camera adjusts by itself: automatic controls that are on, and an exposure that is not manual.
    pub(super) fn automatic(&self) -> Vec<String> {
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
        let controls = self.controls().into_iter().filter(|control| !control.has(locked) && is_on(control));
        controls.map(|control| control.name).collect()
    }

    fn verify(&self, control: &Control, wanted: &FeatureValue) -> Result<(), String> {
        match self.value(control) {
            Some(kept) if kept.trim_end() != wanted.to_string().trim_end() => Err(format!("the camera keeps {kept}")),
            _ => Ok(()),
        }
    }

    /// What a control can be set to, for a person; empty where there is no range.
    fn allowed(&self, control: &Control) -> String {
        match control.kind {
            sys::V4L2_CTRL_TYPE_INTEGER | sys::V4L2_CTRL_TYPE_INTEGER64 => control.range(),
            sys::V4L2_CTRL_TYPE_STRING => format!("{} bytes", control.range()),
            sys::V4L2_CTRL_TYPE_BITMASK => format!("the bits of {:#x}", control.most & 0xffff_ffff),
            sys::V4L2_CTRL_TYPE_MENU | sys::V4L2_CTRL_TYPE_INTEGER_MENU => {
                let words: Vec<_> = self.choices(control).into_iter().map(|(_, word)| word).collect();
                words.join(", ")
            }
            _ => String::new(),
        }
    }

    /// Every control as a line for a person.
    pub(super) fn feature_lines(&self) -> Vec<FeatureLine> {
        let line = |control: Control| FeatureLine {
            depth: 0,
            kind: kind(control.kind),
            value: self.value(&control),
            allowed: self.allowed(&control),
            unit: if control.id == sys::V4L2_CID_EXPOSURE_ABSOLUTE { "100 us".into() } else { String::new() },
            writable: control.lock().is_none(),
            name: control.name,
        };
        self.controls().into_iter().map(line).collect()
    }
}

fn kind(kind: u32) -> Kind {
    match kind {
        sys::V4L2_CTRL_TYPE_BOOLEAN => Kind::Boolean,
        sys::V4L2_CTRL_TYPE_BUTTON => Kind::Command,
        sys::V4L2_CTRL_TYPE_MENU => Kind::Enumeration,
        sys::V4L2_CTRL_TYPE_STRING => Kind::Text,
        _ => Kind::Integer,
    }
}

fn kind_word(raw: u32) -> String {
    match raw {
        sys::V4L2_CTRL_TYPE_INTEGER_MENU => "integer menu".into(),
        sys::V4L2_CTRL_TYPE_BITMASK => "bit mask".into(),
        raw if raw >= sys::V4L2_CTRL_COMPOUND_TYPES => "array, which cannot be set here".into(),
        raw => kind(raw).word().into(),
    }
}
