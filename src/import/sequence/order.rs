//! The order of images, and the number or the time of each, from their names.

use super::list::{Listed, Lister};
use super::names::{Column, Unnumbered, columns};
use super::times::{self, Dates};
use crate::import::ImportError;
use crate::import::timeline::FrameTimes;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Maximum number of gaps listed one by one.
const MAX_LISTED_GAPS: usize = 10;
/// The maximum typical step of a counter, in common divisors of all steps. Numbers with a larger one are times without
/// a unit.
const MAX_COUNTER_STEP: i128 = 8;

/// The images of a sequence in their order.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sequence {
    pub(super) paths: Vec<PathBuf>,
    /// Number of each image, with missing ones counted.
    pub(super) numbers: Vec<u64>,
    /// Time of each image, where the names state it.
    pub(super) times: Option<FrameTimes>,
    pub(super) warnings: Vec<String>,
}

impl Sequence {
    /// Puts images in the order of the numbers or times in their names.
    ///
    /// An order that no shell lists files in is kept, because the user means it.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when the names leave the order open: several series, several numbers that rise in
    /// different orders, the same number twice, a name unlike the others.
    pub(super) fn arrange(listed: Listed) -> Result<Self, ImportError> {
        let plain = Self {
            numbers: (0..listed.paths.len() as u64).collect(),
            paths: listed.paths.clone(),
            times: None,
            warnings: Vec::new(),
        };
        if listed.paths.len() == 1 {
            return Ok(plain);
        }
        let columns = match (columns(&listed.paths), listed.by) {
            (Ok(columns), _) => columns,
            (Err(Unnumbered::Odd(odd)), _) => {
                let reason = "its name is unlike those of the other images; leave it out of the sequence";
                return Err(ImportError::invalid(&listed.paths[odd], reason));
            }
            (Err(Unnumbered::Unlike), Lister::User) => {
                let warning = "the file names have no number in common: the images are taken in the order given";
                return Ok(Self { warnings: vec![warning.into()], ..plain });
            }
            (Err(Unnumbered::Unlike), Lister::Disk) => {
                let reason = "the file names have no number in common; pass the images one by one in their order";
                return Err(ImportError::invalid(&listed.paths[0], reason));
            }
        };
        let dates =
            times::from_dates(&columns).filter(|dates| columns[dates.places.clone()].iter().any(Column::varies));
        match dates {
            Some(Dates { times, places }) if !is_numbered(&columns, &places) || Dates::are_distinct(&times) => {
                let order = time_order(&times.times_ns);
                let mut sequence = Self::with_order(&listed, &order)?;
                let taken = times.reordered(&sequence.order_of(&listed));
                sequence.times = taken.times_ns.is_sorted().then_some(taken);
                Ok(sequence)
            }
            Some(Dates { times, places }) => Self::from_dated_column(&listed, columns, &times, &places),
            None => Self::from_column(&listed, &running_number(&listed.paths, &columns)?),
        }
    }

    /// Orders images by a number next to a date that is too coarse to time them. `places` are the columns of the date.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when the dates fall in that order, or no number counts the images.
    fn from_dated_column(
        listed: &Listed,
        mut columns: Vec<Column>,
        dates: &FrameTimes,
        places: &Range<usize>,
    ) -> Result<Self, ImportError> {
        columns.drain(places.clone());
        let column = running_number(&listed.paths, &columns)?;
        if !dates.reordered(&column.order()).times_ns.is_sorted() {
            let reason =
                format!("the order is not clear: by {}, or by the dates in the names", column.describe_range());
            return Err(ImportError::invalid(&listed.paths[0], reason));
        }
        Self::from_column(listed, &column)
    }

    /// Orders images by the numbers of a column, and numbers or times them by its values if these rise in the order
    /// taken.
    fn from_column(listed: &Listed, column: &Column) -> Result<Self, ImportError> {
        let order = column.order();
        let mut sequence = Self::with_order(listed, &order)?;
        if column.is_hyphened && column.values.iter().all(|value| *value > 0) && times::from_numbers(column).is_none() {
            sequence.warnings.extend(hyphen_warning(column));
        }
        let order = sequence.order_of(listed);
        let values: Vec<i128> = order.iter().map(|index| column.values[*index]).collect();
        if !values.is_sorted() {
            return Ok(sequence);
        }
        if let Some(times) = times::from_numbers(column) {
            sequence.times = Some(times.reordered(&order));
            return Ok(sequence);
        }
        sequence.number_images(&values);
        Ok(sequence)
    }

