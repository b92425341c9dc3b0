//! The numbers of the shots so far: mean, spread, outliers.

use super::numbers::{QUANTITIES, quantity_json};
use crate::plot::{ImpactQuantity, format_estimate};
use crate::report::Spread;
use crate::results::{Estimate, Impact};
use serde_json::{Value, json};

/// One number of all shots.
#[derive(Debug)]
struct Column {
    /// `None` without any value.
    spread: Option<Spread>,
    /// The shot of each value, by its place in the list.
    places: Vec<usize>,
}

/// The numbers of a list of shots.
#[derive(Debug)]
pub(super) struct Series(Vec<Column>);

impl Series {
    /// Computes the spread of each number over the collisions of a list of shots. `None` stands for a shot that does
    /// not count or has no collision.
    pub(super) fn new(impacts: &[Option<&Impact>]) -> Self {
        let column = |name: &str| {
            let measured = impacts.iter().enumerate().filter_map(|(at, impact)| Some((at, (*impact)?.get(name)?)));
            let (places, values): (Vec<usize>, Vec<Estimate>) = measured.unzip();
            Column { spread: Spread::from_estimates(&values), places }
        };
        Self(QUANTITIES.iter().map(|quantity| column(quantity.column)).collect())
    }

    /// Returns the numbers of a collision as JSON, each with whether it is an outlier among the shots. `place` is the
    /// shot's place in the list, from 0.
    pub(super) fn numbers(&self, place: usize, impact: Option<&Impact>) -> Vec<Value> {
        let entry = |(quantity, column): (&ImpactQuantity, &Column)| {
            let mut entry = quantity_json(quantity, impact.and_then(|impact| impact.get(quantity.column)));
            let at = column.places.iter().position(|other| *other == place);
            let outliers = column.spread.as_ref().map(|spread| &spread.outliers);
            entry["outlier"] = json!(at.zip(outliers).is_some_and(|(at, outliers)| outliers[at]));
            entry
        };
        QUANTITIES.iter().zip(&self.0).map(entry).collect()
    }

    /// Returns the mean of each number as JSON, and the number of values in it. Its `sigma` is the standard deviation
    /// of the shots if there are enough, and else their stated uncertainty; `sd_text` is the former alone.
    pub(super) fn as_json(&self) -> Vec<Value> {
        let entry = |(quantity, column): (&ImpactQuantity, &Column)| {
            let spread = column.spread.as_ref();
            let mean = spread.map(|s| Estimate { value: s.mean, sigma: s.sd.unwrap_or(s.stated) });
            let deviation = mean.filter(|_| spread.is_some_and(|s| s.sd.is_some()));
            let mut entry = quantity_json(quantity, mean);
            entry["count"] = json!(spread.map_or(0, |spread| spread.kept));
            entry["sd_text"] = json!(deviation.map(|mean| format_estimate(mean, quantity.factor).sigma));
            entry
        };
        QUANTITIES.iter().zip(&self.0).map(entry).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shots_that_do_not_count_are_in_no_mean_and_an_outlier_is_marked() {
        let impact = |restitution: f64| Impact {
            restitution: Some(Estimate { value: restitution, sigma: 0.001 }),
            ..Impact::unknown(0, 0, 0)
        };
        let all = [0.8, 0.801, 0.9, 0.799, 0.2, 0.8].map(impact);
        let counted: Vec<Option<&Impact>> = all.iter().enumerate().map(|(k, i)| (k != 4).then_some(i)).collect();
        let series = Series::new(&counted);
        let outliers = (0..6).map(|k| series.numbers(k, Some(&all[k]))[0]["outlier"] == true).collect::<Vec<_>>();
        assert_eq!(outliers, [false, false, true, false, false, false]);
        let mean = &series.as_json()[0];
        assert_eq!((mean["count"].as_u64(), mean["text"].as_str()), (Some(4), Some("0.80000")));
        assert_eq!(series.as_json()[1]["text"], Value::Null);
    }
}
