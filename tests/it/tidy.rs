//! The tree stays as ARCHITECTURE.md draws it: who may name whom, how long a file may be, how numbers are called.

mod blank;
mod counts;
mod examples;
mod functions;
mod graph;
mod licences;
mod paths;
mod prose;
mod rules;
mod table;

use graph::Graph;
use rules::{Finding, findings};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use table::{IN_CIRCLES, PAST_THEIR_MOD_RS, ROOMS, UNDER_REVISION};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every file under `folder`, in a fixed order.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let deeper = |path: PathBuf| if path.is_dir() { files(&path) } else { vec![path] };
    paths.into_iter().flat_map(deeper).collect()
}

/// The project's own text files, with their paths from the root.
fn sources() -> Vec<(String, String)> {
    let mut paths: Vec<PathBuf> = ["src", "tests", "benches", "examples", "config", ".ci"]
        .iter()
        .flat_map(|folder| files(&root().join(folder)))
        .collect();
    let top = std::fs::read_dir(root()).unwrap().map(|entry| entry.unwrap().path());
    paths.extend(top.filter(|path| path.is_file() && !path.ends_with("Cargo.lock") && !path.ends_with(".git")));
    let name = |path: &Path| path.strip_prefix(root()).unwrap().to_str().unwrap().to_string();
    paths.iter().filter_map(|path| Some((name(path), std::fs::read_to_string(path).ok()?))).collect()
}

#[test]
fn the_tree_is_tidy() {
    let sources = sources();
    assert!(sources.len() > 30, "only {} files found", sources.len());
    let all: Vec<Finding> = sources.iter().flat_map(|(path, text)| findings(path, text)).collect();
    let lines: Vec<String> = all.iter().map(ToString::to_string).collect();
    assert!(lines.is_empty(), "{} untidy:\n{}", lines.len(), lines.join("\n"));
}

#[test]
fn no_room_has_a_circle_of_imports() {
    let graph = Graph::new(&sources());
    let circles = graph.circles();
    let mut found: BTreeMap<&str, usize> = BTreeMap::new();
    for circle in &circles {
        *found.entry(prose::room_of(circle[0]).unwrap()).or_default() += circle.len();
    }
    let rooms: BTreeSet<&str> = found.keys().copied().chain(IN_CIRCLES.iter().map(|(room, _)| *room)).collect();
    let mut untidy = Vec::new();
    for room in rooms {
        let allowed = IN_CIRCLES.iter().find(|(name, _)| *name == room).map_or(0, |(_, allowed)| *allowed);
        let files = found.get(room).copied().unwrap_or(0);
        if files != allowed {
            untidy.push(format!("{room}: {files} files import each other in circles, IN_CIRCLES says {allowed}"));
            let of_room = circles.iter().filter(|circle| prose::room_of(circle[0]) == Some(room));
            untidy.extend(of_room.map(|circle| format!("  a circle of {}\n{}", circle.len(), graph.explain(circle))));
        }
    }
    if !IN_CIRCLES.is_empty() {
        println!("files in circles that are allowed for now: {IN_CIRCLES:?}");
    }
    assert!(untidy.is_empty(), "{}", untidy.join("\n"));
}

#[test]
fn a_folder_is_entered_through_its_mod_rs() {
    let graph = Graph::new(&sources());
    let lines = graph.past_the_door.iter().map(|(file, line, rule)| (file.clone(), format!("{file}:{line}: {rule}")));
    let untidy = beyond(PAST_THEIR_MOD_RS, lines);
    assert!(untidy.is_empty(), "{untidy}");
}

#[test]
fn the_prose_keeps_to_the_language_guide() {
    let sources = sources();
    let lines = sources.iter().flat_map(|(path, text)| {
        let unclear = prose::unclear(path, text).into_iter();
        unclear.map(move |(line, rule)| (path.clone(), format!("{path}:{line}: {rule}")))
    });
    let untidy = beyond(UNDER_REVISION, lines);
    assert!(untidy.is_empty(), "{untidy}");
}

/// The breaches, given with their files, of each room that has more of them than `allowed` says.
fn beyond(allowed: &[(&str, usize)], breaches: impl Iterator<Item = (String, String)>) -> String {
    let mut rooms: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (path, breach) in breaches {
        if let Some(room) = prose::room_of(&path) {
            rooms.entry(room.to_string()).or_default().push(breach);
        }
    }
    let allowed = |room: &str| allowed.iter().find(|(name, _)| *name == room).map_or(0, |(_, allowed)| *allowed);
    rooms.retain(|room, lines| lines.len() > allowed(room));
    let report = |(room, lines): (&String, &Vec<String>)| {
        format!("{room}: {} breaches, {} allowed\n{}", lines.len(), allowed(room), lines.join("\n"))
    };
    rooms.iter().map(report).collect::<Vec<_>>().join("\n")
}