    /// Puts the images in this order, a list of places in the given list, unless the user gave one that no shell lists.
    /// Warns of either.
    fn with_order(listed: &Listed, order: &[usize]) -> Result<Self, ImportError> {
        let is_given = order.iter().enumerate().all(|(index, place)| index == *place);
        let is_meant = listed.by == Lister::User && !is_given && !is_listing(&listed.paths);
        let mut warnings = Vec::new();
        if is_meant {
            warnings.push(
                "the images are taken in the order given, which is not that of the numbers in their names".into(),
            );
        } else if !is_given && listed.by == Lister::User {
            warnings.push("the images are taken in the order of the numbers in their names, 2 before 10".into());
        }
        let taken = |index: &usize| listed.paths[*index].clone();
        let paths = if is_meant { listed.paths.clone() } else { order.iter().map(taken).collect() };
        Ok(Self { numbers: (0..paths.len() as u64).collect(), paths, times: None, warnings })
    }

    /// Returns the place of each image, in the order of the sequence, in the list that was given.
    fn order_of(&self, listed: &Listed) -> Vec<usize> {
        let places: std::collections::HashMap<&Path, usize> =
            listed.paths.iter().enumerate().map(|(place, path)| (path.as_path(), place)).collect();
        self.paths.iter().map(|path| places[path.as_path()]).collect()
    }

    /// Numbers the images by rising values, with missing images counted.
    ///
    /// The greatest common divisor of the steps is one frame, so that a sequence of every fifth image is complete too.
    /// Numbers that rise by much more than their divisor become times, one unit of which counts as 1 ns.
    fn number_images(&mut self, values: &[i128]) {
        let mut steps: Vec<i128> = values.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let divisor = steps.iter().copied().fold(0, greatest_common_divisor).max(1);
        steps.sort_unstable();
        let typical = steps[(steps.len() - 1) / 2];
        if typical > MAX_COUNTER_STEP * divisor {
            let times_ns = values.iter().map(|value| i64::try_from(value - values[0]).unwrap_or(i64::MAX)).collect();
            self.times = Some(FrameTimes { times_ns, resolution_ns: 1.0 });
            self.warnings
                .push(format!("the numbers in the file names rise like times, by about {typical}; they set the times"));
            return;
        }
        if typical != divisor {
            self.warnings.push(format!(
                "the numbers in the file names rise by {} to {}; one frame is a step of {divisor}",
                steps[0],
                steps[steps.len() - 1]
            ));
        }
        self.numbers = values.iter().map(|value| ((value - values[0]) / divisor) as u64).collect();
        self.warn_of_gaps();
    }

    /// Warns of missing images: up to [`MAX_LISTED_GAPS`] gaps one by one, more of them in one sentence.
    fn warn_of_gaps(&mut self) {
        let missing = self.numbers.windows(2).map(|pair| pair[1] - pair[0] - 1);
        let gaps: Vec<(u64, &PathBuf)> = missing.zip(&self.paths).filter(|(missing, _)| *missing > 0).collect();
        let gap = |(missing, path): &(u64, &PathBuf)| format!("{missing} images are missing after {}", path.display());
        let mut warnings: Vec<String> = gaps.iter().take(MAX_LISTED_GAPS).map(gap).collect();
        if gaps.len() > MAX_LISTED_GAPS {
            let missing: u64 = gaps.iter().map(|(missing, _)| missing).sum();
            warnings.push(format!("{missing} images are missing in {} places", gaps.len()));
        }
        self.warnings.extend(warnings);
    }

    /// Reverses the sequence with its gaps and times.
    pub(super) fn reverse(&mut self) {
        self.paths.reverse();
        let last = self.numbers.last().copied().unwrap_or_default();
        self.numbers = self.numbers.iter().rev().map(|number| last - number).collect();
        self.times = self.times.take().map(FrameTimes::reversed);
    }
}

