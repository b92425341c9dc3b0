//! Where the edge is in every bin of a rim: a blurred step fitted to raw pixels.

use super::normal::normal;
use super::rim::{BAND_PX, LANES, Lane, Rim};

/// Gauss-Newton steps on the edge's place.
const STEPS: usize = 4;
/// Fewest pixels a bin is fitted with.
const LEAST_PIXELS: u32 = 8;

/// The blurred step of one bin.
///
/// Grey level = `outside + contrast * P`, P the share of the pixel's blurred
/// neighbourhood inside the edge, `P = Phi((shift - distance) / blur)`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Edge {
    /// Edge relative to the outline it was gathered around, outwards, px.
    pub shift: f32,
    /// Grey level inside minus outside; 0 when the bin could not be fitted.
    pub contrast: f32,
    /// Grey level inside.
    pub inside: f32,
    /// Root mean square of what the step leaves unexplained.
    pub rms: f32,
    /// Standard deviation of `shift` for noise of one grey level, px.
    pub sigma_unit: f32,
    /// Gradient and curvature of half the residual sum over the blur, grey^2 / px and grey^2 / px^2.
    pub blur_pull: f32,
    pub blur_weight: f32,
}

/// Sums over the pixels of a bin, for [`LANES`] bins at once.
///
/// p: share inside, f: density of the edge, g: how blur changes it, v: grey level.
#[derive(Clone, Copy, Default)]
struct Sums {
    n: Lane,
    p: Lane,
    v: Lane,
    f: Lane,
    g: Lane,
    pp: Lane,
    pv: Lane,
    vv: Lane,
    ff: Lane,
    fp: Lane,
    fv: Lane,
    gg: Lane,
    gp: Lane,
    gf: Lane,
    gv: Lane,
}

/// Fits every bin of `rim`; `light` is how much brighter the inside gets per px towards the centre, grey levels.
pub(super) fn fit_edges(rim: &Rim, blur: f32, light: &[f32], edges: &mut Vec<Edge>) {
    edges.clear();
    let blocks = rim.bins().div_ceil(LANES);
    for block in 0..blocks {
        let mut slope = [0.0_f32; LANES];
        for (lane, value) in slope.iter_mut().zip(light.iter().skip(block * LANES)) {
            *lane = *value;
        }
        let (fitted, level) = fit_block(rim, block, blur, slope);
        for (lane, mut edge) in fitted.into_iter().enumerate() {
            let bin = block * LANES + lane;
            if bin >= rim.bins() {
                break;
            }
            if rim.count(bin) < LEAST_PIXELS || !edge.shift.is_finite() || !edge.rms.is_finite() {
                edge = Edge::default();
            }
            edge.inside += level;
            edges.push(edge);
        }
    }
}

/// The steps of one block, and the grey level they are relative to.
fn fit_block(rim: &Rim, block: usize, blur: f32, slope: Lane) -> ([Edge; LANES], f32) {
    let (distance, grey, weight) = rim.block(block);
    let level = mean(grey, weight);
    let limit = BAND_PX as f32 - 0.5;
    let mut shift = [0.0_f32; LANES];
    for _ in 0..STEPS {
        let s = place_sums(distance, grey, weight, Model { shift, blur, slope, level });
        for i in 0..LANES {
            let c = Centred::new(&s, i);
            let step = (blur * c.pull() / (c.contrast() * c.stiffness())).clamp(-0.7, 0.7);
            // A bin without an edge has no step; NaN fails the comparison.
            shift[i] = if step.abs() <= 0.7 { (shift[i] + step).clamp(-limit, limit) } else { shift[i] };
        }
    }
    let s = all_sums(distance, grey, weight, Model { shift, blur, slope, level });
    let mut edges = [Edge::default(); LANES];
    for (i, edge) in edges.iter_mut().enumerate() {
        *edge = Centred::new(&s, i).edge(&s, i, shift[i], blur);
    }
    (edges, level)
}

/// What the pixels of a block are compared with.
#[derive(Clone, Copy)]
struct Model {
    shift: Lane,
    blur: f32,
    slope: Lane,
    level: f32,
}

fn mean(grey: &[Lane], weight: &[Lane]) -> f32 {
    let total: f32 = grey.iter().flatten().sum();
    let count: f32 = weight.iter().flatten().sum();
    total / count.max(1.0)
}

