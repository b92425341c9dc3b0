//! Recordings and the Python library `mcap`, in both directions.

use crate::support::{Rig, csv, frames, python, succeed};
use ricochet::recording::Recording;
use serde_json::Value;
use std::path::Path;

const RIG_FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/lacrosse.toml");

#[test]
fn python_reads_the_same_values_from_a_recording() {
    let rig = Rig::new();
    let scenario = rig.file("drift.toml", &crate::pipeline::drift(60, 1000.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = false", scenario.display());
    let config = rig.config(&camera, "[scale]\nmm_per_px = 0.5\n[workers]\ncount = 2");
    let printed = succeed(["run".as_ref(), config.as_os_str()]);
    let path = Path::new(printed.trim());
    let Some(text) = python(include_str!("python/read_results.py"), &[path]) else { return };
    let content: Value = serde_json::from_str(&text).unwrap();

    assert_eq!(content["config"], serde_json::json!([std::fs::read_to_string(&config).unwrap()]));
    let images = content["images"].as_array().unwrap();
    let ours = frames(path);
    assert_eq!((images.len(), ours.len()), (60, 60));
    for (image, (meta, pixels)) in images.iter().zip(&ours) {
        let crc = crc32fast::hash(pixels);
        let wanted = serde_json::json!([meta.stamp_ns, meta.width_px, meta.height_px, meta.stride_bytes, crc]);
        assert_eq!(*image, wanted, "frame {}", meta.sequence);
    }
    let measured = rows_are_those_of_the_table(&content["rows"], &csv(path, "velocity"));
    assert!(measured > 50, "only {measured} rows have a velocity");
}

/// Compares every number bit by bit and returns the number of rows with a velocity.
fn rows_are_those_of_the_table(rows: &Value, table: &str) -> usize {
    let mut reader = csv::Reader::from_reader(table.as_bytes());
    let header = reader.headers().unwrap().clone();
    let cells: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let rows = rows.as_array().unwrap();
    assert_eq!(rows.len(), cells.len());
    for (row, cells) in rows.iter().zip(&cells) {
        let cell = |column: &str| &cells[header.iter().position(|name| name == column).unwrap()];
        assert_eq!(cell("stamp_ns"), row["stamp_ns"].to_string());
        assert_eq!(cell("phase"), row["phase"]);
        assert_eq!(cell("status"), row["status"]);
        for (column, bits) in row["numbers"].as_object().unwrap() {
            let ours = cell(column).parse::<f64>().ok().map(|number| format!("{:016x}", number.to_bits()));
            assert_eq!(ours.as_deref(), bits.as_str(), "{column} of frame {}", cell("frame"));
        }
    }
    rows.iter().filter(|row| !row["numbers"]["vx_m_s"].is_null()).count()
}

#[test]
fn images_written_by_python_give_the_same_results() {
    let rig = Rig::new();
    let film = rig.path("film.mcap");
    succeed(["simulate".as_ref(), "lacrosse".as_ref(), "-o".as_ref(), film.as_os_str()]);
    let copy = rig.path("python.mcap");
    if python(include_str!("python/write_film.py"), &[&film, &copy]).is_none() {
        return;
    }
    let foreign = Recording::open(&copy).unwrap();
    assert!(!foreign.is_ours() && foreign.config_toml().is_none());
    assert_eq!(foreign.topics().len(), 1);
    let measure = |film: &Path, results: &Path| {
        let config = ["--config".as_ref(), RIG_FILE.as_ref(), "-o".as_ref(), results.as_os_str()];
        succeed(["analyze".as_ref(), film.as_os_str()].into_iter().chain(config));
        ["velocity", "field", "impact"].map(|topic| csv(results, topic))
    };
    let (ours, theirs) = (measure(&film, &rig.path("ours.mcap")), measure(&copy, &rig.path("theirs.mcap")));
    assert!(ours[0].lines().count() == 101 && ours[2].lines().count() == 2, "{}", ours[2]);
    assert!(theirs == ours, "the same images gave other numbers");
}
