//! A rig file: a text is a configuration or an error that names its place.
#![no_main]

use libfuzzer_sys::fuzz_target;
use ricochet::config::Config;

fuzz_target!(|text: &str| {
    if let Err(error) = Config::parse(text, "rig.toml") {
        assert!(error.to_string().contains("rig.toml"), "{error}");
    }
});
