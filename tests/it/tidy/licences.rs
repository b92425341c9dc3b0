//! Licences and sources of the dependencies, by the lists of `deny.toml`. `cargo deny check` reads the same file, but has to
//! be installed, and also asks for advisories.

use super::root;
use std::process::Command;

/// The packages that end up in the program or build it, each with its licence expression.
fn packages() -> Vec<(String, String)> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--locked", "--target", "x86_64-unknown-linux-gnu", "--prefix", "none"])
        .args(["--format", "{p}|{l}"])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed = String::from_utf8(output.stdout).unwrap();
    let pairs = printed.lines().filter_map(|line| line.trim_end_matches(" (*)").split_once('|'));
    pairs.map(|(package, licence)| (package.to_owned(), licence.to_owned())).collect()
}

/// Whether a licence expression can be met with the allowed licences alone.
fn is_allowed(expression: &str, allowed: &[String]) -> bool {
    let spaced = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let (is_met, read) = any(&words, allowed);
    is_met && read == words.len()
}

/// Evaluates alternatives; returns the result and the number of words.
fn any(words: &[&str], allowed: &[String]) -> (bool, usize) {
    let (mut is_met, mut at) = all(words, allowed);
    while words.get(at) == Some(&"OR") {
        let (next, read) = all(&words[at + 1..], allowed);
        (is_met, at) = (is_met || next, at + 1 + read);
    }
    (is_met, at)
}

fn all(words: &[&str], allowed: &[String]) -> (bool, usize) {
    let (mut is_met, mut at) = one(words, allowed);
    while words.get(at) == Some(&"AND") {
        let (next, read) = one(&words[at + 1..], allowed);
        (is_met, at) = (is_met && next, at + 1 + read);
    }
    (is_met, at)
}

fn one(words: &[&str], allowed: &[String]) -> (bool, usize) {
    match words {
        ["(", rest @ ..] => {
            let (is_met, read) = any(rest, allowed);
            (is_met, read + 2)
        }
        // An exception is a name of its own in the list.
        [name, "WITH", exception, ..] => (allowed.contains(&format!("{name} WITH {exception}")), 3),
        [name, ..] => (allowed.iter().any(|allowed| allowed == name), 1),
        [] => (false, 0),
    }
}

#[test]
fn every_dependency_has_an_allowed_licence_and_comes_from_the_registry() {
    let rules: toml::Value = toml::from_str(&std::fs::read_to_string(root().join("deny.toml")).unwrap()).unwrap();
    let allowed = rules["licenses"]["allow"].as_array().unwrap();
    let allowed: Vec<String> = allowed.iter().map(|name| name.as_str().unwrap().to_owned()).collect();
    assert!(is_allowed("(MIT OR GPL-3.0) AND Unicode-3.0", &allowed) && is_allowed("Unlicense/MIT", &allowed));
    assert!(!is_allowed("MIT AND GPL-3.0", &allowed) && !is_allowed("", &allowed));
    let packages = packages();
    assert!(packages.len() > 100, "{packages:?}");
    let wrong: Vec<_> = packages.iter().filter(|(_, licence)| !is_allowed(licence, &allowed)).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
    let lock = std::fs::read_to_string(root().join("Cargo.lock")).unwrap();
    let sources = lock.lines().filter_map(|line| line.strip_prefix("source = "));
    let is_registry = |source: &str| source == "\"registry+https://github.com/rust-lang/crates.io-index\"";
    assert_eq!(sources.filter(|source| !is_registry(source)).collect::<Vec<_>>(), Vec::<&str>::new());
}
