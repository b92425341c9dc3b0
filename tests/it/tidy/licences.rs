//! Licences and sources of the dependencies, by the lists of `deny.toml`. `cargo deny check` reads the same file, but has to
//! be installed, and also asks for advisories.

use super::root;
use serde_json::Value;
use std::process::Command;

/// The packages that end up in the program, with their licence expressions and sources.
fn packages() -> Vec<(String, String, String)> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .args(["--filter-platform", "x86_64-unknown-linux-gnu"])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let used: Vec<&Value> = metadata["resolve"]["nodes"].as_array().unwrap().iter().map(|node| &node["id"]).collect();
    let all = metadata["packages"].as_array().unwrap().iter().filter(|package| used.contains(&&package["id"]));
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    all.map(|package| (text(&package["name"]), text(&package["license"]), text(&package["source"]))).collect()
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
    let others = packages.iter().filter(|(name, _, _)| name != env!("CARGO_PKG_NAME"));
    let wrong: Vec<_> = others
        .filter(|(_, licence, source)| !is_allowed(licence, &allowed) || !source.starts_with("registry+"))
        .collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}
