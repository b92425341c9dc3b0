//! Compiles the recording's message schemas, without any tool outside Cargo.

use std::{env, error::Error, fs, path::PathBuf};

const FOLDER: &str = "src/recording/schema";
const SCHEMAS: [&str; 7] = ["event", "field", "frame_info", "impact", "status", "track", "velocity"];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed={FOLDER}");
    println!("cargo:rerun-if-changed=build.rs");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    for schema in SCHEMAS {
        // One set a message, because a recording holds each message's schema by itself.
        let set = protox::Compiler::new([FOLDER])?
            .include_source_info(false)
            .open_file(format!("{schema}.proto"))?
            .encode_file_descriptor_set();
        fs::write(out.join(format!("{schema}.bin")), set)?;
    }
    let files = SCHEMAS.map(|schema| format!("{schema}.proto"));
    prost_build::Config::new().compile_fds(protox::compile(files, [FOLDER])?)?;
    Ok(())
}
