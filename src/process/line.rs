//! A camera that waits for its line: where its shots begin and end.

use super::clock::Patience;
use crate::config::{Config, TriggerMode};
use std::time::Duration;

/// Tells shots apart by the silence between them.
#[derive(Debug)]
pub(super) struct Line {
    /// What the line is called.
    name: String,
    silence: Patience,
    is_silent: bool,
    shot: u32,
}

impl Line {
    /// `None` where something else starts the shots.
    pub(super) fn new(config: &Config) -> Option<Self> {
        let silence = Patience::new(Duration::from_secs_f64(config.trigger.silence_s));
        let name = config.camera.trigger_source.clone().unwrap_or_else(|| "simulated".into());
        (config.trigger.mode == TriggerMode::Hardware).then_some(Self { name, silence, is_silent: true, shot: 0 })
    }

    /// A frame came; what begins a shot with it, in words.
    pub(super) fn frame(&mut self) -> Option<String> {
        self.silence.renew();
        if !std::mem::take(&mut self.is_silent) {
            return None;
        }
        self.shot += 1;
        Some(format!("line {}", self.name))
    }

    /// No frame is waiting; whether a shot has ended with that.
    pub(super) fn nothing(&mut self) -> bool {
        let ends = !self.is_silent && self.silence.is_over();
        self.is_silent |= ends;
        ends
    }

    /// The shot under way, counted from 1.
    pub(super) fn shot(&self) -> u32 {
        self.shot
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shot_begins_with_a_frame_after_silence_and_ends_with_silence() {
        let text =
            "[camera]\nsource = \"simulated\"\npulse_period_s = 1\n[trigger]\nmode = \"hardware\"\nsilence_s = 0.05\n";
        let mut line = Line::new(&Config::parse(text, "rig.toml").unwrap()).unwrap();
        assert!(!line.nothing(), "no shot has begun");
        assert_eq!((line.frame(), line.frame()), (Some("line simulated".to_owned()), None));
        assert!(!line.nothing() && line.frame().is_none() && line.shot() == 1);
        std::thread::sleep(Duration::from_millis(60));
        assert!(line.nothing() && !line.nothing(), "told once");
        assert_eq!((line.frame().is_some(), line.shot()), (true, 2));
        let software = text.replace("hardware", "software").replace("silence_s = 0.05\n", "");
        assert!(Line::new(&Config::parse(&software, "rig.toml").unwrap()).is_none());
    }
}
