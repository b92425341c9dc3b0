//! The page of one recording.

use super::quantities::GROUPS;
use super::shot::Shot;
use super::{curves, snapshot};
use crate::image::is_dated;
use crate::plot::{ImpactQuantity, fixed, format_estimate, three_digits};
use crate::results::{Estimate, Impact, PointStatus};
use chrono::DateTime;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use std::collections::BTreeMap;

/// Maximum number of events listed one by one.
const MAX_EVENTS: usize = 100;
/// Maximum length of the rig file shown, bytes.
const MAX_CONFIG_BYTES: usize = 100_000;

/// Wraps `body` into an HTML document with the style sheet and a footer.
///
/// `measured_by` is the version of ricochet that measured the recording, where it is known.
pub(super) fn document(title: &str, measured_by: Option<&str>, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(include_str!("style.css"))) }
            }
            body { main {
                (body)
                footer {
                    @if let Some(version) = measured_by { "Measured by ricochet " (version) ". " }
                    "Report by ricochet " (env!("CARGO_PKG_VERSION")) ". Every " i { "σ" }
                    " is a standard uncertainty (one standard deviation)."
                }
            } }
        }
    };
    page.into_string() + "\n"
}

/// Returns the page of one shot: its collisions, curves and records.
pub(super) fn shot_page(shot: &Shot) -> String {
    let rig = shot.metadata.get("rig").unwrap_or(&shot.name);
    let has_losses = shot.frames.lost + shot.frames.unreadable > 0;
    let body = html! {
        (header(shot, rig))
        @if let Some(reason) = &shot.truncated { p class="alert" { "This recording was cut off: " (reason) "." } }
        @for body in &shot.measured {
            p class={ @if body.is_complete { "note" } @else { "alert" } } { (body.line) "." }
        }
        @if has_losses { p class="alert" { (loss_text(shot)) } }
        @if shot.impacts.is_empty() {
            section { h2 { "Collision" } p class="none" { "No collision was found in this recording." } }
        }
        @for impact in &shot.impacts { (collision_section(shot, impact)) }
        @for (body, name) in &shot.bodies {
            @if let Some(curves) = curves::section(shot, *body) {
                section { h2 { "Motion" @if shot.bodies.len() > 1 { " of " (name) } } (curves) }
            }
        }
        (record_section(shot))
    };
    document(&format!("{rig} – {}", shot.name), shot.metadata.get("version").map(String::as_str), &body)
}

/// Writes the head of the page: rig, file, and facts about camera, scale and frames.
fn header(shot: &Shot, rig: &str) -> Markup {
    let mut facts: Vec<String> = date(shot.origin_ns, &shot.metadata).into_iter().collect();
    if let Some(camera) = shot.metadata.get("camera") {
        let serial = shot.metadata.get("serial").map(|serial| format!(" ({serial})")).unwrap_or_default();
        facts.push(format!("{camera}{serial}"));
    }
    facts.extend(shot.frames.rate_hz.map(|rate| format!("{} frames/s", grouped(rate))));
    facts.extend(shot.metadata.get("scale").cloned());
    facts.extend(shot.frames.shape.map(|m| format!("{} × {} px, {}", m.width_px, m.height_px, m.format.as_str())));
    facts.push(match shot.frames.count {
        0 => "results only, no raw frames".into(),
        count => format!("{} frames", grouped(count as f64)),
    });
    html! {
        header { h1 { (rig) } p class="file" { (shot.name) } ul class="facts" { @for fact in &facts { li { (fact) } } } }
    }
}

/// Returns the measured numbers of an impact by column. Moments count from the recording's first frame; durations stay
/// as they are.
fn impact_numbers(shot: &Shot, impact: &Impact) -> BTreeMap<&'static str, Estimate> {
    let shifted = impact.shifted(shot.shift_s(impact));
    shifted.numbers().into_iter().filter_map(|(name, number)| Some((name, number?))).collect()
}

