//! The rig file: TOML in, checked settings out.