#[test]
fn the_table_lists_the_rooms_of_lib_rs_bottom_to_top() {
    let text = std::fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let declared: Vec<&str> =
        text.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';')).collect();
    let listed: Vec<&str> = ROOMS.iter().map(|room| room.name).collect();
    assert_eq!(declared, listed);
    for (index, room) in ROOMS.iter().enumerate() {
        for below in room.rooms {
            assert!(listed[..index].contains(below), "{} names {below}, which is not below it", room.name);
        }
    }
}

#[test]
fn the_table_names_only_crates_of_the_manifest() {
    let manifest: toml::Table = std::fs::read_to_string(root().join("Cargo.toml")).unwrap().parse().unwrap();
    let known: Vec<String> =
        manifest["dependencies"].as_table().unwrap().keys().map(|name| name.replace('-', "_")).collect();
    for room in ROOMS {
        for name in room.crates {
            assert!(known.iter().any(|known| known == name), "{} may use {name}, which is no dependency", room.name);
        }
    }
    for name in known {
        assert!(table::OUTSIDE.contains(&name.as_str()), "the dependency {name} is missing in OUTSIDE");
    }
}

#[test]
fn the_last_check_of_ci_is_the_test_command_of_the_readme() {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let commands = readme.split("```sh\n").nth(1).unwrap().split("```").next().unwrap();
    let tests: Vec<&str> = commands.lines().filter(|line| line.starts_with("cargo test")).collect();
    let ci = std::fs::read_to_string(root().join(".ci/run")).unwrap();
    assert_eq!(tests, [ci.lines().last().unwrap()]);
}

/// The rules that `text`, standing at `path`, breaks, as `line: rule`.
fn broken(path: &str, text: &str) -> Vec<String> {
    findings(path, text).iter().map(|finding| format!("{}: {}", finding.line, finding.rule)).collect()
}

#[test]
fn a_room_that_reaches_up_or_aside_is_found_however_it_is_written() {
    let rule = |room: &str, other: &str| format!("{room} may not name {other}");
    for text in [
        "//! Doc.\nuse crate::bus;",
        "//! Doc.\nuse crate::bus::Join;",
        "//! Doc.\nuse crate::{results::Circle, bus::Join};",
        "//! Doc.\nuse crate :: { self, bus };",
        "//! Doc.\nfn f() { crate::bus::join(); }",
        "//! Doc.\nuse super::super::bus::Join;",
        "//! Doc.\nuse ricochet::bus::Join;",
        "//! Doc.\nuse {crate::bus::Join, std::fmt};",
    ] {
        assert_eq!(broken("src/dic/x.rs", text), [format!("2: {}", rule("dic", "bus"))], "for {text}");
    }
    assert_eq!(broken("src/dic/mod.rs", "use super::bus;"), [format!("1: {}", rule("dic", "bus"))]);
    assert_eq!(broken("src/ball/x.rs", "use crate::dic::zncc;"), [format!("1: {}", rule("ball", "dic"))]);
    assert_eq!(broken("src/results/x.rs", "use crate::image::Image;"), [format!("1: {}", rule("results", "image"))]);
}

#[test]
fn rooms_below_and_own_modules_are_allowed() {
    assert_eq!(broken("src/dic/x.rs", "use crate::{dic::zncc, image::ImageView, results};"), [""; 0]);
    assert_eq!(broken("src/config/plan.rs", "use super::camera::Source;"), [""; 0]);
    assert_eq!(broken("src/config/mod.rs", "mod camera;\nuse camera::Source;"), [""; 0]);
    assert_eq!(broken("src/process/acquire.rs", "use crate::{bus, camera, recording};"), [""; 0]);
    assert_eq!(broken("src/dic/x.rs", "// crate::bus is above.\nlet x = \"crate::bus\"; /* mcap:: */"), [""; 0]);
}

