//! Values of all functions of time at many times of a run, by which no window and no step passes over a pulse.

use crate::method::term_bounds::{TermBounds, half};
use liouville_base::error::StepError;
use liouville_base::real::WIDTH;

/// Times that are looked at in a run, at least, and for each unit of 1/β; they are apart by one and a half of equal parts at
/// most, ...
const TIMES: usize = 1 << 14;
const EACH: f64 = 16.0;
/// ... and no functions with a period are seen at one phase alone, as each is shifted by multiples of this.
const SHIFT: f64 = 0.618_033_988_749_894_9;

/// Numbers that are kept, where there are more times than at least.
const NUMBERS: usize = 1 << 22;

/// Most numbers that are kept with H for its next plan, as of breaks that derivatives ask for.
const KEPT: usize = 1 << 19;

/// A window that ends at a break takes H so many roundings of the time within it, where a jump is on its other side.
pub(super) const BESIDE: f64 = 8.0 * f64::EPSILON;

/// Rows of values: weights of the groups, then the potential at some points.
#[derive(Clone, Debug)]
pub(super) struct Scan {
    bounds: TermBounds,
    /// In order, and a row for each.
    times: Vec<f64>,
    rows: Vec<f64>,
}

impl Scan {
    /// Whether it is of these bounds, of the run in them.
    pub(super) fn is_of(&self, bounds: &TermBounds) -> bool {
        self.bounds == *bounds
    }

    /// Whether it may be kept with H.
    pub(super) fn is_small(&self) -> bool {
        self.rows.len() <= KEPT
    }

    /// Looks at a run by rows at times, and again where H is so large that it takes more of them.
    ///
    /// # Errors
    /// Rows were interrupted.
    pub(super) fn new(
        bounds: &TermBounds,
        rows_at: impl Fn(&[f64]) -> Result<Vec<f64>, StepError>,
    ) -> Result<Self, StepError> {
        let mut times = times(bounds, TIMES);
        let mut rows = rows_at(&times)?;
        let width = rows.len() / times.len();
        let sizes = rows.chunks(width).map(|row| (bounds.size(row), row));
        let finite = sizes.filter(|(size, _)| size.is_finite());
        let largest = finite.max_by(|a, b| a.0.total_cmp(&b.0));
        let beta = largest.map_or(0.0, |(_, row)| half(bounds.at(row)));
        let theta = beta * (bounds.span.1 - bounds.span.0).abs();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // of a positive number
        let count = ((EACH * theta) as usize).min(NUMBERS / width);
        if count > TIMES && !bounds.is_split {
            times = self::times(bounds, count);
            rows = rows_at(&times)?;
        }
        Ok(Self {
            bounds: bounds.clone(),
            times,
            rows,
        })
    }

    /// The times in an interval without its ends, where a jump may be on the other side.
    fn inside(&self, (t, h): (f64, f64)) -> std::ops::Range<usize> {
        let near = BESIDE * t.abs().max((t + h).abs());
        let (low, high) = (t.min(t + h) + near, t.max(t + h) - near);
        let first = self.times.partition_point(|time| *time < low);
        first..self.times.partition_point(|time| *time <= high).max(first)
    }

    /// Whether no time of an interval was looked at.
    pub(super) fn is_empty(&self, interval: (f64, f64)) -> bool {
        self.inside(interval).is_empty()
    }

    /// Ends of so many parts of an interval with equal shares of its time, of the sum of the sizes of all rows, and of that of
    /// their changes.
    pub(super) fn strata(&self, (start, end): (f64, f64), count: usize) -> Vec<f64> {
        let inside = self.inside((start, end - start));
        let stride = (inside.len() / TIMES).max(1);
        let places: Vec<usize> = inside.step_by(stride).collect();
        let (low, high) = (start.min(end), start.max(end));
        // ends of cells, and the time, phase and change of each
        let (mut ends, mut cells) = (vec![low], Vec::new());
        let mut next = |t: f64, [size, change]: [f64; 2]| {
            let time = t - ends[ends.len() - 1];
            ends.push(t);
            cells.push([time, size * time, change]);
        };
        for pair in places.windows(2) {
            next(self.times[pair[1]], self.sizes((pair[0], pair[1])));
        }
        next(high, [0.0; 2]);
        let whole = |k: usize| cells.iter().map(|cell| cell[k]).sum::<f64>();
        let weights = [0, 1, 2].map(|k| if whole(k) > 0.0 { 1.0 / whole(k) } else { 0.0 });
        let weighed = cells.iter().map(|cell| {
            let parts = cell.iter().zip(&weights);
            parts.map(|(part, weight)| part * weight).sum::<f64>()
        });
        let each = weighed.clone().sum::<f64>() / count as f64;
        let (mut strata, mut sum) = (vec![low], 0.0);
        for (share, cell) in weighed.zip(ends.windows(2)) {
            while strata.len() < count && sum + share >= strata.len() as f64 * each {
                let part = (strata.len() as f64 * each - sum) / share;
                strata.push(cell[0] + part.clamp(0.0, 1.0) * (cell[1] - cell[0]));
            }
            sum += share;
        }
        strata.push(high);
        if end < start {
            strata.reverse();
        }
        strata
    }

