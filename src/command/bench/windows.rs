//! `ricochet bench windows`: the correlation rate in subsets per second.

use super::arithmetic::saturate_core;
use std::io::Write;
use std::sync::Barrier;
use std::time::Duration;

use serde_json::json;

use super::{BenchOptions, median_of, rate_per_s};
use crate::dic::grid;
use crate::dic::{
    CorrelationParams, Correlator, GridPoint, KernelBenchmark, Method, PlanarMotion, Point, Region, RigidBody, Shape,
    Start,
};
use crate::failure::Failure;
use crate::image::Image;
use crate::numeric::{Stream, instruction_set, key};

/// Side of the test images, px.
const SIDE: usize = 512;

/// Grid step between subset centres, px.
const STEP_PX: u32 = 16;

/// Displacement of the test pattern, px.
const SHIFT: Point = Point { x_px: 0.37, y_px: -0.185 };

/// A benchmarked method.
#[derive(Clone, Copy)]
struct Case {
    name: &'static str,
    kind: Kind,
    method: Method,
    shape: Shape,
    /// Number of points per round.
    points: Points,
}

/// The work of a round.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Prepares both frames, then correlates a field from the given start.
    Cold(Start),
    /// Correlates with a kept reference, from a start about 0.03 px off.
    Kept,
    /// Matches a whole ball rigidly.
    Body,
    /// Fused multiply-adds on registers only: the upper bound of the speed-up by threads on this machine.
    Arithmetic,
}

/// The number of points of a round.
#[derive(Clone, Copy, PartialEq)]
enum Points {
    Field,
    Few,
}

/// A row of the result.
struct Row {
    name: &'static str,
    threads: usize,
    points_per_s: f64,
    /// Relative to one thread.
    speedup: f64,
}

/// Number of turns of each thread count; they alternate, so that a drifting machine speed affects all equally.
const TURNS: u32 = 15;

const CASES: [Case; 10] = [
    case("ic-gn affine, cold", Kind::Cold(Start::Search), Method::IcGn, Shape::Affine, Points::Field),
    case("ic-gn affine, from neighbours", Kind::Cold(Start::Neighbor), Method::IcGn, Shape::Affine, Points::Field),
    case("ic-gn translation, cold", Kind::Cold(Start::Search), Method::IcGn, Shape::Translation, Points::Field),
    case("ic-gn translation, kept reference", Kind::Kept, Method::IcGn, Shape::Translation, Points::Field),
    case("ic-gn affine, kept reference", Kind::Kept, Method::IcGn, Shape::Affine, Points::Field),
    case("ic-gn quadratic, cold", Kind::Cold(Start::Search), Method::IcGn, Shape::Quadratic, Points::Few),
    case("peak-gaussian", Kind::Cold(Start::Search), Method::PeakGaussian, Shape::Translation, Points::Field),
    case("spline-fft, 2 points", Kind::Cold(Start::Search), Method::SplineFft, Shape::Translation, Points::Few),
    case("whole ball of 8800 px, rigid", Kind::Body, Method::IcGn, Shape::Rigid, Points::Few),
    case("limit: register arithmetic", Kind::Arithmetic, Method::IcGn, Shape::Translation, Points::Few),
];

/// Returns a case, so that the table above has one line for each.
const fn case(name: &'static str, kind: Kind, method: Method, shape: Shape, points: Points) -> Case {
    Case { name, kind, method, shape, points }
}

/// Measures every method with 1, 2, ... threads and prints points per second.
///
/// A point is a 31 x 31 subset. Cold cases include the preparation of both frames.
///
/// # Errors
///
/// When the result cannot be printed.
pub(super) fn run(options: &BenchOptions) -> Result<(), Failure> {
    let max_threads =
        options.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from)).max(1);
    let counts = (0..usize::BITS).map(|power| 1 << power).take_while(|count| *count < max_threads).chain([max_threads]);
    let counts: Vec<usize> = counts.collect();
    let frames = (render_speckles(Point::default(), 1), render_speckles(SHIFT, 2));
    let duration = options.duration();
    let mut rows = Vec::new();
    for case in CASES {
        let mut rates = vec![Vec::new(); counts.len()];
        for _ in 0..TURNS {
            for (threads, rates) in counts.iter().zip(&mut rates) {
                rates.push(measure_rate(&case, *threads, &frames, duration / TURNS)?);
            }
        }
        for (threads, own) in counts.iter().zip(&rates) {
            let speedups = own.iter().zip(&rates[0]).map(|(own, one)| own / one);
            let (points_per_s, speedup) = (median_of(own.iter().copied()), median_of(speedups));
            rows.push(Row { name: case.name, threads: *threads, points_per_s, speedup });
        }
    }
    print_rates(&rows, &time_parts(&frames, duration), options.json)
}