/// Writes the section of a collision: headline numbers, pictures, and every number with its uncertainty.
fn collision_section(shot: &Shot, impact: &Impact) -> Markup {
    let measured = impact_numbers(shot, impact);
    let truth = shot.truth_of(impact).map(|truth| impact_numbers(shot, truth));
    html! {
        section {
            h2 { (collision_heading(shot, impact)) }
            @if impact.status != PointStatus::Valid {
                p class="alert" { "This collision is " (impact.status.as_str()) ": not all of it could be measured." }
            }
            (headline_tiles(&measured, spin_refusal(shot, impact)))
            (snapshot::picture_strip(shot, impact))
            div class="groups" {
                @for (name, group) in GROUPS { (quantity_table(name, group, &measured, truth.as_ref())) }
            }
            p class="note" {
                "Contact law: " (impact.force_law.as_str())
                @if let Some(share) = impact.force_law_probability {
                    " (" (format!("{:.0}", 100.0 * share)) " % probable of those that follow the motion)"
                }
                ". Velocities along the outward normal and the tangent of the surface; times from the first frame."
            }
        }
    }
}

/// Returns the heading of a collision, with its number and body where there are several.
fn collision_heading(shot: &Shot, impact: &Impact) -> String {
    let of_body = shot.impacts.iter().filter(|other| other.body == impact.body).count();
    let mut heading = String::from("Collision");
    if of_body > 1 {
        heading += &format!(" {}", impact.number + 1);
    }
    if shot.bodies.len() > 1 {
        heading += &format!(" of {}", shot.body_name(impact.body));
    }
    heading
}

/// The headline numbers: title, one column or the columns before and after, unit, factor from the column's unit.
const TILES: [(&str, &[&str], &str, f64); 6] = [
    ("Restitution", &["restitution"], "", 1.0),
    ("Normal velocity", &["vn_before_m_s", "vn_after_m_s"], "m/s", 1.0),
    ("Tangential velocity", &["vt_before_m_s", "vt_after_m_s"], "m/s", 1.0),
    ("Spin", &["omega_before_rad_s", "omega_after_rad_s"], "rad/s", 1.0),
    ("Contact", &["contact_time_s"], "ms", 1e3),
    ("Compression", &["compression_max_mm"], "mm", 1.0),
];

/// Returns the most frequent rotation status of the rows of an impact's body; `None` if it is valid or without rows.
fn spin_refusal(shot: &Shot, impact: &Impact) -> Option<PointStatus> {
    let rows = shot.velocities.iter().filter(|row| row.body == impact.body);
    let mut counts: BTreeMap<&str, (usize, PointStatus)> = BTreeMap::new();
    for status in rows.map(|row| row.rotation_status) {
        counts.entry(status.as_str()).or_insert((0, status)).0 += 1;
    }
    let (_, most_frequent) = counts.into_values().max_by_key(|(count, _)| *count)?;
    (most_frequent != PointStatus::Valid).then_some(most_frequent)
}

/// Writes the headline numbers of a collision with their uncertainties.
///
/// `spin_refusal` is written in place of the uncertainties of a missing spin.
fn headline_tiles(measured: &BTreeMap<&str, Estimate>, spin_refusal: Option<PointStatus>) -> Markup {
    let tile = |label: &str, columns: &[&str], unit: &str, factor: f64| {
        let is_missing = columns.iter().all(|column| !measured.contains_key(column));
        let refusal = spin_refusal.filter(|_| is_missing && columns.iter().any(|column| column.starts_with("omega")));
        let texts = columns.iter().map(|column| measured.get(column).map(|number| format_estimate(*number, factor)));
        let (values, sigmas): (Vec<_>, Vec<_>) = texts
            .map(|text| text.map_or(("–".into(), "–".into()), |text| (text.value, format!("±{}", text.sigma))))
            .unzip();
        html! {
            div class="tile" {
                h3 { (label) }
                p class={ "big" @if columns.len() > 1 { " pair" } } {
                    @for (place, value) in values.iter().enumerate() {
                        @if place > 0 { span class="to" { "→" } }
                        (value)
                    }
                    " " small { (unit) }
                }
                p class="sigma" {
                    @if let Some(status) = refusal { "not measured: " (status.as_str()) } @else { (sigmas.join(" and ")) }
                }
            }
        }
    };
    html! {
        div class="tiles" { @for (label, columns, unit, factor) in TILES { (tile(label, columns, unit, factor)) } }
    }
}

