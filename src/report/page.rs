//! The page of one recording.

use super::number::{GROUPS, Quantity, escape, fixed, short, write};
use super::shot::Shot;
use super::{curves, snapshot};
use crate::results::{Estimate, Impact, PointStatus};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Events told one by one.
const EVENTS_MAX: usize = 100;
/// Longest rig file shown, bytes.
const CONFIG_BYTES_MAX: usize = 100_000;

/// Everything from the document's beginning to its first heading.
pub(super) fn head(title: &str) -> String {
    let style = include_str!("style.css");
    let title = escape(title);
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\"><title>{title}</title><style>\n{style}</style></head><body><main>\n"
    )
}

/// The document's end, with the version that made it.
pub(super) fn foot(recorded: &str) -> String {
    let version = env!("CARGO_PKG_VERSION");
    format!(
        "<footer>{recorded}Report by ricochet {version}. Every <i>σ</i> is a standard uncertainty (one standard deviation).</footer>\n</main></body></html>\n"
    )
}

/// The page.
pub(super) fn of_one(shot: &Shot) -> String {
    let rig = shot.metadata.get("rig").cloned().unwrap_or_else(|| shot.name.clone());
    let mut html = head(&format!("{rig} – {}", shot.name));
    header(&mut html, shot, &rig);
    if let Some(reason) = &shot.truncated {
        let _ = write!(html, "<p class=\"alert\">This recording was cut off: {}.</p>", escape(reason));
    }
    if shot.frames.lost + shot.frames.unreadable > 0 {
        let _ = write!(html, "<p class=\"alert\">{}</p>", losses(shot));
    }
    if shot.impacts.is_empty() {
        html.push_str(
            "<section><h2>Collision</h2><p class=\"none\">No collision was found in this recording.</p></section>",
        );
    }
    for impact in &shot.impacts {
        collision(&mut html, shot, impact);
    }
    for (body, name) in &shot.bodies {
        let curves = curves::section(shot, *body);
        if !curves.is_empty() {
            let name = if shot.bodies.len() > 1 { format!(" of {}", escape(name)) } else { String::new() };
            let _ = write!(html, "<section><h2>Motion{name}</h2>{curves}</section>");
        }
    }
    records(&mut html, shot);
    let version = shot.metadata.get("version").map(|v| format!("Measured by ricochet {}. ", escape(v)));
    let _ = write!(html, "{}", foot(&version.unwrap_or_default()));
    html
}

fn header(html: &mut String, shot: &Shot, rig: &str) {
    let mut facts = vec![utc(shot.origin_ns)];
    let camera = shot.metadata.get("camera").map(|camera| escape(camera));
    let serial = shot.metadata.get("serial").map(|serial| format!(" ({})", escape(serial))).unwrap_or_default();
    facts.extend(camera.map(|camera| format!("{camera}{serial}")));
    facts.extend(shot.frames.rate_hz.map(|rate| format!("{} frames/s", grouped(rate))));
    facts.extend(shot.metadata.get("scale").map(|scale| escape(scale)));
    facts.extend(shot.frames.shape.map(|m| format!("{} × {} px, {}", m.width_px, m.height_px, m.format.word())));
    if shot.frames.count > 0 {
        facts.push(format!("{} frames", grouped(shot.frames.count as f64)));
    } else {
        facts.push("results only, no raw frames".into());
    }
    let items: String = facts.iter().map(|fact| format!("<li>{fact}</li>")).collect();
    let _ = writeln!(
        html,
        "<header><h1>{}</h1><p class=\"file\">{}</p><ul class=\"facts\">{items}</ul></header>",
        escape(rig),
        escape(&shot.name)
    );
}

/// Moments count from the recording's first frame, durations stay as they are.
fn numbers(shot: &Shot, impact: &Impact) -> BTreeMap<&'static str, Estimate> {
    let shift_s = shot.shift_s(impact);
    let shifted = |name: &'static str, number: Estimate| {
        (
            name,
            Estimate { value: if Impact::is_moment(name) { number.value + shift_s } else { number.value }, ..number },
        )
    };
    impact.numbers().into_iter().filter_map(|(name, number)| Some(shifted(name, number?))).collect()
}

