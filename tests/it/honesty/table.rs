//! A table of verdicts, a kind per line.

use super::judge::{MAX_SIGMAS, Share, Verdict};
use std::collections::BTreeMap;
use std::fmt;

/// The sums over the scenes of a kind.
#[derive(Default)]
pub struct Sum {
    pub scenes: usize,
    pub positions: Share,
    pub rotations: Share,
    pub impacts: Share,
    /// The refused rows by their status.
    pub refused: BTreeMap<&'static str, usize>,
    pub rows: usize,
    pub wrong: usize,
    pub misleading: usize,
    pub worst_sigmas: f64,
}

/// The verdicts of many scenes.
pub struct Tally {
    pub all: Sum,
    kinds: BTreeMap<&'static str, Sum>,
    /// A line for each number that is wrong in a scene, the worst scenes first.
    pub faults: Vec<String>,
}

impl Share {
    fn add(&mut self, other: Self) {
        self.possible += other.possible;
        self.measured += other.measured;
    }

    /// Returns the measured share; 1 if nothing could be measured.
    pub fn of_one(self) -> f64 {
        if self.possible == 0 { 1.0 } else { self.measured as f64 / self.possible as f64 }
    }
}

impl Sum {
    fn add(&mut self, verdict: &Verdict) {
        self.scenes += 1;
        self.positions.add(verdict.positions);
        self.rotations.add(verdict.rotations);
        self.impacts.add(verdict.impacts);
        for (status, rows) in &verdict.refused {
            *self.refused.entry(status).or_default() += rows;
        }
        self.rows += verdict.rows;
        self.wrong += verdict.wrong;
        self.misleading += verdict.misleading;
        let worst = verdict.worst.values().map(|worst| worst.sigmas());
        self.worst_sigmas = worst.fold(self.worst_sigmas, f64::max);
    }
}

impl Tally {
    pub fn of(verdicts: &[Verdict]) -> Self {
        let mut tally = Self { all: Sum::default(), kinds: BTreeMap::new(), faults: Vec::new() };
        let mut sorted: Vec<&Verdict> = verdicts.iter().collect();
        sorted.sort_by_key(|verdict| std::cmp::Reverse((verdict.misleading, verdict.wrong)));
        for verdict in sorted {
            tally.all.add(verdict);
            verdict.tags.iter().for_each(|tag| tally.kinds.entry(tag).or_default().add(verdict));
            for (name, worst) in verdict.worst.iter().filter(|(_, worst)| worst.wrong > 0) {
                tally.faults.push(format!(
                    "seed {} ({}): {name} wrong in {} rows, worst in frame {}: {:.4} for {:.4} +- {:.4}, {:.0} sigmas",
                    verdict.seed,
                    verdict.tags.join(", "),
                    worst.wrong,
                    worst.frame,
                    worst.found,
                    worst.truth,
                    worst.sigma,
                    worst.sigmas(),
                ));
            }
        }
        tally
    }
}

impl Tally {
    /// Returns the sums over the scenes with a tag.
    pub fn kind(&self, tag: &str) -> &Sum {
        &self.kinds[tag]
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for fault in &self.faults {
            writeln!(f, "{fault}")?;
        }
        writeln!(f, "refused rows: {:?}", self.all.refused)?;
        writeln!(f, "measured: share of the rows in which a person could measure; wrong: beyond {MAX_SIGMAS} sigmas")?;
        writeln!(
            f,
            "{:<28}{:>7}{:>11}{:>11}{:>9}{:>7}{:>7}{:>11}{:>10}",
            "kind", "scenes", "positions", "rotations", "impacts", "rows", "wrong", "misleading", "worst"
        )?;
        for (kind, sum) in self.kinds.iter().map(|(kind, sum)| (*kind, sum)).chain([("all", &self.all)]) {
            let percent = |share: Share| match share.possible {
                0 => "-".to_owned(),
                _ => format!("{:.0} %", 100.0 * share.of_one()),
            };
            writeln!(
                f,
                "{kind:<28}{:>7}{:>11}{:>11}{:>9}{:>7}{:>7}{:>11}{:>10.1}",
                sum.scenes,
                percent(sum.positions),
                percent(sum.rotations),
                percent(sum.impacts),
                sum.rows,
                sum.wrong,
                sum.misleading,
                sum.worst_sigmas
            )?;
        }
        Ok(())
    }
}
