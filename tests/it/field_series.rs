//! `ricochet field` with several targets: a series of images, each measured from the first.

use crate::rotation_search::{farthest, rows, write_frames};
use crate::support::{Rig, run, succeed};
use ricochet::results::PointStatus;
use std::path::{Path, PathBuf};

const SETTINGS: [&str; 6] = ["--roi", "43,63,83,83", "--subset", "25", "--step", "8"];

/// The arguments of `ricochet field` with these images and settings.
fn line(images: &[PathBuf], rest: &[&str]) -> Vec<String> {
    let images = images.iter().map(|path| path.to_str().unwrap());
    let words = std::iter::once("field").chain(images).chain(SETTINGS).chain(rest.iter().copied());
    words.map(str::to_owned).collect()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn a_ball_is_followed_over_20_deg_from_the_first_image() {
    let rig = Rig::new();
    let (shift_px, angle_deg) = ([6.3, -1.7], 2.3);
    let frames = write_frames(&rig, shift_px, angle_deg, 10);
    let (tables, pictures) = (rig.path("new/tables"), rig.path("pictures"));
    let output = run(line(&frames, &["-o", text(&tables), "--picture", text(&pictures)]));
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && output.stdout.is_empty(), "{stderr}");
    let lines: Vec<&str> = stderr.lines().collect();
    assert_eq!(lines.len(), 9, "one line per target: {stderr}");
    let mut renewed = Vec::new();
    for (index, line) in lines.iter().enumerate() {
        let k = index + 1;
        let name = format!("{}: ", frames[k].display());
        assert!(line.starts_with(&name) && line.contains("subsets valid, mean u "), "{line}");
        if line.ends_with("; reference updated") {
            renewed.push(k);
        }
        let field = rows(&tables.join(format!("field_{k:04}.csv")));
        assert!(field.len() >= 49, "{} windows", field.len());
        assert!(field.iter().all(|point| point.status == PointStatus::Valid), "picture {k}");
        let off = farthest(&field, shift_px.map(|step| step * k as f64), angle_deg * k as f64);
        println!("picture {k}: farthest window {off:.4} px");
        // Windows of 25 px scatter by some 0.005 px. A renewal in whole pixels would be off by up to 0.7 px.
        assert!(off < 0.04, "picture {k}: {off} px");
        let picture = image::open(pictures.join(format!("field_{k:04}.png"))).unwrap();
        assert_eq!((picture.width(), picture.height()), (320, 240));
    }
    // A reference is kept at 2.3 deg and renewed at 4.6 deg.
    assert_eq!(renewed, [2, 4, 6, 8]);
    assert_eq!(std::fs::read_dir(&tables).unwrap().count(), 9);
    // Alone against the first image, the last is not found.
    let alone = rig.path("alone.csv");
    succeed(line(&[frames[0].clone(), frames[9].clone()], &["-o", text(&alone)]));
    let valid = rows(&alone).iter().filter(|point| point.status == PointStatus::Valid).count();
    assert!(valid * 10 < rows(&alone).len(), "the images between are needed: {valid}");
}

#[test]
fn windows_that_left_the_image_are_lost_and_have_no_numbers() {
    let rig = Rig::new();
    let (shift_px, angle_deg) = ([-14.3, 0.6], 3.4);
    let frames = write_frames(&rig, shift_px, angle_deg, 6);
    let tables = rig.path("tables");
    succeed(line(&frames, &["-o", text(&tables)]));
    let (mut before, mut sum) = (0, 0);
    for k in 1..=5_u32 {
        let field = rows(&tables.join(format!("field_{k:04}.csv")));
        let lost: Vec<_> = field.iter().filter(|point| point.status == PointStatus::Lost).collect();
        assert!(lost.iter().all(|point| point.displacement.is_none() && point.zncc.is_none()), "picture {k}");
        assert!(lost.len() >= before, "what is lost stays lost");
        let off = farthest(&field, shift_px.map(|step| step * f64::from(k)), angle_deg * f64::from(k));
        println!("picture {k}: {} of {} lost, farthest {off:.4} px", lost.len(), field.len());
        assert!(off < 0.05, "picture {k}: {off} px");
        (before, sum) = (lost.len(), field.iter().filter(|point| point.status == PointStatus::Valid).count());
    }
    assert!(before >= 7 && sum >= 14, "{before} lost, {sum} left");
    let table = std::fs::read_to_string(tables.join("field_0005.csv")).unwrap();
    let lost = table.lines().find(|line| line.ends_with(",lost")).unwrap();
    assert!(lost.ends_with(",,,,,,,lost"), "{lost}");
}

