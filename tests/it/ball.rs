//! The ball finder against drawn balls whose circle is known.

#[path = "ball/scene.rs"]
mod scene;

use ricochet::ball::{BallFinder, BallParams};
use ricochet::image::ImageView;
use ricochet::results::Circle;
use scene::Scene;

/// Errors of many frames.
#[derive(Debug, Default)]
struct Tally {
    frames: usize,
    center: Vec<f64>,
    radius: Vec<f64>,
    visible: Vec<f64>,
    ratios: Vec<f64>,
}

impl Tally {
    fn add(&mut self, scene: &Scene, circle: Option<Circle>, visible: f64) {
        self.frames += 1;
        let Some(c) = circle else { return };
        for e in [c.x_px - scene.x, c.y_px - scene.y] {
            self.center.push(e.abs());
            self.ratios.push(e.abs() / c.sigma_center_px);
        }
        self.radius.push(c.radius_px - scene.radius);
        self.visible.push((c.visible_fraction - visible).abs());
    }

    fn refused(&self) -> usize {
        self.frames - self.radius.len()
    }

    fn mean(&self) -> f64 {
        mean(&self.center)
    }

    fn worst(&self) -> f64 {
        self.center.iter().copied().fold(0.0, f64::max)
    }

    fn covered(&self, sigmas: f64) -> f64 {
        self.ratios.iter().filter(|r| **r < sigmas).count() as f64 / self.ratios.len().max(1) as f64
    }

    fn line(&self) -> String {
        let mut sorted = self.center.clone();
        sorted.sort_by(f64::total_cmp);
        let q95 = sorted.get(sorted.len() * 95 / 100).copied().unwrap_or(0.0);
        format!(
            "mean {:.4} q95 {q95:.3} worst {:.3} px, radius {:+.3}, refused {} of {}, sigma {:.2} / {:.2}, visible {:.3}",
            self.mean(),
            self.worst(),
            mean(&self.radius),
            self.refused(),
            self.frames,
            self.covered(1.0),
            self.covered(2.0),
            mean(&self.visible)
        )
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Share of the disc's area in front of a straight edge that hides this share of the diameter.
fn visible(hidden: f64) -> f64 {
    let a = (1.0 - 2.0 * hidden).acos();
    1.0 - (a - a.sin() * a.cos()) / std::f64::consts::PI
}

fn hard_scenes(bright: bool, hidden: f64, seeds: std::ops::Range<u64>) -> Tally {
    let mut finder = BallFinder::new(&BallParams::new(50.0, 68.0), 256, 256).unwrap();
    let mut tally = Tally::default();
    for seed in seeds {
        let scene = Scene::hard(seed, bright, hidden);
        let data = scene.render();
        let found = finder.find(ImageView::new(&data, 256, 256).unwrap());
        tally.add(&scene, found, visible(hidden));
        if let Some(c) = found {
            let e = (c.x_px - scene.x).abs().max((c.y_px - scene.y).abs());
            if e > 0.3 {
                println!("  seed {seed} bright {bright} hidden {hidden}: error {e:.2} {c:?}");
            }
        } else {
            println!("  seed {seed} bright {bright} hidden {hidden}: refused");
        }
    }
    tally
}

#[test]
#[ignore = "long"]
fn time_of_a_frame() {
    for (low, high) in [(50.0, 68.0), (20.0, 200.0)] {
        let mut finder = BallFinder::new(&BallParams::new(low, high), 512, 512).unwrap();
        let scene = Scene { width: 512, height: 512, x: 300.2, ..Scene::hard(3, true, 0.2) };
        let data = scene.render();
        let image = ImageView::new(&data, 512, 512).unwrap();
        let circle = finder.find(image).unwrap();
        for _ in 0..20 {
            finder.find(image);
        }
        let Some(start) = clock() else { return };
        for _ in 0..100 {
            finder.find(image);
        }
        println!("find {low}..{high}: {:.3} ms", (clock().unwrap() - start) * 10.0);
        let Some(start) = clock() else { return };
        for _ in 0..300 {
            finder.follow(image, &circle);
        }
        println!("follow {low}..{high}: {:.3} ms", (clock().unwrap() - start) / 0.3);
    }
}

/// Seconds this thread has computed, whatever else the machine does; `None` where the system does not tell.
fn clock() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(text.split_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
}

#[test]
#[ignore = "long"]
fn statistics_of_hard_scenes() {
    for bright in [true, false] {
        for hidden in [0.0, 0.2, 0.4] {
            let tally = hard_scenes(bright, hidden, 0..60);
            println!("bright {bright} hidden {hidden}: {}", tally.line());
        }
    }
}