    /// Sizes of a row and of its change from one before; 0 of what is not finite.
    fn sizes(&self, (before, now): (usize, usize)) -> [f64; 2] {
        let width = self.rows.len() / self.times.len();
        let row = |k: usize| &self.rows[k * width..(k + 1) * width];
        let change = row(before).iter().zip(row(now)).map(|(a, b)| b - a);
        let change: Vec<f64> = change.collect();
        [row(now), &change].map(|row| {
            let size = self.bounds.size(row);
            if size.is_finite() { size } else { 0.0 }
        })
    }

    /// Whether a sum of Chebyshev's polynomials on an interval is off at any time by more than a tolerance.
    pub(super) fn is_missed(
        &self,
        (t, h): (f64, f64),
        (series, all): (&[f64], usize),
        apart: &mut Vec<f64>,
        is_fine: impl Fn(&[f64]) -> bool,
    ) -> bool {
        // points that are looked at since then have no rows
        let width = self.rows.len() / self.times.len();
        let inside = self.inside((t, h));
        let mut polynomials_at: Vec<[f64; WIDTH]> = Vec::new();
        let mut blocks = inside.clone().step_by(WIDTH);
        blocks.any(|first| {
            let here = first..inside.end.min(first + WIDTH);
            let x: [f64; WIDTH] = std::array::from_fn(|k| {
                let time = self.times[(first + k).min(inside.end - 1)];
                (2.0 * (time - t) / h - 1.0).clamp(-1.0, 1.0)
            });
            // Chebyshev's polynomials at these times
            let (mut before, mut now) = (x, [1.0; WIDTH]);
            let polynomials = series.chunks(all).map(|_| {
                let next = std::array::from_fn(|k| 2.0 * x[k] * now[k] - before[k]);
                (before, now) = (now, next);
                before
            });
            polynomials_at.clear();
            polynomials_at.extend(polynomials);
            apart.clear();
            apart.extend_from_slice(&self.rows[here.start * width..here.end * width]);
            for column in 0..width {
                let mut sum = [0.0; WIDTH];
                for (at, row) in polynomials_at.iter().zip(series.chunks(all)) {
                    for (sum, at) in sum.iter_mut().zip(at) {
                        *sum += at * row[column];
                    }
                }
                for (row, sum) in apart.chunks_mut(width).zip(sum) {
                    row[column] = sum - row[column];
                }
            }
            apart.chunks(width).any(|row| !is_fine(row))
        })
    }
}

/// So many times of a run, no two of which are apart by a period for long.
pub(super) fn places((low, high): (f64, f64), count: usize) -> impl Iterator<Item = f64> {
    (0..count).map(move |k| {
        let shift = 0.25 + 0.5 * (k as f64 * SHIFT).fract();
        low + (high - low) * ((k as f64 + shift) / count as f64)
    })
}

/// The times that are looked at: some all over the run, those of samples and of outputs and the middles between them.
fn times(bounds: &TermBounds, count: usize) -> Vec<f64> {
    let (start, end) = bounds.span;
    let (low, high) = (start.min(end), start.max(end));
    let middles = |times: &[f64]| -> Vec<f64> {
        let middle = |ends: &[f64]| f64::midpoint(ends[0], ends[1]);
        times.windows(2).map(middle).collect()
    };
    let given = [&bounds.knots, &bounds.outputs].into_iter();
    let besides = given
        .flat_map(|times| [times.clone(), middles(times)])
        .flatten();
    let is_inside = |time: &f64| low <= *time && *time <= high;
    let mut times: Vec<f64> = places((low, high), count)
        .chain(besides.filter(is_inside))
        .collect();
    times.sort_by(f64::total_cmp);
    times
}