fn collision(html: &mut String, shot: &Shot, impact: &Impact) {
    let measured = numbers(shot, impact);
    let truth = shot.truth_of(impact).map(|truth| numbers(shot, truth));
    let heading = heading(shot, impact);
    let _ = write!(html, "<section><h2>{heading}</h2>");
    if impact.status != PointStatus::Valid {
        let _ = write!(
            html,
            "<p class=\"alert\">This collision is {}: not all of it could be measured.</p>",
            impact.status.word()
        );
    }
    tiles(html, &measured);
    html.push_str(&snapshot::strip(shot, impact));
    html.push_str("<div class=\"groups\">");
    for (name, group) in GROUPS {
        html.push_str(&table(name, group, &measured, truth.as_ref()));
    }
    let law = impact.force_law.word();
    let probable = impact
        .force_law_probability
        .map(|share| format!(" ({:.0} % probable of those that follow the motion)", 100.0 * share));
    let probable = probable.unwrap_or_default();
    let _ = writeln!(
        html,
        "</div><p class=\"note\">Contact law: {law}{probable}. Velocities along the outward normal and the tangent of the surface; times from the first frame.</p></section>"
    );
}

fn heading(shot: &Shot, impact: &Impact) -> String {
    let of_body = shot.impacts.iter().filter(|other| other.body == impact.body).count();
    let mut heading = String::from("Collision");
    if of_body > 1 {
        let _ = write!(heading, " {}", impact.number + 1);
    }
    if shot.bodies.len() > 1 {
        let _ = write!(heading, " of {}", escape(&shot.body_name(impact.body)));
    }
    heading
}

/// The numbers one looks for first: two before and after, or one.
const TILES: [(&str, &[&str], &str, f64); 6] = [
    ("Restitution", &["restitution"], "", 1.0),
    ("Normal velocity", &["vn_before_m_s", "vn_after_m_s"], "m/s", 1.0),
    ("Tangential velocity", &["vt_before_m_s", "vt_after_m_s"], "m/s", 1.0),
    ("Spin", &["omega_before_rad_s", "omega_after_rad_s"], "rad/s", 1.0),
    ("Contact", &["contact_time_s"], "ms", 1e3),
    ("Compression", &["compression_max_mm"], "mm", 1.0),
];

fn tiles(html: &mut String, measured: &BTreeMap<&str, Estimate>) {
    html.push_str("<div class=\"tiles\">");
    for (label, columns, unit, factor) in TILES {
        let written: Vec<_> = columns.iter().map(|column| measured.get(column).map(|e| write(*e, factor))).collect();
        let values = written.iter().map(|w| w.as_ref().map_or("–".to_owned(), |w| w.value.clone()));
        let sigmas = written.iter().map(|w| w.as_ref().map_or("–".to_owned(), |w| format!("±{}", w.sigma)));
        let values = values.collect::<Vec<_>>().join("<span class=\"to\">→</span>");
        let sigmas = sigmas.collect::<Vec<_>>().join(" and ");
        let pair = if columns.len() > 1 { " pair" } else { "" };
        let _ = write!(
            html,
            "<div class=\"tile\"><h3>{label}</h3><p class=\"big{pair}\">{values} <small>{unit}</small></p><p class=\"sigma\">{sigmas}</p></div>"
        );
    }
    html.push_str("</div>");
}

