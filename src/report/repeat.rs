//! The page of several recordings: how well their numbers repeat.

use super::number::{GROUPS, Quantity, escape, fixed, write};
use super::page::{foot, head, utc};
use super::shot::Shot;
use super::spread::Spread;
use crate::results::{Estimate, Impact};
use std::collections::BTreeSet;
use std::fmt::Write as _;

/// The page.
pub(super) fn of_several(shots: &[Shot]) -> String {
    let mut rigs: Vec<&str> = shots.iter().filter_map(|shot| shot.metadata.get("rig").map(String::as_str)).collect();
    rigs.sort_unstable();
    rigs.dedup();
    let title = match rigs[..] {
        [rig] => format!("{rig}: repeatability"),
        _ => "Repeatability".to_owned(),
    };
    let mut html = head(&title);
    let _ =
        writeln!(html, "<header><h1>{}</h1><p class=\"file\">{} recordings</p></header>", escape(&title), shots.len());
    let collisions: BTreeSet<(String, u32)> =
        shots.iter().flat_map(|shot| shot.impacts.iter().map(|i| (shot.body_name(i.body), i.number))).collect();
    if collisions.is_empty() {
        html.push_str("<p class=\"none\">No collision was found in any of them.</p>");
    }
    for (body, number) in &collisions {
        let heading = if *number > 0 || collisions.contains(&(body.clone(), 1)) {
            format!(", collision {}", number + 1)
        } else {
            String::new()
        };
        let _ = write!(html, "<section><h2>{}{heading}</h2>", escape(body));
        let impacts: Vec<Option<&Impact>> = shots
            .iter()
            .map(|shot| shot.impacts.iter().find(|i| (shot.body_name(i.body), i.number) == (body.clone(), *number)))
            .collect();
        spread_table(&mut html, &impacts);
        html.push_str("</section>");
    }
    files(&mut html, shots);
    html.push_str(&foot(""));
    html
}

fn spread_table(html: &mut String, impacts: &[Option<&Impact>]) {
    html.push_str(
        "<table class=\"spread\"><thead><tr><th></th><th>mean</th><th title=\"sample standard deviation from shot to shot\">sd</th><th></th>\
         <th title=\"root mean square of the uncertainties the measurement states\">stated <i>σ</i></th><th>of</th>\
         <th class=\"strip\">each shot</th></tr></thead><tbody>",
    );
    let mut has_outliers = false;
    for (name, group) in GROUPS {
        // Durations and sizes repeat; moments depend on when the camera started.
        for quantity in group.iter().filter(|quantity| !Impact::is_moment(quantity.column)) {
            has_outliers |= spread_row(html, name, quantity, impacts);
        }
    }
    html.push_str("</tbody></table><p class=\"note\">Each dot is a shot, its bar two stated <i>σ</i> to either side; the line is the mean, the shade one sd.");
    if has_outliers {
        html.push_str(" <span class=\"far\">Outliers</span> (numbered by shot) are left out of mean and sd: further from the median than 3.5 times 1.4826 MAD, 3.5 times the typical stated <i>σ</i>, and 3.5 times their own.");
    }
    html.push_str("</p>");
}

