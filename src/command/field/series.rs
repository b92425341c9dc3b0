//! Several targets: each against one reference, which is kept as long as it serves.

use std::collections::BTreeSet;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use super::table::Layout;
use super::{Begin, FieldError, FieldOptions, folder, save_picture, start, stills, summary, to_standard_output};
use crate::command::{Outcome, progress};
use crate::dic::{Correlator, Series};
use crate::image::ImageView;
use crate::process::Stop;
use crate::results::FieldPoint;

/// Measures every target and tells one line of each.
pub(super) fn run(options: &FieldOptions, stop: &Stop) -> Result<Outcome, FieldError> {
    check(options)?;
    let targets: Vec<&Path> = std::iter::once(&options.target).chain(&options.later).map(PathBuf::as_path).collect();
    // All are looked at before the first is measured: a wrong one is told at once.
    let reference = (options.reference.as_path(), stills::size_px(&options.reference)?);
    for target in &targets {
        stills::check_size(reference, (target, stills::size_px(target)?))?;
    }
    let (width, height) = reference.1;
    let mut correlator = Correlator::new(&options.params, width, height)?;
    let points = stills::points_of(options, (width, height))?;
    correlator.set_region(options.cut());
    let outputs = Outputs::make(options, &targets)?;
    let first = stills::read_still(&options.reference)?;
    let mut series = Series::new(correlator, first.view(), &points);
    let mut field = Vec::new();
    let bar = progress::frames(targets.len() as u64, "field");
    for (index, target) in targets.iter().enumerate() {
        if stop.requested() {
            let cause = Some("stopped before every target was measured".to_owned());
            return Ok(Outcome::Lost { count: (targets.len() - index) as u64, cause });
        }
        let picture = bar.suspend(|| stills::read_still(target))?;
        let view = picture.view();
        stills::check_size(reference, (target, (view.width(), view.height())))?;
        let renewals = series.renewals();
        series.push(view, &mut field);
        let is_renewed = series.renewals() > renewals;
        bar.suspend(|| -> Result<(), FieldError> {
            let legend = outputs.write(index, target, first.view(), &field)?;
            let renewed = is_renewed.then(|| "the reference is renewed by it".to_owned());
            let told: Vec<String> = [Some(summary(&field)), renewed, legend].into_iter().flatten().collect();
            eprintln!("{}: {}", target.display(), told.join("; "));
            Ok(())
        })?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(Outcome::Clean)
}

/// Refuses what a series cannot do.
///
/// # Errors
///
/// One line naming the option and what is allowed.
fn check(options: &FieldOptions) -> Result<(), FieldError> {
    if options.begin != Begin::Neighbor {
        let word = Begin::WORDS.iter().find(|(_, begin)| *begin == options.begin).map_or("", |(word, _)| word);
        return Err(FieldError::Usage(format!(
            "--start {word}: with several targets a subset begins where the target before had it; leave it out"
        )));
    }
    // When the reference is renewed, it is the subset that tells how far its material has turned and stretched.
    start::check_turns("several targets", &options.params)
}

/// Where tables and pictures go.
struct Outputs<'a> {
    options: &'a FieldOptions,
    /// Digits of a file's number: names in order of the alphabet are in order of the series.
    digits: usize,
}

impl<'a> Outputs<'a> {
    /// Makes the directories, and the head of a table on standard output.
    ///
    /// # Errors
    ///
    /// One line when an image would be overwritten, when files of a longer series would stay behind, or a directory
    /// cannot be made.
    fn make(options: &'a FieldOptions, targets: &[&Path]) -> Result<Self, FieldError> {
        let outputs = Self { options, digits: targets.len().to_string().len().max(4) };
        let inputs: BTreeSet<PathBuf> = std::iter::once(&options.reference.as_path())
            .chain(targets)
            .filter_map(|path| path.canonicalize().ok())
            .collect();
        let paths = |index: usize| [outputs.table(index), outputs.picture(index)].into_iter().flatten();
        for path in (0..targets.len()).flat_map(paths) {
            if path.canonicalize().is_ok_and(|path| inputs.contains(&path)) {
                let told = format!("{}: is one of the images, and would be overwritten", path.display());
                return Err(FieldError::Usage(told));
            }
        }
        if let Some(path) = paths(targets.len()).find(|path| path.exists()) {
            let told = format!("{}: is of a longer series, and would seem to be of this one", path.display());
            return Err(FieldError::Usage(told));
        }
        for (option, path) in [("--output", &options.output), ("--picture", &options.picture)] {
            if let Some(path) = path {
                folder::make(option, path)?;
            }
        }
        if options.output.is_none() {
            outputs.layout().head(std::io::stdout().lock()).map_err(to_standard_output)?;
        }
        Ok(outputs)
    }

    /// On standard output all fields are in one table.
    fn layout(&self) -> Layout {
        Layout { json: self.options.json, named: self.options.output.is_none() }
    }

    fn table(&self, index: usize) -> Option<PathBuf> {
        self.file(self.options.output.as_ref(), index, if self.options.json { "jsonl" } else { "csv" })
    }

    fn picture(&self, index: usize) -> Option<PathBuf> {
        self.file(self.options.picture.as_ref(), index, "png")
    }

    fn file(&self, directory: Option<&PathBuf>, index: usize, extension: &str) -> Option<PathBuf> {
        let digits = self.digits;
        directory.map(|directory| directory.join(format!("field_{:0digits$}.{extension}", index + 1)))
    }

    /// Writes the table and the picture of one target; gives the legend of a map.
    fn write(
        &self,
        index: usize,
        target: &Path,
        first: ImageView<'_>,
        field: &[FieldPoint],
    ) -> Result<Option<String>, FieldError> {
        match self.table(index) {
            Some(path) => self.layout().write_file(&path, field)?,
            None => {
                let out = BufWriter::new(std::io::stdout().lock());
                self.layout().rows(field, target, out).map_err(to_standard_output)?;
            }
        }
        match self.picture(index) {
            Some(path) => save_picture(self.options, first, field, &path),
            None => Ok(None),
        }
    }
}
