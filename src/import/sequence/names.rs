//! Numbers in file names.

use std::path::{Path, PathBuf};

/// The maximum number of digits of a number.
const MAX_DIGITS: usize = 30;
/// The maximum mean step of a counter; fractions of a second have larger ones.
const MAX_COUNTER_STEP: i128 = 8;

/// A file name, taken apart into numbers and the texts around them.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Name {
    /// One text more than numbers.
    texts: Vec<String>,
    /// The digits of each number.
    digits: Vec<String>,
}

/// The numbers at one position in all names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Column {
    /// The texts before and after it, which all names share.
    pub(super) before: String,
    pub(super) after: String,
    /// The number in each name; that of a decimal number without its point.
    pub(super) values: Vec<i128>,
    /// Number of digits in each name.
    pub(super) digits: Vec<usize>,
    /// Number of digits behind the decimal point.
    pub(super) decimals: usize,
    /// Whether a hyphen that all names share may be meant as a sign.
    pub(super) is_hyphened: bool,
}

/// The reason why names are no numbered sequence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Unnumbered {
    /// Most names are alike, but not this one.
    Odd(usize),
    /// The names have nothing in common.
    Unlike,
}

/// Returns the columns of numbers that all names share, up to the first number with too many digits.
///
/// # Errors
///
/// [`Unnumbered`] when the texts between the numbers differ.
pub(super) fn columns(paths: &[PathBuf]) -> Result<Vec<Column>, Unnumbered> {
    let is_one_folder = paths.windows(2).all(|pair| pair[0].parent() == pair[1].parent());
    // Folders belong to the names where they differ.
    let stem = if is_one_folder { file_stem } else { path_stem };
    let names: Vec<Name> = paths.iter().map(|path| Name::parse(&stem(path))).collect();
    let patterns: Vec<Vec<String>> = names.iter().map(Name::pattern).collect();
    let first = patterns.first().ok_or(Unnumbered::Unlike)?;
    if patterns.iter().any(|pattern| pattern != first) {
        return Err(find_odd_name(&patterns));
    }
    Ok((0..first.len() - 1).map_while(|index| Column::from_names(&names, index)).collect())
}

/// Finds the first name whose pattern differs from that of most others, or else returns that the names are unlike.
fn find_odd_name(patterns: &[Vec<String>]) -> Unnumbered {
    let alike = |pattern: &Vec<String>| patterns.iter().filter(|other| *other == pattern).count();
    // One of the first names has the pattern of most, if there is one.
    let common = patterns.iter().take(3).max_by_key(|pattern| alike(pattern));
    let common = common.filter(|pattern| pattern.len() > 1 && 2 * alike(pattern) > patterns.len());
    let odd = common.and_then(|common| patterns.iter().position(|pattern| pattern != common));
    odd.map_or(Unnumbered::Unlike, Unnumbered::Odd)
}

/// Returns the name without its ending and its folder.
fn file_stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Returns the path without the ending of its name.
fn path_stem(path: &Path) -> String {
    path.with_extension("").to_string_lossy().into_owned()
}

impl Name {
    /// Splits a name at the borders between digits and other characters.
    fn parse(stem: &str) -> Self {
        let mut name = Self { texts: vec![String::new()], digits: Vec::new() };
        let mut was_digit = false;
        for letter in stem.chars() {
            let is_digit = letter.is_ascii_digit();
            if is_digit && !was_digit {
                name.digits.push(String::new());
                name.texts.push(String::new());
            }
            let into = if is_digit { name.digits.last_mut() } else { name.texts.last_mut() };
            into.into_iter().for_each(|text| text.push(letter));
            was_digit = is_digit;
        }
        name
    }

    /// Returns the texts without the signs of the numbers after them.
    fn pattern(&self) -> Vec<String> {
        let last = self.texts.len() - 1;
        let text =
            |(index, text): (usize, &String)| if index < last { without_sign(text).to_owned() } else { text.clone() };
        self.texts.iter().enumerate().map(text).collect()
    }

    /// Returns the sign or hyphen before the number with this index; `None` without one.
    fn sign(&self, index: usize) -> Option<char> {
        let text = &self.texts[index];
        text[without_sign(text).len()..].chars().next()
    }
}

/// Returns the text without a sign at its end.
fn without_sign(text: &str) -> &str {
    text.strip_suffix(['-', '+', '\u{2212}']).unwrap_or(text)
}

impl Column {
    /// Collects the numbers with this index from all names; `None` if one has more than [`MAX_DIGITS`] digits.
    fn from_names(names: &[Name], index: usize) -> Option<Self> {
        let first = names.first()?;
        // A hyphen that all names share separates, one that only some have is a sign.
        let is_signed = names.iter().any(|name| name.sign(index) != first.sign(index));
        let value = |name: &Name| {
            let digits = &name.digits[index];
            let number: i128 = (digits.len() <= MAX_DIGITS).then(|| digits.parse().ok()).flatten()?;
            let is_negative = is_signed && matches!(name.sign(index), Some('-' | '\u{2212}'));
            Some(if is_negative { -number } else { number })
        };
        Some(Self {
            before: if is_signed { without_sign(&first.texts[index]).to_owned() } else { first.texts[index].clone() },
            after: first.texts[index + 1].clone(),
            values: names.iter().map(value).collect::<Option<_>>()?,
            digits: names.iter().map(|name| name.digits[index].len()).collect(),
            decimals: 0,
            is_hyphened: !is_signed && matches!(first.sign(index), Some('-' | '\u{2212}')),
        })
    }

    /// Whether the numbers differ between names.
    pub(super) fn varies(&self) -> bool {
        self.values.iter().any(|value| *value != self.values[0])
    }

    /// Whether all numbers have the same number of digits.
    pub(super) fn is_padded(&self) -> bool {
        self.digits.iter().all(|digits| *digits == self.digits[0])
    }

    /// Whether the numbers are distinct and as dense as those of a counter.
    pub(super) fn counts(&self) -> bool {
        let (min, max) = (self.values.iter().min().unwrap_or(&0), self.values.iter().max().unwrap_or(&0));
        self.is_unique() && max - min < MAX_COUNTER_STEP * self.values.len() as i128
    }

    /// Whether no two names have the same number.
    pub(super) fn is_unique(&self) -> bool {
        let mut sorted = self.values.clone();
        sorted.sort_unstable();
        sorted.windows(2).all(|pair| pair[0] != pair[1])
    }

    /// Returns the indices of the names in the order of their numbers.
    pub(super) fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.values.len()).collect();
        order.sort_by_key(|index| self.values[*index]);
        order
    }

    /// Describes the range of the numbers, as `the number after "img_" (0 to 35)`.
    pub(super) fn describe_range(&self) -> String {
        let (min, max) = (self.values.iter().min().unwrap_or(&0), self.values.iter().max().unwrap_or(&0));
        format!("the number after {:?} ({min} to {max})", self.before)
    }

    /// Appends the digits behind a decimal point; `None` when a number does not fit.
    pub(super) fn with_decimals(&self, decimals: &Self) -> Option<Self> {
        let places = *decimals.digits.first()?;
        let scale = 10_i128.checked_pow(places as u32)?;
        let join = |(whole, part): (&i128, &i128)| {
            let scaled = whole.checked_mul(scale)?;
            Some(if *whole < 0 { scaled - part } else { scaled + part })
        };
        Some(Self {
            after: decimals.after.clone(),
            values: self.values.iter().zip(&decimals.values).map(join).collect::<Option<_>>()?,
            decimals: places,
            ..self.clone()
        })
    }
}