/// Writes the table of a group of numbers. With the truth it has the deviation from it as well.
fn quantity_table(
    name: &str,
    group: &[ImpactQuantity],
    measured: &BTreeMap<&str, Estimate>,
    truth: Option<&BTreeMap<&str, Estimate>>,
) -> Markup {
    html! {
        table {
            thead { tr {
                th { (name) } th { "measured" } th { "± " i { "σ" } } th {}
                @if truth.is_some() {
                    th { "true" } th title="measured minus true, in standard uncertainties" { "off by" }
                }
            } }
            tbody {
                @for quantity in group {
                    @let number = measured.get(quantity.column);
                    @let text = number.map(|number| format_estimate(*number, quantity.factor));
                    tr {
                        td { (quantity.label) }
                        td { (text.as_ref().map_or("–", |text| &text.value)) }
                        td { (text.as_ref().map_or("", |text| &text.sigma)) }
                        td { (quantity.unit) }
                        @if let Some(truth) = truth {
                            @let true_number = truth.get(quantity.column);
                            @let decimals = text.as_ref().map_or(4, |text| text.decimals);
                            td { (true_number.map_or("–".into(), |t| fixed(t.value * quantity.factor, decimals))) }
                            (deviation_cell(number, true_number))
                        }
                    }
                }
            }
        }
    }
}

/// Writes the table cell with measured minus true in standard uncertainties of the measured number; more than three
/// stand out. The cell is empty if either is missing.
fn deviation_cell(measured: Option<&Estimate>, truth: Option<&Estimate>) -> Markup {
    let deviation = measured.zip(truth).map(|(measured, truth)| (measured.value - truth.value) / measured.sigma);
    let Some(deviation) = deviation.filter(|deviation| deviation.is_finite()) else { return html! { td {} } };
    html! {
        td class=[(deviation.abs() > 3.0).then_some("far")] { @if deviation > 0.0 { "+" } (fixed(deviation, 1)) " " i { "σ" } }
    }
}

/// Describes the frames that were lost or cannot be read.
fn loss_text(shot: &Shot) -> String {
    let frames = &shot.frames;
    let lost = match (frames.lost, frames.gaps) {
        (1, _) => "1 frame was lost".to_owned(),
        (lost, 1) => format!("{lost} frames were lost in one gap"),
        (lost, gaps) => format!("{lost} frames were lost in {gaps} gaps"),
    };
    match frames.unreadable {
        0 => format!("{lost}."),
        count => format!("{lost}; {count} cannot be read ({}).", frames.problem.as_deref().unwrap_or_default()),
    }
}

/// Writes the section about the recording itself: counts, events, metadata and rig file.
fn record_section(shot: &Shot) -> Markup {
    let frames = &shot.frames;
    let frame_counts = BTreeMap::from([
        ("in the recording", frames.count),
        ("lost", frames.lost),
        ("gaps", frames.gaps),
        ("unreadable", frames.unreadable),
    ]);
    html! {
        section class="records" {
            h2 { "Record" }
            div class="groups" {
                (count_table("Bodies in frames", &status_counts(shot)))
                (count_table("Subsets of the fields", &shot.field_statuses))
                (count_table("Frames", &frame_counts))
            }
            @if !shot.events.is_empty() { (event_table(shot)) }
            details {
                summary { "About this recording" }
                table class="about" { tbody {
                    @for (key, value) in &shot.metadata { tr { td { (key) } td { (value) } } }
                    tr { td { "written by" } td { (shot.library) } }
                } }
            }
            @match &shot.config_toml {
                Some(config) => {
                    @let shown = &config[..char_boundary(config, MAX_CONFIG_BYTES)];
                    details {
                        summary { "Settings (config.toml)" }
                        pre {
                            (shown)
                            @if shown.len() < config.len() {
                                "\n# ... cut here; the recording has the whole file attached"
                            }
                        }
                    }
                }
                None => p class="none" { "No config.toml is attached." }
            }
        }
    }
}

