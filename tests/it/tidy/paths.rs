//! The paths that a blanked source names: in `use` declarations and inline.

/// One path of a `use` declaration.
pub struct Import {
    /// The byte at which the declaration begins.
    pub at: usize,
    /// The path without a trailing `*` or `as`.
    pub path: String,
    /// The name after `as`.
    pub alias: Option<String>,
    /// Whether all that the path holds is imported.
    pub is_glob: bool,
    /// Whether the declaration is public, to anyone.
    pub is_public: bool,
}

/// Every path of the `use` declarations, and the code without them, byte for byte.
pub fn uses(code: &str) -> (Vec<Import>, String) {
    let (mut imports, mut rest) = (Vec::new(), code.to_string());
    for at in words(code, "use") {
        let Some(length) = code[at..].find(';') else { continue };
        let declaration = &code[at..at + length];
        let before = code[..at].trim_end();
        let is_public = before.ends_with("pub")
            || before.ends_with(')') && before.rfind('(').is_some_and(|open| before[..open].ends_with("pub"));
        expand("", compact(&declaration["use".len()..]).trim_start_matches("::"), &mut |path, rest| {
            let alias = rest.strip_prefix('@').map(str::to_string);
            imports.push(Import { at, path: path.into(), alias, is_glob: rest.starts_with('*'), is_public });
        });
        let blank: String = declaration.bytes().map(|byte| if byte == b'\n' { '\n' } else { ' ' }).collect();
        rest.replace_range(at..at + length, &blank);
    }
    (imports, rest)
}

/// Every path of two names or more in code without `use` declarations, with the byte at which it begins.
pub fn inline_paths(code: &str) -> Vec<(usize, Vec<String>)> {
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    let (mut paths, mut at) = (Vec::new(), 0);
    while let Some(start) = code[at..].find(is_part).map(|offset| at + offset) {
        let mut names = Vec::new();
        let mut end = start;
        loop {
            let length = code[end..].find(|c| !is_part(c)).unwrap_or(code.len() - end);
            names.push(code[end..end + length].to_string());
            end += length;
            let Some(next) = code[end..].trim_start().strip_prefix("::") else { break };
            let next = next.trim_start();
            if !next.starts_with(is_part) {
                break;
            }
            end = code.len() - next.len();
        }
        if names.len() > 1 && !follows_a_path(code, start) {
            paths.push((start, names));
        }
        at = end;
    }
    paths
}

/// A path or declaration without white space, ` as ` written as `@`.
fn compact(declaration: &str) -> String {
    let words: Vec<&str> = declaration.split_whitespace().collect();
    words.join(" ").replace(" as ", "@").split_whitespace().collect()
}

/// Every path that begins with `root::`, with the byte at which it begins; groups in braces are taken apart.
pub fn paths_from(code: &str, root: &str) -> Vec<(usize, String)> {
    let mut paths = Vec::new();
    let first = root.split("::").next().unwrap_or_default();
    for at in words(code, first).filter(|at| !follows_a_path(code, *at)) {
        let compact = compact(code[at..].split(';').next().unwrap_or_default());
        expand("", &compact, &mut |path, _| {
            if path.starts_with(&format!("{root}::")) {
                paths.push((at, path.to_string()));
            }
        });
    }
    paths
}

/// Takes `a::{b, c::{d}}` apart into `a::b` and `a::c::d`; `found` gets each path and what follows it.
fn expand(prefix: &str, text: &str, found: &mut dyn FnMut(&str, &str)) {
    let name_end = text.find(|c: char| !c.is_alphanumeric() && c != '_' && c != ':').unwrap_or(text.len());
    let path = format!("{prefix}{}", &text[..name_end]);
    let is_group = (path.is_empty() || path.ends_with("::")) && text[name_end..].starts_with('{');
    if !is_group {
        return found(path.trim_end_matches(':'), &text[name_end..]);
    }
    let (mut depth, mut start) = (0, name_end + 1);
    for (at, letter) in text.char_indices().skip_while(|(at, _)| *at < name_end) {
        match letter {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if (letter == ',' && depth == 1) || depth == 0 {
            if start < at {
                expand(&path, &text[start..at], found);
            }
            start = at + 1;
        }
        if depth == 0 {
            return;
        }
    }
}

/// Whether the word at `at` continues a path that began before it.
pub fn follows_a_path(code: &str, at: usize) -> bool {
    let before = code[..at].trim_end();
    let Some(before) = before.strip_suffix("::") else { return false };
    before.trim_end().ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == '>')
        && !["use", "return", "in"].iter().any(|word| before.trim_end().ends_with(word) && before.ends_with(' '))
}

/// The bytes at which a whole word begins.
pub fn words<'c>(code: &'c str, word: &'c str) -> impl Iterator<Item = usize> + 'c {
    let part = |c: char| c.is_alphanumeric() || c == '_';
    code.match_indices(word)
        .filter(move |(at, _)| !code[..*at].ends_with(part) && !code[at + word.len()..].starts_with(part))
        .map(|(at, _)| at)
}

/// The line of a byte, from 1.
pub fn line(code: &str, at: usize) -> usize {
    1 + code[..at].matches('\n').count()
}