/// Finds the number that counts the images.
///
/// # Errors
///
/// [`ImportError::Invalid`] when there is none, or several numbers order the images differently.
fn running_number(paths: &[PathBuf], columns: &[Column]) -> Result<Column, ImportError> {
    let columns = joined_decimals(columns);
    let running: Vec<&Column> = columns.iter().filter(|column| column.varies()).collect();
    let refuse = |reason: String| Err(ImportError::invalid(&paths[0], reason));
    let unique: Vec<&Column> = running.iter().copied().filter(|column| column.is_unique()).collect();
    match (unique.as_slice(), running.as_slice()) {
        (_, []) => refuse("all images have the same number; pass the images of one series".into()),
        ([], [only]) => {
            let order = only.order();
            let same = order.windows(2).find(|pair| only.values[pair[0]] == only.values[pair[1]]);
            let names = same.map(|pair| format!("{} and {}", paths[pair[0]].display(), paths[pair[1]].display()));
            refuse(format!("two images have the same number: {}", names.unwrap_or_default()))
        }
        ([], [first, second, ..]) => refuse(format!(
            "the names hold more than one running number: {}, or {}; pass the images of one series",
            first.describe_range(),
            second.describe_range()
        )),
        (unique, running) => {
            // The number with the smallest range counts frames, the others are times or the like.
            let range = |column: &&&Column| {
                let extreme = |value: Option<&i128>| value.copied().unwrap_or_default();
                extreme(column.values.iter().max()) - extreme(column.values.iter().min())
            };
            let Some(counter) = unique.iter().min_by_key(range) else { return refuse("no number".into()) };
            let order = counter.order();
            let falls =
                |column: &&&Column| order.windows(2).any(|pair| column.values[pair[0]] > column.values[pair[1]]);
            match running.iter().find(falls) {
                Some(other) => refuse(format!(
                    "the order is not clear: by {}, or by {}; pass the images one by one in their order",
                    counter.describe_range(),
                    other.describe_range()
                )),
                None => Ok((*counter).clone()),
            }
        }
    }
}

/// Returns the columns with two numbers that have a point between them, as `0.0002`, joined to one, where all names
/// have as many decimals.
fn joined_decimals(columns: &[Column]) -> Vec<Column> {
    let mut joined: Vec<Column> = Vec::new();
    for column in columns {
        let whole = joined.last().filter(|whole| whole.after == "." && whole.decimals == 0 && column.is_padded());
        match whole.and_then(|whole| whole.with_decimals(column)) {
            Some(decimal) => {
                joined.pop();
                joined.push(decimal);
            }
            None => joined.push(column.clone()),
        }
    }
    joined
}

/// Returns the warning of a hyphen before the numbers of a column that may be meant as their sign; `None` without
/// numbers.
fn hyphen_warning(column: &Column) -> Option<String> {
    let least = column.values.iter().min()?;
    Some(format!(
        "the hyphen before the numbers is no sign: {least} is the first image; pass --reverse if they are negative"
    ))
}

/// Whether a shell lists the files in this order: by their bytes, or by the rules of a language.
fn is_listing(paths: &[PathBuf]) -> bool {
    let letters = |path: &Path| -> String {
        let name = path.to_string_lossy();
        name.chars().filter(|letter| letter.is_alphanumeric()).flat_map(char::to_lowercase).collect()
    };
    // Newer rules have punctuation before digits, older ones leave it out.
    let ranked = |path: &Path| -> Vec<(bool, char)> {
        let name = path.to_string_lossy().to_lowercase();
        name.chars().map(|letter| (letter.is_alphanumeric(), letter)).collect()
    };
    paths.windows(2).all(|pair| pair[0].as_os_str() <= pair[1].as_os_str())
        || paths.windows(2).all(|pair| letters(&pair[0]) <= letters(&pair[1]))
        || paths.windows(2).all(|pair| ranked(&pair[0]) <= ranked(&pair[1]))
}

/// Whether a column of numbers other than those at these places varies.
fn is_numbered(columns: &[Column], places: &Range<usize>) -> bool {
    columns.iter().enumerate().any(|(place, column)| !places.contains(&place) && column.varies())
}

/// Returns the indices of the images in the order of their times.
fn time_order(times_ns: &[i64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..times_ns.len()).collect();
    order.sort_by_key(|index| times_ns[*index]);
    order
}

/// Returns the greatest common divisor by Euclid's algorithm; that of a number and 0 is the number.
fn greatest_common_divisor(a: i128, b: i128) -> i128 {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}
