//! `diagnose` shows why a film could not be measured, and what to change.

use crate::support::{Rig, run, succeed};
use serde_json::Value;
use std::path::{Path, PathBuf};

fn film(rig: &Rig) -> PathBuf {
    let (scenario, film) = (rig.file("drift.toml", &crate::pipeline::drift(24, 1000.0)), rig.path("film.mcap"));
    succeed(["simulate".as_ref(), scenario.as_os_str(), "-o".as_ref(), film.as_os_str()]);
    film
}

fn word(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn diagnose(rig: &Rig, film: &Path, text: &str) -> Value {
    let (config, page) = (rig.file("rig.toml", text), rig.path("page.html"));
    let words = ["diagnose", word(film), "--config", word(&config), "-o", word(&page), "--json", "--force"];
    serde_json::from_str(&succeed(words)).unwrap()
}

#[test]
fn a_ball_outside_of_the_searched_radii_is_shown_with_the_radius_to_set() {
    let rig = Rig::new();
    let film = film(&rig);
    let printed = diagnose(&rig, &film, "[scale]\nmm_per_px = 0.5\n[[body]]\nmin_radius_px = 7\nmax_radius_px = 9\n");
    let body = &printed["bodies"][0];
    assert!(body["line"].as_str().unwrap().starts_with("ball: 0 of 24 frames measured"), "{printed}");
    let change = body["changes"][0]["lines"].as_str().unwrap();
    let numbers: Vec<f64> = change.lines().map(|line| line.split(" = ").nth(1).unwrap().parse().unwrap()).collect();
    assert!(change.starts_with("min_radius_px = ") && numbers[0] < 36.0 && numbers[1] > 36.0, "{change}");
    let findings = body["frames"][0]["findings"].to_string();
    assert!(findings.contains("Searched: a ball of 7.0 to 9.0 px radius in the whole image."), "{findings}");
    assert!(findings.contains("Outside of these limits: an outline of radius 36"), "{findings}");
    // The proposed change must make the film measurable.
    let text = format!("[scale]\nmm_per_px = 0.5\n[[body]]\n{change}\n");
    let printed = diagnose(&rig, &film, &text);
    assert_eq!(printed["bodies"][0]["line"], "ball: 24 of 24 frames measured");
    assert_eq!(printed["bodies"][0]["changes"], serde_json::json!([]));
}

#[test]
fn a_ball_outside_of_the_searched_region_is_shown_with_the_region_to_set() {
    let rig = Rig::new();
    let film = film(&rig);
    let printed = diagnose(&rig, &film, "[[body]]\nmin_radius_px = 30\nroi_px = [110, 0, 50, 144]\n");
    let change = printed["bodies"][0]["changes"][0].clone();
    assert!(change["lines"].as_str().unwrap().starts_with("roi_px = "), "{change}");
    assert!(change["reason"].as_str().unwrap().contains("outside of the searched region"), "{change}");
}

#[test]
fn the_page_and_its_pictures_are_written_into_a_folder_and_nothing_is_left_behind() {
    let rig = Rig::new();
    let film = film(&rig);
    let (config, folder) = (rig.file("rig.toml", "[[body]]\nmax_radius_px = 9\n"), rig.path("why"));
    succeed(["diagnose", word(&film), "--config", word(&config), "-o", word(&folder)]);
    let mut names: Vec<String> =
        std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert!(names.contains(&"index.html".into()) && names.contains(&"ball_frame_000000.png".into()), "{names:?}");
    assert!(names.contains(&"movement.png".into()) && !names.iter().any(|name| name.ends_with(".mcap")), "{names:?}");
    let page = std::fs::read_to_string(folder.join("index.html")).unwrap();
    assert!(page.contains("data:image/png;base64,") && !page.contains("src=\"http"));
    let again = run(["diagnose", word(&film), "--config", word(&config), "-o", word(&folder)]);
    let stderr = String::from_utf8(again.stderr).unwrap();
    assert!(again.status.code() == Some(2) && stderr.contains("pass --force"), "{stderr}");
}

#[test]
fn without_a_rig_file_it_shows_what_moves() {
    let rig = Rig::new();
    let drawn = film(&rig);
    let page = rig.path("moves.html");
    // Images of a sequence carry no rig file.
    let images: Vec<PathBuf> = crate::support::frames(&drawn)
        .iter()
        .enumerate()
        .map(|(number, (meta, bytes))| {
            let path = rig.path(&format!("image-{number:03}.png"));
            image::save_buffer(&path, bytes, meta.width_px, meta.height_px, image::ColorType::L8).unwrap();
            path
        })
        .collect();
    let mut words = vec!["diagnose"];
    words.extend(images.iter().map(|path| word(path)));
    words.extend(["--fps", "500", "-o", word(&page), "--json"]);
    let printed: Value = serde_json::from_str(&succeed(words)).unwrap();
    assert_eq!(printed["bodies"], serde_json::json!([]));
    assert!(printed["movers"][0].as_str().unwrap().contains("a ball of radius 36."), "{printed}");
}
