//! The `events` topic.

use super::layout::described;
use crate::results::named_enum;
use iceoryx2::prelude::ZeroCopySend;

/// The maximum length of the text of an event, bytes of UTF-8.
///
/// # Examples
///
/// ```
/// use ricochet::message::{EVENT_TEXT_BYTES, Event, EventKind};
///
/// let event = Event::new(EventKind::Lost, 0, 0, 0, &"x".repeat(300));
/// assert_eq!(event.text().len(), EVENT_TEXT_BYTES);
/// ```
pub const EVENT_TEXT_BYTES: usize = 200;

named_enum! {
    /// The kind of an event.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::message::EventKind;
    ///
    /// assert_eq!(EventKind::from_number(7), Some(EventKind::Recorded));
    /// assert_eq!("contact".parse::<EventKind>(), Ok(EventKind::Contact));
    /// assert_eq!(EventKind::Contact.as_str(), "contact");
    /// ```
    EventKind: "event" {
        /// The ring exists and readers may attach. `sequence` is 0, or the first frame of a stream that continues after its
        /// camera's process died.
        Prepared = 1 "prepared",
        /// The first frame was published.
        Started = 2 "started",
        /// The last frame was published; `sequence` is one past it.
        Ended = 3 "ended",
        /// The recorder waits for a trigger.
        Armed = 4 "armed",
        /// The recorder ignores triggers.
        Disarmed = 5 "disarmed",
        /// A trigger; `sequence` is the frame it belongs to.
        Triggered = 6 "triggered",
        /// A recording is complete; the text is its path.
        Recorded = 7 "recorded",
        /// Data were lost; the text names them.
        Lost = 8 "lost",
        /// A process of the rig died and was restarted.
        Restarted = 9 "restarted",
        /// The camera disappeared or came back.
        Camera = 10 "camera",
        /// All results up to `sequence` were published.
        Tracked = 11 "tracked",
        /// The folder of the recordings has too little space, cannot be written, or works again.
        Storage = 12 "storage",
        /// The condition of the trigger was met; `sequence` is the frame it belongs to, which may be one to come. If it
        /// starts a shot, `Triggered` follows.
        Decided = 13 "decided",
        /// The state of the rig has changed; the text is `idle`, `preparing`, `armed`, `falling`, `impact`,
        /// `writing` or `done`.
        State = 14 "state",
        /// An action of a trigger has ended: a program, a call of a web service, the trigger of another rig.
        Action = 15 "action",
        /// A body touches the surface; `stamp_ns` is the start of the contact, `sequence` the frame by which it was detected.
        Contact = 16 "contact",
        /// A body in contact is thrown back; `stamp_ns` is the time of the deepest position.
        Deepest = 17 "deepest",
        /// A contact is withdrawn: there was none.
        Withdrawn = 18 "withdrawn",
        /// The frames of a further camera were matched in time with those of the first, in one shot.
        Matched = 19 "matched",
        /// A camera with a hardware trigger is silent, so the shot ends before `sequence`.
        Silent = 20 "silent",
        /// A process of the rig shows no sign of life and is killed; `Restarted` follows.
        Hung = 21 "hung",
        /// Half of the ring waits for a worker, or a worker measures more or fewer of its blocks because it is too slow.
        Behind = 22 "behind",
        /// A recording whose rows are incomplete was measured again from its frames; the text is the path of the results.
        Remeasured = 23 "remeasured",
    }
}

described! {
    "ricochet.Event.v1"
    /// An event.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::message::{Event, EventKind};
    ///
    /// // The rig publishes this when frame 4200 triggers a shot.
    /// let event = Event::new(EventKind::Triggered, 0, 4200, 1_700_000_000_420_000_000, "by the motion");
    /// assert_eq!(event.kind(), Some(EventKind::Triggered));
    /// assert_eq!((event.sequence, event.text().as_str()), (4200, "by the motion"));
    /// ```
    #[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
    #[repr(C)]
    pub struct Event {
        /// The start of the acquire process that it belongs to; 0 when none.
        pub run_id: u64,
        /// The frame it belongs to.
        pub sequence: u64,
        /// The stamp of the frame, ns since the Unix epoch.
        pub stamp_ns: u64,
        /// The number of the `EventKind`.
        pub kind: u32,
        /// The number of bytes of `text` in use.
        pub text_bytes: u32,
        /// The text in UTF-8.
        pub text: [u8; EVENT_TEXT_BYTES],
    }
}

impl Event {
    /// Creates an event. A text longer than [`EVENT_TEXT_BYTES`] is cut between two characters.
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

    /// Returns the kind; `None` for an unknown number.
    pub fn kind(&self) -> Option<EventKind> {
        EventKind::from_number(self.kind)
    }

    /// Returns the text; bytes that are not UTF-8 are replaced by U+FFFD.
    pub fn text(&self) -> String {
        let length = (self.text_bytes as usize).min(EVENT_TEXT_BYTES);
        String::from_utf8_lossy(&self.text[..length]).into_owned()
    }
}
