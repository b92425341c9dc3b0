//! Patches in public footage with reference solutions: a filmed clockwork, and a part that turns in steps.
//!
//! `RICOCHET_REAL_DATA` names the folder that holds it in `dice-mechanism` and `dice-rotation20`.

use crate::support::ricochet;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

type Row = BTreeMap<String, String>;
type Polygon = Vec<[f64; 2]>;

/// The points of the reference solution in the first frame, px.
const POINTS_PX: [[f64; 2]; 3] = [[344.0, 212.0], [259.0, 405.0], [266.0, 41.0]];
/// The rms differences allowed from the reference solution: px and deg.
const ALLOWED: [[f64; 2]; 3] = [[0.03, 0.10], [0.05, 0.15], [0.03, 0.10]];
const ROTATING: [[[f64; 2]; 4]; 3] = [
    [[72.0, 28.0], [108.0, 17.0], [125.0, 73.0], [94.0, 83.0]],
    [[48.0, 195.0], [84.0, 152.0], [106.0, 171.0], [71.0, 218.0]],
    [[174.0, 146.0], [178.0, 118.0], [238.0, 127.0], [226.0, 159.0]],
];

fn folder(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("RICOCHET_REAL_DATA").map(|data| PathBuf::from(data).join(name));
    if folder.is_none() {
        println!("left out: RICOCHET_REAL_DATA names no directory of real recordings");
    }
    folder
}

fn table(text: &str) -> Vec<Row> {
    let mut lines = text.lines().filter(|line| !line.starts_with('*') && !line.trim().is_empty());
    let cells = |line: &str| line.split(',').map(|cell| cell.trim().to_string()).collect::<Vec<_>>();
    let names = cells(lines.next().unwrap());
    lines.map(|line| names.iter().cloned().zip(cells(line)).collect()).collect()
}

fn number(row: &Row, name: &str) -> Option<f64> {
    row[name].parse().ok()
}

/// Reads the polygons of a subset file.
fn polygons(text: &str) -> Vec<Polygon> {
    let parts = text.split("begin vertices").skip(1);
    let inside = parts.map(|part| part.split("end").next().unwrap());
    let corner = |line: &str| -> Option<[f64; 2]> {
        let mut words = line.split_whitespace().map(str::parse);
        Some([words.next()?.ok()?, words.next()?.ok()?])
    };
    inside.map(|part| part.lines().filter_map(corner).collect()).collect()
}

/// Returns the track of patches through the images of a folder with this stem.
fn track(folder: &Path, stem: &str, bodies: &[(Polygon, Option<[f64; 2]>)]) -> Vec<Row> {
    let scratch = tempfile::tempdir().unwrap();
    let [rig, results] = ["rig.toml", "results.mcap"].map(|name| scratch.path().join(name));
    let mut text = "[rig]\nname = \"footage\"\n[scale]\nmm_per_px = 0.1\n".to_string();
    for (k, (polygon, center)) in bodies.iter().enumerate() {
        write!(text, "[[body]]\nname = \"p{k}\"\nkind = \"patch\"\npolygon_px = {polygon:?}\n").unwrap();
        center.iter().for_each(|center| writeln!(text, "center_px = {center:?}").unwrap());
    }
    std::fs::write(&rig, text).unwrap();
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut images: Vec<PathBuf> = files
        .filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(stem)))
        .filter(|path| path.extension().is_some_and(|extension| extension == "tif"))
        .collect();
    images.sort();
    let mut command = ricochet(["analyze", "--fps", "1000", "--config", rig.to_str().unwrap()]);
    let done = command.args(&images).args(["-o", results.to_str().unwrap()]).output().unwrap();
    println!("{}", String::from_utf8_lossy(&done.stderr));
    let exported = ricochet(["export", results.to_str().unwrap(), "--topic", "track"]).output().unwrap();
    table(&String::from_utf8(exported.stdout).unwrap())
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|error| error * error).sum::<f64>() / errors.len().max(1) as f64).sqrt()
}

#[test]
fn three_parts_of_a_clockwork_are_followed_through_all_frames() {
    let Some(folder) = folder("dice-mechanism") else { return };
    let polygons = polygons(&std::fs::read_to_string(folder.join("subset_defs.txt")).unwrap());
    let bodies: Vec<_> = polygons.into_iter().zip(POINTS_PX.map(Some)).collect();
    let rows = track(&folder, "mechanism", &bodies);
    for (part, [x_px, y_px]) in POINTS_PX.into_iter().enumerate() {
        let exact = std::fs::read_to_string(folder.join(format!("gold/DICe_solution_{part}.txt"))).unwrap();
        let body = format!("p{part}");
        let (mut apart, mut turned) = (Vec::new(), Vec::new());
        for (row, exact) in rows.iter().filter(|row| row["body"] == body).zip(table(&exact)) {
            let of = |name: &str| number(row, name).unwrap_or_else(|| panic!("{body}: no {name} in {row:?}"));
            let exact = |name: &str| number(&exact, name).unwrap();
            apart.push(of("center_x_px") - x_px - exact("DISPLACEMENT_X"));
            apart.push(of("center_y_px") - y_px - exact("DISPLACEMENT_Y"));
            // The reference turns clockwise, in rad.
            turned.push(of("angle_deg") + exact("ROTATION_Z").to_degrees());
        }
        let (px, deg) = (rms(&apart), rms(&turned));
        println!("part {part}: {} frames, {px:.4} px rms, {deg:.3} deg rms", turned.len());
        assert!(turned.len() == 56 && px <= ALLOWED[part][0] && deg <= ALLOWED[part][1], "part {part}: {px} {deg}");
    }
}

#[test]
fn a_part_that_turns_by_20_deg_per_frame_keeps_its_angle() {
    let Some(folder) = folder("dice-rotation20") else { return };
    let bodies: Vec<_> = ROTATING.iter().map(|polygon| (polygon.to_vec(), None)).collect();
    let rows = track(&folder, "CG", &bodies);
    for row in &rows {
        let angle = number(row, "angle_deg").unwrap_or_else(|| panic!("no angle in {row:?}"));
        let error = (angle - 20.0 * number(row, "frame").unwrap() + 180.0).rem_euclid(360.0) - 180.0;
        assert!(error.abs() <= 0.02, "{error} deg in {row:?}");
    }
    assert_eq!(rows.len(), 57);
}
