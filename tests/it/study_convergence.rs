//! `ricochet study convergence`: its table, its verdict, and its refusals.

use crate::support::{Rig, run, succeed};
use serde_json::Value;

/// Runs the study of the drawn pattern, coarse enough to be quick, and returns report, table and figure.
fn drawn(rig: &Rig) -> (Value, Vec<Vec<String>>, String) {
    let output = rig.path("made/settle");
    let printed = succeed(["study", "convergence", "--step", "26", "--json", "-o", output.to_str().unwrap()]);
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_path(output.join("convergence.csv")).unwrap();
    let table = reader.records().map(|row| row.unwrap().iter().map(str::to_owned).collect()).collect();
    let figure = std::fs::read_to_string(output.join("convergence.svg")).unwrap();
    (serde_json::from_str(&printed).unwrap(), table, figure)
}

/// The positions of marks of one kind, left to right.
fn marks(figure: &str, start: &str, names: [&str; 2]) -> Vec<[f64; 2]> {
    let number = |tag: &str, name: &str| {
        let from = tag.split_once(&format!(" {name}=\"")).unwrap().1;
        from.split_once('"').unwrap().0.parse::<f64>().unwrap()
    };
    figure.split('<').filter(|tag| tag.starts_with(start)).map(|tag| names.map(|name| number(tag, name))).collect()
}

/// Checks two curves in two panels, with a mark for every number of points. The first panel has none at 0 points.
fn figure_shows(figure: &str, rows: &[Value]) {
    assert!(figure.starts_with("<svg ") && figure.trim_end().ends_with("</svg>"));
    assert!(!figure.contains("href") && !figure.contains("url("), "it needs nothing else");
    for text in ["with the peak fit", "without it", "tolerance 0.001 px", "ic-gn", "rms error, px", ">20</text>"] {
        assert!(figure.contains(text), "{text}");
    }
    let discs = marks(figure, "circle class=\"mark\"", ["cx", "cy"]);
    let squares = marks(figure, "rect class=\"mark\"", ["x", "y"]);
    // One mark of each kind is in the legend of a panel.
    assert_eq!((discs.len(), squares.len()), (8 + 9 + 2, 8 + 9 + 2));
    let errors = |fit: bool| {
        let rows = rows.iter().filter(move |row| row["peak_fit"] == fit);
        rows.map(|row| row["rms_px"].as_f64().unwrap().log10()).collect::<Vec<_>>()
    };
    // The axes are logarithmic: equal distances are equal ratios, the same for both curves.
    let drawn = |marks: &[[f64; 2]]| marks[marks.len() - 9..].iter().map(|at| at[1]).collect::<Vec<_>>();
    let (y, logs) = (drawn(&discs), errors(true));
    let (bare_y, bare_logs) = (drawn(&squares), errors(false));
    // The scale is taken from the curve with the larger span, because positions are written to 0.1.
    let per_decade = (bare_y[0] - bare_y[8]) / (bare_logs[0] - bare_logs[8]);
    assert!(per_decade < -20.0, "more error is higher: {per_decade} px a decade");
    let places = y.iter().copied().chain(bare_y.iter().map(|y| y + 3.5));
    for (y, log) in places.zip(logs.iter().chain(&bare_logs)) {
        let expected = bare_y[0] + 3.5 + per_decade * (log - bare_logs[0]);
        assert!((y - expected).abs() < 0.4, "{y} px for 10^{log}, not {expected}");
    }
}

