//! The page of several recordings: how well their numbers repeat.

use super::page::{date, document};
use super::quantities::GROUPS;
use super::shot::Shot;
use super::spread::Spread;
use crate::plot::{ImpactQuantity, fixed, format_estimate, px};
use crate::results::{Estimate, Impact};
use maud::{Markup, html};
use std::collections::BTreeSet;

/// Returns the page of several shots: the spread of every number of each collision.
pub(super) fn repeatability_page(shots: &[Shot]) -> String {
    let rigs: BTreeSet<&String> = shots.iter().filter_map(|shot| shot.metadata.get("rig")).collect();
    let title = match (rigs.first(), rigs.len()) {
        (Some(rig), 1) => format!("{rig}: repeatability"),
        _ => "Repeatability".to_owned(),
    };
    let collisions: BTreeSet<(String, u32)> =
        shots.iter().flat_map(|shot| shot.impacts.iter().map(|i| (shot.body_name(i.body), i.number))).collect();
    let of_collision = |body: &str, number: u32| -> Vec<Option<&Impact>> {
        let same = |shot: &Shot, impact: &Impact| impact.number == number && shot.body_name(impact.body) == body;
        shots.iter().map(|shot| shot.impacts.iter().find(|impact| same(shot, impact))).collect()
    };
    let body = html! {
        header { h1 { (title) } p class="file" { (shots.len()) " recordings" } }
        @if collisions.is_empty() { p class="none" { "No collision was found in any of them." } }
        @for (body, number) in &collisions {
            @let is_numbered = *number > 0 || collisions.contains(&(body.clone(), 1));
            section {
                h2 { (body) @if is_numbered { ", collision " (number + 1) } }
                (spread_table(&of_collision(body, *number)))
            }
        }
        (recording_table(shots))
    };
    document(&title, None, &body)
}

/// Writes the table with the spread of every number of one collision. `impacts` has an entry per shot.
fn spread_table(impacts: &[Option<&Impact>]) -> Markup {
    // Durations and sizes repeat. Moments depend on when the camera started.
    let quantities = GROUPS.iter().flat_map(|(name, group)| group.iter().map(move |quantity| (*name, quantity)));
    let rows: Vec<SpreadRow> = quantities
        .filter(|(_, quantity)| !Impact::is_moment(quantity.column))
        .map(|(group, quantity)| SpreadRow::new(group, quantity, impacts))
        .collect();
    html! {
        table class="spread" {
            thead { tr {
                th {} th { "mean" } th title="sample standard deviation from shot to shot" { "sd" } th {}
                th title="root mean square of the uncertainties the measurement states" { "stated " i { "σ" } }
                th { "of" } th class="strip" { "each shot" }
            } }
            tbody { @for row in &rows { (row.draw()) } }
        }
        p class="note" {
            "Each dot is a shot, its bar two stated " i { "σ" }
            " to either side; the line is the mean, the shade one sd."
            @if rows.iter().any(SpreadRow::has_outliers) {
                " " span class="far" { "Outliers" }
                " (numbered by shot) are left out of mean and sd: further from the median than 3.5 times 1.4826 MAD, "
                "3.5 times the typical stated " i { "σ" } ", and 3.5 times their own."
            }
        }
    }
}

/// One number of a collision over all shots.
struct SpreadRow<'a> {
    group: &'a str,
    quantity: &'a ImpactQuantity,
    shots: usize,
    /// The shots that have the number, counted from 1, with its value in the page's unit.
    values: Vec<(usize, Estimate)>,
    spread: Option<Spread>,
}

impl<'a> SpreadRow<'a> {
    /// Collects a number from the shots that have it, in the page's unit, and computes its spread.
    fn new(group: &'a str, quantity: &'a ImpactQuantity, impacts: &[Option<&Impact>]) -> Self {
        let values: Vec<(usize, Estimate)> = (1..)
            .zip(impacts)
            .filter_map(|(shot, impact)| {
                let Estimate { value, sigma } = (*impact)?.get(quantity.column)?;
                Some((shot, Estimate { value: value * quantity.factor, sigma: sigma * quantity.factor }))
            })
            .collect();
        let spread = Spread::from_estimates(&values.iter().map(|(_, estimate)| *estimate).collect::<Vec<_>>());
        Self { group, quantity, shots: impacts.len(), values, spread }
    }

