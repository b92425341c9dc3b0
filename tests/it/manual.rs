//! The README and the pages of docs/: every command runs, and prints what the page shows.
//!
//! A block that begins with `sh` is run line by line, in the order of the page. A block `text` right behind it is what
//! these commands print: `...` stands for anything. A block `toml` is saved under the name that the text before it gives.
//! A paragraph that ends with a colon names what its block needs: a camera, ffmpeg or OpenCV.

use crate::support::{Background, Rig, frames, is_required, succeed, wait_until};
use ricochet::cli::{self, Parsed};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The fenced block of a page, with what the page says of it.
struct Block<'p> {
    language: &'p str,
    text: &'p str,
    /// The paragraph in front of it, on one line.
    lead: String,
    /// The first line of the block, from 1.
    line: usize,
}

/// The blocks of a page, in their order.
fn blocks(page: &str) -> Vec<Block<'_>> {
    let mut blocks = Vec::new();
    let mut rest = page;
    while let Some((before, after)) = rest.split_once("```") {
        let (language, inside) = after.split_once('\n').unwrap();
        let (text, behind) = inside.split_once("```").unwrap();
        let lead = squeezed(before.trim_end().rsplit("\n\n").next().unwrap());
        let line = page.len() - inside.len();
        blocks.push(Block { language, text, lead, line: page[..line].matches('\n').count() + 1 });
        rest = behind;
    }
    blocks
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(page: &str) -> String {
    std::fs::read_to_string(root().join(page)).unwrap()
}

/// Equipment that a machine may lack, by the words for it on the pages.
const NEEDS: [(&str, Need); 3] = [
    ("With a camera attached", Need::Camera),
    ("With ffmpeg installed", Need::Tool { variable: "FFMPEG", trial: "ffmpeg -version" }),
    (
        "With NumPy and OpenCV installed",
        Need::Tool { variable: "OPENCV", trial: "python3 -c 'import cv2, mcap_protobuf'" },
    ),
];

#[derive(Clone, Copy)]
enum Need {
    /// The commands are only parsed.
    Camera,
    /// The commands are run where `trial` succeeds, and have to where `RICOCHET_REQUIRE_` and `variable` says so.
    Tool { variable: &'static str, trial: &'static str },
}

impl Need {
    fn of(block: &Block<'_>) -> Option<Self> {
        NEEDS.iter().find(|(words, _)| block.lead.contains(words)).map(|(_, need)| *need)
    }

    /// Whether the machine has it.
    fn is_met(self) -> bool {
        let Self::Tool { variable, trial } = self else { return false };
        let tried = Command::new("bash").args(["-c", trial]).output().unwrap().status.success();
        assert!(tried || !is_required(variable), "{trial} fails");
        tried
    }
}

/// A folder to follow a page in: the project's files, and pictures of your own.
struct Session {
    rig: Rig,
    running: Vec<Background>,
}

/// Names of rigs that the pages use.
const RIGS: [&str; 4] = ["lacrosse", "several", "drop", "webcam"];

impl Session {
    fn new() -> Self {
        let rig = Rig::new();
        let session = Self { rig, running: Vec::new() };
        for folder in ["config", "recordings", "examples", "bin", "images"] {
            std::fs::create_dir(session.path(folder)).unwrap();
        }
        for entry in std::fs::read_dir(root().join("config")).unwrap() {
            let path = entry.unwrap().path();
            let text = session.renamed(&std::fs::read_to_string(&path).unwrap());
            std::fs::write(session.path("config").join(path.file_name().unwrap()), text).unwrap();
        }
        let recording = root().join("recordings/lacrosse.mcap");
        std::fs::copy(&recording, session.path("recordings/lacrosse.mcap")).unwrap();
        // The scripts of the examples start the program that was built beside them.
        std::fs::create_dir_all(session.path("target/release")).unwrap();
        for place in ["bin/ricochet", "target/release/ricochet"] {
            std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_ricochet"), session.path(place)).unwrap();
        }
        for example in ["lucas_kanade.py", "hough_circle.py", "gallery.sh"] {
            std::fs::copy(root().join("examples").join(example), session.path("examples").join(example)).unwrap();
        }
        session.save_pictures(&recording);
        session
    }

    fn path(&self, name: &str) -> PathBuf {
        self.rig.path(name)
    }

