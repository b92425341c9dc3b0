//! `ricochet config`: the reference of the rig file.

use crate::config::{self, Config, Entry, Key, Section};
use crate::console::{Outcome, UsageError, print_line, wrapped};
use crate::failure::Failure;
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// The subcommands of `ricochet config`.
#[derive(Debug, Subcommand)]
pub enum ConfigCommand {
    /// Explain a key or a table of the rig file: meaning, allowed values, default.
    #[command(after_help = "Example: ricochet config explain body.diameter_mm")]
    Explain(ExplainOptions),
    /// Print the JSON Schema of the rig file, for editors.
    #[command(after_help = "Example: ricochet config schema > rig.schema.json")]
    Schema,
    /// Check a rig file without starting anything.
    #[command(after_help = "Example: ricochet config check rig.toml")]
    Check {
        /// Rig file.
        config: PathBuf,
    },
}

/// The options of `ricochet config explain`.
#[derive(Debug, Args)]
pub struct ExplainOptions {
    /// Key as `TABLE.KEY`, or table [default: all tables].
    pub key: Option<String>,
    /// Print JSON.
    #[arg(long, conflicts_with = "markdown")]
    pub json: bool,
    /// Print the whole reference as Markdown.
    #[arg(long, conflicts_with = "key")]
    pub markdown: bool,
}

/// Runs a subcommand.
///
/// # Errors
///
/// An unknown key, or a refused rig file.
pub fn run(command: &ConfigCommand) -> Result<Outcome, Failure> {
    match command {
        ConfigCommand::Schema => print_line(&serde_json::to_string_pretty(&config::schema())?),
        ConfigCommand::Check { config } => {
            Config::load(config)?;
            print_line(&format!("{}: no errors", config.display()));
        }
        ConfigCommand::Explain(options) if options.markdown => print_line(config::to_markdown().trim_end()),
        ConfigCommand::Explain(options) => explain(options)?,
    }
    Ok(Outcome::Clean)
}

/// Prints the reference of one key, of a table, or of all tables, as text or JSON.
fn explain(options: &ExplainOptions) -> Result<(), Failure> {
    let entry = options.key.as_deref().map(find_entry).transpose()?;
    if options.json {
        let value = match entry {
            None => config::reference().iter().map(Section::to_json).collect(),
            Some(Entry::Section(section)) => section.to_json(),
            Some(Entry::Key(section, key)) => key.to_json(section),
        };
        print_line(&value.to_string());
        return Ok(());
    }
    match entry {
        None => config::reference().iter().for_each(print_overview),
        Some(Entry::Section(section)) => {
            print_line(&format!("{}\n{}", section.header(), wrapped(&section.about(), 2)));
            section.keys.iter().for_each(|key| print_key(key.name, key));
        }
        Some(Entry::Key(section, key)) => print_key(&format!("{}.{}", section.path, key.name), key),
    }
    Ok(())
}

/// Finds a key or a table by its name.
///
/// # Errors
///
/// [`UsageError`] with the nearest name.
fn find_entry(name: &str) -> Result<Entry, UsageError> {
    config::find(name).map_err(|nearest| UsageError(format!("no key or table {name:?}; the nearest is {nearest}")))
}

/// Prints a table with the names of its keys.
fn print_overview(section: &Section) {
    let names: Vec<&str> = section.keys.iter().map(|key| key.name).collect();
    let about = wrapped(&section.about(), 2);
    print_line(&format!("{}\n{about}\n{}\n", section.header(), wrapped(&names.join(", "), 4)));
}

/// Prints a key under this name: type, meaning, allowed values and default.
fn print_key(name: &str, key: &Key) {
    let facts = [key.meaning(), format!("Must be {}.", key.allowed), format!("Default: {}.", key.default)];
    let facts: Vec<String> = facts.iter().map(|fact| wrapped(fact, 2)).collect();
    print_line(&format!("\n{name} ({})\n{}", key.value, facts.join("\n")));
}
