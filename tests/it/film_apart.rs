//! Results and the film they were measured in are different files: pictures and pages take the frames from the film.

use crate::support::{Rig, frames, run, succeed};
use std::path::PathBuf;

/// A film as images of a sequence, and the results of measuring it at 500 frames/s.
fn images_and_results(rig: &Rig) -> (Vec<PathBuf>, PathBuf) {
    let (scenario, film) = (rig.file("drift.toml", &crate::pipeline::drift(12, 1000.0)), rig.path("film.mcap"));
    succeed(["simulate".as_ref(), scenario.as_os_str(), "-o".as_ref(), film.as_os_str()]);
    let save = |(number, (meta, bytes)): (usize, &(ricochet::image::FrameMeta, Vec<u8>))| {
        let path = rig.path(&format!("image-{number:03}.png"));
        image::save_buffer(&path, bytes, meta.width_px, meta.height_px, image::ColorType::L8).unwrap();
        path
    };
    let images: Vec<PathBuf> = frames(&film).iter().enumerate().map(save).collect();
    let (config, results) = (rig.file("any.toml", "[scale]\nmm_per_px = 0.5\n"), rig.path("results.mcap"));
    let mut words = vec!["analyze".into()];
    words.extend(images.iter().map(|path| path.clone().into_os_string()));
    words.extend(["--fps", "500", "--config"].map(Into::into));
    words.extend([config.into_os_string(), "-o".into(), results.clone().into_os_string()]);
    succeed(words);
    (images, results)
}

fn words(first: &[&str], images: &[PathBuf], last: &[&str]) -> Vec<String> {
    let images = images.iter().map(|path| path.to_str().unwrap());
    first.iter().copied().chain(images).chain(last.iter().copied()).map(str::to_owned).collect()
}

#[test]
fn outlines_are_drawn_over_the_images_that_were_measured() {
    let rig = Rig::new();
    let (images, results) = images_and_results(&rig);
    let (results, folder) = (results.to_str().unwrap(), rig.path("tracked"));
    let target = ["--topic", "track", "--format", "png", "-o", folder.to_str().unwrap()];
    succeed(words(&["export", results, "--film"], &images, &target));
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 12);
    let drawn = image::open(folder.join("track_000003.png")).unwrap().to_rgb8();
    assert!(drawn.pixels().filter(|pixel| pixel.0 == [53, 224, 111]).count() > 500, "the outline");

    // Without the film there are no frames, and the message says what to do.
    let apart = run(["export", results, "--topic", "track", "--format", "png", "-o", folder.to_str().unwrap()]);
    let stderr = String::from_utf8(apart.stderr).unwrap();
    assert_eq!(apart.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("it has no frames; pass the film that it was measured in with --film"), "{stderr}");
    let table = run(["export", results, "--film", "film.avi", "--topic", "track", "--format", "csv"]);
    assert_eq!(table.status.code(), Some(2), "{table:?}");
}

#[test]
fn another_film_is_refused_by_the_stamps_of_its_frames() {
    let rig = Rig::new();
    let (_, results) = images_and_results(&rig);
    // The same frames, recorded at 1000 frames/s and started at another time.
    let film = rig.path("film.mcap");
    let shifted = rig.path("shifted.mcap");
    let info = ricochet::recording::RecordingInfo::default();
    let mut writer =
        ricochet::recording::RecordingWriter::create(&shifted, &info, &ricochet::recording::WriterOptions::default())
            .unwrap();
    for (mut meta, bytes) in frames(&film) {
        meta.stamp_ns += 5;
        writer.write_frame(&ricochet::image::Frame { meta, bytes: &bytes }).unwrap();
    }
    writer.finish().unwrap();
    let (results, folder) = (results.to_str().unwrap(), rig.path("other"));
    let target = ["--topic", "track", "--format", "png", "-o", folder.to_str().unwrap()];
    let refused = run(words(&["export", results, "--film"], &[shifted], &target));
    let stderr = String::from_utf8(refused.stderr).unwrap();
    assert!(refused.status.code() == Some(5) && stderr.contains("this is another film"), "{stderr}");
}

#[test]
fn the_page_shows_how_many_frames_were_measured() {
    let rig = Rig::new();
    let (images, results) = images_and_results(&rig);
    let page = rig.path("page.html");
    let target = ["-o", page.to_str().unwrap()];
    succeed(words(&["report", results.to_str().unwrap(), "--film"], &images, &target));
    let page = std::fs::read_to_string(page).unwrap();
    assert!(page.contains("ball: 12 of 12 frames measured.") && page.contains("160 × 144 px"), "{page}");
}
