//! The page of a shot, and the page on the repeatability of several.

use crate::browser;
use crate::recording::samples;
use crate::support::{Rig, run, succeed};
use ricochet::image::{Frame, PixelFormat};
use ricochet::recording::{Recording, RecordingInfo, RecordingWriter, WriterOptions};
use ricochet::report::{self, Shot};
use ricochet::results::{Estimate, Impact, PointStatus};
use std::path::{Path, PathBuf};

const SIZE_MAX: usize = 3 << 20;

/// The sequence number of the first frame of a synthetic recording, which is 0 in its tables.
const FIRST: u64 = 5000;

/// The addresses that the page requests. Images inside the page are no requests.
fn requests(page: &str) -> Vec<&str> {
    let mut found: Vec<&str> = Vec::new();
    for key in ["src=\"", "href=\"", "url(", "@import", "srcset=", "http://", "https://", "<script", "<link", "<iframe"]
    {
        let after = page.match_indices(key).map(|(at, _)| &page[at..(at + 60).min(page.len())]);
        found.extend(after.filter(|text| !text.starts_with("href=\"data:image/png;base64,")));
    }
    found
}

/// Measures a shot of the simulated ball.
fn measured(rig: &Rig) -> PathBuf {
    let (film, measured) = (rig.path("film.mcap"), rig.path("measured.mcap"));
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/lacrosse.toml");
    succeed(["simulate".as_ref(), "lacrosse".as_ref(), "-o".as_ref(), film.as_os_str()]);
    let arguments = ["analyze".as_ref(), film.as_os_str(), "--config".as_ref(), config.as_os_str()];
    succeed(arguments.into_iter().chain(["-o".as_ref(), measured.as_os_str()]));
    measured
}

#[test]
fn the_page_of_a_shot_holds_its_numbers_and_requests_nothing() {
    let rig = Rig::new();
    let (shot, page) = (measured(&rig), rig.path("page.html"));
    let printed = succeed(["report".as_ref(), shot.as_os_str(), "-o".as_ref(), page.as_os_str()]);
    assert_eq!(printed.trim(), page.to_str().unwrap());
    let html = std::fs::read_to_string(&page).unwrap();
    assert_eq!(requests(&html), [""; 0]);
    assert!(html.len() < SIZE_MAX, "{} bytes", html.len());
    let recording = Recording::open(&shot).unwrap();
    let impact = report::last_revisions(recording.impacts().unwrap().map(Result::unwrap).collect())[0];
    let restitution = impact.restitution.unwrap();
    // Two digits of an uncertainty of some 1e-4 are five decimals.
    assert!((1e-4..1e-3).contains(&restitution.sigma), "{restitution:?}");
    assert!(html.contains(&format!("<td>{:.5}</td><td>{:.5}</td>", restitution.value, restitution.sigma)));
    for word in ["vn_before_m_s", "NaN", "inf<"] {
        assert!(!html.contains(word), "{word} is on the page");
    }
    assert!(html.matches("class=\"chart\"").count() == 6, "six curves");
    let Some(shown) = browser::show(&page, ".chart, figure svg, table:not(details *)") else { return };
    assert_eq!((shown.requests.len(), shown.console.len()), (0, 0), "{:?} {:?}", shown.requests, shown.console);
    let [width_px, height_px] = shown.content_px;
    assert!(width_px <= f64::from(browser::SIZE_PX[0]), "{width_px} px wide: something sticks out");
    assert!((1500.0..f64::from(browser::SIZE_PX[1])).contains(&height_px), "{height_px} px high");
    let seen: Vec<[f64; 4]> = shown.boxes.iter().copied().filter(|[_, _, width, _]| *width > 0.0).collect();
    assert!(seen.len() >= 6 + 3 + 4, "curves, pictures, tables: {:?}", shown.boxes);
    for place in seen {
        let (colours, part) = shown.drawn(place);
        assert!(colours >= 8 && part > 0.02, "{place:?}: {colours} colours, {part} of it drawn");
    }
    let margin = [0.0, 0.0, 20.0, height_px];
    assert_eq!(shown.drawn(margin), (1, 0.0), "the margin is blank");
}

