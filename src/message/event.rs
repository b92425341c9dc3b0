//! The `events` topic: what happened, in words.

use iceoryx2::prelude::ZeroCopySend;

/// Longest text of an event, bytes of UTF-8.
pub const EVENT_TEXT_BYTES: usize = 200;

/// What kind of thing happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum EventKind {
    /// The ring exists; readers may attach. `sequence` is 0, or the earliest frame of a stream that goes on after its
    /// camera's process died.
    Prepared = 1,
    /// The first frame was published.
    Started = 2,
    /// The last frame was published; `sequence` is one past it.
    Ended = 3,
    /// The recorder waits for a trigger.
    Armed = 4,
    /// The recorder ignores triggers.
    Disarmed = 5,
    /// A trigger; `sequence` is the frame it belongs to.
    Triggered = 6,
    /// A recording is complete; the text is its path.
    Recorded = 7,
    /// Data were lost; the text says what.
    Lost = 8,
    /// A process of the rig died and was started again.
    Restarted = 9,
    /// The camera vanished or came back.
    Camera = 10,
    /// Every result up to `sequence` was published.
    Tracked = 11,
    /// The folder of the recordings: too little room, cannot be written, or all right again.
    Storage = 12,
    /// What the trigger waits for was seen; `sequence` is the frame it belongs to, which may be one to come. Whether it
    /// starts a shot is told by `Triggered`.
    Decided = 13,
    /// What the rig as a whole does has changed; the text is `idle`, `preparing`, `armed`, `falling`, `impact`,
    /// `writing` or `done`.
    State = 14,
    /// What a trigger set off has ended: a program, a call of a web service, the trigger of another rig.
    Action = 15,
    /// A body touches the surface; `stamp_ns` is the moment it began to, `sequence` the frame by which it was noticed.
    Contact = 16,
    /// A body that touches the surface is thrown back; `stamp_ns` is the deepest moment.
    Deepest = 17,
    /// What was told as contact was none.
    Withdrawn = 18,
    /// How the frames of a further camera lie in time beside those of the first, in one shot.
    Matched = 19,
    /// A camera that waits for its line has been silent: the shot ends before `sequence`.
    Silent = 20,
}

impl EventKind {
    /// Every kind.
    pub const ALL: [Self; 20] = [
        Self::Prepared,
        Self::Started,
        Self::Ended,
        Self::Armed,
        Self::Disarmed,
        Self::Triggered,
        Self::Recorded,
        Self::Lost,
        Self::Restarted,
        Self::Camera,
        Self::Tracked,
        Self::Storage,
        Self::Decided,
        Self::State,
        Self::Action,
        Self::Contact,
        Self::Deepest,
        Self::Withdrawn,
        Self::Matched,
        Self::Silent,
    ];

    /// The word used in tables.
    pub fn word(self) -> &'static str {
        match self {
            Self::Prepared => "prepared",
            Self::Started => "started",
            Self::Ended => "ended",
            Self::Armed => "armed",
            Self::Disarmed => "disarmed",
            Self::Triggered => "triggered",
            Self::Recorded => "recorded",
            Self::Lost => "lost",
            Self::Restarted => "restarted",
            Self::Camera => "camera",
            Self::Tracked => "tracked",
            Self::Storage => "storage",
            Self::Decided => "decided",
            Self::State => "state",
            Self::Action => "action",
            Self::Contact => "contact",
            Self::Deepest => "deepest",
            Self::Withdrawn => "withdrawn",
            Self::Matched => "matched",
            Self::Silent => "silent",
        }
    }

    /// The kind with this number, if there is one.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| *kind as u32 == number)
    }
}

/// Something happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[type_name("ricochet.Event.v1")]
#[repr(C)]
pub struct Event {
    /// Which start of the acquire process it belongs to; 0 when none.
    pub run_id: u64,
    /// The frame it belongs to.
    pub sequence: u64,
    /// When, ns since the Unix epoch: the frame's stamp.
    pub stamp_ns: u64,
    /// Number of the `EventKind`.
    pub kind: u32,
    /// Bytes of `text` in use.
    pub text_bytes: u32,
    /// UTF-8.
    pub text: [u8; EVENT_TEXT_BYTES],
}

impl Event {
    /// An event; a text too long is cut at a character.
    pub fn new(kind: EventKind, run_id: u64, sequence: u64, stamp_ns: u64, text: &str) -> Self {
        let mut length = text.len().min(EVENT_TEXT_BYTES);
        while !text.is_char_boundary(length) {
            length -= 1;
        }
        let mut bytes = [0; EVENT_TEXT_BYTES];
        bytes[..length].copy_from_slice(&text.as_bytes()[..length]);
        let text_bytes = u32::try_from(length).unwrap_or(0);
        Self { run_id, sequence, stamp_ns, kind: kind as u32, text_bytes, text: bytes }
    }

    /// What kind of event; `None` for a number that is not one of ours.
    pub fn kind(&self) -> Option<EventKind> {
        EventKind::from_number(self.kind)
    }

    /// The text.
    pub fn text(&self) -> String {
        let length = (self.text_bytes as usize).min(EVENT_TEXT_BYTES);
        String::from_utf8_lossy(&self.text[..length]).into_owned()
    }
}
