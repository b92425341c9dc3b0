//! The parameters of functions, as far as they can be read without a parser.

use super::paths::words;

/// One function of a blanked source.
pub struct Function {
    /// The pattern and type of each parameter; `self` has no type.
    pub parameters: Vec<(String, String)>,
}

impl Function {
    /// Whether a parameter is taken apart by a tuple or array pattern, or has a tuple as its type.
    pub fn packs_parameters(&self) -> bool {
        self.parameters.iter().any(|(pattern, kind)| {
            let kind = kind.trim_start_matches('&').trim_start_matches("mut ");
            pattern.trim_start_matches('&').starts_with(['(', '[']) || kind.starts_with('(')
        })
    }

    /// Whether a parameter is a `bool`.
    pub fn takes_bool(&self) -> bool {
        self.parameters.iter().any(|(_, kind)| kind == "bool")
    }
}

/// The functions with a name, in the order of the source.
pub fn functions(code: &str) -> Vec<Function> {
    let mut functions = Vec::new();
    for at in words(code, "fn") {
        let rest = code[at + 2..].trim_start();
        let name = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
        let mut rest = rest[name..].trim_start();
        if rest.starts_with('<') {
            rest = rest[closing(rest)..].trim_start();
        }
        if name == 0 || !rest.starts_with('(') {
            continue;
        }
        let inside = &rest[1..closing(rest) - 1];
        let parameters = split(inside, ',').into_iter().filter(|text| !text.trim().is_empty()).map(parameter).collect();
        functions.push(Function { parameters });
    }
    functions
}

fn parameter(text: &str) -> (String, String) {
    let mut text = text.trim();
    while text.starts_with("#[") {
        text = text.split_once(']').map_or("", |(_, rest)| rest).trim_start();
    }
    let pattern = split(text, ':')[0];
    (pattern.trim().to_string(), text[pattern.len()..].trim_start_matches(':').trim().to_string())
}

/// The length of the group of brackets that `text` begins with.
fn closing(text: &str) -> usize {
    let mut depth = 0_usize;
    let mut previous = ' ';
    for (at, letter) in text.char_indices() {
        match letter {
            '(' | '[' | '{' | '<' => depth += 1,
            '>' if previous == '-' => {}
            ')' | ']' | '}' | '>' if depth <= 1 => return at + 1,
            ')' | ']' | '}' | '>' => depth -= 1,
            _ => {}
        }
        previous = letter;
    }
    text.len()
}

/// Splits at a separator outside of all brackets.
fn split(text: &str, separator: char) -> Vec<&str> {
    let (mut parts, mut start, mut at) = (Vec::new(), 0, 0);
    while let Some(letter) = text[at..].chars().next() {
        if letter == separator {
            parts.push(&text[start..at]);
            start = at + letter.len_utf8();
        }
        at += if "([{<".contains(letter) { closing(&text[at..]) } else { letter.len_utf8() };
    }
    parts.push(&text[start..]);
    parts
}