/// Measures the time of each part of a match on one thread, us.
fn time_parts(frames: &(Image, Image), duration: Duration) -> [(&'static str, f64); 5] {
    // Rotated by 1 deg, so that no iteration takes the shortcut for pure translation.
    let motion = PlanarMotion { u_px: SHIFT.x_px, v_px: SHIFT.y_px, angle_deg: 1.0 };
    let mut parts = KernelBenchmark::new(frames.0.view(), frames.1.view(), motion);
    let points = grid::rectangle([8, 8, SIDE as u32 - 16, SIDE as u32 - 16], STEP_PX, 31);
    let (second, mut next) = (frames.1.view(), points.iter().copied().cycle());
    let mut time = |part: &mut dyn FnMut(&mut KernelBenchmark, GridPoint) -> bool| {
        let mut call = |at| std::hint::black_box(part(&mut parts, at));
        1e6 / rate_per_s(duration, || next.by_ref().take(64).map(&mut call).count())
    };
    [
        (
            "prepare a frame of 512 x 512 px",
            time(&mut |parts, _| {
                parts.prepare(second);
                true
            }),
        ),
        ("subset: mean, gradients, Hessian", time(&mut |parts, at| parts.extract(at))),
        ("FFT correlation 32 x 32 and its peak", time(&mut |parts, at| parts.find_peak(at))),
        ("affine iteration, 31 x 31", time(&mut |parts, at| parts.iterate(at))),
        ("rigid iteration, ball of 8800 px", time(&mut |parts, _| parts.iterate_disc())),
    ]
}

/// Prints the rates of the methods and the times of the parts, as a table or as JSON.
fn print_rates(rows: &[Row], parts: &[(&str, f64)], as_json: bool) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    if as_json {
        let row = |row: &Row| {
            json!({
                "method": row.name,
                "subset_size_px": 31,
                "threads": row.threads,
                "points_per_s": row.points_per_s,
                "points_per_s_per_core": row.points_per_s / row.threads as f64,
                "speedup": row.speedup,
            })
        };
        let rows: Vec<_> = rows.iter().map(row).collect();
        let parts: Vec<_> = parts.iter().map(|(name, us)| json!({ "part": name, "us": us })).collect();
        writeln!(
            out,
            "{}",
            serde_json::to_string_pretty(
                &json!({ "instructions": instruction_set(), "windows": rows, "parts": parts })
            )?
        )?;
        return Ok(());
    }
    writeln!(out, "instructions: {}", instruction_set())?;
    writeln!(
        out,
        "{:36} {:>7} {:>12} {:>14} {:>8}",
        "31 x 31 subsets", "threads", "points/s", "us/point/core", "speed-up"
    )?;
    for row in rows {
        let us = 1e6 * row.threads as f64 / row.points_per_s;
        let (name, threads, rate, speedup) = (row.name, row.threads, row.points_per_s, row.speedup);
        writeln!(out, "{name:36} {threads:>7} {rate:>12.0} {us:>14.2} {speedup:>8.2}")?;
    }
    writeln!(out, "\n{:36} {:>14}", "parts, one thread", "us")?;
    for (name, us) in parts {
        writeln!(out, "{name:36} {us:>14.2}")?;
    }
    Ok(())
}

/// Returns the points per second of all threads together. A whole ball, or a round of arithmetic, counts as one point.
fn measure_rate(case: &Case, threads: usize, frames: &(Image, Image), duration: Duration) -> Result<f64, Failure> {
    let ready = Barrier::new(threads);
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(|| run_case(case, frames, duration, &ready))).collect();
        let mut sum = 0.0;
        for worker in workers {
            sum += worker.join().map_err(|_| Failure::internal("a worker of the benchmark panicked"))??;
        }
        Ok(sum)
    })
}