#[test]
fn exported_results_show_the_frames_of_their_own_film_only() {
    let rig = Rig::new();
    let (shot, page) = (measured(&rig), rig.path("page.html"));
    let film = rig.path("film.mcap");
    let report = |film: &Path| {
        let arguments = ["report".as_ref(), "--force".as_ref(), shot.as_os_str(), "--film".as_ref(), film.as_os_str()];
        run(arguments.into_iter().chain(["-o".as_ref(), page.as_os_str()]))
    };
    let pictures = || std::fs::read_to_string(&page).unwrap().matches("data:image/png").count();
    succeed(["report".as_ref(), shot.as_os_str(), "-o".as_ref(), page.as_os_str()]);
    assert_eq!(pictures(), 0, "results alone hold none");
    assert!(report(&film).status.success());
    assert_eq!(pictures(), 3, "start, deepest, end");

    let other = rig.path("other.mcap");
    synthetic(&other, 100, 0.8, None);
    std::fs::remove_file(&page).unwrap();
    let before = rig.path("before.mcap");
    let mut writer = RecordingWriter::create(&before, &RecordingInfo::default(), &WriterOptions::default()).unwrap();
    for frame in Recording::open(&film).unwrap().frames().unwrap() {
        let (mut meta, bytes) = frame.unwrap();
        meta.stamp_ns -= 1;
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
    }
    writer.finish().unwrap();
    let output = report(&before);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(5), "{stderr}");
    assert!(stderr.contains("this is another film") && stderr.contains("before.mcap"), "{stderr}");
    assert!(!page.exists());
    let arguments = ["report".as_ref(), shot.as_os_str(), other.as_os_str(), "--film".as_ref(), film.as_os_str()];
    assert_eq!(run(arguments).status.code(), Some(2));
}

#[test]
fn a_page_with_requests_or_errors_is_noticed() {
    let rig = Rig::new();
    let text = "<img src=\"http://example.invalid/x.png\"><script>console.error(\"oops\")</script>";
    let page = rig.file("bad.html", &format!("<html><body>{text}</body></html>"));
    let Some(shown) = browser::show(&page, "img") else { return };
    assert_eq!(shown.requests, ["http://example.invalid/x.png"]);
    assert!(shown.console.len() == 1 && shown.console[0].contains("oops"), "{:?}", shown.console);
    assert_eq!(shown.boxes.len(), 1);
}

/// Writes a recording of `frames` frames of 128 x 96 px with one collision of this restitution.
fn synthetic(path: &Path, frames: u64, restitution: f64, skip: Option<u64>) {
    let info = RecordingInfo { config_toml: "[rig]\nname = \"<test>\"\n".into(), ..samples::info() };
    let mut writer = RecordingWriter::create(path, &info, &WriterOptions::default()).unwrap();
    for number in (0..frames).filter(|number| Some(*number) != skip) {
        let sequence = FIRST + number;
        let (meta, bytes) = samples::frame(sequence, PixelFormat::Mono8, [128, 96], 0);
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
        let mut row = samples::velocity(0, 0);
        (row.frame, row.stamp_ns) = (sequence, meta.stamp_ns);
        (row.center_x_px, row.center_y_px, row.radius_px) = (Some(64.0), Some(48.0), Some(40.0));
        if let Some(velocity) = &mut row.velocity {
            let t = number as f64 * 0.01;
            (velocity.vn_m_s, velocity.vt_m_s, velocity.omega_rad_s) = (t.sin(), t.cos(), Some(10.0 * t.sin()));
            (velocity.sigma_v_m_s, velocity.sigma_omega_rad_s) = (0.01, Some(0.1));
        }
        row.status = if number % 50 == 7 { PointStatus::Occluded } else { PointStatus::Valid };
        writer.write_velocity(&row).unwrap();
        writer.write_field(&samples::field(sequence)).unwrap();
    }
    let known = |value: f64, sigma: f64| Some(Estimate { value, sigma });
    writer
        .write_impact(&Impact {
            start_s: known(0.0101, 1e-6),
            deepest_s: known(0.0203, 1e-6),
            end_s: known(0.0305, 1e-6),
            restitution: known(restitution, 0.001),
            status: PointStatus::Valid,
            ..Impact::unknown(0, 0, samples::START_NS + FIRST * 100_000)
        })
        .unwrap();
    writer.finish().unwrap();
}

