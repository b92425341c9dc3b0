//! A page as headless Chromium shows it.

use std::path::Path;
use std::process::{Command, Output};

/// The width of the page, and a height that is enough for all of it, px.
pub const SIZE_PX: [u32; 2] = [1100, 6000];

/// The result of showing a page.
pub struct Shown {
    pub picture: image::RgbImage,
    /// Addresses that the page requested, other than its own.
    pub requests: Vec<String>,
    /// Console output, including errors.
    pub console: Vec<String>,
    /// Left, top, width and height of the elements asked for, px.
    pub boxes: Vec<[f64; 4]>,
    /// Width and height of the whole content, px.
    pub content_px: [f64; 2],
}

/// The name of an installed Chromium; reports that the test was left out if there is none.
pub fn program() -> Option<&'static str> {
    let program = ["chromium", "chromium-browser", "google-chrome"]
        .into_iter()
        .find(|name| Command::new(name).arg("--version").output().is_ok_and(|output| output.status.success()));
    if program.is_none() {
        let required = crate::support::is_required("CHROMIUM");
        assert!(!required, "Chromium is required but not installed");
        eprintln!("left out: no Chromium to render the page with");
    }
    program
}

/// Shows a page and measures the elements of `selector`. Reports that the test was left out if there is no Chromium.
pub fn show(page: &Path, selector: &str) -> Option<Shown> {
    let program = program()?;
    let folder = tempfile::tempdir().unwrap();
    let (picture, log) = (folder.path().join("page.png"), folder.path().join("net.json"));
    let options = [format!("--screenshot={}", picture.display()), format!("--log-net-log={}", log.display())];
    let output = run(program, folder.path(), page, &options);
    let messages = String::from_utf8_lossy(&output.stderr).into_owned();
    let (boxes, content_px) = measure(program, folder.path(), page, selector);
    Some(Shown {
        picture: image::open(&picture).unwrap().into_rgb8(),
        requests: requests(&std::fs::read_to_string(&log).unwrap()),
        console: messages.lines().filter(|line| line.contains(":CONSOLE")).map(str::to_owned).collect(),
        boxes,
        content_px,
    })
}

fn run(program: &str, folder: &Path, page: &Path, options: &[String]) -> Output {
    let mut command = Command::new(program);
    command.args(["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr"]);
    command.args(["--force-device-scale-factor=1", "--disable-background-networking"]).args(options);
    command.arg(format!("--window-size={},{}", SIZE_PX[0], SIZE_PX[1]));
    command.arg(format!("--user-data-dir={}", folder.join("profile").display()));
    // The page gets nothing from the network.
    let output = command.arg("--proxy-server=127.0.0.1:9").arg(format!("file://{}", page.display())).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

/// Measures boxes by a script at the end of a copy of the page.
fn measure(program: &str, folder: &Path, page: &Path, selector: &str) -> (Vec<[f64; 4]>, [f64; 2]) {
    let script = format!(
        "<script>const root = document.documentElement;\
         root.dataset.boxes = [...document.querySelectorAll('{selector}')].map(e => e.getBoundingClientRect())\
         .map(r => [r.x, r.y, r.width, r.height].join(',')).join(';');\
         root.dataset.content = [root.scrollWidth, document.body.scrollHeight].join(',');</script>"
    );
    let copy = folder.join("measured.html");
    std::fs::write(&copy, std::fs::read_to_string(page).unwrap() + &script).unwrap();
    let dom = String::from_utf8(run(program, folder, &copy, &["--dump-dom".into()]).stdout).unwrap();
    let numbers_of = |key: &str| {
        let from = dom.find(&format!("data-{key}=\"")).unwrap() + key.len() + 7;
        let text = &dom[from..][..dom[from..].find('"').unwrap()];
        let numbers = |text: &str| text.split(',').map(|number| number.parse().unwrap()).collect::<Vec<f64>>();
        text.split(';').filter(|text| !text.is_empty()).map(numbers).collect::<Vec<_>>()
    };
    let boxes = numbers_of("boxes").into_iter().map(|numbers| numbers.try_into().unwrap()).collect();
    (boxes, numbers_of("content").remove(0).try_into().unwrap())
}

/// The addresses in Chromium's network log that a page requested. Requests of the browser itself have no origin.
fn requests(log: &str) -> Vec<String> {
    let mut found = Vec::new();
    for line in log.lines() {
        // One event per line.
        let Ok(event) = serde_json::from_str::<serde_json::Value>(line.trim_end_matches([',', ']'])) else { continue };
        let text = |key: &str| event["params"][key].as_str();
        let Some((initiator, url)) = text("initiator").zip(text("url")) else { continue };
        if initiator != "not an origin" && !url.starts_with("file:") && !url.starts_with("data:") {
            found.push(url.to_owned());
        }
    }
    found
}

impl Shown {
    /// The number of colours in a box, and the share of it that does not have the most frequent one.
    pub fn drawn(&self, [x, y, width, height]: [f64; 4]) -> (usize, f64) {
        let mut colours = std::collections::BTreeMap::<[u8; 3], u64>::new();
        for row in y.ceil() as u32..(y + height) as u32 {
            for column in x.ceil() as u32..(x + width) as u32 {
                *colours.entry(self.picture.get_pixel(column, row).0).or_default() += 1;
            }
        }
        let all: u64 = colours.values().sum();
        let largest = colours.values().max().copied().unwrap_or(0);
        (colours.len(), (all - largest) as f64 / all.max(1) as f64)
    }
}