#[test]
fn on_standard_output_every_row_begins_with_its_target() {
    let rig = Rig::new();
    let frames = write_frames(&rig, [1.3, 0.4], 0.5, 3);
    let tables = rig.path("tables");
    succeed(line(&frames, &["-o", text(&tables)]));
    let named = |path: &Path| {
        let table = std::fs::read_to_string(path).unwrap();
        table.lines().skip(1).map(str::to_owned).collect::<Vec<_>>()
    };
    let fields = [1, 2].map(|k| named(&tables.join(format!("field_{k:04}.csv"))));
    let table = succeed(line(&frames, &[]));
    let mut all = vec!["target,x_px,y_px,u_px,v_px,sigma_u_px,sigma_v_px,zncc,peak_ratio,status".to_owned()];
    for (field, target) in fields.iter().zip(&frames[1..]) {
        all.extend(field.iter().map(|row| format!("{},{row}", target.display())));
    }
    assert_eq!(table.lines().collect::<Vec<_>>(), all);
    let json = succeed(line(&frames, &["--json"]));
    assert_eq!(json.lines().count(), fields[0].len() + fields[1].len());
    for (row, at) in json.lines().zip(&all[1..]) {
        let target = at.split(',').next().unwrap();
        assert!(row.starts_with(&format!("{{\"target\":\"{target}\",\"x_px\":")), "{row}");
    }
    // Files hold one field each, with the same rows as for one target, and without a target key.
    succeed(line(&frames, &["--json", "-o", text(&tables)]));
    let lines = std::fs::read_to_string(tables.join("field_0002.jsonl")).unwrap();
    assert_eq!(lines.lines().count(), fields[1].len());
    assert!(lines.lines().all(|row| row.starts_with("{\"x_px\":")));
    let one = succeed(line(&frames[..2], &["--json"]));
    assert!(one.lines().all(|row| row.starts_with("{\"x_px\":")) && one.lines().count() == fields[0].len());
    assert!(succeed(line(&frames[..2], &[])).starts_with("x_px,y_px,"));
}

#[test]
fn each_map_of_a_series_has_its_own_legend() {
    let rig = Rig::new();
    let frames = write_frames(&rig, [1.3, 0.4], 0.0, 3);
    let folder = rig.path("maps");
    let output = run(line(&frames, &["-o", text(&folder), "--picture", text(&folder), "--map", "u"]));
    let stderr = String::from_utf8(output.stderr).unwrap();
    let starts: Vec<f64> = stderr
        .lines()
        .map(|line| line.split_once("; map of u from ").unwrap().1.split(' ').next().unwrap().parse().unwrap())
        .collect();
    assert!((starts[0] - 1.3).abs() < 0.03 && (starts[1] - 2.6).abs() < 0.03, "{stderr}");
    let height = |k: u32| image::open(folder.join(format!("field_{k:04}.png"))).unwrap().height();
    assert!(height(1) > 240 && height(2) > 240, "the bar comes below");
}

#[test]
fn an_impossible_series_is_refused_in_one_line() {
    let rig = Rig::new();
    let frames = write_frames(&rig, [1.3, 0.4], 0.0, 4);
    let refused = |code: i32, images: &[PathBuf], rest: &[&str], wanted: &str| {
        let output = run(line(images, rest));
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{stderr}");
        assert!(stderr.lines().count() == 1 && stderr.contains(wanted), "{stderr}");
        assert!(output.stdout.is_empty());
    };
    let small = rig.path("small.png");
    image::GrayImage::new(200, 240).save(&small).unwrap();
    let tables = rig.path("tables");
    let mut images = frames.clone();
    images[3] = small;
    refused(2, &images, &["-o", text(&tables)], "small.png is 200 x 240 px: both images need the same size");
    images[3] = rig.path("missing.png");
    refused(5, &images, &["-o", text(&tables)], "missing.png");
    images[3] = rig.file("notes.txt", "not a picture");
    refused(5, &images, &["-o", text(&tables)], "notes.txt: not a readable BMP, PNG, TIFF or PGM image");
    assert!(!tables.exists(), "nothing is made before all images are looked at");
    refused(2, &frames, &["--start", "any-angle"], "--start any-angle: not allowed with several targets");
    refused(2, &frames, &["--start", "search"], "--start search: not allowed with several targets");
    for method in ["spline-fft", "peak-gaussian", "peak-spline"] {
        let wanted =
            format!("several targets: needs subsets that can rotate, but the method is {method}; allowed: ic-gn");
        refused(2, &frames, &["--method", method], &wanted);
    }
    refused(
        2,
        &frames,
        &["--shape", "translation"],
        "several targets: needs subsets that can rotate, but the shape is translation",
    );
    let file = rig.file("field.csv", "earlier");
    for option in ["-o", "--picture"] {
        refused(2, &frames, &[option, text(&file)], "field.csv: is a file, expected a directory");
    }
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "earlier");
    let input = rig.path("field_0002.png");
    std::fs::copy(&frames[1], &input).unwrap();
    images[3] = input.clone();
    refused(
        2,
        &images,
        &["--picture", text(&rig.path(""))],
        "field_0002.png: cannot write: it would overwrite an input",
    );
    assert_eq!(std::fs::read(input).unwrap(), std::fs::read(&frames[1]).unwrap());
    succeed(line(&frames, &["-o", text(&tables)]));
    refused(2, &frames[..3], &["-o", text(&tables)], "field_0003.csv: cannot write next to it");
}
