//! The edge in every bin of an annulus: a blurred step fitted to raw pixels.

use super::annulus::{Annulus, BAND_PX, LANES, Lane};
use crate::numeric::normal;

/// The minimum number of pixels per fitted bin.
const MIN_PIXELS: u32 = 8;
/// The minimum number of unclipped pixels of a bin within the annulus.
const MIN_UNCLIPPED: f32 = 5.0;

/// The blurred step fitted to one bin.
///
/// The grey level is `outside + contrast * P`, where `P = Phi((shift - distance) / blur)` is the fraction of the
/// pixel's blurred neighbourhood inside the edge. If the inside gets brighter inwards by `slope` per px, its blurred
/// part is `- slope * (distance * P - blur * phi)`, where phi is the density of Phi.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Edge {
    /// The position of the edge relative to the gathered circle, outwards, px.
    pub shift: f32,
    /// The grey level inside minus that outside; 0 if the bin could not be fitted.
    pub contrast: f32,
    /// The grey level inside.
    pub inside: f32,
    /// The root mean square of the residuals, grey levels.
    pub rms: f32,
    /// The standard deviation of `shift` for noise of one grey level, px.
    pub sigma_unit: f32,
    /// Gradient and curvature of half the residual sum with respect to the blur, grey^2 / px and grey^2 / px^2.
    pub blur_gradient: f32,
    pub blur_curvature: f32,
}

/// Sums over the pixels of a bin, for [`LANES`] bins at once.
///
/// p: fraction inside, f: density of the edge, g: derivative of p by the blur, v: grey level.
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

/// The parameters of the edge fit.
#[derive(Clone, Copy)]
pub(super) struct EdgeSearch<'a> {
    /// The blur of the image, px.
    pub blur: f32,
    /// The rise of the brightness inside towards the centre, per bin, grey levels/px.
    pub brightness_slope: &'a [f32],
    /// The number of Gauss-Newton steps on the position of the edge.
    pub steps: usize,
    /// Whether the edges are close to their start, so that the final sums allow one more step.
    pub is_near: bool,
}

/// Fits every bin of `rim`, starting from the shifts in `edges` if they belong to the same bins.
pub(super) fn fit_edges(rim: &Annulus, search: EdgeSearch<'_>, edges: &mut Vec<Edge>) {
    if edges.len() != rim.bins() {
        edges.clear();
        edges.resize(rim.bins(), Edge::default());
    }
    for block in 0..rim.bins().div_ceil(LANES) {
        let bins = block * LANES..((block + 1) * LANES).min(rim.bins());
        let (mut slope, mut shift) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        for (lane, bin) in bins.clone().enumerate() {
            (slope[lane], shift[lane]) = (search.brightness_slope[bin], edges[bin].shift);
        }
        let (distance, grey, weight) = rim.block(block);
        let level = reference_level(grey);
        let model = Model { shift, blur: search.blur, slope, level, is_near: search.is_near };
        let fitted = fit_block(distance, grey, weight, model, search.steps);
        for (mut edge, bin) in fitted.into_iter().zip(bins) {
            if rim.count(bin) < MIN_PIXELS || !edge.shift.is_finite() || !edge.rms.is_finite() {
                edge = Edge::default();
            }
            edge.inside += level;
            edges[bin] = edge;
        }
    }
}

/// Fits the steps of one block, starting from the shifts in `model`, with `steps` Gauss-Newton steps.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn fit_block(distance: &[Lane], grey: &[Lane], weight: &[Lane], mut model: Model, steps: usize) -> [Edge; LANES] {
    for _ in 0..steps {
        let s = accumulate_sums::<false>(distance, grey, weight, model);
        for i in 0..LANES {
            model.shift[i] = Centred::new(&s, i).stepped_shift(model.shift[i], model.blur);
        }
    }
    let s = accumulate_sums::<true>(distance, grey, weight, model);
    let mut edges = [Edge::default(); LANES];
    for (i, edge) in edges.iter_mut().enumerate() {
        let c = Centred::new(&s, i);
        *edge = c.to_edge(&s, i, model.shift[i], model.blur);
        // The sums allow one more step for free. Close to the edge it hardly changes the other values.
        if model.is_near && edge.contrast.abs() > 0.0 {
            edge.shift = c.stepped_shift(model.shift[i], model.blur);
        }
    }
    edges
}

/// The model that the pixels of a block are compared with.
#[derive(Clone, Copy)]
struct Model {
    shift: Lane,
    blur: f32,
    slope: Lane,
    level: f32,
    is_near: bool,
}

