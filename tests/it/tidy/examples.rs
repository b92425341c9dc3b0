//! The items that the documentation shows to other programs, and their examples.

use super::paths::words;
use super::sources;

/// The attribute of rooms and items that only contributors see.
const HIDING: &str = "#[cfg_attr(all(doc, not(internals)), doc(hidden))]";

/// The names in the statements of `code` that begin with `start` and are not hidden.
fn visible<'c>(code: &'c str, start: &str) -> Vec<&'c str> {
    let is_shown = |at: &usize| code[..*at].ends_with('\n') && !code[..*at].trim_end().ends_with(HIDING);
    let statements = code.match_indices(start).filter(|(at, _)| is_shown(at)).map(|(at, _)| &code[at + start.len()..]);
    let names = |statement: &'c str| {
        let statement = statement.split([';', '(', '<']).next().unwrap_or_default();
        let list = statement.rsplit("::").next().unwrap_or_default();
        list.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|name| !name.is_empty())
    };
    statements.flat_map(names).collect()
}

/// Whether a doc with an example stands at the item `name`, or at the description that a macro derives it from.
fn has_example(text: &str, name: &str) -> bool {
    let mut is_example = false;
    for line in text.lines().map(str::trim_start).filter(|line| !line.starts_with("#[")) {
        if line.starts_with("///") {
            is_example |= line.contains("```");
            continue;
        }
        let item = line.strip_prefix("pub ").and_then(|item| item.split([':', '(', '<', '=', '{']).next());
        if is_example && words(item.unwrap_or(line), name).next().is_some() {
            return true;
        }
        is_example = false;
    }
    false
}

#[test]
fn every_item_that_other_programs_see_has_an_example() {
    let sources = sources();
    let text_of = |path: &str| sources.iter().find(|(other, _)| other == path).map_or("", |(_, text)| text);
    let rooms = visible(text_of("src/lib.rs"), "pub mod ");
    let is_documented = |path: &str| rooms.iter().any(|room| path.starts_with(&format!("src/{room}/")));
    let texts: Vec<&str> = sources.iter().filter(|(path, _)| is_documented(path)).map(|(_, text)| &text[..]).collect();
    let doors: Vec<String> = rooms.iter().map(|room| format!("src/{room}/mod.rs")).collect();
    let names =
        doors.iter().flat_map(|door| visible(text_of(door), "pub use ").into_iter().map(move |name| (door, name)));
    let bare: Vec<_> = names.filter(|(_, name)| !texts.iter().any(|text| has_example(text, name))).collect();
    assert!(rooms.len() > 3 && bare.is_empty(), "items of {rooms:?} without an example: {bare:?}");
}

#[test]
fn an_item_without_an_example_and_a_hidden_one_are_recognized() {
    let door = format!("mod a;\n{HIDING}\npub use a::Inner;\npub use a::{{First, second}};\n");
    assert_eq!(visible(&door, "pub use "), ["First", "second"]);
    let item = "/// Doc.\n///\n/// ```\n/// f();\n/// ```\n#[derive(Debug)]\npub struct First(Second);";
    assert!(has_example(item, "First") && !has_example(item, "Second"));
    assert!(!has_example(&item.replace("```", ""), "First"));
}
