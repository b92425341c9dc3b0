//! A camera's features, by name: read, written and asked for their range.

use super::handle::{Library, Object, c_text, checked, free, text};
use super::sys::{ARV_GC_ACCESS_MODE_RO, ARV_GC_ACCESS_MODE_WO};
use super::sys::{ArvCamera, ArvDevice, ArvGcNode, GClosure, GError, GType, gpointer, guint};
use std::ffi::{CString, c_char};
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A gamma this near to 1 is 1.
const STRAIGHT: f64 = 0.005;

/// What a feature holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// True or false.
    Boolean,
    /// One of a list of words.
    Enumeration,
    /// Something to execute.
    Command,
    /// A group of features.
    Category,
    /// A whole number in a range.
    Integer,
    /// A real number in a range.
    Float,
    /// A text.
    Text,
}

impl Kind {
    /// The word for a person.
    pub fn word(self) -> &'static str {
        match self {
            Self::Boolean => "boolean",
            Self::Enumeration => "enumeration",
            Self::Command => "command",
            Self::Category => "category",
            Self::Integer => "integer",
            Self::Float => "float",
            Self::Text => "text",
        }
    }
}

/// Whether a feature may be read and written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Only read.
    Read,
    /// Only written.
    Write,
    /// Both.
    Both,
}

/// An open camera.
#[derive(Debug)]
pub struct Device {
    pub(super) aravis: Library,
    pub(super) camera: Object<ArvCamera>,
}

type Read<R> = unsafe extern "C" fn(*mut ArvDevice, *const c_char, *mut *mut GError) -> R;
type Write<V> = unsafe extern "C" fn(*mut ArvDevice, *const c_char, V, *mut *mut GError);
type Range<V> = unsafe extern "C" fn(*mut ArvDevice, *const c_char, *mut V, *mut V, *mut *mut GError);
type Ask<R> = unsafe extern "C" fn(*mut ArvCamera, *mut *mut GError) -> R;

impl Device {
    /// The device below the camera; valid while `self` lives.
    pub(super) fn as_ptr(&self) -> *mut ArvDevice {
        // SAFETY: the camera is open and owns its device.
        unsafe { self.aravis.arv_camera_get_device(self.camera.as_ptr()) }
    }

    fn read<R>(&self, name: &str, function: Read<R>) -> Result<R, String> {
        let name = c_text(name)?;
        // SAFETY: an open device and a terminated name; the function is one of the library's getters.
        checked(self.aravis, |error| unsafe { function(self.as_ptr(), name.as_ptr(), error) })
    }

    fn write<V>(&self, name: &str, value: V, function: Write<V>) -> Result<(), String> {
        let name = c_text(name)?;
        // SAFETY: as in `read`; pointers in the value outlive the call.
        checked(self.aravis, |error| unsafe { function(self.as_ptr(), name.as_ptr(), value, error) })
    }

    fn range<V: Default>(&self, name: &str, function: Range<V>) -> Result<(V, V), String> {
        let name = c_text(name)?;
        let (mut least, mut most) = (V::default(), V::default());
        // SAFETY: as in `read`; both bounds are ours to write to.
        checked(self.aravis, |error| unsafe {
            function(self.as_ptr(), name.as_ptr(), &raw mut least, &raw mut most, error);
        })?;
        Ok((least, most))
    }

    /// Asks the camera something that takes no argument.
    pub(super) fn ask<R>(&self, function: Ask<R>) -> Result<R, String> {
        // SAFETY: an open camera; the function is one of the library's.
        checked(self.aravis, |error| unsafe { function(self.camera.as_ptr(), error) })
    }

    /// The value of an integer.
    pub fn integer(&self, name: &str) -> Result<i64, String> {
        self.read(name, self.aravis.arv_device_get_integer_feature_value)
    }

    /// Sets an integer.
    pub fn set_integer(&self, name: &str, value: i64) -> Result<(), String> {
        self.write(name, value, self.aravis.arv_device_set_integer_feature_value)
    }