fn table(
    name: &str,
    group: &[Quantity],
    measured: &BTreeMap<&str, Estimate>,
    truth: Option<&BTreeMap<&str, Estimate>>,
) -> String {
    let truth_head = if truth.is_some() {
        "<th>true</th><th title=\"measured minus true, in standard uncertainties\">off by</th>"
    } else {
        ""
    };
    let mut html = format!(
        "<table><thead><tr><th>{name}</th><th>measured</th><th>± <i>σ</i></th><th></th>{truth_head}</tr></thead><tbody>"
    );
    for quantity in group {
        let found = measured.get(quantity.column);
        let (value, sigma, decimals) = match found {
            Some(estimate) => {
                let written = write(*estimate, quantity.factor);
                (written.value, written.sigma, written.decimals)
            }
            None => ("–".into(), String::new(), 4),
        };
        let _ =
            write!(html, "<tr><td>{}</td><td>{value}</td><td>{sigma}</td><td>{}</td>", quantity.label, quantity.unit);
        if let Some(truth) = truth {
            let true_value = truth.get(quantity.column);
            let text = true_value.map_or("–".into(), |t| fixed(t.value * quantity.factor, decimals));
            let _ = write!(html, "<td>{text}</td>{}", deviation(found, true_value));
        }
        html.push_str("</tr>");
    }
    html.push_str("</tbody></table>");
    html
}

/// How many standard uncertainties the measured number is off; beyond three it stands out.
fn deviation(measured: Option<&Estimate>, truth: Option<&Estimate>) -> String {
    let (Some(measured), Some(truth)) = (measured, truth) else { return "<td></td>".into() };
    let off = (measured.value - truth.value) / measured.sigma;
    if !off.is_finite() {
        return "<td></td>".into();
    }
    let class = if off.abs() > 3.0 { " class=\"far\"" } else { "" };
    let sign = if off > 0.0 { "+" } else { "" };
    format!("<td{class}>{sign}{} <i>σ</i></td>", fixed(off, 1))
}

fn losses(shot: &Shot) -> String {
    let frames = &shot.frames;
    let mut text = match (frames.lost, frames.gaps) {
        (1, _) => "1 frame was lost".to_owned(),
        (lost, 1) => format!("{lost} frames were lost in one gap"),
        (lost, gaps) => format!("{lost} frames were lost in {gaps} gaps"),
    };
    if frames.unreadable > 0 {
        let reason = frames.problem.as_deref().unwrap_or_default();
        let _ = write!(text, "; {} cannot be read ({})", frames.unreadable, escape(reason));
    }
    text.push('.');
    text
}

fn records(html: &mut String, shot: &Shot) {
    html.push_str("<section class=\"records\"><h2>Record</h2><div class=\"groups\">");
    counted(html, "Bodies in frames", &statuses(shot.velocities.iter().map(|row| row.status.word())));
    counted(html, "Subsets of the fields", &shot.field_statuses);
    let frames = &shot.frames;
    let film = [
        ("in the recording", frames.count),
        ("lost", frames.lost),
        ("gaps", frames.gaps),
        ("unreadable", frames.unreadable),
    ];
    counted(html, "Frames", &film.into_iter().collect());
    html.push_str("</div>");
    if !shot.events.is_empty() {
        html.push_str("<table class=\"events\"><thead><tr><th>Event</th><th>at, ms</th><th></th></tr></thead><tbody>");
        for event in shot.events.iter().take(EVENTS_MAX) {
            let at = fixed(1e3 * shot.seconds(event.stamp_ns), 3);
            let _ =
                write!(html, "<tr><td>{}</td><td>{at}</td><td>{}</td></tr>", escape(&event.kind), escape(&event.text));
        }
        html.push_str("</tbody></table>");
        if shot.events.len() > EVENTS_MAX {
            let _ = write!(html, "<p class=\"note\">and {} more</p>", shot.events.len() - EVENTS_MAX);
        }
    }
    let rows: String = shot
        .metadata
        .iter()
        .map(|(key, value)| format!("<tr><td>{}</td><td>{}</td></tr>", escape(key), escape(value)))
        .collect();
    let _ = write!(
        html,
        "<details><summary>About this recording</summary><table class=\"about\"><tbody>{rows}<tr><td>written by</td><td>{}</td></tr></tbody></table></details>",
        escape(&shot.library)
    );
    match &shot.config_toml {
        Some(config) => {
            let end =
                (0..=config.len().min(CONFIG_BYTES_MAX)).rev().find(|at| config.is_char_boundary(*at)).unwrap_or(0);
            let cut =
                if end < config.len() { "\n# ... cut here; the whole of it is attached to the recording" } else { "" };
            let _ = write!(
                html,
                "<details><summary>Settings (config.toml)</summary><pre>{}{cut}</pre></details>",
                escape(&config[..end])
            );
        }
        None => html.push_str("<p class=\"none\">No config.toml is attached.</p>"),
    }
    html.push_str("</section>\n");
}

