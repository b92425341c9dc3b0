//! The view of one of several cameras in a recording.

use super::{RecordedFile, Recording, RecordingError};
use crate::recording::schema::Topic;
use crate::recording::{METADATA_NAME, VIEW_KEY};
use std::collections::BTreeMap;
use std::sync::Arc;

impl Recording {
    /// Returns the names of the additional cameras, in the order of the rig file.
    pub fn views(&self) -> Vec<String> {
        (0..).map_while(|index| self.metadata().get(&format!("{VIEW_KEY}.{index}")).cloned()).collect()
    }

    /// Returns the recording of one additional camera, as if it were alone. The recording itself is that of the first.
    ///
    /// Events and damage stay those of all cameras.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Invalid`] when there is no such camera; [`RecordingError::Io`] when the system fails.
    pub fn view(&self, name: &str) -> Result<Self, RecordingError> {
        let views = self.views();
        if !views.iter().any(|view| view == name) {
            let known = if views.is_empty() { "it has one camera".into() } else { format!("it has {views:?}") };
            return Err(self.inner.invalid(format!("no additional camera named {name:?}: {known}")));
        }
        let mut all_files = Vec::new();
        for inner in self.all_files() {
            all_files.push(Arc::new(inner.view(name)?));
        }
        let first = all_files.remove(0);
        let rest = super::file_set::Rest {
            files: all_files,
            truncated: self.rest.truncated.clone(),
            damage: self.rest.damage.clone(),
        };
        Ok(Self { inner: first, rest: Arc::new(rest) })
    }

    /// Returns the recording of the named camera, or of the first without a name.
    ///
    /// # Errors
    ///
    /// The errors of [`view`](Self::view).
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn select_view(self, name: Option<&str>) -> Result<Self, RecordingError> {
        name.map_or(Ok(self.clone()), |name| self.view(name))
    }
}

impl RecordedFile {
    /// Returns this file reduced to the topics, metadata and attachments of one additional camera, without their
    /// prefix; the events of the rig stay.
    fn view(&self, name: &str) -> Result<Self, RecordingError> {
        let mut structure = self.structure.clone();
        let (prefix, metadata_name) = (format!("/{name}"), format!("{METADATA_NAME}/{name}"));
        let all = std::mem::take(&mut structure.channels);
        for (id, mut channel) in all {
            match channel.topic.strip_prefix(&prefix).filter(|topic| topic.starts_with('/')) {
                Some(own_name) => channel.topic = own_name.to_owned(),
                None if channel.topic == Topic::Events.as_str() => {}
                None => continue,
            }
            structure.channels.insert(id, channel);
        }
        // Its own record and attachments take the names of those of the first camera.
        structure.metadata.retain(|(of, _)| of != METADATA_NAME);
        for (of, _) in structure.metadata.iter_mut().filter(|(of, _)| *of == metadata_name) {
            *of = METADATA_NAME.to_owned();
        }
        let own_name = |of: &str| of.strip_prefix(name).and_then(|of| of.strip_prefix('/')).map(str::to_owned);
        structure.attachments.retain(|attachment| own_name(&attachment.name).is_some());
        for attachment in &mut structure.attachments {
            attachment.name = own_name(&attachment.name).unwrap_or_default();
        }
        let mut inner = Self {
            path: self.path.clone(),
            file: self.file.try_clone().map_err(|error| self.io(error))?,
            file_bytes: self.file_bytes,
            structure,
            counts: self.counts.clone(),
            metadata: BTreeMap::new(),
            bodies: Vec::new(),
            config_toml: None,
            damage: self.damage.clone(),
        };
        inner.describe()?;
        Ok(inner)
    }
}