    /// Whether any shot is an outlier of this number.
    fn has_outliers(&self) -> bool {
        self.spread.as_ref().is_some_and(|spread| spread.outliers.contains(&true))
    }

    /// Writes the row of the table: mean, standard deviation, stated uncertainty and a dot per shot.
    fn draw(&self) -> Markup {
        let Self { group, quantity, shots, .. } = self;
        let Some(spread) = &self.spread else {
            return html! { tr {
                td { (group) " " b { (quantity.label) } } td { "–" } td {} td { (quantity.unit) } td {}
                td { "0 of " (shots) } td {}
            } };
        };
        // The mean is as certain as the spread, or as stated where the shots agree exactly.
        let sigma = spread.sd.filter(|sd| *sd > 0.0).unwrap_or(spread.stated);
        let mean = format_estimate(Estimate { value: spread.mean, sigma }, 1.0);
        html! { tr {
            td { (group) " " b { (quantity.label) } } td { (mean.value) }
            td { (spread.sd.map_or("–".into(), |sd| fixed(sd, mean.decimals))) } td { (quantity.unit) }
            td { (format_estimate(Estimate { value: 0.0, sigma: spread.stated }, 1.0).sigma) }
            td { (spread.kept) " of " (shots) } td class="strip" { (draw_dots(&self.values, spread)) }
        } }
    }
}

/// Draws the values of all shots on a line with bars of two stated sigmas, and their mean and standard deviation.
///
/// Outliers are labelled with the number of their shot.
fn draw_dots(values: &[(usize, Estimate)], spread: &Spread) -> Markup {
    let ends = values.iter().flat_map(|(_, e)| [e.value - 2.0 * e.sigma, e.value + 2.0 * e.sigma]);
    let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    let range = if high > low { high - low } else { 1.0 };
    let x = |value: f64| 8.0 + (value - low) / range * 284.0;
    let sd = spread.sd.unwrap_or(0.0);
    let (left, width) = (x(spread.mean - sd), x(spread.mean + sd) - x(spread.mean - sd));
    html! {
        svg class="dots" viewBox="0 0 300 26" role="img" aria-label="value of each shot" {
            rect class="contact" x=(px(left)) y="2" width=(px(width)) height="22" {}
            path class="axis" d={ "M" (px(x(spread.mean))) " 2v22" } {}
            @for (k, ((shot, estimate), is_outlier)) in values.iter().zip(&spread.outliers).enumerate() {
                // A fixed pattern over the height keeps equal values apart.
                @let y = 6.0 + ((k * 5) % 8) as f64 * 2.0;
                @let (at, bar) = (x(estimate.value), x(low + 4.0 * estimate.sigma) - x(low));
                path class="bar" d={ "M" (px(at - bar / 2.0)) " " (y) "h" (px(bar)) } {}
                circle class=(if *is_outlier { "dot far" } else { "dot a" }) cx=(px(at)) cy=(y) r="2.6" {}
                @if *is_outlier {
                    @let (label_x, anchor) = if at > 150.0 { (at - 6.0, "end") } else { (at + 6.0, "start") };
                    text class="tick far" x=(px(label_x)) y=(px(y + 4.0)) text-anchor=(anchor) { (shot) }
                }
            }
        }
    }
}

/// Writes the table of the recordings: file, rig, first frame, losses and version.
fn recording_table(shots: &[Shot]) -> Markup {
    html! {
        section {
            h2 { "Recordings" }
            table class="files" {
                @let heads = ["shot", "file", "rig", "first frame", "frames", "lost", "collisions", "version"];
                thead { tr { @for head in heads { th { (head) } } } }
                tbody {
                    @for (k, shot) in shots.iter().enumerate() {
                        @let entry = |key: &str| shot.metadata.get(key).map_or("", String::as_str);
                        @let lost = shot.frames.lost + shot.frames.unreadable;
                        @let is_cut = shot.truncated.is_some();
                        tr {
                            td { (k + 1) } td { (shot.name) } td { (entry("rig")) } td { (date(shot.origin_ns, &shot.metadata).unwrap_or_default()) }
                            td { (shot.frames.count) }
                            td class=[(lost > 0 || is_cut).then_some("far")] { (lost) @if is_cut { ", cut off" } }
                            td { (shot.impacts.len()) } td { (entry("version")) }
                        }
                    }
                }
            }
        }
    }
}
