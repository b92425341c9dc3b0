//! Access to a camera's features by name.

use super::handle::{Library, Object, c_text, checked, free, text};
use super::sys::{ARV_GC_ACCESS_MODE_RO, ARV_GC_ACCESS_MODE_WO};
use super::sys::{ArvCamera, ArvDevice, ArvGcNode, GClosure, GError, GType, gpointer, guint};
use crate::camera::FeatureKind;
use crate::camera::feature_setting::{FloatRange, IntegerRange};
use std::ffi::{CString, c_char};
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Maximum deviation of a gamma that counts as 1.
const GAMMA_TOLERANCE: f64 = 0.005;

/// Access to a feature.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Read-only.
    Read,
    /// Write-only.
    Write,
    /// Read and write.
    Both,
}

/// An open camera. The error of each method is the library's message.
#[derive(Debug)]
pub struct Device {
    pub(super) aravis: Library,
    pub(super) camera: Object<ArvCamera>,
}

// Signatures of the library's functions: getter, setter and bounds of a feature by name; getter and bounds of a camera.
type Read<R> = unsafe extern "C" fn(*mut ArvDevice, *const c_char, *mut *mut GError) -> R;
type Write<V> = unsafe extern "C" fn(*mut ArvDevice, *const c_char, V, *mut *mut GError);
type Range<V> = unsafe extern "C" fn(*mut ArvDevice, *const c_char, *mut V, *mut V, *mut *mut GError);
type Call<R> = unsafe extern "C" fn(*mut ArvCamera, *mut *mut GError) -> R;
type Bounds = unsafe extern "C" fn(*mut ArvCamera, *mut f64, *mut f64, *mut *mut GError);

impl Device {
    /// Returns the underlying device; valid while `self` lives.
    pub(super) fn as_ptr(&self) -> *mut ArvDevice {
        // SAFETY: the camera is open and owns its device.
        unsafe { self.aravis.arv_camera_get_device(self.camera.as_ptr()) }
    }

    /// Calls one of the library's functions on the feature of this name and returns its result.
    fn read<R>(&self, name: &str, function: Read<R>) -> Result<R, String> {
        let name = c_text(name)?;
        // SAFETY: an open device and a terminated name; the function is one of the library's getters.
        checked(self.aravis, |error| unsafe { function(self.as_ptr(), name.as_ptr(), error) })
    }

    /// Writes a feature through one of the library's setters.
    pub(super) fn write<V>(&self, name: &str, value: V, function: Write<V>) -> Result<(), String> {
        let name = c_text(name)?;
        // SAFETY: as in `read`; pointers in the value outlive the call.
        checked(self.aravis, |error| unsafe { function(self.as_ptr(), name.as_ptr(), value, error) })
    }

    /// Returns the minimum and the maximum of a feature at the present settings.
    fn min_max<V: Default>(&self, name: &str, function: Range<V>) -> Result<(V, V), String> {
        let name = c_text(name)?;
        let (mut min, mut max) = (V::default(), V::default());
        // SAFETY: as in `read`; both bounds are ours to write to.
        checked(self.aravis, |error| unsafe {
            function(self.as_ptr(), name.as_ptr(), &raw mut min, &raw mut max, error);
        })?;
        Ok((min, max))
    }

    /// Returns the range of a quantity at the present settings, through the library's function for its bounds.
    pub(super) fn bounds(&self, function: Bounds) -> Result<FloatRange, String> {
        let mut range = FloatRange { min: 0.0, max: 0.0 };
        // SAFETY: an open camera and two numbers of ours to write to.
        checked(self.aravis, |error| unsafe {
            function(self.camera.as_ptr(), &raw mut range.min, &raw mut range.max, error);
        })?;
        Ok(range)
    }

    /// Calls a function of the camera that takes no argument.
    pub(super) fn call<R>(&self, function: Call<R>) -> Result<R, String> {
        // SAFETY: an open camera; the function is one of the library's.
        checked(self.aravis, |error| unsafe { function(self.camera.as_ptr(), error) })
    }

    /// Returns the value of an integer.
    pub fn integer(&self, name: &str) -> Result<i64, String> {
        self.read(name, self.aravis.arv_device_get_integer_feature_value)
    }

    /// Sets an integer.
    pub fn set_integer(&self, name: &str, value: i64) -> Result<(), String> {
        self.write(name, value, self.aravis.arv_device_set_integer_feature_value)
    }

    /// Returns the range of an integer at the present settings; its increment is 1 if the camera reports none.
    pub fn integer_range(&self, name: &str) -> Result<IntegerRange, String> {
        let (min, max) = self.min_max(name, self.aravis.arv_device_get_integer_feature_bounds)?;
        let step = self.read(name, self.aravis.arv_device_get_integer_feature_increment).unwrap_or(1);
        Ok(IntegerRange { min, max, step: step.max(1).unsigned_abs() })
    }

    /// Returns the value of a real number.
    pub fn float(&self, name: &str) -> Result<f64, String> {
        self.read(name, self.aravis.arv_device_get_float_feature_value)
    }

    /// Sets a real number.
    pub fn set_float(&self, name: &str, value: f64) -> Result<(), String> {
        self.write(name, value, self.aravis.arv_device_set_float_feature_value)
    }

    /// Returns the range of a real number at the present settings.
    pub fn float_range(&self, name: &str) -> Result<FloatRange, String> {
        let (min, max) = self.min_max(name, self.aravis.arv_device_get_float_feature_bounds)?;
        Ok(FloatRange { min, max })
    }

    /// Returns the value of a boolean.
    pub fn boolean(&self, name: &str) -> Result<bool, String> {
        Ok(self.read(name, self.aravis.arv_device_get_boolean_feature_value)? != 0)
    }