/// The sums that place the edge.
#[inline(always)]
fn place_sums(distance: &[Lane], grey: &[Lane], weight: &[Lane], model: Model) -> Sums {
    let mut s = Sums::default();
    let scale = 1.0 / model.blur;
    for ((d, v), w) in distance.iter().zip(grey).zip(weight) {
        for i in 0..LANES {
            let (p, f) = normal((model.shift[i] - d[i]) * scale);
            let w = w[i];
            let (wp, wf) = (w * p, w * f);
            let v = v[i] - model.level + model.slope[i] * d[i] * p;
            s.n[i] += w;
            s.p[i] += wp;
            s.v[i] += w * v;
            s.f[i] += wf;
            s.pp[i] += wp * p;
            s.pv[i] += wp * v;
            s.ff[i] += wf * f;
            s.fp[i] += wf * p;
            s.fv[i] += wf * v;
        }
    }
    s
}

/// The sums that place the edge, and those that tell its blur and what is left.
#[inline(always)]
fn all_sums(distance: &[Lane], grey: &[Lane], weight: &[Lane], model: Model) -> Sums {
    let mut s = place_sums(distance, grey, weight, model);
    let scale = 1.0 / model.blur;
    for ((d, v), w) in distance.iter().zip(grey).zip(weight) {
        for i in 0..LANES {
            let t = (model.shift[i] - d[i]) * scale;
            let (p, f) = normal(t);
            let v = v[i] - model.level + model.slope[i] * d[i] * p;
            let g = t * f;
            let wg = w[i] * g;
            s.g[i] += wg;
            s.gg[i] += wg * g;
            s.gp[i] += wg * p;
            s.gf[i] += wg * f;
            s.gv[i] += wg * v;
            s.vv[i] += w[i] * v * v;
        }
    }
    s
}

/// The sums of one bin with the means taken out: what is left when `outside` is solved for.
struct Centred {
    n: f32,
    pp: f32,
    pv: f32,
    ff: f32,
    fp: f32,
    fv: f32,
}

impl Centred {
    fn new(s: &Sums, i: usize) -> Self {
        let n = s.n[i].max(1.0);
        let (p, f, v) = (s.p[i] / n, s.f[i] / n, s.v[i]);
        Self {
            n,
            pp: s.pp[i] - p * s.p[i],
            pv: s.pv[i] - p * v,
            ff: s.ff[i] - f * s.f[i],
            fp: s.fp[i] - f * s.p[i],
            fv: s.fv[i] - f * v,
        }
    }

    fn contrast(&self) -> f32 {
        self.pv / self.pp
    }

    /// How the residual projects on a shift of the edge.
    fn pull(&self) -> f32 {
        self.fv - self.contrast() * self.fp
    }

    fn stiffness(&self) -> f32 {
        self.ff - self.fp * self.fp / self.pp
    }

    fn edge(&self, s: &Sums, i: usize, shift: f32, blur: f32) -> Edge {
        let contrast = self.contrast();
        if !(self.pp > 1e-3 && self.stiffness() > 1e-4 && contrast.abs() > 0.0) {
            return Edge::default();
        }
        let (n, g, v) = (self.n, s.g[i] / self.n, s.v[i]);
        let (gp, gf, gv) = (s.gp[i] - g * s.p[i], s.gf[i] - g * s.f[i], s.gv[i] - g * v);
        let gg = s.gg[i] - g * s.g[i];
        let across = (gf - gp * self.fp / self.pp) / self.stiffness();
        let free = gg - gp * gp / self.pp - across * across * self.stiffness();
        let pull = gv - contrast * gp - across * self.pull();
        let left = (s.vv[i] - v * v / n - contrast * self.pv).max(0.0);
        Edge {
            shift,
            contrast,
            inside: (v - contrast * s.p[i]) / n + contrast,
            rms: (left / (n - 3.0).max(1.0)).sqrt(),
            sigma_unit: blur / (contrast.abs() * self.stiffness().sqrt()),
            blur_pull: -contrast * pull / blur,
            blur_weight: contrast * contrast * free.max(0.0) / (blur * blur),
        }
    }
}
