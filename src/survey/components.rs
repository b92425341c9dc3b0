//! Connected regions of a mask.

/// A mask, row-major.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Mask {
    pub(super) marked: Vec<bool>,
    pub(super) width: usize,
    pub(super) height: usize,
}

/// A connected region.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Component {
    /// The indices of its pixels, rising.
    pub(super) pixels: Vec<usize>,
    /// Left, top, and one past right and bottom.
    pub(super) bounds: [usize; 4],
}

impl Mask {
    /// Returns the mask dilated by a square: every pixel is marked that has a marked one at most `reach` pixels away
    /// along x and along y.
    pub(super) fn dilated(&self, reach: usize) -> Self {
        let mut rows = vec![false; self.marked.len()];
        for (from, to) in self.marked.chunks_exact(self.width).zip(rows.chunks_exact_mut(self.width)) {
            for x in (0..self.width).filter(|x| from[*x]) {
                to[x.saturating_sub(reach)..(x + reach + 1).min(self.width)].fill(true);
            }
        }
        let mut marked = vec![false; self.marked.len()];
        for y in 0..self.height {
            for near in y.saturating_sub(reach)..(y + reach + 1).min(self.height) {
                for x in (0..self.width).filter(|x| rows[near * self.width + x]) {
                    marked[y * self.width + x] = true;
                }
            }
        }
        Self { marked, ..*self }
    }

    /// Returns the morphological closing of the mask by a square, which joins marks at most `2 * reach` pixels apart.
    ///
    /// Regions keep their borders, except near the edge of the image.
    pub(super) fn closed(&self, reach: usize) -> Self {
        let grown = self.dilated(reach);
        let inverted = Self { marked: grown.marked.iter().map(|is_marked| !is_marked).collect(), ..grown };
        let shrunk = inverted.dilated(reach);
        Self { marked: shrunk.marked.iter().map(|is_marked| !is_marked).collect(), ..shrunk }
    }

    /// Returns the connected regions, the largest first. Pixels connect along their sides, not at their corners.
    pub(super) fn components(&self) -> Vec<Component> {
        let mut is_taken = vec![false; self.marked.len()];
        let mut components = Vec::new();
        let mut waiting = Vec::new();
        for start in 0..self.marked.len() {
            if !self.marked[start] || is_taken[start] {
                continue;
            }
            is_taken[start] = true;
            waiting.push(start);
            let mut pixels = Vec::new();
            while let Some(at) = waiting.pop() {
                pixels.push(at);
                let (x, y) = (at % self.width, at / self.width);
                let neighbours = [
                    (x > 0).then(|| at - 1),
                    (x + 1 < self.width).then_some(at + 1),
                    (y > 0).then(|| at - self.width),
                    (y + 1 < self.height).then_some(at + self.width),
                ];
                for next in neighbours.into_iter().flatten() {
                    if self.marked[next] && !is_taken[next] {
                        is_taken[next] = true;
                        waiting.push(next);
                    }
                }
            }
            pixels.sort_unstable();
            components.push(Component { bounds: self.bounds(&pixels), pixels });
        }
        components.sort_by_key(|component| std::cmp::Reverse(component.pixels.len()));
        components
    }

    /// Returns the bounds of the pixels with these indices: left, top, and one past right and bottom.
    fn bounds(&self, pixels: &[usize]) -> [usize; 4] {
        let mut bounds = [usize::MAX, usize::MAX, 0, 0];
        for at in pixels {
            let (x, y) = (at % self.width, at / self.width);
            bounds = [bounds[0].min(x), bounds[1].min(y), bounds[2].max(x + 1), bounds[3].max(y + 1)];
        }
        bounds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(rows: &[&str]) -> Mask {
        let marked = rows.iter().flat_map(|row| row.chars().map(|letter| letter == '#')).collect();
        Mask { marked, width: rows[0].len(), height: rows.len() }
    }

    #[test]
    fn regions_are_separate_unless_they_share_a_side() {
        let components = mask(&["##...", ".##.#", "....#", "#..#."]).components();
        let found: Vec<_> = components.iter().map(|c| (c.pixels.len(), c.bounds)).collect();
        assert_eq!(found, [(4, [0, 0, 3, 2]), (2, [4, 1, 5, 3]), (1, [0, 3, 1, 4]), (1, [3, 3, 4, 4])]);
    }

    #[test]
    fn closing_joins_what_is_near_and_keeps_the_border() {
        let empty = ".........";
        let closed = mask(&[empty, empty, empty, "...#.#...", empty, empty, empty]).closed(1);
        assert_eq!(closed, mask(&[empty, empty, empty, "...###...", empty, empty, empty]));
    }
}