fn statuses<'a>(words: impl Iterator<Item = &'a str>) -> BTreeMap<&'a str, u64> {
    let mut counts = BTreeMap::new();
    for word in words {
        *counts.entry(word).or_default() += 1;
    }
    counts
}

fn counted(html: &mut String, heading: &str, counts: &BTreeMap<&str, u64>) {
    let mut counts: Vec<_> = counts.iter().filter(|(_, count)| **count > 0).collect();
    counts.sort_by_key(|(word, count)| (std::cmp::Reverse(**count), **word));
    let total: u64 = counts.iter().map(|(_, count)| **count).sum();
    if total == 0 {
        let _ = write!(
            html,
            "<table><thead><tr><th>{heading}</th><th></th></tr></thead><tbody><tr><td>none</td><td></td></tr></tbody></table>"
        );
        return;
    }
    let rows: String = counts
        .iter()
        .map(|(word, count)| format!("<tr><td>{word}</td><td>{}</td></tr>", grouped(**count as f64)))
        .collect();
    let _ = write!(html, "<table><thead><tr><th>{heading}</th><th></th></tr></thead><tbody>{rows}</tbody></table>");
}

/// A count or a rate with thin spaces between thousands.
fn grouped(number: f64) -> String {
    let text = if (number - number.round()).abs() < 1e-6 * number.abs().max(1.0) {
        format!("{number:.0}")
    } else {
        short(number)
    };
    let (whole, rest) = text.split_at(text.find('.').unwrap_or(text.len()));
    let mut grouped = String::new();
    for (k, digit) in whole.char_indices() {
        if k > 0 && (whole.len() - k).is_multiple_of(3) && whole.len() > 4 {
            grouped.push('\u{2009}');
        }
        grouped.push(digit);
    }
    grouped + rest
}

/// Date and time of day, from days since 1970-01-01 by the civil calendar (H. Hinnant, `civil_from_days`).
pub(super) fn utc(stamp_ns: u64) -> String {
    let seconds = stamp_ns / 1_000_000_000;
    let (days, of_day) = (seconds / 86_400 + 719_468, seconds % 86_400);
    let (era, of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
    let year = 400 * era + year_of_era + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02} {:02}:{:02}:{:02} UTC", of_day / 3600, of_day / 60 % 60, of_day % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, text) in [
            (0, "1970-01-01 00:00:00 UTC"),
            (951_782_399, "2000-02-28 23:59:59 UTC"),
            (951_782_400, "2000-02-29 00:00:00 UTC"),
            (1_700_000_000, "2023-11-14 22:13:20 UTC"),
            (4_107_542_400, "2100-03-01 00:00:00 UTC"),
        ] {
            assert_eq!(utc(seconds * 1_000_000_000), text);
        }
    }

    #[test]
    fn thousands_are_grouped_from_five_digits_on() {
        assert_eq!(grouped(10_000.0), "10\u{2009}000");
        assert_eq!(grouped(2000.0), "2000");
        assert_eq!(grouped(29.97), "30.0");
        assert_eq!(grouped(1_234_567.0), "1\u{2009}234\u{2009}567");
    }

    #[test]
    fn a_number_far_from_the_truth_stands_out() {
        let estimate = |value: f64| Estimate { value, sigma: 0.1 };
        assert_eq!(deviation(Some(&estimate(1.4)), Some(&estimate(1.0))), "<td class=\"far\">+4.0 <i>σ</i></td>");
        assert_eq!(deviation(Some(&estimate(0.9)), Some(&estimate(1.0))), "<td>\u{2212}1.0 <i>σ</i></td>");
        assert_eq!(deviation(None, Some(&estimate(1.0))), "<td></td>");
    }
}