    /// Saves frames of a recording as the pictures that the pages use.
    fn save_pictures(&self, recording: &Path) {
        let frames = frames(recording);
        let save = |index: usize, name: &str| {
            let (meta, bytes) = &frames[index];
            image::save_buffer(self.path(name), bytes, meta.width_px, meta.height_px, image::ColorType::L8).unwrap();
        };
        let named = ["before", "after", "rest", "load_1", "load_2", "turned"];
        for (name, index) in named.iter().zip([10, 11, 0, 4, 8, 60]) {
            save(index, &format!("{name}.bmp"));
        }
        (0..40).for_each(|index| save(index, &format!("images/{index:04}.png")));
    }

    /// Gives the rigs of a text names that no other test has.
    fn renamed(&self, text: &str) -> String {
        RIGS.iter().fold(text.to_owned(), |text, rig| {
            let own = format!("{rig}-{}", self.rig.name);
            text.replace(&format!("[rig]\nname = \"{rig}\""), &format!("[rig]\nname = \"{own}\""))
                .replace(&format!("--rig {rig}"), &format!("--rig {own}"))
        })
    }

    fn shell(&self, line: &str) -> Command {
        let mut command = Command::new("bash");
        let path = format!("{}:{}", self.path("bin").display(), std::env::var("PATH").unwrap());
        command.args(["-c", line]).current_dir(self.path("")).env("PATH", path).stdin(std::process::Stdio::null());
        command
    }

    /// Runs one line to its end, again while no rig answers.
    fn run(&mut self, line: &str) -> String {
        let line = self.renamed(line);
        if let Some(line) = line.strip_suffix(" &") {
            self.running.push(Background::start(self.shell(&format!("exec {line}"))));
            return String::new();
        }
        let output: Output = wait_until(&line, || {
            let output = self.shell(&line).output().unwrap();
            (output.status.code() != Some(4)).then_some(output)
        });
        let printed = [output.stdout, output.stderr].concat();
        let printed = String::from_utf8(printed).unwrap();
        assert!(output.status.success(), "{line}: {}\n{printed}", output.status);
        printed
    }
}

/// The commands of a block, without the comments behind them.
fn commands<'p>(block: &Block<'p>) -> impl Iterator<Item = &'p str> {
    let command = |line: &'p str| line.split(" #").next().unwrap().trim();
    block.text.lines().map(command).filter(|line| !line.is_empty())
}

/// The words of a command of the program, quotes taken off, as a shell would.
fn words(command: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut is_quoted = false;
    for letter in command.trim_end_matches('&').trim().chars() {
        match letter {
            '"' => is_quoted = !is_quoted,
            ' ' if !is_quoted => words.push(String::new()),
            letter => words.last_mut().unwrap().push(letter),
        }
    }
    words
}