    /// Least and greatest value of an integer, and its step.
    pub fn integer_range(&self, name: &str) -> Result<(i64, i64, i64), String> {
        let (least, most) = self.range(name, self.aravis.arv_device_get_integer_feature_bounds)?;
        Ok((least, most, self.read(name, self.aravis.arv_device_get_integer_feature_increment).unwrap_or(1).max(1)))
    }

    /// The value of a real number.
    pub fn float(&self, name: &str) -> Result<f64, String> {
        self.read(name, self.aravis.arv_device_get_float_feature_value)
    }

    /// Sets a real number.
    pub fn set_float(&self, name: &str, value: f64) -> Result<(), String> {
        self.write(name, value, self.aravis.arv_device_set_float_feature_value)
    }

    /// Least and greatest value of a real number.
    pub fn float_range(&self, name: &str) -> Result<(f64, f64), String> {
        self.range(name, self.aravis.arv_device_get_float_feature_bounds)
    }

    /// The value of a boolean.
    pub fn boolean(&self, name: &str) -> Result<bool, String> {
        Ok(self.read(name, self.aravis.arv_device_get_boolean_feature_value)? != 0)
    }

    /// Sets a boolean.
    pub fn set_boolean(&self, name: &str, value: bool) -> Result<(), String> {
        self.write(name, i32::from(value), self.aravis.arv_device_set_boolean_feature_value)
    }

    /// The value of a text or the chosen word of an enumeration.
    pub fn text(&self, name: &str) -> Result<String, String> {
        let value = self.read(name, self.aravis.arv_device_get_string_feature_value)?;
        // SAFETY: the library answers null or a terminated string that it keeps until the next call.
        unsafe { text(value) }.ok_or_else(|| format!("{name} has no value"))
    }

    /// Sets a text or chooses a word of an enumeration.
    pub fn set_text(&self, name: &str, value: &str) -> Result<(), String> {
        let value: CString = c_text(value)?;
        self.write(name, value.as_ptr(), self.aravis.arv_device_set_string_feature_value)
    }

    /// The words of an enumeration that can be chosen now.
    pub fn words(&self, name: &str) -> Result<Vec<String>, String> {
        let name = c_text(name)?;
        let mut count: guint = 0;
        let function = self.aravis.arv_device_dup_available_enumeration_feature_values_as_strings;
        // SAFETY: an open device, a terminated name, and a count of ours to write to.
        let list =
            checked(self.aravis, |error| unsafe { function(self.as_ptr(), name.as_ptr(), &raw mut count, error) })?;
        if list.is_null() {
            return Ok(Vec::new());
        }
        // SAFETY: the library allocated a list of `count` terminated strings, of which only the list is ours.
        unsafe {
            let words = (0..count as usize).filter_map(|index| text(*list.add(index))).collect();
            free(self.aravis, list);
            Ok(words)
        }
    }

    /// Exponent of its tone curve, where it has one in use and grey levels are not light.
    pub fn gamma(&self) -> Option<f64> {
        let is_on = !self.has("GammaEnable") || self.boolean("GammaEnable").unwrap_or(true);
        let gamma = self.has("Gamma").then(|| self.float("Gamma").ok()).flatten()?;
        (is_on && gamma > 0.0 && (gamma - 1.0).abs() > STRAIGHT).then_some(gamma)
    }

    /// Executes a command.
    pub fn execute(&self, name: &str) -> Result<(), String> {
        self.read(name, self.aravis.arv_device_execute_command)
    }

    /// Whether the camera has this feature and offers it now.
    pub fn has(&self, name: &str) -> bool {
        self.read(name, self.aravis.arv_device_is_feature_available).is_ok_and(|available| available != 0)
    }