#[test]
fn an_outside_crate_in_the_wrong_room_is_found() {
    for (path, text, said) in [
        ("src/process/record.rs", "use mcap::Writer;", "process may not name the crate mcap"),
        ("src/process/record.rs", "let w = mcap::Writer::new();", "process may not name the crate mcap"),
        ("src/recording/writer.rs", "use mcap::Writer;", "recording may not name the crate mcap"),
        ("src/command/info.rs", "use foxglove::schemas;", "command may not name the crate foxglove"),
        ("src/message/frame.rs", "use iceoryx2::prelude::*;", "message may not name the crate iceoryx2"),
        ("src/main.rs", "use clap::Parser;", "main may not name the crate clap"),
        ("src/dic/x.rs", "use ::serde::Serialize;", "dic may not name the crate serde"),
        ("src/dic/x.rs", "use {std::fmt, toml::Value};", "dic may not name the crate toml"),
        ("src/dic/x.rs", "use image::open;", "dic may not name the crate image"),
    ] {
        assert_eq!(broken(path, text), [format!("1: {said}")], "for {text}");
    }
    assert_eq!(broken("src/recording/writer.rs", "use crc32fast::Hasher;\nuse foxglove::schemas;"), [""; 0]);
    assert_eq!(broken("src/bus/join.rs", "use iceoryx2::prelude::*;"), [""; 0]);
    assert_eq!(broken("src/message/frame.rs", "use iceoryx2::prelude::ZeroCopySend;"), [""; 0]);
    assert_eq!(broken("src/cli.rs", "use clap::Parser;"), [""; 0]);
    assert_eq!(broken("src/dic/x.rs", "use crate::image;\nlet v = image::Image::new();"), [""; 0]);
}

#[test]
fn a_pure_room_that_reads_clock_file_or_environment_is_found() {
    for (text, what) in [
        ("use std::time::Instant;", "std::time::Instant"),
        ("use std::fs;", "std::fs"),
        ("std::thread::spawn(f);", "std::thread"),
        ("use std::{env, fmt};", "std::env"),
        ("use std::net::UdpSocket;", "std::net"),
    ] {
        assert_eq!(broken("src/motion/fit.rs", text), [format!("1: motion is pure and may not name {what}")]);
        assert_eq!(broken("src/process/acquire.rs", text), [""; 0]);
    }
    assert_eq!(broken("src/motion/fit.rs", "use std::time::Duration;"), [""; 0]);
    let in_tests = "fn f() {}\n#[cfg(test)]\nmod tests {\n    use std::fs;\n    fn g() { crate::bus::join(); }\n}\n";
    assert_eq!(broken("src/motion/fit.rs", in_tests), [""; 0]);
    let after_tests = format!("{in_tests}use std::env;");
    assert_eq!(broken("src/motion/fit.rs", &after_tests), ["7: motion is pure and may not name std::env"]);
}

#[test]
fn unsafe_outside_camera_and_bus_is_found() {
    let text = "fn f() {\n    unsafe { g() }\n}";
    assert_eq!(broken("src/dic/x.rs", text), ["2: unsafe belongs in camera and bus only"]);
    assert_eq!(broken("src/main.rs", "unsafe impl Send for X {}"), ["1: unsafe belongs in camera and bus only"]);
    assert_eq!(broken("src/camera/slot.rs", text), [""; 0]);
    assert_eq!(broken("src/bus/join.rs", text), [""; 0]);
    assert_eq!(broken("src/dic/x.rs", "#![deny(unsafe_code)] // unsafe"), [""; 0]);
}

#[test]
fn a_number_without_its_unit_is_found() {
    let field = |line: &str| broken("src/results/x.rs", &format!("pub struct S {{\n    {line}\n}}"));
    for line in ["pub width: u32,", "pub speed: f64,", "pub gain: Option<f32>,", "pub(crate) rows: Vec<[u16; 2]>,"] {
        let name = line.split([' ', ':']).nth(1).unwrap();
        assert_eq!(field(line), [format!("2: the number {name} does not end in its unit")], "for {line}");
    }
    for line in ["pub width_px: u32,", "pub vx_m_s: Option<f64>,", "pub zncc: f32,", "pub name: String,", "speed: f64,"]
    {
        assert_eq!(field(line), [""; 0], "for {line}");
    }
    assert_eq!(broken("src/dic/x.rs", "pub struct S {\n    pub speed: f64,\n}"), [""; 0], "rule for three rooms only");
    assert_eq!(broken("src/message/x.rs", "pub struct S { pub speed: f64 }").len(), 1, "on one line");
    assert_eq!(broken("src/config/x.rs", "pub struct S {\n    pub speed: f64,\n}").len(), 1);
}

