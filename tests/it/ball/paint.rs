//! Images without a ball: paint full of round marks, and texture.

use super::scene::{Random, blur};

pub const SIDE: usize = 240;

/// An image of texture (one in four), or of marks of up to 5 px radius, dark and bright in turn.
pub fn picture(seed: u64) -> Vec<f32> {
    let mut r = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0xabcd);
    let area = r.uniform(3_f64.ln(), 60_f64.ln()).exp();
    let (cover, soft) = (r.uniform(0.2, 0.6), r.uniform(0.5, 1.6));
    let (bright, dark) = (r.uniform(130.0, 200.0), r.uniform(15.0, 80.0));
    let mut grey = if seed % 4 == 3 {
        let mut grey: Vec<f32> = (0..SIDE * SIDE).map(|_| r.normal() as f32).collect();
        blur(&mut grey, SIDE, SIDE, r.uniform(1.0, 4.0));
        let power = grey.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / grey.len() as f64;
        let scale = (r.uniform(5.0, 40.0) / power.sqrt()) as f32;
        grey.iter().map(|v| 120.0 + scale * v).collect()
    } else {
        let [paint, mark] = if seed.is_multiple_of(2) { [bright, dark] } else { [dark, bright] }.map(|v| v as f32);
        let mut marks = marks(&mut r, area, cover);
        marks.iter_mut().for_each(|v| *v = paint + (mark - paint) * *v);
        blur(&mut marks, SIDE, SIDE, soft);
        marks
    };
    let noise = r.uniform(1.0, 4.0);
    grey.iter_mut().for_each(|v| *v = (f64::from(*v) + noise * r.normal()).round().clamp(0.0, 255.0) as f32);
    grey
}

/// A mask of random discs, the largest of this area, px^2.
fn marks(r: &mut Random, area: f64, cover: f64) -> Vec<f32> {
    let mut mask = vec![0.0_f32; SIDE * SIDE];
    let side = SIDE as f64;
    let wanted = -(1.0 - cover).ln() * (side + 20.0).powi(2);
    let mut laid = 0.0;
    while laid < wanted {
        let (cx, cy) = (r.uniform(-10.0, side + 10.0), r.uniform(-10.0, side + 10.0));
        let size = (r.uniform(area / 3.0, area) / std::f64::consts::PI).sqrt();
        laid += std::f64::consts::PI * size * size;
        let span =
            |c: f64| ((c - size - 1.0).max(0.0) as usize).min(SIDE)..((c + size + 2.0).max(0.0) as usize).min(SIDE);
        for y in span(cy) {
            for x in span(cx) {
                let cover = (size - (x as f64 - cx).hypot(y as f64 - cy) + 0.5).clamp(0.0, 1.0) as f32;
                mask[y * SIDE + x] = mask[y * SIDE + x].max(cover);
            }
        }
    }
    mask
}
