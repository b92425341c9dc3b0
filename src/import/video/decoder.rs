//! The frames of a film, each with the index that its time gives it.

use super::super::ImportError;
use super::super::footage::{Findings, Stored};
use super::super::shape::Shape;
use super::decoding::{Decoded, Decoding};
use super::times::Ticks;
use std::io::{self, Read};
use std::process::ChildStdout;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// The pixels of a film with the index of each frame among those that the file lists.
pub(super) struct Decoder {
    decoding: Decoding,
    pixels: Receiver<io::Result<Vec<u8>>>,
    ticks: Ticks,
    shape: Shape,
    next: usize,
    decoded: usize,
    is_over: bool,
    findings: Findings,
}

impl Decoder {
    /// Starts to read frames of `shape`, on a thread of its own, from a decoding that writes grey levels.
    pub(super) fn new(mut decoding: Decoding, ticks: Ticks, shape: Shape, findings: Findings) -> Self {
        // One frame is read while the one before is used.
        let (sender, pixels) = sync_channel(0);
        if let Some(pipe) = decoding.pixels() {
            std::thread::spawn(move || read_frames(pipe, shape.bytes(), &sender));
        }
        Self { decoding, pixels, ticks, shape, next: 0, decoded: 0, is_over: false, findings }
    }

    /// Reads the next frame; `None` after the last. Frames that were not decoded are reported then.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when ffmpeg fails or hangs, the frame is refused, or its pixels are incomplete.
    fn read_frame(&mut self) -> Result<Option<Stored>, ImportError> {
        let Some(frame) = self.decoding.next_frame()? else {
            self.report_missing();
            return Ok(None);
        };
        let index = self.frame_index(frame)?;
        let bytes = match self.decoding.receive(&self.pixels)? {
            Some(pixels) => {
                let pixels = pixels.map_err(|error| ImportError::io("read", &self.decoding.path, error))?;
                if pixels.len() as u64 == self.shape.bytes() {
                    self.next = index + 1;
                    self.decoded += 1;
                    return Ok(Some(Stored { index: index as u64, pixels }));
                }
                pixels.len()
            }
            None => 0,
        };
        // The reason why ffmpeg ended early is better than the number of bytes.
        while self.decoding.next_frame()?.is_some() {}
        Err(self.invalid(format!("{bytes} bytes of {}", self.shape.bytes())))
    }

    /// Returns the index of a frame by its time, so that a frame that ffmpeg leaves out moves no other.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when its time is unknown, its size differs, or it is interlaced.
    fn frame_index(&self, frame: Decoded) -> Result<usize, ImportError> {
        let [width, height] = [self.shape.width_px, self.shape.height_px].map(u64::from);
        if [frame.width_px, frame.height_px] != [width, height] {
            return Err(self.invalid(format!(
                "the size changes from {width}x{height} to {}x{} pixels; cut the film there with ffmpeg -ss and -to",
                frame.width_px, frame.height_px
            )));
        }
        if frame.is_interlaced {
            return Err(self.invalid(INTERLACED.to_owned()));
        }
        self.ticks.index(frame.time, self.next).ok_or_else(|| {
            let tick = self.ticks.tick;
            self.invalid(format!(
                "it was decoded with the time {} in units of {}/{} s, which no packet of the file has; \
                 store the film again with ffmpeg -i FILM -fps_mode passthrough -c:v ffv1 NEW.mkv",
                frame.time, tick.over, tick.under
            ))
        })
    }

    /// Adds a finding of the number of frames that the file lists and that were not decoded, if there are any.
    fn report_missing(&self) {
        let listed = self.ticks.times.len();
        if self.decoded < listed {
            let missing = listed - self.decoded;
            self.findings.set("decoded", format!("{missing} of {listed} frames that the file lists were not decoded"));
        }
    }

    /// Returns the error that the next frame is refused, for this reason.
    fn invalid(&self, reason: String) -> ImportError {
        ImportError::invalid(&self.decoding.path, format!("frame {}: {reason}", self.next))
    }
}

/// The reason why a film of fields is refused, with the cure.
pub(super) const INTERLACED: &str = "each frame holds two fields of different times; take them apart with \
    ffmpeg -i FILM -vf bwdif=mode=send_field -c:v ffv1 NEW.mkv, or, if the frames are progressive, mark them so with \
    ffmpeg -i FILM -vf setfield=prog -fps_mode passthrough -c:v ffv1 NEW.mkv";

/// Sends the frames of a pipe on, `frame_bytes` each, until the pipe ends or fails or nobody receives them. The last
/// one is incomplete or empty.
fn read_frames(mut pipe: ChildStdout, frame_bytes: u64, frames: &SyncSender<io::Result<Vec<u8>>>) {
    loop {
        let mut pixels = Vec::new();
        let read = pipe.by_ref().take(frame_bytes).read_to_end(&mut pixels);
        let is_whole = matches!(read, Ok(bytes) if bytes as u64 == frame_bytes);
        if frames.send(read.map(|_| pixels)).is_err() || !is_whole {
            return;
        }
    }
}

impl Iterator for Decoder {
    type Item = Result<Stored, ImportError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over {
            return None;
        }
        let frame = self.read_frame().transpose();
        self.is_over = !matches!(frame, Some(Ok(_)));
        frame
    }
}
