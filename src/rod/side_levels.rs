//! The grey levels on one side of an edge and clear of it.

use super::level_grid::{EdgeLine, LANES, Lane, LevelGrid, Profile};
use multiversion::multiversion;

/// The profiles of a block.
#[derive(Debug, Clone)]
pub(super) struct SideBlock {
    /// Their coordinates along the edge, in units of the scale.
    pub(super) x: [f64; LANES],
    /// The position of the edge in each, px from the first row.
    pub(super) edge: [f64; LANES],
}

/// The levels on one side of an edge and clear of it.
#[derive(Debug, Clone, Default)]
pub(super) struct SideLevels {
    blocks: Vec<SideBlock>,
    /// The rows of the first block, then those of the second; infinite out of the side.
    levels: Vec<Lane>,
    rows: usize,
    count: usize,
    scale_px: f64,
}

/// The first row of each profile on one side of an edge, and one past its last.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct SideRows(Vec<[usize; 2]>);

impl SideRows {
    /// Selects the rows at least `margin` px before the edge (`side` 0) or behind it (1).
    pub(super) fn new(grid: &LevelGrid, edge: EdgeLine, side: usize, margin: f64) -> Self {
        // Conversions round towards zero and are faster than `floor` and `ceil`.
        let up = |across: f64| across.max(0.0) as usize + usize::from(across > (across.max(0.0) as usize) as f64);
        let rows = |profile: &Profile| {
            let edge = edge.in_profile(profile);
            let [start, end] = [profile.across[0], profile.across[1] + 1];
            let [from, to] = match side {
                0 => [start, (edge - margin + 1.0).max(0.0) as usize],
                _ => [up(edge + margin), end],
            };
            [from.clamp(start, end), to.clamp(start, end)].map(|across| across - grid.first)
        };
        Self(grid.profiles.iter().map(rows).collect())
    }

    /// Returns the number of levels.
    pub(super) fn count(&self) -> usize {
        self.0.iter().map(|[from, to]| to - from).sum()
    }
}

impl SideLevels {
    /// Collects the levels of these rows.
    pub(super) fn new(grid: &LevelGrid, edge: EdgeLine, side_rows: &SideRows) -> Self {
        let spans = || side_rows.0.iter().filter(|[from, to]| to > from);
        let first = spans().map(|span| span[0]).min().unwrap_or(0);
        let rows = spans().map(|span| span[1]).max().unwrap_or(0) - first;
        let levels = Vec::with_capacity(rows * grid.blocks.len());
        let mut side = Self { levels, rows, count: side_rows.count(), scale_px: 1.0, ..Self::default() };
        for (index, (profiles, spans)) in grid.profiles.chunks(LANES).zip(side_rows.0.chunks(LANES)).enumerate() {
            let mut block = SideBlock { x: [0.0; LANES], edge: [0.0; LANES] };
            let (mut from, mut to) = ([1.0; LANES], [0.0; LANES]);
            for (lane, (profile, span)) in profiles.iter().zip(spans).enumerate() {
                block.x[lane] = profile.along;
                block.edge[lane] = edge.in_profile(profile) - (grid.first + first) as f64;
                [from[lane], to[lane]] = span.map(|row| row as f32 - first as f32);
                if span[1] > span[0] {
                    side.scale_px = side.scale_px.max(profile.along.abs());
                }
            }
            append_rows(&mut side.levels, &grid.rows_of(index)[first..first + rows], &from, &to);
            side.blocks.push(block);
        }
        for block in &mut side.blocks {
            block.x = block.x.map(|along| along / side.scale_px);
        }
        side
    }

    /// Returns the number of levels.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// Returns the largest distance of a profile from the middle, at least 1 px.
    pub(super) fn scale_px(&self) -> f64 {
        self.scale_px
    }

    /// Returns the blocks with their rows.
    pub(super) fn blocks(&self) -> impl Iterator<Item = (&SideBlock, &[Lane])> {
        self.blocks.iter().zip(self.levels.chunks(self.rows.max(1)))
    }

