//! The sections of a rod between the edges of its tapes, and the speckled one among them.

use super::observation::INSET_PX;
use crate::image::ImageView;

/// The margin of rows to the edges in the search for texture, px.
const TEXTURE_MARGIN_PX: f64 = 3.0;
/// The minimum height of a section for a subset, px.
const MIN_SECTION_PX: f64 = 9.0;

/// The position of the speckled tape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Section {
    /// Between this edge and the next.
    Between(usize),
    /// Above the first edge.
    Above,
    /// Below the last.
    Below,
}

/// Returns the section with the most texture, both along the rows and along the columns: the speckled tape. `None` if
/// none is high enough.
///
/// A reflection and shading vary along the rows only. `region` is left, top, width and height, px.
pub(super) fn speckled_section(
    image: ImageView<'_>,
    region: [usize; 4],
    edges_px: &[f64],
    sides_px: [f64; 2],
) -> Option<Section> {
    let [_, top, _, height] = region.map(|number| number as f64);
    let mut sections: Vec<(Section, [f64; 2])> =
        edges_px.windows(2).enumerate().map(|(upper, pair)| (Section::Between(upper), [pair[0], pair[1]])).collect();
    if edges_px.len() % 2 == 1 {
        // One tape shows a single edge: it lies above the first or below the last.
        sections.push((Section::Above, [top, edges_px[0]]));
        sections.push((Section::Below, [edges_px[edges_px.len() - 1], top + height - 1.0]));
    }
    let columns = sides_px.map(|side| side.max(0.0) as usize);
    let columns = columns[0] + INSET_PX as usize + 1..columns[1].saturating_sub(INSET_PX as usize);
    let texture = |[from, to]: [f64; 2]| {
        let rows = (from + TEXTURE_MARGIN_PX).ceil() as usize..((to - TEXTURE_MARGIN_PX).floor().max(0.0)) as usize;
        let count = (rows.len() * columns.len()).max(1) as f64;
        let square = |low: f32, high: f32| f64::from(high - low).powi(2);
        let squares = |y: usize| {
            let [above, row, below] = [y - 1, y, y + 1].map(|y| image.row(y));
            let across = columns.clone().map(|x| square(row[x - 1], row[x + 1])).sum::<f64>();
            [across, columns.clone().map(|x| square(above[x], below[x])).sum::<f64>()]
        };
        let sums = rows.map(squares).fold([0.0; 2], |sums, [across, along]| [sums[0] + across, sums[1] + along]);
        sums[0].min(sums[1]) / count
    };
    let candidates = sections.into_iter().filter(|(_, [from, to])| to - from >= MIN_SECTION_PX);
    candidates.map(|(section, rows)| (section, texture(rows))).max_by(|a, b| a.1.total_cmp(&b.1)).map(|best| best.0)
}