/// One number; whether it has outliers.
fn spread_row(html: &mut String, group: &str, quantity: &Quantity, impacts: &[Option<&Impact>]) -> bool {
    let of =
        |impact: &Impact| impact.numbers().into_iter().find(|(name, _)| *name == quantity.column).and_then(|(_, e)| e);
    let found: Vec<(usize, Estimate)> = impacts
        .iter()
        .enumerate()
        .filter_map(|(shot, impact)| {
            let Estimate { value, sigma } = of((*impact)?)?;
            Some((shot + 1, Estimate { value: value * quantity.factor, sigma: sigma * quantity.factor }))
        })
        .collect();
    let values: Vec<Estimate> = found.iter().map(|(_, estimate)| *estimate).collect();
    let label = format!("{group} <b>{}</b>", quantity.label);
    let Some(spread) = Spread::of(&values) else {
        let _ = write!(
            html,
            "<tr><td>{label}</td><td>–</td><td></td><td>{}</td><td></td><td>0 of {}</td><td></td></tr>",
            quantity.unit,
            impacts.len()
        );
        return false;
    };
    // The mean is as sure as the spread says, or what is stated where shots agree exactly.
    let width = spread.sd.filter(|sd| *sd > 0.0).unwrap_or(spread.stated);
    let written = write(Estimate { value: spread.mean, sigma: width }, 1.0);
    let sd = spread.sd.map_or("–".into(), |sd| fixed(sd, written.decimals));
    let stated = write(Estimate { value: 0.0, sigma: spread.stated }, 1.0).sigma;
    let _ = write!(
        html,
        "<tr><td>{label}</td><td>{}</td><td>{sd}</td><td>{}</td><td>{stated}</td><td>{} of {}</td><td class=\"strip\">{}</td></tr>",
        written.value,
        quantity.unit,
        spread.kept,
        impacts.len(),
        dots(&found, &spread)
    );
    spread.outliers.contains(&true)
}

/// Every shot's value on a line.
fn dots(found: &[(usize, Estimate)], spread: &Spread) -> String {
    let ends = found.iter().flat_map(|(_, e)| [e.value - 2.0 * e.sigma, e.value + 2.0 * e.sigma]);
    let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    let range = if high > low { high - low } else { 1.0 };
    let x = |value: f64| 8.0 + (value - low) / range * 284.0;
    let sd = spread.sd.unwrap_or(0.0);
    let (from, width, mean) = (x(spread.mean - sd), x(spread.mean + sd) - x(spread.mean - sd), x(spread.mean));
    let mut svg = format!(
        "<svg class=\"dots\" viewBox=\"0 0 300 26\" role=\"img\" aria-label=\"value of each shot\"><rect class=\"contact\" x=\"{from:.1}\" y=\"2\" \
         width=\"{width:.1}\" height=\"22\"/><path class=\"axis\" d=\"M{mean:.1} 2v22\"/>"
    );
    for (k, ((shot, estimate), out)) in found.iter().zip(&spread.outliers).enumerate() {
        // Spread over the height in a fixed pattern, so that equal values stay apart.
        let y = 6.0 + ((k * 5) % 8) as f64 * 2.0;
        let (at, bar) = (x(estimate.value), x(low + 4.0 * estimate.sigma) - x(low));
        let class = if *out { "dot far" } else { "dot a" };
        let _ = write!(
            svg,
            "<path class=\"bar\" d=\"M{:.1} {y}h{bar:.1}\"/><circle class=\"{class}\" cx=\"{at:.1}\" cy=\"{y}\" r=\"2.6\"/>",
            at - bar / 2.0
        );
        if *out {
            let beside = if at > 150.0 { (at - 6.0, "end") } else { (at + 6.0, "start") };
            let _ = write!(
                svg,
                "<text class=\"tick far\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{}\">{shot}</text>",
                beside.0,
                y + 4.0,
                beside.1
            );
        }
    }
    svg.push_str("</svg>");
    svg
}

fn files(html: &mut String, shots: &[Shot]) {
    html.push_str("<section><h2>Recordings</h2><table class=\"files\"><thead><tr><th>shot</th><th>file</th><th>rig</th><th>first frame</th><th>frames</th><th>lost</th><th>collisions</th><th>version</th></tr></thead><tbody>");
    for (k, shot) in shots.iter().enumerate() {
        let told = |key: &str| shot.metadata.get(key).map(|text| escape(text)).unwrap_or_default();
        let lost = shot.frames.lost + shot.frames.unreadable;
        let class = if lost > 0 || shot.truncated.is_some() { " class=\"far\"" } else { "" };
        let cut = if shot.truncated.is_some() { ", cut off" } else { "" };
        let _ = write!(
            html,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td{class}>{lost}{cut}</td><td>{}</td><td>{}</td></tr>",
            k + 1,
            escape(&shot.name),
            told("rig"),
            utc(shot.origin_ns),
            shot.frames.count,
            shot.impacts.len(),
            told("version")
        );
    }
    html.push_str("</tbody></table></section>");
}
