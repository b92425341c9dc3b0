//! What a recording says of itself.

use std::collections::BTreeMap;

/// What a recording says of itself, written first.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordingInfo {
    /// The rig's configuration, attached as `config.toml`; empty for none.
    pub config_toml: String,
    /// Entries of the metadata record `ricochet`: version, camera, serial, scale, host, trigger.
    pub metadata: BTreeMap<String, String>,
    /// Names of the bodies, in the order of the configuration; entries `body.0`, `body.1`, ... of the metadata.
    pub bodies: Vec<String>,
    /// Further attachments: file name, media type, content.
    pub attachments: Vec<(String, String, Vec<u8>)>,
    /// Further cameras.
    pub views: Vec<ViewInfo>,
}

/// What a recording says of a further camera: in metadata `ricochet/NAME` and an attachment `NAME/config.toml`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ViewInfo {
    /// What the camera is called; the topics of its frames and results begin with `/NAME`.
    pub name: String,
    /// Its own configuration, as if it were alone.
    pub config_toml: String,
    /// Entries as those of the first camera.
    pub metadata: BTreeMap<String, String>,
    /// Names of the bodies that it sees.
    pub bodies: Vec<String>,
}

/// The entries, and the names of the bodies among them.
pub(super) fn with_bodies(entries: &BTreeMap<String, String>, bodies: &[String]) -> BTreeMap<String, String> {
    let named = bodies.iter().enumerate().map(|(index, body)| (format!("body.{index}"), body.clone()));
    entries.clone().into_iter().chain(named).collect()
}