    /// Returns the levels at some fractions, 0 to 1, of the sorted levels, DN. See [`quantile`](crate::numeric::quantile).
    ///
    /// They are found faster if they are those of `guess`. NaN without levels.
    pub(super) fn quantiles<const N: usize>(&self, fractions: [f64; N], guess: Option<[f64; N]>) -> [f64; N] {
        let Some(last) = self.count.checked_sub(1) else { return [f64::NAN; N] };
        let ranks = fractions.map(|fraction| ((last as f64 * fraction).round() as usize).min(last) as u32);
        if let Some(guess) = guess
            && guess.iter().zip(ranks).all(|(level, rank)| self.has_rank(*level as f32, rank))
        {
            return guess;
        }
        let bits = key_bits(&self.levels);
        ranks.map(|rank| f64::from(self.nth_level(bits, rank)))
    }

    /// Returns the level at a rank, from 0, in ascending order, by bisection over the bits that vary.
    fn nth_level(&self, bits: KeyBits, rank: u32) -> f32 {
        let mut key = bits.common;
        for place in (0..u32::BITS).rev().filter(|place| bits.varying >> place & 1 == 1) {
            // The bits below are not known yet: all are zero in the limit.
            let limit = (key & u32::MAX << place) | 1 << place;
            key |= u32::from(count_below(&self.levels, level_of(limit)) <= rank) << place;
        }
        level_of(key)
    }

    /// Whether a level is that of this rank, from 0, in ascending order.
    fn has_rank(&self, level: f32, rank: u32) -> bool {
        count_below(&self.levels, level) <= rank && rank < count_below(&self.levels, level.next_up())
    }
}

/// Appends rows, with infinity where the row is not from `from` to below `to`.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn append_rows(levels: &mut Vec<Lane>, rows: &[Lane], from: &Lane, to: &Lane) {
    for (index, row) in rows.iter().enumerate() {
        let at = index as f32;
        let mut kept = *row;
        for i in 0..LANES {
            let is_inside = (at >= from[i]) & (at < to[i]);
            kept[i] = if is_inside { row[i] } else { f32::INFINITY };
        }
        levels.push(kept);
    }
}

/// The bits that the keys of all levels share, and those that vary. Keys are integers in the order of their levels.
#[derive(Debug, Clone, Copy)]
struct KeyBits {
    common: u32,
    varying: u32,
}

/// Returns the bits of the keys of finite levels.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn key_bits(levels: &[Lane]) -> KeyBits {
    let key = |level: f32| {
        let bits = level.to_bits();
        bits ^ (0_u32.wrapping_sub(bits >> 31) | 0x8000_0000)
    };
    let is_level = |level: f32| 0_u32.wrapping_sub(u32::from(level < f32::INFINITY));
    let levels = levels.as_flattened();
    let any = levels.iter().fold(0, |any, level| any | (key(*level) & is_level(*level)));
    let all = levels.iter().fold(u32::MAX, |all, level| all & (key(*level) | !is_level(*level)));
    KeyBits { common: all, varying: any & !all }
}

/// Returns the number of levels below a level.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn count_below(levels: &[Lane], level: f32) -> u32 {
    levels.as_flattened().iter().map(|at| u32::from(*at < level)).sum()
}

/// Returns the level of a key.
#[inline(always)]
fn level_of(key: u32) -> f32 {
    f32::from_bits(if key >> 31 == 1 { key & 0x7fff_ffff } else { !key })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::{Xorshift, quantile};

    #[test]
    fn quantiles_are_those_of_the_sorted_levels() {
        let mut random = Xorshift::default();
        for (scale, shift) in [(1.0, 0.0), (0.37, -30.0), (1e-3, 5.0)] {
            let profiles: Vec<Profile> =
                (0..21).map(|k| Profile { along: f64::from(k), across: [7, 7 + k as usize], trust: 1.0 }).collect();
            let grid = LevelGrid::new(profiles, |_, _| random.below(200) as f32 * scale + shift);
            let rows = SideRows(grid.profiles.iter().map(|profile| [0, profile.across[1] - 6]).collect());
            let side = SideLevels::new(&grid, EdgeLine { at: 8.0, slope: 0.0 }, &rows);
            let mut all: Vec<f32> = (0..21).flat_map(|k| grid.levels_of(k).map(|(_, level)| level)).collect();
            assert_eq!((side.count(), all.len()), (231, 231));
            let fractions = [0.0, 0.15, 0.5, 0.85, 1.0];
            let expected = fractions.map(|fraction| f64::from(quantile(&mut all, fraction).unwrap()));
            for guess in [None, Some(expected), Some([expected[2]; 5])] {
                assert_eq!(side.quantiles(fractions, guess).map(f64::to_bits), expected.map(f64::to_bits));
            }
        }
    }
}