#[test]
fn the_peak_fit_converges_within_0_003_px_and_the_bare_grid_does_not() {
    let (study, table, figure) = drawn(&Rig::new());
    let rows = study["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 19, "ic-gn, and nine numbers of points with and without the fit");
    assert_eq!(table.len(), rows.len() + 1);
    figure_shows(&figure, rows);
    let row = |points: u64, fit: bool| {
        let found = rows.iter().find(|row| row["spline_points"] == points && row["peak_fit"] == fit);
        found.unwrap_or_else(|| panic!("no row for {points} points"))
    };
    let number = |row: &Value, name: &str| row[name].as_f64().unwrap_or_else(|| panic!("{name}: {row}"));
    let settled = study["settled_points"].as_u64().expect("it settles");
    println!("settled at {settled}: {}", row(settled, true));
    assert!((1..=7).contains(&settled), "{settled}");
    assert_eq!(study["settled_points_without_peak_fit"], Value::Null);
    let (fitted, bare) = (row(settled, true), row(20, false));
    // The paper gives a mean error of 0.0013 to 0.0017 px with a fit.
    assert!(number(fitted, "bias_px") < 0.003 && number(fitted, "rms_px") < 0.006, "{fitted}");
    // At most half a grid step of 1/21 px. A uniform error is 0.0137 px rms.
    assert!(number(bare, "rms_px") > 0.01 && number(bare, "max_px") < 0.0239 + 0.01, "{bare}");
    assert!(number(row(0, true), "bias_px") > number(fitted, "bias_px"), "more points help");
    for row in rows {
        let (valid, subsets) = (row["valid"].as_u64().unwrap(), row["subsets"].as_u64().unwrap());
        // On a coarse grid, neighbours on different points may be rejected as outliers of each other.
        let fewest = if row["peak_fit"] == false { subsets * 9 / 10 } else { subsets };
        assert!((fewest..=subsets).contains(&valid), "{row}");
        assert!(number(row, "time_s") > 0.0);
    }
    assert_eq!(number(row(1, true), "compared"), number(fitted, "subsets"));
    assert_eq!(row(0, true)["compared"], Value::Null, "nothing comes before the first");
}

#[test]
fn two_files_are_studied_against_their_ic_gn_displacement() {
    let rig = Rig::new();
    let (reference, target) = crate::field::write_pair(rig.path("").as_path(), (2, -1));
    let files = [reference.to_str().unwrap(), target.to_str().unwrap()];
    let line = |rest: &[&'static str]| {
        let start = ["study", "convergence"].map(str::to_owned).into_iter().chain(files.map(str::to_owned));
        start.chain(rest.iter().map(|word| (*word).to_owned())).collect::<Vec<_>>()
    };
    let printed = succeed(line(&["--subset", "21", "--roi", "8,8,76,60"]));
    let verdict = printed.lines().find(|line| line.starts_with("with the peak fit: ")).unwrap();
    assert!(verdict.contains("converged at"), "{verdict}");
    assert!(verdict.contains("ic-gn: mean u 2.00") && verdict.contains("v -1.00"), "{verdict}");
    let study: Value = serde_json::from_str(&succeed(line(&["--subset", "21", "--json"]))).unwrap();
    for row in study["rows"].as_array().unwrap().iter().filter(|row| row["method"] == "spline-fft") {
        let (u, v) = (row["mean_u_px"].as_f64().unwrap(), row["mean_v_px"].as_f64().unwrap());
        assert!((u - 2.0).abs() < 0.01 && (v + 1.0).abs() < 0.01, "{row}");
        assert_eq!(row["rms_px"], Value::Null, "the truth of files is not known");
    }
    // An earlier table in the directory is replaced on request only.
    let output = rig.path("settle");
    std::fs::create_dir(&output).unwrap();
    std::fs::write(output.join("convergence.csv"), "earlier\n".repeat(10_000)).unwrap();
    let into =
        |options: &[&'static str]| line(options).into_iter().chain(["-o".into(), output.to_str().unwrap().to_owned()]);
    let refused = run(into(&["--subset", "21"]));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--force"), "{refused:?}");
    let printed = succeed(into(&["--subset", "21", "--force"]));
    assert!(printed.contains("with the peak fit: converged"), "{printed}");
    let table = std::fs::read_to_string(output.join("convergence.csv")).unwrap();
    assert!(table.starts_with("method,") && !table.contains("earlier"));
    let figure = std::fs::read_to_string(output.join("convergence.svg")).unwrap();
    assert!(figure.contains("reference.png to ") && figure.contains("target.bmp"), "the figure names its images");
    assert!(!figure.contains("rms error"), "one panel where the truth is not known");
    // Every displacement of the bare grid is the same whole number: no change, which is a mark at 0 and no line.
    assert_eq!(marks(&figure, "rect class=\"mark\"", ["x", "y"]).len(), 8 + 1);
    assert!(figure.contains(">0</text>"));
}

#[test]
fn impossible_studies_are_refused_in_one_line() {
    let rig = Rig::new();
    let (reference, target) = crate::field::write_pair(rig.path("").as_path(), (0, 0));
    let (reference, target) = (reference.to_str().unwrap(), target.to_str().unwrap());
    let help = succeed(["study", "convergence", "--help"]);
    assert!(help.contains("Example: ricochet study convergence "), "{help}");
    let refused = |code: i32, arguments: &[&str], wanted: &str| {
        let output = run(["study", "convergence"].iter().chain(arguments));
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{message}");
        assert!(message.lines().count() == 1 && message.contains(wanted), "{message}");
        assert!(output.stdout.is_empty());
    };
    refused(2, &[reference], "<TARGET>");
    refused(2, &["--roi", "0,0,50,50"], "REFERENCE");
    refused(2, &["--tolerance-px", "nan"], "--tolerance-px NaN: must be above 0 and at most 1");
    refused(2, &["--subset", "30"], "subset_size_px is 30");
    refused(2, &["--subset", "107"], "--subset 107: too large");
    refused(2, &[reference, target, "--roi", "90,0,40,40"], "exceeds");
    refused(2, &[reference, target, "-o", target], "target.bmp: is a file, expected a directory");
    let input = rig.path("convergence.csv");
    std::fs::copy(target, &input).unwrap();
    let folder = rig.path("").to_str().unwrap().to_owned();
    refused(2, &[reference, input.to_str().unwrap(), "-o", &folder], "it would overwrite");
    assert_eq!(std::fs::read(input).unwrap(), std::fs::read(target).unwrap());
    refused(5, &["missing.png", target], "missing.png");
    refused(5, &["-o", "/dev/null/settle"], "write /dev/null/settle");
}
