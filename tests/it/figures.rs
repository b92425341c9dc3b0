//! The figures that `ricochet demo` draws next to its recording.

use std::path::Path;

/// The largest file, bytes: three images and some curves.
const BYTES_MAX: u64 = 400_000;

/// Whether every tag is closed by its own, in order.
fn is_well_formed(svg: &str) -> bool {
    let mut open: Vec<&str> = Vec::new();
    for tag in svg.split('<').skip(1) {
        let Some((tag, text)) = tag.split_once('>') else { return false };
        if text.contains('&') && !["&amp;", "&lt;", "&gt;", "&quot;", "&#39;"].iter().any(|known| text.contains(known))
        {
            return false;
        }
        let name = tag.trim_start_matches('/').split([' ', '/']).next().unwrap();
        match () {
            () if tag.starts_with('/') => {
                if open.pop() != Some(name) {
                    return false;
                }
            }
            () if tag.ends_with('/') => {}
            () => open.push(name),
        }
        if tag.matches('"').count() % 2 != 0 {
            return false;
        }
    }
    open.is_empty()
}

/// The number of points of all lines of a class.
fn points(svg: &str, class: &str) -> usize {
    let start = format!("<path class=\"line {class}\" d=\"");
    let lines = svg.split(start.as_str()).skip(1).map(|rest| rest.split_once('"').unwrap().0);
    lines.map(|line| line.matches(['M', 'L']).count()).sum()
}

/// Checks the figures in `folder`, one for each of `expected`: the end of the file name, the words at the axes, and the
/// number of curves with a point for nearly each of `frames` frames, next to as many of the truth; 0 for three images.
/// A figure with the paper's settings shows the truth a second time with them.
pub fn check(folder: &Path, frames: usize, expected: &[(&str, &[&str], usize)]) {
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|end| end == "svg"));
    assert_eq!(files.len(), expected.len(), "{files:?}");
    for (name, words, curves) in expected {
        let file = files.iter().find(|file| file.to_string_lossy().ends_with(&format!("-{name}.svg")));
        let file = file.unwrap_or_else(|| panic!("no {name} in {files:?}"));
        let svg = std::fs::read_to_string(file).unwrap();
        assert!(std::fs::metadata(file).unwrap().len() < BYTES_MAX, "{name}: {} bytes", svg.len());
        assert!(svg.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\"") && is_well_formed(&svg), "{name}");
        // The base64 text of an image may contain these letters.
        assert!(*curves == 0 || !(svg.contains("NaN") || svg.contains("inf")), "{name}");
        for word in *words {
            assert!(svg.contains(word), "{name}: no {word:?}");
        }
        let (measured, truth) = (points(&svg, "a"), points(&svg, "truth"));
        let by_the_paper = [points(&svg, "b"), points(&svg, "c")];
        let shown = svg.contains("by the paper's settings") || svg.contains("by the paper&#39;s settings");
        assert_eq!(truth, (curves + usize::from(shown)) * frames, "{name}: points of the truth");
        assert_eq!(by_the_paper, if shown { [frames - 5, frames - 15] } else { by_the_paper }, "{name}");
        assert!(measured <= curves * frames && measured + 8 * curves >= curves * frames, "{name}: {measured} points");
        if *curves == 0 {
            assert_eq!(svg.matches("data:image/png;base64,").count(), 3, "{name}");
            let arrows: usize = svg
                .split("class=\"arrow\" d=\"")
                .skip(1)
                .map(|d| d.split_once('"').unwrap().0.matches('l').count())
                .sum();
            assert!(arrows > 90, "{name}: {arrows} strokes");
        }
    }
}