#[test]
fn a_file_that_is_too_long_is_found() {
    let long = "// line\n".repeat(501);
    assert_eq!(broken("src/dic/x.rs", &long), ["501: longer than 500 lines"]);
    assert_eq!(broken("tests/it/x.rs", &long), ["501: longer than 500 lines"]);
    assert_eq!(broken("src/dic/x.rs", &"// line\n".repeat(500)), [""; 0]);
    assert_eq!(broken("src/camera/genicam/sys.rs", &long), [""; 0]);
    assert_eq!(broken("README.md", &long), [""; 0]);
}

#[test]
fn a_path_of_one_machine_is_found_in_any_text() {
    for folder in ["home/me", "root/x", "tmp/x", "work/x", "Users/me", "mnt/x", "opt/x"] {
        for (path, text) in
            [("README.md", format!("see\n/{folder}")), ("src/dic/x.rs", format!("\nlet p = \"/{folder}\";"))]
        {
            let said = format!("2: /{}/ is a path of one machine", folder.split_once('/').unwrap().0);
            assert_eq!(broken(path, &text), [said], "in {path}");
        }
    }
    let [temporary, home] = ["tmp", "home"];
    let elsewhere = format!("/dev/shm, target/{temporary}/x, https://a.org/{home}/b, /usr/bin/env");
    assert_eq!(broken("README.md", &elsewhere), [""; 0]);
}

/// A graph of hand-made files, each a path and a text.
fn graph_of(files: &[(&str, &str)]) -> Graph {
    let files: Vec<(String, String)> = files.iter().map(|(path, text)| (path.to_string(), text.to_string())).collect();
    Graph::new(&files)
}

#[test]
fn a_circle_of_imports_is_found_however_it_is_written() {
    let first = ("src/dic/inner/first.rs", "use crate::dic::second::Second;\npub struct First;");
    let door = ("src/dic/inner/mod.rs", "mod first;\npub use first::First;");
    let room = ("src/dic/mod.rs", "pub mod second;\nmod inner;\npub use inner::First as Renamed;");
    for second in [
        "use super::inner::First;\npub struct Second;",
        "use crate::dic::{inner::{self, First}};\npub struct Second;",
        "use crate::dic::Renamed;\npub struct Second;",
        "use super::*;\npub struct Second;\nfn f() -> super::inner::First {}",
        "use super::inner;\npub struct Second;\nfn f() { inner::First::new(); }",
        "pub struct Second;\nfn f() {\n    use super::inner::First;\n}",
    ] {
        let graph = graph_of(&[room, door, first, ("src/dic/second.rs", second)]);
        assert_eq!(graph.circles(), [["src/dic/inner/first.rs", "src/dic/second.rs"]], "for {second}");
    }
    let longer = graph_of(&[
        ("src/dic/a.rs", "use super::b::B;\npub struct A;"),
        ("src/dic/b.rs", "use super::c::C;\npub struct B;"),
        ("src/dic/c.rs", "use super::a::A;\npub struct C;"),
        ("src/dic/d.rs", "use super::a::A;"),
    ]);
    assert_eq!(longer.circles(), [["src/dic/a.rs", "src/dic/b.rs", "src/dic/c.rs"]]);
    assert!(longer.explain(&longer.circles()[0]).contains("src/dic/c.rs:1 imports src/dic/a.rs"));
}

#[test]
fn tests_and_parts_of_a_module_make_no_circle() {
    let graph = graph_of(&[
        ("src/dic/mod.rs", "mod a;\nmod b;\npub use a::A;\npub struct Shape;\n#[cfg(test)]\nmod checks;"),
        ("src/dic/a.rs", "use super::Shape;\npub struct A;\n#[cfg(test)]\nmod tests {\n    use super::super::b::B;\n}"),
        ("src/dic/b.rs", "use super::{Shape, a::A};\npub struct B;"),
        ("src/dic/checks.rs", "use super::b::B;\npub fn f() {}"),
    ]);
    assert_eq!(graph.circles(), [[""; 0]; 0]);
}

#[test]
fn a_folder_that_is_entered_past_its_mod_rs_is_found() {
    let room = ("src/dic/mod.rs", "mod second;\nmod inner;");
    let first = ("src/dic/inner/first.rs", "pub struct First;");
    let past = |declaration: &str, second: &str| {
        let door = format!("{declaration} mod first;\npub use first::First;");
        let graph = graph_of(&[room, ("src/dic/inner/mod.rs", &door), first, ("src/dic/second.rs", second)]);
        graph.past_the_door.iter().map(|(file, line, _)| format!("{file}:{line}")).collect::<Vec<_>>()
    };
    for second in ["use super::inner::first::First;", "fn f() { crate::dic::inner::first::First::new(); }"] {
        assert_eq!(past("pub(super)", second), ["src/dic/second.rs:1"], "for {second}");
        assert_eq!(past("pub", second), [""; 0], "for {second}");
    }
    assert_eq!(past("pub(super)", "use super::inner::First;"), [""; 0]);
}

