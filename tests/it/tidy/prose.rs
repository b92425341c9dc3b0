//! The rules of the language guide that a machine can check.

use super::blank::{Kind, pieces};
use super::paths::words;

/// Words that belong to fairy tales, each with the word to use instead.
const FORBIDDEN_WORDS: &[(&str, &str)] = &[
    ("tell", "report, publish, print or return"),
    ("tells", "reports, publishes, prints or returns"),
    ("telling", "reporting"),
    ("told", "reported, published, printed or returned"),
    ("foretell", "predict"),
    ("foretells", "predicts"),
    ("foretold", "predicted"),
    ("foresee", "expect"),
    ("foresees", "expects"),
    ("foreseen", "expected"),
    ("anew", "again"),
];

/// Openings of a doc that make a clause or a stump of its first sentence.
const FORBIDDEN_OPENINGS: &[&str] = &["What", "How", "By", "Of", "Which", "Where", "From which", "As"];

/// Texts outside src/ that the rules read, besides the folders of [`READ_FOLDERS`].
const READ_FILES: &[&str] = &["README.md", "CONVENTIONS.md", "ARCHITECTURE.md"];

/// Folders that the rules read.
const READ_FOLDERS: &[&str] = &["src", "docs", "config", "examples", "tests"];

/// The folder whose texts are the rules themselves and the violations that try them.
const RULES: &str = "tests/it/tidy";

/// The room of a file, or the file or folder at the root that stands for one; `None` where prose is not checked.
pub fn room_of(path: &str) -> Option<&str> {
    let (folder, inside) = path.split_once('/').unwrap_or(("", path));
    match folder {
        _ if path.starts_with(RULES) => None,
        "src" => inside.split(['/', '.']).next(),
        "" => READ_FILES.contains(&path).then_some(path),
        folder => READ_FOLDERS.contains(&folder).then_some(folder),
    }
}

/// Every line of `text` that breaks the guide, with the rule that it breaks.
pub fn unclear(path: &str, text: &str) -> Vec<(usize, String)> {
    let mut broken = Vec::new();
    if path.ends_with(".rs") {
        let mut line = 1;
        for (kind, piece) in pieces(text) {
            if matches!(kind, Kind::Comment | Kind::Text) {
                broken.extend(forbidden_words(&piece, |_| false).map(|(inside, rule)| (line + inside, rule)));
            }
            line += piece.matches('\n').count();
        }
        for doc in docs(text) {
            if let Some(opening) = doc.opening(FORBIDDEN_OPENINGS) {
                broken.push((doc.line, format!("a doc opens with {opening}; begin with a verb or an article")));
            }
        }
    } else {
        let quotes = |at: usize| path == "CONVENTIONS.md" && is_forbidding(text, at);
        broken.extend(forbidden_words(text, quotes).map(|(inside, rule)| (1 + inside, rule)));
    }
    broken.sort();
    broken
}

/// The forbidden words of a text, each with its line from 0 and its rule.
fn forbidden_words(text: &str, is_excused: impl Fn(usize) -> bool) -> impl Iterator<Item = (usize, String)> {
    let lower = text.to_ascii_lowercase();
    let mut broken = Vec::new();
    for (word, instead) in FORBIDDEN_WORDS {
        for at in words(&lower, word).filter(|at| !is_excused(*at)) {
            broken.push((lower[..at].matches('\n').count(), format!("\"{word}\": say {instead}")));
        }
    }
    broken.into_iter()
}

/// Whether the sentence around `at` says what never to write.
fn is_forbidding(text: &str, at: usize) -> bool {
    let sentence = text[..at].rsplit(['.', ';', ':']).next().unwrap_or_default().to_ascii_lowercase();
    sentence.contains("never")
}

/// The first line of a doc comment.
pub struct Doc {
    /// The line, from 1.
    pub line: usize,
    /// The words of the line.
    pub text: String,
    /// Whether a function is documented.
    pub is_function: bool,
}

impl Doc {
    /// The first of `openings` that the doc begins with.
    pub fn opening(&self, openings: &[&'static str]) -> Option<&'static str> {
        let begins = |opening: &str| {
            self.text.strip_prefix(opening).is_some_and(|rest| !rest.starts_with(|c: char| c.is_alphanumeric()))
        };
        openings.iter().copied().find(|opening| begins(opening))
    }
}

/// The doc comments of a source, of items and of modules.
pub fn docs(text: &str) -> Vec<Doc> {
    let lines: Vec<&str> = text.lines().collect();
    let marker = |line: usize| {
        let line = lines.get(line)?.trim_start();
        ["///", "//!"].into_iter().find(|marker| line.starts_with(marker) && !line.starts_with("////"))
    };
    let (mut docs, mut line) = (Vec::new(), 0);
    for (kind, piece) in pieces(text) {
        if kind == Kind::Comment
            && let Some(found) = marker(line).filter(|found| piece.starts_with(found))
            && (line == 0 || marker(line - 1) != Some(found))
        {
            let is_heading =
                |line: &&&str| ["///", "#[", "//!"].iter().any(|start| line.trim_start().starts_with(start));
            let item = lines[line..].iter().find(|line| !is_heading(line)).map_or("", |line| line.trim());
            let before_name = item.split_once("fn ").map(|(before, _)| before);
            let is_modifier =
                |word: &str| ["const", "async", "unsafe", "extern"].contains(&word) || word.starts_with("pub");
            let is_function =
                before_name.is_some_and(|before| before.split(' ').filter(|word| !word.is_empty()).all(is_modifier));
            docs.push(Doc { line: line + 1, text: piece[3..].trim().into(), is_function });
        }
        line += piece.matches('\n').count();
    }
    docs
}
