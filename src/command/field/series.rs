//! A series of targets, correlated with one reference until it has to be updated.

use std::io::BufWriter;
use std::path::{Path, PathBuf};

use super::stills::Still;
use super::table::Layout;
use super::{Begin, FieldOptions, Size, save_picture, standard_output_error, start, stills, summarize_field};
use crate::console::{Outcome, UsageError, check_no_input, create_directory, progress};
use crate::dic::{Correlator, Series};
use crate::failure::Failure;
use crate::image::ImageView;
use crate::interrupt::{self, Unfinished};
use crate::results::FieldPoint;

/// Measures every target and prints one summary line each.
pub(super) fn run(options: &FieldOptions) -> Result<Outcome, Failure> {
    check_options(options)?;
    let targets: Vec<&Path> = std::iter::once(&options.target).chain(&options.later).map(PathBuf::as_path).collect();
    // All sizes are checked first, so that a wrong image is reported before the first measurement.
    let reference = Still { path: &options.reference, size: stills::read_size(&options.reference)? };
    for target in &targets {
        reference.check_size(&Still { path: target, size: stills::read_size(target)? })?;
    }
    let Size { width, height } = reference.size;
    let mut correlator = Correlator::new(&options.params, width, height)?;
    let points = stills::field_points(options, reference.size)?;
    correlator.set_region(options.cut_region());
    let outputs = Outputs::create(options, &targets)?;
    let first = stills::read_still(&options.reference)?;
    let mut series = Series::new(correlator, first.view(), &points);
    let mut field = Vec::new();
    let bar = progress::bar(targets.len() as u64, "field");
    for (index, target) in targets.iter().enumerate() {
        let picture = bar.suspend(|| stills::read_still(target))?;
        let view = picture.view();
        reference.check_size(&Still { path: target, size: Size::from_view(view) })?;
        let renewals = series.renewals();
        series.push(view, &mut field);
        let is_renewed = series.renewals() > renewals;
        bar.suspend(|| -> Result<(), Failure> {
            let legend = outputs.write(index, target, first.view(), &field)?;
            let renewed = is_renewed.then(|| "reference updated".to_owned());
            let notes: Vec<String> = [Some(summarize_field(&field)), renewed, legend].into_iter().flatten().collect();
            eprintln!("{}: {}", target.display(), notes.join("; "));
            Ok(())
        })?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(Outcome::Clean)
}

/// Checks that the options allow a series.
///
/// # Errors
///
/// [`UsageError`] naming the option and the allowed values.
fn check_options(options: &FieldOptions) -> Result<(), UsageError> {
    if options.begin != Begin::Neighbor {
        let word = Begin::WORDS.iter().find(|(_, begin)| *begin == options.begin).map_or("", |(word, _)| word);
        return Err(UsageError(format!(
            "--start {word}: not allowed with several targets, which start from the previous one"
        )));
    }
    // When the reference is updated, the subset itself supplies the rotation and stretch of its material so far.
    start::check_turns("several targets", &options.params)
}

/// The output files of a series.
struct Outputs<'a> {
    options: &'a FieldOptions,
    /// Digits of a file's number, so that alphabetical order is the order of the series.
    digits: usize,
    /// The notes of the new files, which are complete only together.
    unfinished: Vec<Unfinished>,
}

impl<'a> Outputs<'a> {
    /// Creates the directories and writes the table header to standard output.
    ///
    /// # Errors
    ///
    /// When an image would be overwritten, files of a longer series would remain, or a directory cannot be created.
    fn create(options: &'a FieldOptions, targets: &[&Path]) -> Result<Self, Failure> {
        let digits = targets.len().to_string().len().max(4);
        let mut outputs = Self { options, digits, unfinished: Vec::new() };
        let paths = |index: usize| [outputs.table_path(index), outputs.picture_path(index)].into_iter().flatten();
        let (existing, new): (Vec<_>, Vec<_>) = (0..targets.len()).flat_map(paths).partition(|path| path.exists());
        for path in existing {
            check_no_input(&path, std::iter::once(options.reference.as_path()).chain(targets.iter().copied()))?;
        }
        if let Some(path) = paths(targets.len()).find(|path| path.exists()) {
            let reason =
                format!("{}: cannot write next to it: it belongs to a longer series; delete it first", path.display());
            return Err(UsageError(reason).into());
        }
        for (option, path) in [("--output", &options.output), ("--picture", &options.picture)] {
            if let Some(path) = path {
                create_directory(option, path)?;
            }
        }
        if options.output.is_none() {
            outputs.layout().write_header(std::io::stdout().lock()).map_err(standard_output_error)?;
        }
        outputs.unfinished = new.iter().map(|path| interrupt::note(path)).collect();
        Ok(outputs)
    }

    /// Returns the layout; on standard output all fields share one table.
    fn layout(&self) -> Layout {
        Layout { json: self.options.json, named: self.options.output.is_none() }
    }

    /// Returns the table of a target; `None` for standard output.
    fn table_path(&self, index: usize) -> Option<PathBuf> {
        self.numbered_path(self.options.output.as_ref(), index, if self.options.json { "jsonl" } else { "csv" })
    }

    /// Returns the picture of a target; `None` without pictures.
    fn picture_path(&self, index: usize) -> Option<PathBuf> {
        self.numbered_path(self.options.picture.as_ref(), index, "png")
    }

    /// Returns `field_0001.csv` and so on in a directory, for targets counted from 0; `None` without a directory.
    fn numbered_path(&self, directory: Option<&PathBuf>, index: usize, extension: &str) -> Option<PathBuf> {
        let digits = self.digits;
        directory.map(|directory| directory.join(format!("field_{:0digits$}.{extension}", index + 1)))
    }

    /// Writes the table and the picture of the target of this index, from 0, over the `first` image; returns the legend
    /// of a map.
    fn write(
        &self,
        index: usize,
        target: &Path,
        first: ImageView<'_>,
        field: &[FieldPoint],
    ) -> Result<Option<String>, Failure> {
        match self.table_path(index) {
            Some(path) => self.layout().write_file(&path, field, self.options.overwrite)?,
            None => {
                let out = BufWriter::new(std::io::stdout().lock());
                self.layout().write_rows(field, target, out).map_err(standard_output_error)?;
            }
        }
        match self.picture_path(index) {
            Some(path) => save_picture(self.options, first, field, &path),
            None => Ok(None),
        }
    }
}
