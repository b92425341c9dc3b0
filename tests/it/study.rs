//! `ricochet study convergence`: its table, its verdict, and what it refuses.

use crate::support::{Rig, run, succeed};
use serde_json::Value;

/// The study of the drawn pattern, coarse enough to be quick.
fn drawn(rig: &Rig) -> (Value, Vec<Vec<String>>) {
    let output = rig.path("settle.csv");
    let told = succeed(["study", "convergence", "--step", "26", "--json", "-o", output.to_str().unwrap()]);
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_path(output).unwrap();
    let table = reader.records().map(|row| row.unwrap().iter().map(str::to_owned).collect()).collect();
    (serde_json::from_str(&told).unwrap(), table)
}

#[test]
fn the_peak_fit_settles_within_three_thousandths_of_the_truth_and_the_bare_grid_does_not_settle() {
    let (study, table) = drawn(&Rig::new());
    let rows = study["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 19, "ic-gn, and nine numbers of points with and without the fit");
    assert_eq!(table.len(), rows.len() + 1);
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
    // The method's note has 0.0013 to 0.0017 px of mean error with a fit.
    assert!(number(fitted, "bias_px") < 0.003 && number(fitted, "rms_px") < 0.006, "{fitted}");
    // Half a grid step of 1/21 px is the most, spread evenly it is 0.0137 px rms.
    assert!(number(bare, "rms_px") > 0.01 && number(bare, "max_px") < 0.0239 + 0.01, "{bare}");
    assert!(number(row(0, true), "bias_px") > number(fitted, "bias_px"), "more points help");
    for row in rows {
        let (valid, subsets) = (row["valid"].as_u64().unwrap(), row["subsets"].as_u64().unwrap());
        // Neighbours on different points of a coarse grid may take each other for outliers.
        let least = if row["peak_fit"] == false { subsets * 9 / 10 } else { subsets };
        assert!((least..=subsets).contains(&valid), "{row}");
        assert!(number(row, "time_s") > 0.0);
    }
    assert_eq!(number(row(1, true), "compared"), number(fitted, "subsets"));
    assert_eq!(row(0, true)["compared"], Value::Null, "nothing comes before the first");
}

#[test]
fn two_files_are_studied_beside_their_ic_gn_displacement() {
    let rig = Rig::new();
    let (reference, target) = crate::field::write_pair(rig.path("").as_path(), (2, -1));
    let files = [reference.to_str().unwrap(), target.to_str().unwrap()];
    let line = |rest: &[&'static str]| {
        let start = ["study", "convergence"].map(str::to_owned).into_iter().chain(files.map(str::to_owned));
        start.chain(rest.iter().map(|word| (*word).to_owned())).collect::<Vec<_>>()
    };
    let told = succeed(line(&["--subset", "21", "--roi", "8,8,76,60"]));
    let verdict = told.lines().find(|line| line.starts_with("with the peak fit: ")).unwrap();
    assert!(verdict.contains("settled at"), "{verdict}");
    assert!(verdict.contains("ic-gn: mean u 2.00") && verdict.contains("v -1.00"), "{verdict}");
    let study: Value = serde_json::from_str(&succeed(line(&["--subset", "21", "--json"]))).unwrap();
    for row in study["rows"].as_array().unwrap().iter().filter(|row| row["method"] == "spline-fft") {
        let (u, v) = (row["mean_u_px"].as_f64().unwrap(), row["mean_v_px"].as_f64().unwrap());
        assert!((u - 2.0).abs() < 0.01 && (v + 1.0).abs() < 0.01, "{row}");
        assert_eq!(row["rms_px"], Value::Null, "the truth of files is not known");
    }
}

#[test]
fn what_cannot_be_studied_is_one_line() {
    let rig = Rig::new();
    let (reference, target) = crate::field::write_pair(rig.path("").as_path(), (0, 0));
    let (reference, target) = (reference.to_str().unwrap(), target.to_str().unwrap());
    let help = succeed(["study", "convergence", "--help"]);
    assert!(help.contains("Example: ricochet study convergence "), "{help}");
    let refused = |code: i32, arguments: &[&str], wanted: &str| {
        let output = run(["study", "convergence"].iter().chain(arguments));
        let told = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{told}");
        assert!(told.lines().count() == 1 && told.contains(wanted), "{told}");
        assert!(output.stdout.is_empty());
    };
    refused(2, &[reference], "<TARGET>");
    refused(2, &["--roi", "0,0,50,50"], "REFERENCE");
    refused(2, &["--tolerance-px", "nan"], "--tolerance-px NaN: more than 0, at most 1");
    refused(2, &["--subset", "30"], "subset_size_px is 30");
    refused(2, &["--subset", "107"], "--subset 107: has no room");
    refused(2, &[reference, target, "--roi", "90,0,40,40"], "not within");
    refused(2, &[reference, target, "-o", target], "would be overwritten");
    refused(5, &["missing.png", target], "missing.png");
    refused(5, &["-o", "missing/settle.csv"], "write missing/settle.csv");
}