    /// The node of this name in the camera's description, null when there is none; it lives as long as the device.
    pub(super) fn node(&self, name: &str) -> *mut ArvGcNode {
        let Ok(name) = c_text(name) else { return ptr::null_mut() };
        // SAFETY: an open device and a terminated name.
        unsafe { self.aravis.arv_device_get_feature(self.as_ptr(), name.as_ptr()) }
    }

    /// What a feature holds; nothing when the camera does not have it.
    pub fn kind(&self, name: &str) -> Option<Kind> {
        self.kind_of(self.node(name))
    }

    pub(super) fn kind_of(&self, node: *mut ArvGcNode) -> Option<Kind> {
        if node.is_null() {
            return None;
        }
        let aravis = self.aravis;
        // Order matters: an enumeration is an integer too.
        let kinds: [(Kind, unsafe extern "C" fn() -> GType); 7] = [
            (Kind::Enumeration, aravis.arv_gc_enumeration_get_type),
            (Kind::Boolean, aravis.arv_gc_boolean_get_type),
            (Kind::Command, aravis.arv_gc_command_get_type),
            (Kind::Category, aravis.arv_gc_category_get_type),
            (Kind::Integer, aravis.arv_gc_integer_get_type),
            (Kind::Float, aravis.arv_gc_float_get_type),
            (Kind::Text, aravis.arv_gc_string_get_type),
        ];
        // SAFETY: `node` is an object of the library; the type functions take nothing.
        kinds
            .into_iter()
            .find(|(_, of)| unsafe { aravis.g_type_check_instance_is_a(node.cast(), of()) } != 0)
            .map(|(kind, _)| kind)
    }

    /// Whether another setting keeps this feature from being set now.
    pub fn is_locked(&self, name: &str) -> bool {
        let node = self.node(name);
        // SAFETY: nodes found by name are feature nodes.
        let locked = |error| unsafe { self.aravis.arv_gc_feature_node_is_locked(node.cast(), error) };
        !node.is_null() && checked(self.aravis, locked).is_ok_and(|locked| locked != 0)
    }

    /// Whether a feature may be read and written now; nothing when the camera does not have it.
    pub fn access(&self, name: &str) -> Option<Access> {
        let node = self.node(name);
        if node.is_null() {
            return None;
        }
        // SAFETY: nodes found by name are feature nodes.
        let mode = unsafe { self.aravis.arv_gc_feature_node_get_actual_access_mode(node.cast()) };
        Some(match mode {
            ARV_GC_ACCESS_MODE_RO => Access::Read,
            ARV_GC_ACCESS_MODE_WO => Access::Write,
            _ => Access::Both,
        })
    }
}

impl Device {
    /// Raises the flag when the camera goes away or another program takes it over.
    pub(super) fn watch(&self, lost: &Arc<AtomicBool>) {
        let data = Arc::into_raw(Arc::clone(lost)).cast_mut().cast();
        // SAFETY: the handler's true type is that of the signal, (device, data); the library keeps the data until it
        // calls `forget_flag`, which it does once, when the device goes.
        unsafe {
            let handler: unsafe extern "C" fn(*mut ArvDevice, gpointer) = raise_flag;
            let handler =
                std::mem::transmute::<unsafe extern "C" fn(*mut ArvDevice, gpointer), unsafe extern "C" fn()>(handler);
            let (device, signal) = (self.as_ptr().cast(), c"control-lost".as_ptr());
            self.aravis.g_signal_connect_data(device, signal, Some(handler), data, Some(forget_flag), 0);
        }
    }
}

/// Called by the library on its own thread.
unsafe extern "C" fn raise_flag(_device: *mut ArvDevice, data: gpointer) {
    // SAFETY: `watch` handed this in, and the library has not called `forget_flag` yet.
    unsafe { &*data.cast::<AtomicBool>() }.store(true, Ordering::Release);
}

unsafe extern "C" fn forget_flag(data: gpointer, _closure: *mut GClosure) {
    // SAFETY: the one reference that `watch` turned into a pointer.
    drop(unsafe { Arc::from_raw(data.cast::<AtomicBool>().cast_const()) });
}
