//! The files of a diagnosis.

use super::DiagnoseOptions;
use crate::console::{check_no_input, create_directory, print_line, write_file};
use crate::failure::Failure;
use crate::report::{Diagnosis, diagnosis_page};
use serde_json::{Value, json};
use std::path::PathBuf;

/// A page, or a folder with the page and its pictures.
pub(super) struct Target {
    page: PathBuf,
    folder: Option<PathBuf>,
}

impl Target {
    /// Chooses the page, or a folder for it, from `-o` or the film's name, and creates the folder.
    ///
    /// # Errors
    ///
    /// When the page would replace an input, or another file without `--force`, or the folder cannot be created.
    pub(super) fn new(options: &DiagnoseOptions) -> Result<Self, Failure> {
        let output = options.output.clone().unwrap_or_else(|| options.film[0].with_extension("diagnosis"));
        let is_page = output.extension().is_some_and(|extension| extension == "html");
        let target = match is_page {
            true => Self { page: output, folder: None },
            false => Self { page: output.join("index.html"), folder: Some(output) },
        };
        check_no_input(&target.page, &options.film)?;
        options.overwrite.check(&target.page)?;
        if let Some(folder) = &target.folder {
            create_directory("-o", folder)?;
        }
        Ok(target)
    }

    /// Returns the path of a file for the results, next to the page.
    pub(super) fn scratch(&self) -> PathBuf {
        let name = self.page.file_stem().unwrap_or_default().to_string_lossy();
        self.page.with_file_name(format!(".{name}-{}.mcap", std::process::id()))
    }

    /// Writes the page and the pictures, and prints where they are.
    pub(super) fn write(&self, diagnosis: &Diagnosis, options: &DiagnoseOptions) -> Result<(), Failure> {
        if let Some(folder) = &self.folder {
            for body in &diagnosis.bodies {
                for frame in &body.frames {
                    for (panel, kind) in frame.panels.iter().zip(["frame", "body"]) {
                        let name = format!("{}_{kind}_{:06}.png", body.name, frame.number);
                        write_file(&folder.join(name), &panel.png, options.overwrite)?;
                    }
                }
            }
            if let Some(movement) = &diagnosis.movement {
                write_file(&folder.join("movement.png"), &movement.png, options.overwrite)?;
            }
        }
        write_file(&self.page, diagnosis_page(diagnosis), options.overwrite)?;
        if options.json {
            print_line(&self.to_json(diagnosis).to_string());
        } else {
            print_line(&self.page.display().to_string());
        }
        Ok(())
    }

    /// Returns page, bodies and movers as JSON.
    fn to_json(&self, diagnosis: &Diagnosis) -> Value {
        let frames = |body: &crate::report::BodyDiagnosis| {
            let frame = |frame: &crate::report::FrameDiagnosis| {
                json!({
                    "frame": frame.number, "t_ms": frame.time_ms, "status": frame.status.as_str(),
                    "findings": frame.findings,
                })
            };
            body.frames.iter().map(frame).collect::<Vec<_>>()
        };
        let body = |body: &crate::report::BodyDiagnosis| {
            let changes = body.changes.iter().map(|change| json!({ "lines": change.lines, "reason": change.reason }));
            json!({
                "body": body.name, "line": body.line, "changes": changes.collect::<Vec<_>>(), "frames": frames(body),
            })
        };
        json!({
            "page": self.page, "bodies": diagnosis.bodies.iter().map(body).collect::<Vec<_>>(),
            "movers": diagnosis.movers,
        })
    }
}