/// Returns the points per second of one thread, measured over `duration` once all threads are ready.
fn run_case(case: &Case, frames: &(Image, Image), duration: Duration, ready: &Barrier) -> Result<f64, Failure> {
    let params =
        CorrelationParams { method: case.method, shape: case.shape, step_px: STEP_PX, ..CorrelationParams::default() };
    let mut correlator = Correlator::new(&params, SIDE, SIDE)?;
    let mut points = grid::rectangle([8, 8, SIDE as u32 - 16, SIDE as u32 - 16], STEP_PX, params.subset_size_px);
    if case.points == Points::Few {
        points.truncate(60);
    }
    let (mut a, mut b) = (correlator.prepare(frames.0.view()), correlator.prepare(frames.1.view()));
    let near = Start::Motion { x_px: 0.0, y_px: 0.0, u_px: SHIFT.x_px - 0.02, v_px: SHIFT.y_px + 0.03, angle_deg: 0.0 };
    let kept = correlator.keep_reference(a.clone(), &points);
    let center = Point::new(0.5 * SIDE as f64, 0.5 * SIDE as f64);
    let ball = Region::Disc { x_px: center.x_px, y_px: center.y_px, radius_px: 53.0 };
    let near_ball = PlanarMotion { u_px: SHIFT.x_px - 0.02, v_px: SHIFT.y_px + 0.03, angle_deg: 0.05 };
    let mut body = RigidBody::new(&a, &ball)
        .map_err(|status| Failure::internal(format!("cannot match the test ball: {}", status.as_str())))?;
    let mut field = Vec::new();
    let mut round = |field: &mut Vec<_>| -> usize {
        match case.kind {
            Kind::Cold(start) => {
                correlator.prepare_into(frames.0.view(), &mut a);
                correlator.prepare_into(frames.1.view(), &mut b);
                correlator.correlate(&a, &b, &points, start, field);
                points.len()
            }
            Kind::Kept => {
                correlator.correlate_kept(&kept, &b, near, field);
                points.len()
            }
            Kind::Arithmetic => {
                std::hint::black_box(saturate_core(std::hint::black_box(0.5)));
                1
            }
            Kind::Body => usize::from(body.find(&b, center, near_ball).is_ok()),
        }
    };
    round(&mut field);
    ready.wait();
    Ok(rate_per_s(duration, || round(&mut field)))
}

/// Renders speckle discs of 3 to 6 px with soft edges and uniform noise, shifted by `shift`.
///
/// The discs are the same for every noise seed.
fn render_speckles(shift: Point, noise_seed: u64) -> Image {
    let mut random = Stream::new(7);
    let mut clear = vec![1.0_f32; SIDE * SIDE];
    for _ in 0..10_000 {
        let x = random.uniform() * SIDE as f64 + shift.x_px;
        let y = random.uniform() * SIDE as f64 + shift.y_px;
        let radius = 1.5 + 1.4 * random.uniform();
        let low = |center: f64| (center - 6.0).max(0.0) as usize;
        let high = |center: f64| ((center + 6.0).max(0.0) as usize).min(SIDE - 1);
        for row in low(y)..=high(y) {
            for column in low(x)..=high(x) {
                let distance = (column as f64 - x).hypot(row as f64 - y) - radius;
                clear[row * SIDE + column] *= (1.0 - 1.0 / (1.0 + (2.7 * distance).exp())) as f32;
            }
        }
    }
    let mut noise = Stream::new(key(noise_seed, 0, 0));
    let level = |clear: &f32| (18.0 + 200.0 * clear + 3.4 * (noise.uniform() as f32 - 0.5)).round();
    let mut image = Image::new(SIDE, SIDE);
    let levels: Vec<f32> = clear.iter().map(level).collect();
    image.data_mut().copy_from_slice(&levels);
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_measures_a_rate() {
        let frames = (render_speckles(Point::default(), 1), render_speckles(SHIFT, 2));
        for case in CASES {
            let rate = measure_rate(&case, 1, &frames, Duration::from_millis(1)).unwrap();
            assert!(rate > 0.0, "{}", case.name);
        }
    }
}
