//! The grey levels around an edge, sixteen profiles at a time.
//!
//! A profile is a line of levels across the edge. Its place in a block is its lane, so that sums over the levels of a
//! profile need no sums over lanes.

use std::ops::AddAssign;

/// The number of profiles of a block.
pub(super) const LANES: usize = 16;

/// One level of each profile of a block.
pub(super) type Lane = [f32; LANES];

/// A line of levels across the edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Profile {
    /// The coordinate along the edge, from its middle, px.
    pub(super) along: f64,
    /// The coordinates across of the first and the last level, px.
    pub(super) across: [usize; 2],
    /// The maximum weight, 0 to 1: the square of the contrast relative to the others.
    pub(super) trust: f64,
}

/// A straight line along the edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EdgeLine {
    /// The position across, at the middle, px.
    pub(super) at: f64,
    /// The slope: px across per px along.
    pub(super) slope: f64,
}

impl EdgeLine {
    /// Returns the position across in a profile, px.
    pub(super) fn in_profile(&self, profile: &Profile) -> f64 {
        self.at + self.slope * profile.along
    }
}

/// The places of the profiles of a block. Unused lanes have no rows.
#[derive(Debug, Clone)]
pub(super) struct Block {
    /// The coordinates along the edge, from its middle, px.
    pub(super) along: [f64; LANES],
    /// The coordinates along of the first and of the last profile, px.
    pub(super) ends: [f64; 2],
    /// The first and the last row of each profile.
    pub(super) from: Lane,
    pub(super) to: Lane,
}

/// The profiles around an edge with their levels, DN.
#[derive(Debug, Clone)]
pub(super) struct LevelGrid {
    pub(super) profiles: Vec<Profile>,
    pub(super) blocks: Vec<Block>,
    /// The coordinate across of the first row, px.
    pub(super) first: usize,
    /// The number of rows of a block.
    pub(super) rows: usize,
    /// The rows of the first block, then those of the second; zero beyond the ends of a profile.
    levels: Vec<Lane>,
}

impl Block {
    /// Creates the block of some profiles, at most 16, in a grid whose first row has the coordinate `first`.
    fn new(profiles: &[Profile], first: usize) -> Self {
        let along = |profile: Option<&Profile>| profile.map_or(0.0, |profile| profile.along);
        let ends = [along(profiles.first()), along(profiles.last())];
        let mut block = Self { along: [0.0; LANES], ends, from: [1.0; LANES], to: [0.0; LANES] };
        for (lane, profile) in profiles.iter().enumerate() {
            block.along[lane] = profile.along;
            [block.from[lane], block.to[lane]] = profile.across.map(|across| (across - first) as f32);
        }
        block
    }
}

impl LevelGrid {
    /// Collects the levels of some profiles, `level_at(index, across)`.
    pub(super) fn new(profiles: Vec<Profile>, mut level_at: impl FnMut(usize, usize) -> f32) -> Self {
        let first = profiles.iter().map(|profile| profile.across[0]).min().unwrap_or(0);
        let last = profiles.iter().map(|profile| profile.across[1]).max().unwrap_or(0);
        let rows = last + 1 - first;
        let mut levels = vec![[0.0; LANES]; rows * profiles.len().div_ceil(LANES)];
        for (index, profile) in profiles.iter().enumerate() {
            let block = &mut levels[index / LANES * rows..][..rows];
            let [start, end] = profile.across;
            for (row, across) in block[start - first..=end - first].iter_mut().zip(start..) {
                row[index % LANES] = level_at(index, across);
            }
        }
        let blocks = profiles.chunks(LANES).map(|profiles| Block::new(profiles, first)).collect();
        Self { profiles, blocks, first, rows, levels }
    }

    /// Returns the levels of a profile with their coordinates across, px.
    pub(super) fn levels_of(&self, index: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let [start, end] = self.profiles[index].across;
        let rows = self.rows_of(index / LANES);
        (start..=end).map(move |across| (across, rows[across - self.first][index % LANES]))
    }

    /// Returns the level of a profile at a coordinate across, px.
    pub(super) fn level(&self, index: usize, across: usize) -> f32 {
        self.rows_of(index / LANES)[across - self.first][index % LANES]
    }

    /// Returns the highest level, DN, at least 0.
    pub(super) fn highest_dn(&self) -> f32 {
        let mut highest = [0.0_f32; LANES];
        for row in &self.levels {
            for (highest, level) in highest.iter_mut().zip(row) {
                *highest = if *level > *highest { *level } else { *highest };
            }
        }
        highest.into_iter().fold(0.0, f32::max)
    }

    /// Returns the rows of a block.
    pub(super) fn rows_of(&self, index: usize) -> &[Lane] {
        &self.levels[index * self.rows..][..self.rows]
    }
}

/// Returns the sum of the lanes, added by halves.
#[inline(always)]
pub(super) fn sum_lanes<T: Copy + AddAssign>(lanes: &[T; LANES]) -> T {
    let mut sums = *lanes;
    for half in [8, 4, 2, 1] {
        for lane in 0..half {
            let other = sums[lane + half];
            sums[lane] += other;
        }
    }
    sums[0]
}