/// Returns the last character boundary of a text at or below `limit_bytes`.
fn char_boundary(text: &str, limit_bytes: usize) -> usize {
    (0..=text.len().min(limit_bytes)).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0)
}

/// Writes the table of the first [`MAX_EVENTS`] events, with times from the first frame.
fn event_table(shot: &Shot) -> Markup {
    html! {
        table class="events" {
            thead { tr { th { "Event" } th { "at, ms" } th {} } }
            tbody {
                @for event in shot.events.iter().take(MAX_EVENTS) {
                    @let at_ms = fixed(1e3 * shot.seconds(event.stamp_ns), 3);
                    tr { td { (event.kind) } td { (at_ms) } td { (event.text) } }
                }
            }
        }
        @if shot.events.len() > MAX_EVENTS { p class="note" { "and " (shot.events.len() - MAX_EVENTS) " more" } }
    }
}

/// Counts the velocity rows of each status.
fn status_counts(shot: &Shot) -> BTreeMap<&str, u64> {
    let mut counts = BTreeMap::new();
    for row in &shot.velocities {
        *counts.entry(row.status.as_str()).or_default() += 1;
    }
    counts
}

/// Writes a table of counts, the most frequent first, without zeros.
fn count_table(heading: &str, counts: &BTreeMap<&str, u64>) -> Markup {
    let mut counts: Vec<_> = counts.iter().filter(|(_, count)| **count > 0).collect();
    counts.sort_by_key(|(name, count)| (std::cmp::Reverse(**count), **name));
    html! {
        table {
            thead { tr { th { (heading) } th {} } }
            tbody {
                @for (name, count) in &counts { tr { td { (name) } td { (grouped(**count as f64)) } } }
                @if counts.is_empty() { tr { td { "none" } td {} } }
            }
        }
    }
}

/// Formats a count or a rate with thin spaces between thousands, from five digits on; three digits if it is not whole.
fn grouped(number: f64) -> String {
    let text = if (number - number.round()).abs() < 1e-6 * number.abs().max(1.0) {
        format!("{number:.0}")
    } else {
        three_digits(number)
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

/// Returns the date of a shot: that of its first frame's stamp, ns, else the one that the imported file stated. `None`
/// if neither is known.
pub fn date(stamp_ns: u64, metadata: &BTreeMap<String, String>) -> Option<String> {
    if is_dated(stamp_ns) { Some(utc(stamp_ns)) } else { metadata.get("date").map(|date| date.replacen('T', " ", 1)) }
}

/// Formats a stamp, ns since the Unix epoch, as date and time of day.
fn utc(stamp_ns: u64) -> String {
    let time = DateTime::from_timestamp_nanos(i64::try_from(stamp_ns).unwrap_or(i64::MAX));
    time.format("%Y-%m-%d %H:%M:%S UTC").to_string()
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
    fn a_film_without_a_date_is_not_of_1970() {
        let stated = BTreeMap::from([("date".to_owned(), "2024-05-01T12:00:00".to_owned())]);
        assert_eq!(date(100_000, &BTreeMap::new()), None);
        assert_eq!(date(100_000, &stated).as_deref(), Some("2024-05-01 12:00:00"));
        assert_eq!(date(1_700_000_000_000_000_000, &stated).as_deref(), Some("2023-11-14 22:13:20 UTC"));
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
        let cell = |measured: Option<f64>, truth: f64| {
            let estimate = |value: f64| Estimate { value, sigma: 0.1 };
            deviation_cell(measured.map(estimate).as_ref(), Some(&estimate(truth))).into_string()
        };
        assert_eq!(cell(Some(1.4), 1.0), "<td class=\"far\">+4.0 <i>σ</i></td>");
        assert_eq!(cell(Some(0.9), 1.0), "<td>\u{2212}1.0 <i>σ</i></td>");
        assert_eq!(cell(None, 1.0), "<td></td>");
    }
}