    /// Returns the value of a text, or the selected entry of an enumeration.
    pub fn text(&self, name: &str) -> Result<String, String> {
        let value = self.read(name, self.aravis.arv_device_get_string_feature_value)?;
        // SAFETY: the library returns null or a terminated string that it keeps until the next call.
        unsafe { text(value) }.ok_or_else(|| format!("{name} has no value"))
    }

    /// Sets a text, or selects an entry of an enumeration.
    pub fn set_text(&self, name: &str, value: &str) -> Result<(), String> {
        let value: CString = c_text(value)?;
        self.write(name, value.as_ptr(), self.aravis.arv_device_set_string_feature_value)
    }

    /// Returns the entries of an enumeration that are available now.
    pub fn enum_entries(&self, name: &str) -> Result<Vec<String>, String> {
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
            let entries = (0..count as usize).filter_map(|index| text(*list.add(index))).collect();
            free(self.aravis, list);
            Ok(entries)
        }
    }

    /// Returns the gamma exponent, if one is active and differs from 1 by more than 0.005.
    pub fn gamma(&self) -> Option<f64> {
        let is_on = !self.has("GammaEnable") || self.boolean("GammaEnable").unwrap_or(true);
        let gamma = self.has("Gamma").then(|| self.float("Gamma").ok()).flatten()?;
        (is_on && gamma > 0.0 && (gamma - 1.0).abs() > GAMMA_TOLERANCE).then_some(gamma)
    }

    /// Executes a command.
    pub fn execute(&self, name: &str) -> Result<(), String> {
        self.read(name, self.aravis.arv_device_execute_command)
    }

    /// Whether the camera has this feature and it is available now.
    pub fn has(&self, name: &str) -> bool {
        self.read(name, self.aravis.arv_device_is_feature_available).is_ok_and(|available| available != 0)
    }

    /// Returns the node of this name in the camera's description, null if there is none. It lives as long as the
    /// device.
    pub(super) fn node(&self, name: &str) -> *mut ArvGcNode {
        let Ok(name) = c_text(name) else { return ptr::null_mut() };
        // SAFETY: an open device and a terminated name.
        unsafe { self.aravis.arv_device_get_feature(self.as_ptr(), name.as_ptr()) }
    }

    /// Returns the type of a feature; `None` if the camera does not have it.
    pub fn kind(&self, name: &str) -> Option<FeatureKind> {
        self.kind_of(self.node(name))
    }

    /// Returns the type of a node of the camera's description; `None` if it is null or of a type without a value.
    pub(super) fn kind_of(&self, node: *mut ArvGcNode) -> Option<FeatureKind> {
        if node.is_null() {
            return None;
        }
        let aravis = self.aravis;
        // The order matters: an enumeration is an integer too.
        let kinds: [(FeatureKind, unsafe extern "C" fn() -> GType); 7] = [
            (FeatureKind::Enumeration, aravis.arv_gc_enumeration_get_type),
            (FeatureKind::Boolean, aravis.arv_gc_boolean_get_type),
            (FeatureKind::Command, aravis.arv_gc_command_get_type),
            (FeatureKind::Category, aravis.arv_gc_category_get_type),
            (FeatureKind::Integer, aravis.arv_gc_integer_get_type),
            (FeatureKind::Float, aravis.arv_gc_float_get_type),
            (FeatureKind::Text, aravis.arv_gc_string_get_type),
        ];
        // SAFETY: `node` is an object of the library; the type functions take no arguments.
        kinds
            .into_iter()
            .find(|(_, type_code)| unsafe { aravis.g_type_check_instance_is_a(node.cast(), type_code()) } != 0)
            .map(|(kind, _)| kind)
    }

    /// Whether another setting locks this feature; `false` if the camera does not have it.
    pub fn is_locked(&self, name: &str) -> bool {
        let node = self.node(name);
        // SAFETY: nodes found by name are feature nodes.
        let locked = |error| unsafe { self.aravis.arv_gc_feature_node_is_locked(node.cast(), error) };
        !node.is_null() && checked(self.aravis, locked).is_ok_and(|locked| locked != 0)
    }

    /// Returns the present access to a feature; `None` if the camera does not have it.
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
    /// Registers for the end of the connection: `lost` becomes `true` when it is lost or another program takes control.
    pub(super) fn watch_connection(&self, lost: &Arc<AtomicBool>) {
        let data = Arc::into_raw(Arc::clone(lost)).cast_mut().cast();
        // SAFETY: the handler's true type is that of the signal, (device, data). The library keeps the data
        // until it calls `release_flag`, which it does once, on destroying the device.
        unsafe {
            let handler: unsafe extern "C" fn(*mut ArvDevice, gpointer) = raise_flag;
            let handler =
                std::mem::transmute::<unsafe extern "C" fn(*mut ArvDevice, gpointer), unsafe extern "C" fn()>(handler);
            let (device, signal) = (self.as_ptr().cast(), c"control-lost".as_ptr());
            self.aravis.g_signal_connect_data(device, signal, Some(handler), data, Some(release_flag), 0);
        }
    }
}

/// Records that the connection is lost. The library calls it on its own thread.
unsafe extern "C" fn raise_flag(_device: *mut ArvDevice, data: gpointer) {
    // SAFETY: `watch_connection` passed this pointer, and the library has not called `release_flag` yet.
    unsafe { &*data.cast::<AtomicBool>() }.store(true, Ordering::Release);
}

/// Releases the library's reference to the flag. The library calls it once, on destroying the device.
unsafe extern "C" fn release_flag(data: gpointer, _closure: *mut GClosure) {
    // SAFETY: the one reference that `watch_connection` turned into a pointer.
    drop(unsafe { Arc::from_raw(data.cast::<AtomicBool>().cast_const()) });
}
