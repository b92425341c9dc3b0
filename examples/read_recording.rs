//! Prints the velocities of a recording: `cargo run --release --example read_recording -- shot.mcap`
#![allow(clippy::print_stdout, reason = "an example that prints")]

use ricochet::recording::Recording;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: read_recording FILE.mcap")?;
    for sample in Recording::open(path.as_ref())?.velocities()? {
        let sample = sample?;
        if let Some(velocity) = sample.velocity {
            let spin = velocity.omega_rad_s.map_or_else(|| "-".into(), |omega| omega.to_string());
            println!("{} {} {} {spin}", sample.frame, velocity.vn_m_s, velocity.vt_m_s);
        }
    }
    Ok(())
}