/// The parts of a line, spaces put aside.
fn squeezed(line: &str) -> String {
    line.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Whether a line has the pieces of a pattern in their order, and ends where it ends.
fn is_like(line: &str, pattern: &str) -> bool {
    let pieces: Vec<&str> = pattern.split("...").collect();
    let Some(mut rest) = line.strip_prefix(pieces[0]) else { return false };
    for piece in &pieces[1..] {
        match rest.find(piece) {
            Some(at) => rest = &rest[at + piece.len()..],
            None => return false,
        }
    }
    rest.is_empty() || pattern.ends_with("...")
}

/// Every line that a page shows stands in what was printed, in this order.
fn shows(page: &str, block: &Block<'_>, printed: &str) {
    let mut lines = printed.lines().map(squeezed);
    for (line, shown) in (block.line..).zip(block.text.lines().map(squeezed)) {
        let is_there = shown == "..." || lines.any(|line| is_like(&line, &shown));
        assert!(is_there, "{page}:{line}: not printed: {shown}\n{printed}");
    }
}

/// Follows a page from its top to its end.
fn follow(page: &str) {
    let text = read(page);
    let blocks = blocks(&text);
    let mut session = Session::new();
    let mut printed = String::new();
    for block in &blocks {
        match block.language {
            "toml" => {
                let name = block.lead.split('`').nth(1).unwrap_or_else(|| panic!("{page}:{}: no name", block.line));
                std::fs::write(session.path(name), session.renamed(block.text)).unwrap();
            }
            "sh" if Need::of(block).is_none_or(Need::is_met) => {
                if block.text.contains("film.avi") {
                    session.run("ffmpeg -loglevel error -i images/%04d.png -c:v ffv1 -pix_fmt gray film.avi");
                }
                if block.text.contains("phone.mp4") && !session.path("phone.mp4").exists() {
                    session.run("ricochet export recordings/lacrosse.mcap --topic frames --format mp4 -o phone.mp4");
                }
                printed = commands(block).map(|line| session.run(&as_installed(line))).collect();
            }
            "sh" => {
                eprintln!("left out: {page}:{}: {}", block.line, block.lead);
                printed.clear();
            }
            "text" if !printed.is_empty() => shows(page, block, &std::mem::take(&mut printed)),
            _ => {}
        }
    }
}

/// A command that builds the program first, as one of the built program.
fn as_installed(command: &str) -> String {
    match command.strip_prefix("cargo run --release -- ") {
        Some(arguments) => format!("ricochet {arguments}"),
        // What this test runs within; `tidy` sees that CI runs it.
        None if command == "cargo test --release" => "true".into(),
        None => command.into(),
    }
}

#[test]
fn the_readme_shows_what_its_commands_print() {
    assert!(read("README.md").lines().count() <= 150);
    follow("README.md");
}

#[test]
fn the_guide_can_be_followed() {
    follow("docs/guide.md");
}

#[test]
fn the_page_of_the_cameras_can_be_followed() {
    if crate::fake_gige::aravis_or_leave_out().is_some() {
        follow("docs/cameras.md");
    }
}

#[test]
fn the_short_guides_can_be_followed() {
    ["docs/phone.md", "docs/scale.md", "docs/rate.md", "docs/reading-report.md"].into_iter().for_each(follow);
}

/// The pages that the table of contents names, in its order.
fn contents() -> Vec<String> {
    let summary = read("docs/SUMMARY.md");
    let targets = summary.split("](").skip(1).map(|rest| rest.split(')').next().unwrap());
    targets.map(|page| format!("docs/{page}")).collect()
}

#[test]
fn the_book_has_each_page_once() {
    let mut named = contents();
    let mut pages: Vec<String> = pages().into_iter().filter(|page| page.starts_with("docs/")).collect();
    pages.retain(|page| page != "docs/SUMMARY.md");
    named.sort();
    pages.sort();
    assert_eq!(named, pages);
    assert!(read("book.toml").contains("src = \"docs\""));
}

#[test]
fn the_table_of_exit_codes_is_the_same_on_each_page_and_in_the_help() {
    let help = succeed(["--help"]);
    for code in ["0", "1", "2", "3", "4", "5", "6", "7", "130"] {
        assert!(help.lines().any(|line| line.trim_start().starts_with(&format!("{code}  "))), "{code}: {help}");
        for page in ["docs/guide.md", "docs/statuses.md"] {
            let text = read(page);
            let row = [format!("| {code} | "), format!("| {code}, ")];
            assert!(text.lines().any(|line| row.iter().any(|row| line.starts_with(row))), "{page}: {code}");
        }
    }
}

#[test]
fn each_status_is_explained_with_its_cure() {
    let page = read("docs/statuses.md");
    for status in ricochet::results::PointStatus::ALL {
        assert!(page.contains(&format!("| `{}` |", status.as_str())), "{status:?}");
    }
    let keys = ricochet::results::PointStatus::ALL
        .into_iter()
        .filter_map(|status| status.reason(ricochet::results::BodyKind::Ball))
        .map(|reason| reason.keys[0]);
    keys.for_each(|key| assert!(page.contains(key), "{key}"));
}

/// Every page that people read.
fn pages() -> Vec<String> {
    let docs = std::fs::read_dir(root().join("docs")).unwrap().map(|entry| entry.unwrap().file_name());
    let docs = docs.map(|name| format!("docs/{}", name.to_str().unwrap())).filter(|name| name.ends_with(".md"));
    ["README.md", "ARCHITECTURE.md", "CONVENTIONS.md"].map(str::to_owned).into_iter().chain(docs).collect()
}

#[test]
fn every_command_of_every_page_is_understood() {
    let pages = pages();
    let mut count = 0;
    for page in &pages {
        let text = read(page);
        for block in blocks(&text).iter().filter(|block| block.language == "sh") {
            for command in commands(block).map(as_installed).filter(|command| command.starts_with("ricochet ")) {
                let understood = matches!(cli::parse_from(words(&command)), Parsed::Run(_));
                assert!(understood, "{page}:{}: {command}", block.line);
                count += 1;
            }
        }
    }
    assert!(count > 60, "{count} commands in {pages:?}");
}

/// The anchor of a heading, as viewers of Markdown make it.
fn anchor(heading: &str) -> String {
    let plain: String = heading.trim_start_matches('#').trim().to_lowercase();
    plain
        .chars()
        .filter(|c| c.is_alphanumeric() || " -_".contains(*c))
        .map(|c| if c == ' ' { '-' } else { c })
        .collect()
}

#[test]
fn every_link_between_pages_resolves() {
    let mut pages = pages();
    pages.extend(["CONTRIBUTING.md".into(), "SECURITY.md".into()]);
    let mut count = 0;
    for page in &pages {
        let text = read(page);
        let folder = Path::new(page).parent().unwrap();
        for target in text.split("](").skip(1).map(|rest| rest.split(')').next().unwrap()) {
            if target.starts_with("http") {
                continue;
            }
            let (file, part) = target.split_once('#').unwrap_or((target, ""));
            let path = if file.is_empty() { PathBuf::from(page) } else { folder.join(file) };
            assert!(root().join(&path).exists(), "{page}: no {target}");
            if !part.is_empty() {
                let linked = std::fs::read_to_string(root().join(&path)).unwrap();
                let found = linked.lines().filter(|line| line.starts_with('#')).any(|line| anchor(line) == part);
                assert!(found, "{page}: no heading for {target}");
            }
            count += 1;
        }
    }
    assert!(count > 30, "{count} links");
}

/// Every file below a folder of the project.
fn files(folder: &Path) -> Vec<String> {
    let paths = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    paths.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path.to_str().unwrap().to_owned()] }).collect()
}

