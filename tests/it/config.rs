//! The rig file: its meaning, and the messages about errors in it.

mod accepted;
mod files;
mod reference;
mod refused;

use ricochet::config::Config;

pub const SIMULATED: &str = "[camera]\nsource = \"simulated\"\n";
pub const GENICAM: &str =
    "[camera]\nsource = \"genicam\"\nid = \"10.0.0.2\"\nwidth_px = 512\nheight_px = 512\nframe_rate_hz = 1000\n";

pub fn parse(text: &str) -> Config {
    Config::parse(text, "rig.toml").unwrap_or_else(|error| panic!("refused:\n{text}\n{error}"))
}

/// The message that refuses `text`. Panics if the text is accepted or the message has several lines.
pub fn refusal(text: &str) -> String {
    let message = match Config::parse(text, "rig.toml") {
        Ok(_) => panic!("accepted:\n{text}"),
        Err(error) => error.to_string(),
    };
    assert!(!message.contains('\n'), "more than one line: {message}");
    message
}

/// Checks that each addition to a simulated rig is refused with this message after the name of the file.
pub fn refused_on_a_simulated_rig(cases: &[(&str, &str)]) {
    for (addition, message) in cases {
        assert_eq!(refusal(&format!("{SIMULATED}{addition}\n")), format!("rig.toml{message}"), "for {addition}");
    }
}
