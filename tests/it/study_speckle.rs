//! `ricochet study translation` to `peak`: tables, figures, resumption and refusals.

use crate::support::{Background, Rig, ricochet, run, succeed, wait_until};
use serde_json::Value;
use std::path::Path;

/// Three films of one pattern, which are quick to measure.
const SMALL: [&str; 6] = ["study", "rotation", "--patterns", "e-II", "--speeds", "off-grid"];

/// The result files of a study, without measured times.
fn files(directory: &Path, study: &str) -> Vec<(String, Vec<u8>)> {
    let read = |ending: &str| {
        let name = format!("{study}{ending}");
        let bytes = std::fs::read(directory.join(&name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        (name, bytes)
    };
    ["_films.csv", ".csv", ".svg", "_settings.json"].map(read).into()
}

fn into<'a>(line: &[&'a str], directory: &'a Path) -> Vec<&'a str> {
    line.iter().copied().chain(["-o", directory.to_str().unwrap()]).collect()
}

fn table(path: &Path) -> (Vec<String>, Vec<csv::StringRecord>) {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let head = reader.headers().unwrap().iter().map(str::to_owned).collect();
    (head, reader.records().map(Result::unwrap).collect())
}

/// The number in the named column of a row.
fn number(head: &[String], row: &csv::StringRecord, name: &str) -> Option<f64> {
    let cell = &row[head.iter().position(|column| column == name).unwrap_or_else(|| panic!("no column {name}"))];
    (!cell.is_empty()).then(|| cell.parse().unwrap())
}

#[test]
fn the_whole_surface_gives_the_rotation_within_0_003_deg() {
    let rig = Rig::new();
    let directory = rig.path("made/studies");
    let report: Value = serde_json::from_str(&succeed(into(&SMALL, &directory).into_iter().chain(["--json"]))).unwrap();
    let (head, rows) = table(&directory.join("rotation_films.csv"));
    assert_eq!(
        head.join(","),
        "pattern,speeds,case,film,frame,method,vx_px_frame,vy_px_frame,omega_deg_frame,dx_px,dy_px,dtheta_deg,\
         sigma_dx_px,sigma_dy_px,sigma_dtheta_deg,points,status"
    );
    assert_eq!(rows.len(), 3 * 2 * 4, "three films of two pairs of frames, four methods");
    for row in &rows {
        let error = |measured: &str, truth: &str| {
            (number(&head, row, measured).unwrap() - number(&head, row, truth).unwrap()).abs()
        };
        let px = error("dx_px", "vx_px_frame").max(error("dy_px", "vy_px_frame"));
        let deg = error("dtheta_deg", "omega_deg_frame");
        // A field on a grid of 5 points is known to 1/12 px, and a rotation across 30 px of it to 0.16 deg.
        let (max_px, max_deg) = match &row[5] {
            "rigid" => (0.004, 0.005),
            "ic-gn" => (0.006, 0.01),
            _ => (0.09, 0.16),
        };
        assert!(px < max_px && deg < max_deg, "{row:?}");
        assert_eq!(&row[16], "valid");
        assert_eq!(number(&head, row, "sigma_dx_px").is_some(), ["rigid", "ic-gn"].contains(&&row[5]), "{row:?}");
    }
    let (head, lines) = table(&directory.join("rotation.csv"));
    assert_eq!(lines.len(), 4);
    let rigid = lines.iter().find(|line| &line[3] == "rigid").unwrap();
    assert_eq!(number(&head, rigid, "pairs"), Some(6.0));
    let (px, deg) = (number(&head, rigid, "mean_x_px").unwrap(), number(&head, rigid, "mean_deg").unwrap());
    assert!(px < 0.002 && deg < 0.003, "{px} px, {deg} deg");
    assert_eq!((&report["study"], &report["films"]), (&Value::from("rotation"), &Value::from(3)));
    let best = report["best"].as_array().unwrap();
    assert_eq!(best.len(), 4 * 2, "each method has a best pattern for motion and for rotation");
    assert!(best.iter().any(|b| b["method"] == "rigid" && b["of"] == "deg_frame" && b["mean"] == deg), "{best:?}");
    let figure = std::fs::read_to_string(directory.join("rotation.svg")).unwrap();
    assert!(figure.starts_with("<svg ") && figure.trim_end().ends_with("</svg>") && !figure.contains("href"));
    for words in
        ["Fig. 5", "e-II; 3 films of 3 frames", "noise 2 of 255", "Windows of 25 px, 12 px apart", ">eII</text>"]
    {
        assert!(figure.contains(words), "{words}");
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let rig = Rig::new();
    let line = ["study", "translation", "--patterns", "a-II", "--speeds", "paper", "--methods", "ic-gn,rigid"];
    let made = |name: &str, threads: &str| {
        let directory = rig.path(name);
        succeed(into(&line, &directory).into_iter().chain(["--threads", threads]));
        files(&directory, "translation")
    };
    let one = made("one", "1");
    assert!(String::from_utf8_lossy(&one[0].1).lines().count() == 1 + 11 * 2 * 2);
    assert!(one == made("five", "5"));
}

#[test]
fn an_interrupted_study_resumes_and_gives_the_same_bytes() {
    let rig = Rig::new();
    let whole = rig.path("whole");
    let line: Vec<&str> = SMALL.into_iter().chain(["--methods", "ic-gn,rigid"]).collect();
    succeed(into(&line, &whole));
    let wanted = files(&whole, "rotation");
    let rows = String::from_utf8(wanted[0].1.clone()).unwrap();
    let end_of_line = |number: usize| rows.match_indices('\n').nth(number).unwrap().0 + 1;
    // Within the header, after it, within the second film, within a row, at the end of a film.
    for length in [0, 20, end_of_line(0), end_of_line(6), end_of_line(6) + 30, end_of_line(4), end_of_line(12)] {
        let part = rig.path(&format!("part-{length}"));
        std::fs::create_dir(&part).unwrap();
        std::fs::copy(whole.join("rotation_settings.json"), part.join("rotation_settings.json")).unwrap();
        std::fs::write(part.join("rotation_films.csv"), &rows.as_bytes()[..length]).unwrap();
        succeed(into(&line, &part));
        assert!(files(&part, "rotation") == wanted, "cut after {length} bytes");
    }
    // Existing rows are not measured again: a number changed by hand stays.
    let changed = rows.replacen(",valid\n", ",lost\n", 1);
    std::fs::write(whole.join("rotation_films.csv"), &changed).unwrap();
    succeed(into(&line, &whole));
    assert_eq!(std::fs::read_to_string(whole.join("rotation_films.csv")).unwrap(), changed);
}

#[test]
fn an_interrupted_study_names_what_is_missing_and_the_same_command_finishes_it() {
    let rig = Rig::new();
    let line =
        ["study", "translation", "--patterns", "e-I", "--methods", "paper-fit", "--step", "20", "--threads", "1"];
    let (whole, part) = (rig.path("whole"), rig.path("part"));
    let study = Background::start(ricochet(into(&line, &part)));
    let films = part.join("translation_films.csv");
    wait_until("a film is written", || std::fs::metadata(&films).ok().filter(|file| file.len() > 300));
    study.signal(2);
    let (code, printed, stderr) = study.end();
    assert_eq!(code, None, "a signal ends it: {stderr}");
    assert!(printed.is_empty() && stderr.contains("repeat the command to resume"), "{printed}{stderr}");
    assert!(!part.join("translation.svg").exists(), "no figure of half a study");
    succeed(into(&line, &part));
    succeed(into(&line, &whole));
    assert!(files(&part, "translation") == files(&whole, "translation"));
}

#[test]
fn a_table_of_another_study_is_neither_resumed_nor_changed() {
    let rig = Rig::new();
    let directory = rig.path("");
    let quick: Vec<&str> = SMALL.into_iter().chain(["--methods", "ic-gn"]).collect();
    succeed(into(&quick, &directory));
    let films = directory.join("rotation_films.csv");
    let before = std::fs::read(&films).unwrap();
    let refused = |more: &[&str], wanted: &str| {
        let output = run(into(&quick, &directory).iter().chain(more));
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.lines().count() == 1 && stderr.contains(wanted), "{stderr}");
    };
    refused(&["--noise-dn", "3"], "rotation_settings.json: noise_dn is 2.0 there, 3.0 now; choose another directory");
    refused(&["--seed", "2"], "seed is 1 there, 2 now");
    refused(&["--frames", "4"], "frames is 3 there, 4 now");
    let methods = run(into(&SMALL, &directory).iter().chain(&["--methods", "ic-gn,rigid"]));
    let stderr = String::from_utf8(methods.stderr).unwrap();
    assert!(
        methods.status.code() == Some(2) && stderr.contains("methods is [\"ic-gn\"] there, [\"ic-gn\",\"rigid\"] now"),
        "{stderr}"
    );
    assert_eq!(std::fs::read(&films).unwrap(), before);
    // Half a table whose last film has other numbers than this program measures.
    let text = String::from_utf8(before.clone()).unwrap();
    let ends: Vec<usize> = text.match_indices('\n').map(|(at, _)| at + 1).collect();
    let half = text[..ends[2]].replacen(",valid\n", ",lost\n", 2);
    std::fs::write(&films, &half).unwrap();
    refused(&[], "rotation_films.csv: film 1 was measured differently by another version; choose another directory");
    assert_eq!(std::fs::read_to_string(&films).unwrap(), half);
    // A row that is not in the plan.
    let changed = String::from_utf8(before).unwrap().replacen("off-grid,spin,2,", "off-grid,spin,1,", 1);
    std::fs::write(&films, &changed).unwrap();
    refused(&[], "rotation_films.csv: line 4 is not a row of this study");
    assert_eq!(std::fs::read_to_string(&films).unwrap(), changed);
    std::fs::remove_file(directory.join("rotation_settings.json")).unwrap();
    refused(&[], "rotation_films.csv: cannot read its settings");
}

#[test]
fn the_peak_study_gives_the_error_at_every_speed_and_the_cost_of_a_window() {
    let rig = Rig::new();
    let directory = rig.path("peak");
    let line = ["study", "peak", "--frames", "2", "--step", "40", "--speeds", "off-grid"];
    let more = ["--methods", "peak-plain,peak-spline", "--json"];
    let printed = succeed(into(&line, &directory).into_iter().chain(more));
    let report: Value = serde_json::from_str(&printed).unwrap();
    let (head, rows) = table(&directory.join("peak.csv"));
    assert_eq!(rows.len(), 20 * 2);
    let mean = |method: &str| {
        let of = rows.iter().filter(|row| &row[1] == method).map(|row| number(&head, row, "mean_x_px").unwrap());
        of.sum::<f64>() / 20.0
    };
    let (plain, normalised) = (mean("peak-plain"), mean("peak-spline"));
    println!("peak without overlap normalization {plain:.4} px, with it {normalised:.4} px");
    // Without division by the overlap, peaks are biased to zero. Half a grid step of 1/6 px adds 0.083 px.
    assert!(plain > 0.05 && normalised < 0.02, "{plain} {normalised}");
    let (head, costs) = table(&directory.join("peak_time.csv"));
    assert_eq!(head, ["method", "us_per_window"]);
    assert!(costs.len() == 2 && costs.iter().all(|cost| cost[1].parse::<f64>().unwrap() > 0.0));
    assert_eq!(report["speeds"].as_array().unwrap().len(), 40);
    let figure = std::fs::read_to_string(directory.join("peak.svg")).unwrap();
    assert!(figure.contains("Fig. 7") && figure.contains("us a window") && !figure.contains("NaN"));
}

#[test]
fn the_error_grows_with_noise_and_every_level_is_present() {
    let rig = Rig::new();
    let directory = rig.path("noise");
    let line = ["study", "noise", "--frames", "2", "--methods", "ic-gn,rigid"];
    succeed(into(&line, &directory));
    let (head, rows) = table(&directory.join("noise.csv"));
    assert_eq!(rows.len(), 6 * 2);
    assert_eq!(&head[..3], ["noise_dn", "method", "pairs"]);
    let mean = |noise_dn: f64, method: &str| {
        let of = |row: &&csv::StringRecord| number(&head, row, "noise_dn") == Some(noise_dn) && &row[1] == method;
        let row = rows.iter().find(of).unwrap();
        assert_eq!(number(&head, row, "pairs"), Some(8.0));
        0.5 * (number(&head, row, "mean_x_px").unwrap() + number(&head, row, "mean_y_px").unwrap())
    };
    for method in ["ic-gn", "rigid"] {
        println!("{method}: {:.5} px without noise, {:.5} at 16 levels", mean(0.0, method), mean(16.0, method));
        assert!(mean(16.0, method) > 2.0 * mean(2.0, method) && mean(0.0, method) < mean(2.0, method), "{method}");
    }
    assert!(mean(2.0, "rigid") < 0.002, "{}", mean(2.0, "rigid"));
    let (head, films) = table(&directory.join("noise_films.csv"));
    assert!(head.contains(&"noise_dn".to_owned()) && !head.contains(&"blur_px".to_owned()));
    assert_eq!(films.len(), 6 * 8 * 2);
    // This study resumes like the others.
    let whole = files(&directory, "noise");
    std::fs::write(directory.join("noise_films.csv"), &whole[0].1[..whole[0].1.len() / 2]).unwrap();
    succeed(into(&line, &directory));
    assert!(files(&directory, "noise") == whole);
}

#[test]
fn wrong_options_are_refused_in_one_line_with_value_and_allowed_range() {
    let rig = Rig::new();
    let help = succeed(["study", "general", "--help"]);
    assert!(help.contains("Example: ricochet study general "), "{help}");
    let refused = |code: i32, more: &[&str], wanted: &str| {
        let output = run(["study", "general"].iter().chain(more));
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{stderr}");
        assert!(stderr.lines().count() == 1 && stderr.contains(wanted), "{stderr}");
        assert!(output.stdout.is_empty());
    };
    refused(2, &["--patterns", "g-I"], "--patterns \"g-I\": allowed are a-I, a-II, a-III, b-I");
    refused(2, &["--patterns", "e-I,e-I"], "--patterns \"e-I\": given twice");
    refused(2, &["--methods", "hough"], "--methods \"hough\": allowed are paper, paper-fit, peak-spline");
    refused(2, &["--speeds", "fast"], "--speeds \"fast\": allowed are paper, off-grid");
    refused(2, &["--frames", "1"], "--frames 1: must be 2 to 12");
    refused(2, &["--noise-dn", "nan"], "--noise-dn NaN: must be 0 to 64");
    refused(2, &["--noise-dn=-1"], "--noise-dn -1: must be 0 to 64");
    refused(2, &["--subset", "24"], "subset_size_px is 24");
    refused(2, &["--step", "0"], "step_px is 0");
    refused(
        2,
        &["--subset", "81"],
        "--subset 81 --step 12: 0 windows fit into a ball of 114 px, more than 3 are needed",
    );
    refused(2, &["--threads", "0"], "--threads");
    let swept = |arguments: &[&str], wanted: &str| {
        let output = run(["study"].iter().chain(arguments));
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && stderr.contains(wanted), "{stderr}");
    };
    swept(&["noise", "--noise-dn", "2"], "--noise-dn 2: not allowed, study noise has its own levels");
    swept(&["rate", "--speeds", "paper"], "--speeds: not allowed, study rate has its own speeds");
    let file = rig.file("is-a-file", "");
    refused(2, &["-o", file.to_str().unwrap()], "is-a-file: is a file, expected a directory");
    refused(5, &["-o", "/dev/null/studies"], "/dev/null/studies");
}

#[test]
fn the_page_on_studies_shows_small_figures_that_exist() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let page = std::fs::read_to_string(docs.join("studies.md")).unwrap();
    let mut shown = 0;
    for figure in page.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(name, _)| name) {
        let svg = std::fs::read_to_string(docs.join(figure)).unwrap_or_else(|error| panic!("{figure}: {error}"));
        assert!(svg.starts_with("<svg ") && svg.len() < 60_000, "{figure}: {} bytes", svg.len());
        shown += 1;
    }
    assert!(shown >= 5, "{shown} figures");
}

#[test]
fn the_ring_is_a_method_of_the_studies() {
    let rig = Rig::new();
    let directory = rig.path("ring");
    let line = [&SMALL[..], &["--methods", "ring"]].concat();
    succeed(into(&line, &directory));
    let (head, rows) = table(&directory.join("rotation_films.csv"));
    assert_eq!(rows.len(), 3 * 2);
    for row in &rows {
        let of = |name: &str| number(&head, row, name).unwrap();
        let error_deg = (of("dtheta_deg") - of("omega_deg_frame")).abs();
        assert!(error_deg < 0.01 && of("sigma_dtheta_deg") < 0.005, "{row:?}");
    }
}