#[test]
fn every_file_that_the_architecture_names_exists() {
    let all: Vec<String> =
        ["src", "tests", "docs", "examples"].iter().flat_map(|folder| files(&root().join(folder))).collect();
    let page = read("ARCHITECTURE.md");
    let named = page.split('`').skip(1).step_by(2).filter(|name| name.ends_with(".rs") || name.ends_with(".sh"));
    for name in named.filter(|name| !name.contains(' ')) {
        assert!(all.iter().any(|file| file.ends_with(&format!("/{name}"))), "ARCHITECTURE.md: there is no {name}");
    }
}

#[test]
fn every_test_that_a_page_names_exists() {
    let listed = Command::new(std::env::current_exe().unwrap()).arg("--list").output().unwrap();
    let listed = String::from_utf8(listed.stdout).unwrap();
    let sources = files(&root().join("src"));
    for page in pages() {
        for named in squeezed(&read(&page)).split("cargo test --release --test it ").skip(1) {
            let filter = named.split([' ', '`']).next().unwrap();
            assert!(listed.lines().any(|test| test.contains(filter)), "{page}: no test is named {filter}");
        }
        for named in squeezed(&read(&page)).split("cargo test --release --lib ").skip(1) {
            let filter = named.split([' ', '`']).next().unwrap();
            let path = filter.replace("::", "/");
            assert!(sources.iter().any(|file| file.contains(&path)), "{page}: no room or file is named {filter}");
        }
    }
}

/// After a change that is meant, `RICOCHET_WRITE_GOLDEN=1` writes them.
#[test]
fn the_figures_of_the_readme_are_those_of_the_demo() {
    let mut session = Session::new();
    session.run("ricochet demo");
    for (figure, name) in [("fig18-field", "impact-field"), ("fig20-velocity", "impact-velocity")] {
        let drawn = std::fs::read_dir(session.path("shots")).unwrap().map(|entry| entry.unwrap().path());
        let drawn = drawn.into_iter().find(|path| path.to_string_lossy().ends_with(&format!("{figure}.svg"))).unwrap();
        let (drawn, page) = (std::fs::read_to_string(drawn).unwrap(), root().join(format!("docs/{name}.svg")));
        if std::env::var_os("RICOCHET_WRITE_GOLDEN").is_some_and(|value| value == "1") {
            std::fs::write(&page, &drawn).unwrap();
        }
        assert!(
            std::fs::read_to_string(&page).unwrap() == drawn,
            "docs/{name}.svg is not what `ricochet demo` draws; RICOCHET_WRITE_GOLDEN=1 writes it"
        );
    }
}
