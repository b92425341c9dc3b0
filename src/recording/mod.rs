//! Recordings: the only room that names MCAP.
//!
//! A recording is one MCAP file: frames as `foxglove.RawImage`, results as our
//! own protobuf messages (`schema/*.proto`), the rig's configuration attached.
//! Written by [`RecordingWriter`], read by [`Recording`], which takes unfinished
//! files and other people's files too.

mod annotations;
mod batch;
mod container;
mod copier;
mod encode;
mod error;
mod extract;
mod part;
mod picture;
mod reader;
mod record;
mod recover;
mod rows;
mod schema;
mod split;
mod syncer;
mod writer;

pub use annotations::Annotations;
pub use error::RecordingError;
pub use extract::{copy_as_ros2, copy_results};
pub use part::part_path;
pub use picture::{from_png, to_png};
pub use reader::{Attachment, Frames, Recording, Rows, TopicSummary};
pub use recover::{Recovered, recover};
pub use rows::{EventRow, StatusRow};
pub use schema::Topic;
pub use split::files_of;
pub use writer::{Compression, FinishedRecording, RecordingInfo, RecordingWriter, ViewInfo, WriterOptions};

/// Name of the metadata record every recording of ours has.
const METADATA_NAME: &str = "ricochet";
/// Name of the attached configuration.
const CONFIG_NAME: &str = "config.toml";
/// Name of the metadata record at the end of a file that goes on in a next one.
const CONTINUED_NAME: &str = "continued";
/// Name of the metadata record a recovered recording has besides.
const RECOVERED_NAME: &str = "recovered";
