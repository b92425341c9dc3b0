//! The command line; the only file that names clap.
