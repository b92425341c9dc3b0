//! Worker threads that measure films; results are delivered in order.

use crate::failure::Failure;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use super::film::{self, Filming, FramePair, SIDE_PX};
use super::films_plan::{Film, SpeckleStudy};
use super::methods::{Evaluator, Method, Windows};
use super::row::Row;
use crate::image::Image;
use crate::synth::SimulatedFilm;

/// The settings that determine the results of a study.
#[derive(Debug, Clone)]
pub(super) struct Job {
    pub(super) study: SpeckleStudy,
    pub(super) films: Vec<Film>,
    pub(super) methods: Vec<Method>,
    pub(super) windows: Windows,
    pub(super) filming: Filming,
}

/// The balls by pattern and level.
type Balls = BTreeMap<(usize, usize), SimulatedFilm>;

/// The index of a film, and its rows or error.
type FilmResult = (usize, Result<Vec<Row>, Failure>);

impl Job {
    /// Measures the films from `first` on and passes their rows to `write_rows` in order.
    ///
    /// The rows of a film depend on the job only, not on the number of threads.
    ///
    /// # Errors
    ///
    /// Any error of a film or of `write_rows`.
    pub(super) fn run(
        &self,
        first: usize,
        threads: usize,
        mut write_rows: impl FnMut(Vec<Row>) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let next = AtomicUsize::new(first);
        let balls = self.prepare_balls(first)?;
        std::thread::scope(|scope| {
            let (sender, receiver) = sync_channel(2 * threads);
            let work = |sender: SyncSender<FilmResult>| self.run_worker(&balls, &next, &sender);
            let workers: Vec<_> = (0..threads)
                .map(|_| {
                    let sender = sender.clone();
                    scope.spawn(move || work(sender))
                })
                .collect();
            drop(sender);
            let given = deliver_in_order(first, receiver, &mut write_rows);
            for worker in workers {
                worker.join().map_err(|_| Failure::internal("a measuring thread panicked"))??;
            }
            given
        })
    }

    /// Measures the film with this index on the calling thread. Its rows are those that [`Self::run`] passes on.
    ///
    /// # Errors
    ///
    /// Any error of the film.
    ///
    /// # Panics
    ///
    /// If the job has no such film.
    pub(super) fn measure_single(&self, index: usize) -> Result<Vec<Row>, Failure> {
        let film = &self.films[index];
        let ball = film::static_ball(film.pattern, &self.filming_of(film))?;
        self.measure(&mut Evaluator::new(&self.methods, self.windows, SIDE_PX)?, &ball, film)
    }

    /// Places the speckles of the balls that the films from `first` on need, per pattern and level.
    ///
    /// # Errors
    ///
    /// When a ball cannot be rendered.
    fn prepare_balls(&self, first: usize) -> Result<Balls, Failure> {
        let mut balls = Balls::new();
        for film in &self.films[first..] {
            if let Entry::Vacant(place) = balls.entry((film.pattern, film.level)) {
                place.insert(film::static_ball(film.pattern, &self.filming_of(film))?);
            }
        }
        Ok(balls)
    }

    /// Returns the settings of a film, with the varied setting at its level.
    fn filming_of(&self, film: &Film) -> Filming {
        let Some(level) = self.study.levels().get(film.level).copied() else { return self.filming };
        match self.study {
            SpeckleStudy::Noise => Filming { noise_dn: level, ..self.filming },
            SpeckleStudy::Blur => Filming { blur_px: level, ..self.filming },
            _ => self.filming,
        }
    }

    /// Runs one thread: measures the film with index `next` and sends its rows, until there are no films or the
    /// receiver is gone.
    ///
    /// # Errors
    ///
    /// When the methods cannot be planned. An error of a film is sent.
    fn run_worker(&self, balls: &Balls, next: &AtomicUsize, sender: &SyncSender<FilmResult>) -> Result<(), Failure> {
        let mut evaluator = Evaluator::new(&self.methods, self.windows, SIDE_PX)?;
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(plan) = self.films.get(number) else { break };
            let Some(ball) = balls.get(&(plan.pattern, plan.level)) else { break };
            if sender.send((number, self.measure(&mut evaluator, ball, plan))).is_err() {
                break;
            }
        }
        Ok(())
    }

    /// Renders one film and measures it with every method. Returns its rows, pair by pair and method by method.
    ///
    /// # Errors
    ///
    /// When the velocity is out of range, or the rendered bytes are not a frame.
    fn measure(&self, evaluator: &mut Evaluator, ball: &SimulatedFilm, plan: &Film) -> Result<Vec<Row>, Failure> {
        let rendered = film::moving_ball(ball, plan, &self.filming)?;
        let (mut bytes, mut before, mut after) = (Vec::new(), Image::default(), Image::default());
        rendered.draw(0, &mut bytes, &mut before)?;
        let mut rows = Vec::new();
        for frame in 0..self.filming.frames - 1 {
            rendered.draw(frame + 1, &mut bytes, &mut after)?;
            let answers = evaluator.measure(FramePair { before: before.view(), after: after.view() });
            rows.extend(
                self.methods
                    .iter()
                    .zip(&answers)
                    .map(|(method, answer)| Row::new(self.study, plan, frame, *method, answer)),
            );
            std::mem::swap(&mut before, &mut after);
        }
        Ok(rows)
    }
}

/// Passes the results of films from `first` on to `write_rows` in order, whatever the order of their arrival.
///
/// # Errors
///
/// The first error of a film, in order, or of `write_rows`.
fn deliver_in_order(
    first: usize,
    receiver: Receiver<FilmResult>,
    write_rows: &mut impl FnMut(Vec<Row>) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let (mut next, mut early) = (first, BTreeMap::new());
    // Returning early drops the receiver, which ends the threads.
    for (number, rows) in receiver {
        early.insert(number, rows);
        while let Some(rows) = early.remove(&next) {
            write_rows(rows?)?;
            next += 1;
        }
    }
    Ok(())
}
