//! The choice of the tape edges among the lines across a rod.

use super::projections::Line;
use crate::results::PointStatus;

/// The relative strength of one line too many from which the edges are ambiguous.
const RIVAL_RATIO: f64 = 0.75;
/// The bare rod next to an edge: the number of rows, and the maximum fraction of pixels of the other shade there, without
/// and with a reflection.
const BARE_ROWS: usize = 3;
const MAX_BARE_FRACTION: f64 = 0.1;
const MAX_COVERED_FRACTION: f64 = 0.45;

/// The shade of a rod.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shade {
    Black,
    White,
}

const SHADES: [Shade; 2] = [Shade::White, Shade::Black];

/// Chooses `count` edges of tapes, from the top downwards, among `lines`, the strongest first. `white` is the fraction
/// of white pixels in each row of the rod.
///
/// A rod is black or white between its tapes. The bare rod lies next to an edge of a tape, but not next to a line between
/// speckles. A reflection along the rod covers the same part of it next to each edge. With one, all choices of the
/// barest lines are compared with the shade of every row.
///
/// # Errors
///
/// [`PointStatus::Lost`] for too few edges, [`PointStatus::Ambiguous`] for too many or if they do not alternate.
pub(super) fn select_edges(white: &[f64], lines: &[Line], count: usize) -> Result<Vec<Line>, PointStatus> {
    let barest = |rod: Shade, max_fraction: f64| -> Option<BareLines> {
        let is_bare = |line: &&Line| covered_fraction(white, line, rod) <= max_fraction;
        let lines: Vec<Line> = lines.iter().filter(is_bare).copied().collect();
        (lines.len() >= count).then_some(BareLines { rod, lines })
    };
    let strength = |bare: &BareLines| bare.lines[..count].iter().map(|line| line.strength.abs()).sum::<i32>();
    let without_reflection = SHADES.into_iter().filter_map(|rod| barest(rod, MAX_BARE_FRACTION));
    if let Some(bare) = without_reflection.max_by_key(strength) {
        return bare.tape_edges(count).ok_or(PointStatus::Ambiguous);
    }
    let limits = |rod: Shade| {
        let fractions = lines.iter().map(move |line| covered_fraction(white, line, rod));
        fractions.filter(|fraction| (MAX_BARE_FRACTION..=MAX_COVERED_FRACTION).contains(fraction))
    };
    let choices = SHADES.into_iter().flat_map(|rod| limits(rod).filter_map(move |limit| barest(rod, limit)));
    let edges = choices.filter_map(|bare| bare.tape_edges(count));
    edges.min_by(|a, b| mismatch(white, a).total_cmp(&mismatch(white, b))).ok_or(PointStatus::Lost)
}

/// Lines next to which a rod of this shade is bare, the strongest first.
struct BareLines {
    rod: Shade,
    lines: Vec<Line>,
}

impl BareLines {
    /// Returns `count` edges from the top downwards; `None` unless exactly one choice of neighbours alternates.
    ///
    /// If there are more lines about as strong, an even number of edges begins where a tape does. One line too many
    /// belongs to something else at the end of the rod, such as the surface that it strikes.
    fn tape_edges(&self, count: usize) -> Option<Vec<Line>> {
        let weakest = f64::from(self.lines[count - 1].strength.abs());
        let is_strong = |line: &&Line| f64::from(line.strength.abs()) >= RIVAL_RATIO * weakest;
        let mut strong: Vec<Line> = self.lines.iter().filter(is_strong).copied().collect();
        strong.sort_by_key(|line| line.at);
        let has_rivals = strong.len() > count;
        let begins_tape = |line: &Line| (line.strength > 0) == (self.rod == Shade::Black);
        let is_choice = |edges: &&[Line]| {
            let alternates = edges.windows(2).all(|pair| pair[0].strength.signum() != pair[1].strength.signum());
            alternates && (!has_rivals || count % 2 == 1 || begins_tape(&edges[0]))
        };
        let mut choices = strong.windows(count).filter(is_choice);
        let found = choices.next()?.to_vec();
        choices.next().is_none().then_some(found)
    }
}

/// Returns the sum of squares of the difference between the fraction of white pixels in each row and the shade that the
/// edges give it.
fn mismatch(white: &[f64], edges: &[Line]) -> f64 {
    let shade_of = |row: usize| {
        let above = edges.iter().rev().find(|edge| edge.at < row);
        let is_white = above.map_or_else(|| edges[0].strength < 0, |edge| edge.strength > 0);
        f64::from(u8::from(is_white))
    };
    white.iter().enumerate().map(|(row, fraction)| (fraction - shade_of(row)).powi(2)).sum()
}

/// Returns the maximum fraction of pixels of the other shade than the `rod` in the three rows next to a line, on the side
/// of the bare rod.
fn covered_fraction(white: &[f64], line: &Line, rod: Shade) -> f64 {
    let is_above = (line.strength > 0) == (rod == Shade::Black);
    let rows = if is_above { line.at.saturating_sub(BARE_ROWS)..line.at } else { line.at + 2..line.at + 2 + BARE_ROWS };
    let other = |row: usize| white.get(row).map_or(0.0, |white| if rod == Shade::Black { *white } else { 1.0 - white });
    rows.map(other).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reflection_on_the_bare_rod_does_not_lose_its_edges() {
        // Two white tapes, rows 11 to 30 and 51 to 60, the upper one speckled; a reflection covers 0.2 between them.
        let shade = |row: usize| match row {
            11..=30 if row.is_multiple_of(5) => 0.5,
            11..=30 => 0.75,
            31..=50 => 0.2,
            51..=60 => 1.0,
            _ => 0.0,
        };
        let white: Vec<f64> = (0..80).map(shade).collect();
        let lines =
            [(50, 16), (60, -20), (10, 15), (30, -11), (20, 9), (24, -9)].map(|(at, strength)| Line { at, strength });
        let found = select_edges(&white, &lines, 4).unwrap();
        assert_eq!(found.iter().map(|line| line.at).collect::<Vec<_>>(), [10, 30, 50, 60]);
        assert_eq!(select_edges(&white, &lines, 5), Err(PointStatus::Lost));
    }

    #[test]
    fn the_surface_below_the_rod_is_not_a_tape_but_a_third_tape_is_ambiguous() {
        let shade = |row: usize| f64::from(u8::from(matches!(row, 11..=30 | 51..=60 | 71..=90)));
        let white: Vec<f64> = (0..110).map(shade).collect();
        let mut lines =
            [(10, 20), (30, -20), (50, 20), (60, -20), (70, 19)].map(|(at, strength)| Line { at, strength }).to_vec();
        let found = select_edges(&white, &lines, 4).unwrap();
        assert_eq!(found.iter().map(|line| line.at).collect::<Vec<_>>(), [10, 30, 50, 60]);
        lines.push(Line { at: 90, strength: -19 });
        assert_eq!(select_edges(&white, &lines, 4), Err(PointStatus::Ambiguous));
    }
}
