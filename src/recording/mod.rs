//! Recordings: MCAP files with frames and results.
//!
//! A recording is one MCAP file, or several when it is split by size. Frames are `foxglove.RawImage`, results are our
//! own protobuf messages (`schema/proto.rs`), and the rig's configuration is attached. [`RecordingWriter`] writes it.
//! [`Recording`] reads it, and reads unfinished files and files of other programs too.

mod annotations;
mod container;
mod disk_sync;
mod error;
mod extract;
mod frame_message;
mod message_copy;
mod part_file;
mod png_attachment;
mod reader;
mod record;
mod recover;
mod results_file;
mod row_batch;
mod rows;
mod schema;
mod split;
mod writer;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use annotations::Annotations;
pub use container::Compression;
pub use error::RecordingError;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use extract::{copy_as_ros2, copy_results};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use part_file::part_path;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use png_attachment::{from_png, to_png, to_png_with_bit_depth};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use reader::files_of;
pub use reader::{Attachment, Frames, Recording, Rows, TopicSummary};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use recover::{Recovered, recover, recover_with_progress};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use results_file::results_path;
pub use rows::{EventRow, StatusRow};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use schema::Topic;
pub use writer::{FinishedRecording, RecordingInfo, RecordingWriter, ViewInfo, WriterOptions};

/// Name of the metadata record that every recording of ours has.
const METADATA_NAME: &str = "ricochet";
/// Name of the attached configuration.
const CONFIG_NAME: &str = "config.toml";
/// Name of the metadata record at the end of a file that continues in a next one.
const CONTINUED_NAME: &str = "continued";
/// Name of the additional metadata record of a recovered recording.
const RECOVERED_NAME: &str = "recovered";
/// Entries of the metadata record `ricochet`: the names of the additional cameras.
const VIEW_KEY: &str = "view";
