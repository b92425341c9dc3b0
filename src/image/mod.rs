//! Raw camera frames, and the grey-level images computed from them.

mod correction;
mod defects;
mod format;
mod frame;
mod frame_runs;
mod grey;
mod png;
mod rect;
mod tone;
mod view;

pub use correction::Correction;
pub use defects::{DefectError, Defects};
pub use format::{PixelFormat, is_saturated};
pub use frame::{Frame, FrameMeta, is_dated};
pub use frame_runs::FrameRuns;
pub use grey::grey_pixels;
pub use png::encode_png;
pub use rect::PixelRect;
pub use tone::Tone;
pub use view::{Image, ImageView, ShapeError};
