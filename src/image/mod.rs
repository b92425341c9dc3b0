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

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use correction::Correction;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use defects::{DefectError, Defects};
pub use format::PixelFormat;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use format::is_saturated;
pub use frame::{Frame, FrameMeta, is_dated};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use frame_runs::FrameRuns;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use grey::grey_pixels;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use png::encode_png;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use rect::PixelRect;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use tone::Tone;
pub use view::{Image, ImageView, ShapeError};
