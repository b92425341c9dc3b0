//! The regression gate: every number that the program writes equals its checksum in `tests/golden/equal.txt`.

use crate::support::is_required;
use std::path::Path;
use std::process::Command;

#[test]
fn every_table_of_every_film_is_unchanged_to_the_byte() {
    if Command::new("python3").arg("--version").output().is_err() {
        assert!(!is_required("PYTHON"), "python3 is required and not installed");
        eprintln!("left out: python3 is not installed");
        return;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/equal.sh");
    let output = Command::new(script).arg(env!("CARGO_BIN_EXE_ricochet")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