/// The lines of `text`, standing at `path`, that break the language guide.
fn unclear_lines(path: &str, text: &str) -> Vec<usize> {
    prose::unclear(path, text).into_iter().map(|(line, _)| line).collect()
}

#[test]
fn a_forbidden_word_is_found_in_docs_comments_messages_and_pages() {
    for text in [
        "//! Doc.\n/// Returns the motion told by the tracker.\nfn f() {}",
        "//! Doc.\n// Told here.\nfn f() {}",
        "//! Doc.\nfn f() { panic!(\"cannot tell\"); }",
        "//! Doc.\nfn f() { let text = r#\"read anew\"#; }",
        "//! Doc.\n/* as\nforeseen */ fn f() {}".replace("as\n", "as ").as_str(),
    ] {
        assert_eq!(unclear_lines("src/dic/x.rs", text), [2], "for {text}");
    }
    assert_eq!(unclear_lines("docs/guide.md", "# Guide\n\nThe page tells a shot."), [3]);
    assert_eq!(unclear_lines("config/rod.toml", "# The rate is foretold."), [1]);
    assert_eq!(unclear_lines("CONVENTIONS.md", "Report, publish; never tell,\nforetell. Tell nobody."), [2]);
    assert_eq!(unclear_lines("src/dic/x.rs", "/// Reads the intelligible, untold.\nfn tell() { told(); }"), [0; 0]);
}

#[test]
fn a_doc_that_opens_with_a_clause_is_found() {
    for opening in
        ["What the tracker does", "How far it moved", "By what factor", "Of a body", "Which body", "As above"]
    {
        let text = format!("struct S {{\n    /// {opening}.\n    ///\n    /// What else.\n    field: f64,\n}}");
        assert_eq!(unclear_lines("src/dic/x.rs", &text), [2], "for {text}");
        assert_eq!(unclear_lines("src/dic/x.rs", &format!("//! {opening}.\nfn f() {{}}")), [1], "for {text}");
    }
    for text in
        ["/// Whether it moved.", "/// Offsets of rows.", "// What follows is slow.", "/// Howling.", "/// Bytes."]
    {
        assert_eq!(unclear_lines("src/dic/x.rs", &format!("{text}\nfn f() {{}}")), [0; 0], "for {text}");
    }
}

#[test]
fn packed_and_bool_parameters_are_counted() {
    let counted = |text: &str| {
        let functions = functions::functions(text);
        (functions.iter().filter(|f| f.packs_parameters()).count(), functions.iter().filter(|f| f.takes_bool()).count())
    };
    for text in
        ["fn f((x, y): Point) {}", "fn f(&self, [a, b]: [f64; 2]) {}", "fn f<T: Fn(u8) -> u8>(at: (f64, f64)) {}"]
    {
        assert_eq!(counted(text), (1, 0), "for {text}");
    }
    assert_eq!(counted("fn f(&mut self, name: &str, is_open: bool,) -> (f64, f64) {}"), (0, 1));
    assert_eq!(counted("fn f(at: [f64; 2], g: impl Fn((u8, u8)) -> bool, rows: Vec<(u8, bool)>) {}"), (0, 0));
}

#[test]
fn comments_texts_and_letters_are_blanked_and_lines_kept() {
    for (text, blanked) in [
        ("a // b\nc", format!("a{}\nc", " ".repeat(5))),
        ("a /* b /* c */\n d */ e", format!("a{}\n{}e", " ".repeat(13), " ".repeat(6))),
        ("x(\"a\\\"b\") y", format!("x({}) y", " ".repeat(6))),
        ("\"a\nb\" c", format!("{}\n{}c", " ".repeat(2), " ".repeat(3))),
        ("r#\"a\"b\"# c", format!("{}c", " ".repeat(9))),
        ("br\"y\" c", format!("b{}c", " ".repeat(5))),
        ("'a' '\\'' &'a b", format!("{}&'a b", " ".repeat(9))),
        ("for\"a", format!("for{}", " ".repeat(2))),
    ] {
        assert_eq!(blank::blank(text), blanked, "for {text}");
    }
}
