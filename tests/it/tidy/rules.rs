//! The rules, each over one file.

use super::blank::{blank, without_tests};
use super::paths::{follows_a_path, line, paths_from, uses, words};
use super::table::{
    DIMENSIONLESS, DIMENSIONLESS_ENDINGS, IMPURE, LINES_MAX, MACHINE_FOLDERS, MAIN_CRATES, OUTSIDE, ROOMS, Room,
    SINGLE_NAMES, UNIT_ROOMS, UNITS, UNSAFE_FILE, UNSAFE_ROOMS,
};
use std::fmt;

/// One broken rule.
pub struct Finding {
    /// The path of the file from the root of the project.
    pub file: String,
    /// The line, from 1.
    pub line: usize,
    /// The rule, as a sentence about this line.
    pub rule: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.line, self.rule)
    }
}

/// Every rule that the text of a file breaks, in the order of the lines.
pub fn findings(file: &str, text: &str) -> Vec<Finding> {
    let mut broken = machine_paths(text);
    if file.ends_with(".rs") {
        broken.extend(length(file, text));
    }
    if let Some(inside) = file.strip_prefix("src/").filter(|_| file.ends_with(".rs")) {
        broken.extend(source_rules(inside, text));
    }
    broken.sort();
    broken.dedup();
    broken.into_iter().map(|(line, rule)| Finding { file: file.into(), line, rule }).collect()
}

type Broken = Vec<(usize, String)>;

fn source_rules(inside: &str, text: &str) -> Broken {
    let code = without_tests(&blank(text));
    let room_name = inside.split(['/', '.']).next().unwrap_or_default();
    let is_test = inside.ends_with("/tests.rs") || inside.contains("/tests/");
    let mut broken = Vec::new();
    if !UNSAFE_ROOMS.contains(&room_name) && inside != UNSAFE_FILE.trim_start_matches("src/") {
        broken
            .extend(words(&code, "unsafe").map(|at| (line(&code, at), "unsafe belongs in camera and bus only".into())));
    }
    if is_test {
        return broken;
    }
    if UNIT_ROOMS.contains(&room_name) {
        broken.extend(units(&code));
    }
    match ROOMS.iter().find(|room| room.name == room_name) {
        Some(room) => broken.extend(room_rules(room, inside, &code)),
        None if inside == "main.rs" => broken.extend(crates("main", MAIN_CRATES, &code)),
        None if inside == "lib.rs" => broken.extend(crates("lib", &[], &code)),
        None => broken.push((1, format!("{room_name} is not a room of the table"))),
    }
    broken
}

fn room_rules(room: &Room, inside: &str, code: &str) -> Broken {
    let mut broken = crates(room.name, room.crates, code);
    let is_room = |name: &str| ROOMS.iter().any(|other| other.name == name);
    for (at, name) in rooms_named(inside, code) {
        if is_room(&name) && name != room.name && !room.rooms.contains(&name.as_str()) {
            broken.push((line(code, at), format!("{} may not name {name}", room.name)));
        }
    }
    if room.pure {
        for (at, path) in paths_from(code, "std") {
            if let Some(what) = IMPURE.iter().find(|what| path == **what || path.starts_with(&format!("{what}::"))) {
                broken.push((line(code, at), format!("{} is pure and may not name {what}", room.name)));
            }
        }
    }
    broken
}

/// The first names after the root of the crate, however the root is reached.
fn rooms_named(inside: &str, code: &str) -> Vec<(usize, String)> {
    let parts = inside.split('/').count();
    let depth = if inside.ends_with("/mod.rs") { parts - 1 } else { parts };
    let climb = vec!["super"; depth].join("::");
    ["crate", "ricochet", climb.as_str()]
        .iter()
        .flat_map(|root| paths_from(code, root).into_iter().map(|(at, path)| (at, path[root.len() + 2..].to_string())))
        .map(|(at, path)| (at, path.split("::").next().unwrap_or_default().to_string()))
        .collect()
}

fn crates(room: &str, allowed: &[&str], code: &str) -> Broken {
    let (uses, rest) = uses(code);
    let forbidden = |name: &str| OUTSIDE.contains(&name) && !allowed.contains(&name) && !is_module_here(code, name);
    let mut broken = Vec::new();
    for import in uses {
        let name = import.path.split("::").next().unwrap_or_default();
        let single = SINGLE_NAMES.contains(&(room, import.path.as_str()));
        if forbidden(name) && !single {
            broken.push((line(code, import.at), format!("{room} may not name the crate {name}")));
        }
    }
    for name in OUTSIDE.iter().filter(|name| forbidden(name)) {
        for at in words(&rest, name) {
            let is_path = rest[at + name.len()..].trim_start().starts_with("::");
            if is_path && !follows_a_path(&rest, at) {
                broken.push((line(code, at), format!("{room} may not name the crate {name}")));
            }
        }
    }
    broken
}

/// Whether the file brings a module of our own with this name into scope.
fn is_module_here(code: &str, name: &str) -> bool {
    let imported = |root: &str| {
        let paths = paths_from(code, root);
        paths.iter().any(|(_, path)| path.ends_with(&format!("::{name}")) || path.ends_with(&format!("::{name}::self")))
    };
    code.contains(&format!("mod {name};")) || imported("crate") || imported("super")
}

fn units(code: &str) -> Broken {
    let mut broken = Vec::new();
    for at in words(code, "pub") {
        let rest = code[at + 3..].trim_start();
        let rest =
            if rest.starts_with('(') { rest.split_once(')').map_or("", |(_, rest)| rest).trim_start() } else { rest };
        let Some((name, kind)) = rest.split_once(':') else { continue };
        let name = name.trim();
        let is_field =
            !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || c == '_') && !kind.starts_with(':');
        let kind = kind.split([',', '}', '\n']).next().unwrap_or_default();
        let known =
            DIMENSIONLESS.contains(&name) || UNITS.iter().chain(DIMENSIONLESS_ENDINGS).any(|end| name.ends_with(end));
        if is_field && is_number(kind) && !known {
            broken.push((line(code, at), format!("the number {name} does not end in its unit")));
        }
    }
    broken
}

fn is_number(kind: &str) -> bool {
    const NUMBERS: [&str; 12] = ["f32", "f64", "u8", "u16", "u32", "u64", "usize", "i8", "i16", "i32", "i64", "isize"];
    // The length of an array is no number of the field.
    let element = kind.split(';').next().unwrap_or_default();
    element.split(|c: char| !c.is_alphanumeric()).any(|word| NUMBERS.contains(&word))
}

fn length(file: &str, text: &str) -> Broken {
    let lines = text.lines().count();
    let generated = file.ends_with("/sys.rs");
    if lines > LINES_MAX && !generated { vec![(lines, format!("longer than {LINES_MAX} lines"))] } else { Vec::new() }
}

fn machine_paths(text: &str) -> Broken {
    let mut broken = Vec::new();
    for folder in MACHINE_FOLDERS {
        let path = format!("/{folder}/");
        for (at, _) in text.match_indices(&path) {
            let is_start = !text[..at].ends_with(|c: char| c.is_alphanumeric() || "._-/*~{}$)".contains(c));
            if is_start {
                broken.push((line(text, at), format!("{path} is a path of one machine")));
            }
        }
    }
    broken
}
