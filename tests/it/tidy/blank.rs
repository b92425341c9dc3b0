//! Rust source taken apart into code, comments and literals.

/// A stretch of source that is all code, or one comment or literal.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kind {
    Code,
    Comment,
    Text,
    Letter,
}

/// The pieces of a source, one after the other and without gaps.
pub fn pieces(source: &str) -> Vec<(Kind, String)> {
    let chars: Vec<char> = source.chars().collect();
    let mut pieces: Vec<(Kind, String)> = Vec::new();
    let mut at = 0;
    while at < chars.len() {
        let end = end_of_piece(&chars, at);
        let kind = match chars[at] {
            _ if end == at => Kind::Code,
            '/' => Kind::Comment,
            '\'' => Kind::Letter,
            _ => Kind::Text,
        };
        let end = end.max(at + 1);
        match pieces.last_mut() {
            Some((Kind::Code, text)) if kind == Kind::Code => text.push(chars[at]),
            _ => pieces.push((kind, chars[at..end].iter().collect())),
        }
        at = end;
    }
    pieces
}

/// The source with comments and literals replaced by spaces, line for line and character for character.
pub fn blank(source: &str) -> String {
    masked(source, |_| ' ')
}

/// The code lines of a source that are neither blank nor comment nor under `#[cfg(test)]`.
pub fn production_lines(source: &str) -> usize {
    let code = without_tests(&masked(source, |kind| if kind == Kind::Comment { ' ' } else { 'x' }));
    code.lines().filter(|line| !line.trim().is_empty()).count()
}

fn masked(source: &str, mask: fn(Kind) -> char) -> String {
    let mut out = String::with_capacity(source.len());
    for (kind, text) in pieces(source) {
        match kind {
            Kind::Code => out.push_str(&text),
            _ => out.extend(text.chars().map(|letter| if letter == '\n' { '\n' } else { mask(kind) })),
        }
    }
    out
}

/// The end of the comment or literal that begins at `at`, or `at` itself for code.
fn end_of_piece(chars: &[char], at: usize) -> usize {
    let next = chars.get(at + 1).copied();
    match chars[at] {
        '/' if next == Some('/') => (at..chars.len()).find(|i| chars[*i] == '\n').unwrap_or(chars.len()),
        '/' if next == Some('*') => end_of_block_comment(chars, at),
        '"' => end_of_text(chars, at),
        'r' if !follows_a_word(chars, at) => end_of_raw_text(chars, at),
        '\'' => end_of_letter(chars, at),
        _ => at,
    }
}

/// Whether `at` is inside a word (`br` and `cr` begin raw texts too).
fn follows_a_word(chars: &[char], at: usize) -> bool {
    let word = |i: usize| chars[i].is_alphanumeric() || chars[i] == '_';
    at > 0 && word(at - 1) && !(matches!(chars[at - 1], 'b' | 'c') && (at == 1 || !word(at - 2)))
}

fn end_of_block_comment(chars: &[char], at: usize) -> usize {
    let (mut depth, mut i) = (0, at);
    while i + 1 < chars.len() {
        match (chars[i], chars[i + 1]) {
            ('/', '*') => (depth, i) = (depth + 1, i + 2),
            ('*', '/') => (depth, i) = (depth - 1, i + 2),
            _ => i += 1,
        }
        if depth == 0 {
            return i;
        }
    }
    chars.len()
}

fn end_of_text(chars: &[char], at: usize) -> usize {
    let mut i = at + 1;
    while i < chars.len() && chars[i] != '"' {
        i += if chars[i] == '\\' { 2 } else { 1 };
    }
    (i + 1).min(chars.len())
}

fn end_of_raw_text(chars: &[char], at: usize) -> usize {
    let hashes = chars[at + 1..].iter().take_while(|letter| **letter == '#').count();
    let open = at + 1 + hashes;
    if chars.get(open) != Some(&'"') {
        return at;
    }
    let closes =
        |i: usize| chars[i] == '"' && chars[i + 1..].iter().take(hashes).filter(|c| **c == '#').count() == hashes;
    (open + 1..chars.len()).find(|i| closes(*i)).map_or(chars.len(), |i| i + 1 + hashes)
}

/// The end of a letter in quotes, or `at` for a lifetime.
fn end_of_letter(chars: &[char], at: usize) -> usize {
    if chars.get(at + 1) == Some(&'\\') {
        return (at + 3..chars.len()).find(|i| chars[*i] == '\'').map_or(chars.len(), |i| i + 1);
    }
    if chars.get(at + 2) == Some(&'\'') { at + 3 } else { at }
}

/// Blanked source without the items under `#[cfg(test)]`, line for line.
pub fn without_tests(blanked: &str) -> String {
    let mut out = String::with_capacity(blanked.len());
    let mut rest = blanked;
    while let Some(start) = rest.find("#[cfg(test)]") {
        out.push_str(&rest[..start]);
        let end = start + end_of_item(&rest[start..]);
        out.extend(rest[start..end].chars().filter(|letter| *letter == '\n'));
        rest = &rest[end..];
    }
    out + rest
}

/// The length of the item that `text` begins with: up to its closing brace, or to a semicolon before any brace.
fn end_of_item(text: &str) -> usize {
    let mut depth = 0_usize;
    for (at, letter) in text.char_indices() {
        match letter {
            '{' => depth += 1,
            '}' if depth <= 1 => return at + 1,
            '}' => depth -= 1,
            ';' if depth == 0 => return at + 1,
            _ => {}
        }
    }
    text.len()
}
