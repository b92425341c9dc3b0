//! The description of a recording.

use std::collections::BTreeMap;

/// The description of a recording, written at its beginning.
///
/// # Examples
///
/// ```
/// use ricochet::recording::{Recording, RecordingInfo, RecordingWriter, WriterOptions};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("shot.mcap");
///
/// let info = RecordingInfo {
///     metadata: [("scale".into(), "0.5 mm/px".into())].into(),
///     bodies: vec!["ball".into()],
///     ..RecordingInfo::default()
/// };
/// let writer = RecordingWriter::create(&path, &info, &WriterOptions::default())?;
/// let recording = Recording::open(&writer.finish()?.path)?;
/// assert_eq!(recording.metadata()["scale"], "0.5 mm/px");
/// assert_eq!((recording.bodies(), recording.config_toml()), (&["ball".to_owned()][..], None));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordingInfo {
    /// The rig's configuration, attached as `config.toml`; empty for none.
    pub config_toml: String,
    /// Entries of the metadata record `ricochet`: version, camera, serial, scale, host, trigger.
    pub metadata: BTreeMap<String, String>,
    /// Names of the bodies, in the order of the configuration; entries `body.0`, `body.1`, ... of the metadata.
    pub bodies: Vec<String>,
    /// Additional attachments: file name, media type, content.
    pub attachments: Vec<(String, String, Vec<u8>)>,
    /// Additional cameras.
    pub views: Vec<ViewInfo>,
}

/// The description of an additional camera: metadata `ricochet/NAME` and attachment `NAME/config.toml`.
///
/// # Examples
///
/// ```
/// use ricochet::image::{Frame, FrameMeta};
/// use ricochet::recording::{Recording, RecordingInfo, RecordingWriter, ViewInfo, WriterOptions};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("shot.mcap");
///
/// let side = ViewInfo { name: "side".into(), ..ViewInfo::default() };
/// let info = RecordingInfo { views: vec![side], ..RecordingInfo::default() };
/// let mut writer = RecordingWriter::create(&path, &info, &WriterOptions::default())?;
/// # let meta = FrameMeta { width_px: 4, height_px: 2, stride_bytes: 4, ..FrameMeta::default() };
/// for camera in 0..=1 {
///     writer.select_camera(camera);
///     writer.write_frame(&Frame { meta, bytes: &[50; 8] })?;
/// }
/// let recording = Recording::open(&writer.finish()?.path)?;
/// assert_eq!(recording.views(), ["side"]);
/// assert_eq!(recording.view("side")?.frame_count(), 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ViewInfo {
    /// The name of the camera. The topics of its frames and results begin with `/NAME`.
    pub name: String,
    /// Its configuration as a rig of its own.
    pub config_toml: String,
    /// Entries like those of the first camera.
    pub metadata: BTreeMap<String, String>,
    /// Names of the bodies that it sees.
    pub bodies: Vec<String>,
}

/// Returns the entries with the names of the bodies added as `body.0`, `body.1`, ...
pub(super) fn with_bodies(entries: &BTreeMap<String, String>, bodies: &[String]) -> BTreeMap<String, String> {
    let named = bodies.iter().enumerate().map(|(index, body)| (format!("body.{index}"), body.clone()));
    entries.clone().into_iter().chain(named).collect()
}
