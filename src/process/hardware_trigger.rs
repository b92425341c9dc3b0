//! Shots of a camera with a hardware trigger: the silence between bursts separates them.

use super::clock::Timeout;
use crate::config::{Config, TriggerMode};
use std::time::Duration;

/// Separates shots by the silence between them.
#[derive(Debug)]
pub(super) struct HardwareTrigger {
    /// Name of the trigger line.
    name: String,
    silence: Timeout,
    is_silent: bool,
    shot: u32,
}

impl HardwareTrigger {
    /// Returns `None` unless a hardware trigger starts the shots.
    pub(super) fn new(config: &Config) -> Option<Self> {
        let silence = Timeout::new(Duration::from_secs_f64(config.trigger.silence_s));
        let name = config.camera.trigger_source.clone().unwrap_or_else(|| "simulated".into());
        (config.trigger.mode == TriggerMode::Hardware).then_some(Self { name, silence, is_silent: true, shot: 0 })
    }

    /// Records a frame; if it begins a shot, returns the cause as text.
    pub(super) fn on_frame(&mut self) -> Option<String> {
        self.silence.renew();
        if !std::mem::take(&mut self.is_silent) {
            return None;
        }
        self.shot += 1;
        Some(format!("line {}", self.name))
    }

    /// Records that no frame came, and returns whether that ends a shot.
    pub(super) fn on_timeout(&mut self) -> bool {
        let ends = !self.is_silent && self.silence.has_expired();
        self.is_silent |= ends;
        ends
    }

    /// Returns the number of the current shot, counted from 1; 0 before the first.
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
        let mut trigger = HardwareTrigger::new(&Config::parse(text, "rig.toml").unwrap()).unwrap();
        assert!(!trigger.on_timeout(), "no shot has begun");
        assert_eq!((trigger.on_frame(), trigger.on_frame()), (Some("line simulated".to_owned()), None));
        assert!(!trigger.on_timeout() && trigger.on_frame().is_none() && trigger.shot() == 1);
        std::thread::sleep(Duration::from_millis(60));
        assert!(trigger.on_timeout() && !trigger.on_timeout(), "reported once");
        assert_eq!((trigger.on_frame().is_some(), trigger.shot()), (true, 2));
        let software = text.replace("hardware", "software").replace("silence_s = 0.05\n", "");
        assert!(HardwareTrigger::new(&Config::parse(&software, "rig.toml").unwrap()).is_none());
    }
}