fn page_of(paths: &[PathBuf]) -> String {
    let shots: Vec<Shot> = paths.iter().map(|path| Shot::read(&Recording::open(path).unwrap()).unwrap()).collect();
    report::page(&shots)
}

#[test]
fn a_thousand_noisy_frames_make_a_page_under_3_mb_that_reports_the_losses() {
    let rig = Rig::new();
    let path = rig.path("long.mcap");
    synthetic(&path, 1000, 0.8, Some(500));
    let html = page_of(&[path]);
    assert!(html.len() < SIZE_MAX, "{} bytes", html.len());
    assert!(html.contains("1 frame was lost."), "the loss is reported at the top");
    assert!(html.contains("<td>occluded</td><td>20</td>") && html.contains("<td>valid</td><td>979</td>"));
    assert_eq!(html.matches("data:image/png").count(), 3, "start, deepest, end");
    assert!(html.contains("frame 101,") && html.contains("frame 203,") && html.contains("frame 305,"));
    assert!(html.contains("name = &quot;&lt;test&gt;&quot;"), "what is written in a file is text, not markup");
    assert_eq!(requests(&html), [""; 0]);
    // The lost frame splits every curve in two.
    assert_eq!(html.matches("<path class=\"line a\"").count(), 2 * 6);
}

#[test]
fn the_page_of_a_recording_without_frames_reports_that() {
    let rig = Rig::new();
    let path = rig.path("results.mcap");
    let mut writer = RecordingWriter::create(&path, &samples::info(), &WriterOptions::default()).unwrap();
    writer.write_velocity(&samples::velocity(100, 0)).unwrap();
    writer.write_impact(&samples::impact(0, 0)).unwrap();
    writer.finish().unwrap();
    let html = page_of(&[path]);
    assert!(html.contains("results only, no raw frames") && html.contains("this recording holds no raw frames"));
}

#[test]
fn several_recordings_give_mean_spread_and_the_outlier_by_its_number() {
    let rig = Rig::new();
    let values = [0.800, 0.802, 0.798, 0.801, 0.799, 0.900];
    let paths: Vec<PathBuf> = (0..values.len()).map(|k| rig.path(&format!("shot-{k}.mcap"))).collect();
    for (path, value) in paths.iter().zip(values) {
        synthetic(path, 40, value, None);
    }
    let page = rig.path("page.html");
    let arguments = ["report".as_ref(), "-o".as_ref(), page.as_os_str()];
    succeed(arguments.into_iter().chain(paths.iter().map(|path| path.as_os_str())));
    let html = std::fs::read_to_string(&page).unwrap();
    // Without the sixth: mean 0.8, standard deviation sqrt(1e-5 / 4) = 0.00158.
    let row = "<td>0.8000</td><td>0.0016</td><td></td><td>0.0010</td><td>5 of 6</td>";
    assert!(html.contains(row), "{}", &html[html.find("restitution").unwrap()..][..300]);
    assert!(html.contains("text-anchor=\"end\">6</text>"), "the outlier is shot 6");
    assert!(!html.contains("NaN"));
    assert_eq!(requests(&html), [""; 0]);
}

#[test]
fn a_page_never_overwrites_a_recording() {
    let rig = Rig::new();
    let path = rig.path("shot.mcap");
    synthetic(&path, 2, 0.8, None);
    let before = std::fs::read(&path).unwrap();
    let output = run(["report".as_ref(), path.as_os_str(), "-o".as_ref(), path.as_os_str()]);
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(std::fs::read(&path).unwrap(), before);
    let other = rig.path("other.mcap");
    synthetic(&other, 3, 0.8, None);
    let before = std::fs::read(&other).unwrap();
    let output = run(["report".as_ref(), path.as_os_str(), "-o".as_ref(), other.as_os_str()]);
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(std::fs::read(&other).unwrap(), before, "nor another one");
    let output = run(["report".as_ref(), rig.path("missing.mcap").as_os_str()]);
    assert_eq!(output.status.code(), Some(5));
}
