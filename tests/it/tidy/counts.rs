//! Counts that show whether the house is getting simpler.

use super::blank::{blank, production_lines, without_tests};
use super::functions::functions;
use super::graph::Graph;
use super::prose::{docs, room_of, unclear};
use super::{root, sources};
use std::collections::BTreeMap;

/// Openings of function docs that are counted, although a few of them are allowed.
const CLAUSES: &[&str] = &["What", "How", "By", "Of", "Which", "Where", "From which", "As", "When", "If"];

/// A column of `velocity` that no other row has.
const COLUMN: &str = "sigma_omega_rad_s";

/// Rooms that read single columns, which a further column does not touch.
const READERS: &[&str] = &["report", "trigger", "impact", "synth", "study", "plot"];

const HEADINGS: [&str; 8] = ["lines", "functions", "packed", "bools", "circles", "clauses", "prose", "column"];

/// Counts of one room, in the order of [`HEADINGS`].
type Row = [usize; HEADINGS.len()];

/// Prints a table of counts, a room a line:
/// `cargo test --release --test it tidy::counts -- --ignored --nocapture`.
///
/// - `lines`: code lines of production, without docs, comments, blanks, tests and generated bindings
/// - `functions`, and of those `packed`: with a parameter that is taken apart by a tuple or array pattern or has a tuple
///   as its type; `bools`: with a `bool` parameter
/// - `circles`: circles of imports within a room
/// - `clauses`: docs of functions that open with a clause or stump
/// - `prose`: breaches of the language guide that the tidy test finds
/// - `column`: files that name one column of `velocity`, readers of single columns left out
#[test]
#[ignore = "prints counts"]
fn counts() {
    let mut rows: BTreeMap<String, Row> = BTreeMap::new();
    let sources = sources();
    let graph = Graph::new(&sources);
    let production: Vec<&str> = graph.paths().chain(["src/lib.rs", "src/main.rs"]).collect();
    for (path, text) in &sources {
        let Some(room) = room_of(path) else { continue };
        let row = rows.entry(room.to_string()).or_default();
        row[6] += unclear(path, text).len();
        let is_schema = path.starts_with("src/") && path.ends_with(".proto");
        let is_production = production.contains(&path.as_str()) && !path.ends_with("/sys.rs");
        if is_production {
            let code = without_tests(&blank(text));
            let functions = functions(&code);
            row[0] += production_lines(text);
            row[1] += functions.len();
            row[2] += functions.iter().filter(|function| function.packs_parameters()).count();
            row[3] += functions.iter().filter(|function| function.takes_bool()).count();
            row[5] += docs(text).iter().filter(|doc| doc.is_function && doc.opening(CLAUSES).is_some()).count();
        }
        let is_reader = READERS.contains(&room) || path.contains("/study/");
        let named = if is_schema { text.contains(COLUMN) } else { without_tests(text).contains(COLUMN) };
        row[7] += usize::from((is_schema || is_production) && !is_reader && named);
    }
    for circle in graph.circles() {
        rows.entry(room_of(circle[0]).unwrap().to_string()).or_default()[4] += 1;
    }
    let total = rows.values().fold(Row::default(), |sum, row| std::array::from_fn(|i| sum[i] + row[i]));
    println!("{:<16}{}", root().file_name().unwrap().display(), HEADINGS.map(|name| format!("{name:>10}")).concat());
    for (room, row) in rows.iter().map(|(room, row)| (room.as_str(), row)).chain([("total", &total)]) {
        println!("{room:<16}{}", row.map(|count| format!("{count:>10}")).concat());
    }
}
