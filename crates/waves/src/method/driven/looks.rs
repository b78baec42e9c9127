//! The points at which a potential is looked at over a run: some all over the grid, and others at which it was found to change.
//!
//! The potential is taken at many points and at some times, those among them at which its functions of the time are least or
//! largest or change most. Points are pivots of the changes, one after another, by which all of these follow from those
//! found before (bebendorf2000).

use super::scan::places;
use crate::problem::{Hamiltonian, Potential};
use liouville_base::cancel;
use liouville_base::error::StepError;

/// Points all over the grid, and most of those at which changes were found.
const SPREAD: usize = 16;
const PIVOTS: usize = 32;

/// Points among which pivots are found, and times; times at which functions of the time are looked at, and most of these.
const CANDIDATES: usize = 4096;
const TIMES: usize = 32;
const LOOKS: usize = 1 << 14;
const FUNCTIONS: usize = 8;

/// Changes below this part of the largest are roundings.
const LEAST: f64 = 1e-12;

/// Points of the potential that were chosen for a run.
#[derive(Clone, Debug)]
pub(super) struct LookPoints {
    span: (f64, f64),
    pub(super) points: Vec<usize>,
}

impl LookPoints {
    /// Returns those of a run, kept with H or found now; none where no potential depends on time.
    ///
    /// # Errors
    /// It was interrupted.
    pub(super) fn of(hamiltonian: &Hamiltonian, span: (f64, f64)) -> Result<Vec<usize>, StepError> {
        let Some(potential) = hamiltonian.potential() else {
            return Ok(Vec::new());
        };
        let make = || {
            let points = choose(potential, span)?;
            Ok(Self { span, points })
        };
        let fits = |found: &Self| found.span == span;
        let found = hamiltonian.looks().get(fits, make, |_| true)?;
        Ok(found.points.clone())
    }
}

/// So many places in equal distances, or all of them.
fn spread(size: usize, count: usize) -> Vec<usize> {
    let count = count.min(size);
    (0..count)
        .map(|k| (2 * k + 1) * size / (2 * count))
        .collect()
}

fn choose(potential: &Potential, (start, end): (f64, f64)) -> Result<Vec<usize>, StepError> {
    let size = potential.size();
    if size <= SPREAD || start.to_bits() == end.to_bits() {
        return Ok(spread(size, SPREAD));
    }
    let candidates = spread(size, CANDIDATES);
    let some = potential.at_points(&candidates);
    let mut registers = some.bind();
    let mut rows = Vec::new();
    for t in times(potential, (start, end))? {
        if cancel::is_cancelled() {
            return Err(StepError::Interrupted);
        }
        let mut row = vec![0.0; candidates.len()];
        some.add(&mut registers, (1.0, t), 0, &mut row);
        if row.iter().all(|v| v.is_finite()) {
            rows.push(row);
        }
    }
    let mut found: Vec<usize> = pivots(rows).into_iter().map(|k| candidates[k]).collect();
    found.extend(spread(size, SPREAD));
    found.sort_unstable();
    found.dedup();
    Ok(found)
}

/// Times all over a run, and those at which functions of the time are least, largest and change most.
fn times(potential: &Potential, (start, end): (f64, f64)) -> Result<Vec<f64>, StepError> {
    let ends = (start.min(end), start.max(end));
    let mut found: Vec<f64> = places(ends, TIMES).collect();
    found.extend([start, end]);
    let looked: Vec<f64> = places(ends, LOOKS).collect();
    let mut registers = potential.bind();
    let count = potential.functions().min(FUNCTIONS);
    // the value and the time of the least, of the largest, and of the one after the largest change
    let mut extremes = vec![
        [
            (f64::INFINITY, start),
            (-f64::INFINITY, start),
            (0.0, start)
        ];
        count
    ];
    let mut before = vec![f64::NAN; count];
    for (k, t) in looked.into_iter().enumerate() {
        if k % TIMES == 0 && cancel::is_cancelled() {
            return Err(StepError::Interrupted);
        }
        let values = potential.at_time(&mut registers, t);
        for ((value, extremes), before) in values.iter().zip(&mut extremes).zip(&mut before) {
            let [least, largest, change] = extremes;
            let size = (value - *before).abs();
            if *value < least.0 {
                *least = (*value, t);
            }
            if *value > largest.0 {
                *largest = (*value, t);
            }
            if size > change.0 {
                *change = (size, t);
            }
            *before = *value;
        }
    }
    found.extend(extremes.iter().flatten().map(|(_, t)| *t));
    Ok(found)
}

/// Columns of the largest changes from the first row, each without what follows from those before.
fn pivots(mut rows: Vec<Vec<f64>>) -> Vec<usize> {
    let Some(first) = rows.pop() else {
        return Vec::new();
    };
    for row in &mut rows {
        row.iter_mut().zip(&first).for_each(|(v, x)| *v -= x);
    }
    let largest = |rows: &[Vec<f64>]| {
        let all = rows.iter().enumerate().flat_map(|(i, row)| {
            let each = row.iter().enumerate();
            each.map(move |(k, v)| (v.abs(), i, k))
        });
        all.fold(
            (0.0, 0, 0),
            |most, each| if each.0 > most.0 { each } else { most },
        )
    };
    let (all, mut found) = (largest(&rows).0, Vec::new());
    while found.len() < PIVOTS {
        let (size, i, k) = largest(&rows);
        if size <= LEAST * all {
            break;
        }
        let pivot = rows.swap_remove(i);
        for row in &mut rows {
            let factor = row[k] / pivot[k];
            row.iter_mut()
                .zip(&pivot)
                .for_each(|(v, x)| *v -= factor * x);
        }
        found.push(k);
    }
    found
}