/// Returns the mean grey level of the first pixels of the block's bins, to be subtracted from all its grey levels.
///
/// The sums in single precision keep their digits near zero, so the exact value does not matter. A bin without pixels
/// counts as 0, and a block without any has the level 0.
fn reference_level(grey: &[Lane]) -> f32 {
    let sum: f32 = grey.first().map_or(0.0, |first| first.iter().sum());
    sum / LANES as f32
}

/// Sums the terms of the normal equations for the position of the edge; with `ALL`, also those of blur and residuals.
#[inline(always)]
fn accumulate_sums<const ALL: bool>(distance: &[Lane], grey: &[Lane], weight: &[Lane], model: Model) -> Sums {
    let mut s = Sums::default();
    let scale = 1.0 / model.blur;
    for ((d, v), w) in distance.iter().zip(grey).zip(weight) {
        for i in 0..LANES {
            let t = (model.shift[i] - d[i]) * scale;
            let (p, f) = normal(t);
            let w = w[i];
            let (wp, wf) = (w * p, w * f);
            let v = v[i] - model.level + model.slope[i] * (d[i] * p - model.blur * f);
            s.n[i] += w;
            s.p[i] += wp;
            s.v[i] += w * v;
            s.f[i] += wf;
            s.pp[i] += wp * p;
            s.pv[i] += wp * v;
            s.ff[i] += wf * f;
            s.fp[i] += wf * p;
            s.fv[i] += wf * v;
            if ALL {
                let g = t * f;
                let wg = w * g;
                s.g[i] += wg;
                s.gg[i] += wg * g;
                s.gp[i] += wg * p;
                s.gf[i] += wg * f;
                s.gv[i] += wg * v;
                s.vv[i] += w * v * v;
            }
        }
    }
    s
}

/// The sums of one bin without the means, i.e. with `outside` eliminated.
struct Centred {
    n: f32,
    pp: f32,
    pv: f32,
    ff: f32,
    fp: f32,
    fv: f32,
}

impl Centred {
    /// Eliminates `outside` from the sums of bin `i`.
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

    /// Returns the contrast of least squares for the current position of the edge, grey levels.
    fn contrast(&self) -> f32 {
        self.pv / self.pp
    }

    /// Returns the projection of the residuals on a shift of the edge.
    fn gradient(&self) -> f32 {
        self.fv - self.contrast() * self.fp
    }

    /// Returns the curvature of half the residual sum with respect to the position, relative to contrast^2 / blur^2.
    fn curvature(&self) -> f32 {
        self.ff - self.fp * self.fp / self.pp
    }

    /// Returns the shift of the edge after a Gauss-Newton step, px, limited to the annulus.
    fn stepped_shift(&self, shift: f32, blur: f32) -> f32 {
        let limit = BAND_PX as f32 - 0.5;
        let step = (blur * self.gradient() / (self.contrast() * self.curvature())).clamp(-0.7, 0.7);
        // A bin without an edge has no step; NaN fails the comparison.
        if step.abs() <= 0.7 { (shift + step).clamp(-limit, limit) } else { shift }
    }

    /// Returns the fitted edge of bin `i`; a default one if its pixels do not determine it.
    fn to_edge(&self, s: &Sums, i: usize, shift: f32, blur: f32) -> Edge {
        let contrast = self.contrast();
        if !(self.n >= MIN_UNCLIPPED && self.pp > 1e-3 && self.curvature() > 1e-4 && contrast.abs() > 0.0) {
            return Edge::default();
        }
        let (n, g, v) = (self.n, s.g[i] / self.n, s.v[i]);
        let (gp, gf, gv) = (s.gp[i] - g * s.p[i], s.gf[i] - g * s.f[i], s.gv[i] - g * v);
        let gg = s.gg[i] - g * s.g[i];
        let across = (gf - gp * self.fp / self.pp) / self.curvature();
        let free = gg - gp * gp / self.pp - across * across * self.curvature();
        let gradient = gv - contrast * gp - across * self.gradient();
        let residual_sum = (s.vv[i] - v * v / n - contrast * self.pv).max(0.0);
        Edge {
            shift,
            contrast,
            inside: (v - contrast * s.p[i]) / n + contrast,
            rms: (residual_sum / (n - 3.0).max(1.0)).sqrt(),
            sigma_unit: blur / (contrast.abs() * self.curvature().sqrt()),
            blur_gradient: -contrast * gradient / blur,
            blur_curvature: contrast * contrast * free.max(0.0) / (blur * blur),
        }
    }
}
