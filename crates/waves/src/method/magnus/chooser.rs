//! How long steps of a Magnus method may be.
//!
//! The error of a step is predicted as C m, where m adds up by norms all words of weight p + 1, but that of α_1 alone, in
//! the parts of H
//!
//!     H(t + s h) h = Σ_n α_n T_{n−1}(2s − 1),    α_n of weight n,
//!
//! which are found by Chebyshev's nodes, the ends of the step among them. So a step into a pulse is shortened before it is
//! made, and one around a jump, which leaves much to the last α_n. Of an H(t) known by its products alone the last α_n, to
//! which every jump leaves the same, acts on the state, and others are not looked for: m is the power p + 1 of the phase of
//! a step, which is short at first and then follows from the errors found.

use super::probe::Probe;
use super::{Averages, Nodes};
use crate::method::bessel::degree;
use crate::method::driven::Sampler;
use crate::method::driven::polynomials::{chebyshev_node, chebyshev_weight};
use crate::method::term_bounds::{Interval, TermBounds};
use crate::problem::{Hamiltonian, HamiltonianAt};
use liouville_base::error::StepError;
use std::sync::Arc;

/// The parts of the tolerance: for all exponentials, and for the Magnus method itself.
pub(super) const SERIES: f64 = 0.1;
const METHOD: f64 = 0.8;

/// A step, as one around a jump, may be off by this part of what those before it have left, and at first of this part of the
/// whole tolerance.
const JUMP: f64 = 0.1;
const SPARE: f64 = 0.1;

/// New steps are so much shorter than those that just keep to the tolerance, ...
pub(super) const SAFETY: f64 = 0.9;
/// ... change by such factors at once, ...
pub(super) const CHANGE: (f64, f64) = (0.3, 3.0);
/// ... and are shortened so often before they are refused.
const TRIES: usize = 200;

/// The tolerance of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MagnusTolerance {
    /// Error allowed in a unit of time.
    pub rate: f64,
    /// In all.
    pub whole: f64,
    /// Tolerance of the norm.
    pub norm: f64,
}

/// A step that is to be made.
#[derive(Clone, Copy, Debug)]
pub(super) struct Proposed {
    /// Its length.
    pub(super) step: f64,
    /// Its m.
    pub(super) size: f64,
    /// The error that it has, at most, where H has a kink or a jump.
    pub(super) unresolved: f64,
}

/// The choice of steps by scalars.
#[derive(Clone)]
pub(super) struct Chooser {
    hamiltonian: Arc<Hamiltonian>,
    current: HamiltonianAt,
    averages: Averages,
    pub(super) nodes: Nodes,
    /// Points, and weights of values there in α_n / h.
    points: Vec<f64>,
    moments: Vec<Vec<f64>>,
    /// Weights of the parts of H and its potential at each of the points, and a sum of them.
    values: Vec<f64>,
    sum: Vec<f64>,
    pub(super) tolerance: MagnusTolerance,
    /// The last step, ...
    pub(super) last: f64,
    /// ... and the error that steps so far have left to others.
    pub(super) left: f64,
    /// Functions of time as they were looked at over the run.
    scan: Sampler,
    /// Norms of α_n / h, and sums of all words of each weight.
    pub(super) norms: Vec<f64>,
    words: Vec<f64>,
    /// Products, where nothing else is known of H(t).
    pub(super) probe: Option<Probe>,
}

/// Points of a step at which H is looked at, ...
const NODES: usize = 9;
/// ... and the last terms of its series there.
const LAST: std::ops::Range<usize> = NODES - 6..NODES;

/// A step over a jump may be no shorter, in units of t: the jump is known to rounding errors of the time.
const LEAST: f64 = 4.0 * f64::EPSILON;

/// Roundings of the part of H h that its α_n do not have, relative to what is rounded.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// The error of a step in units of the last two terms of the series of H, where the last three are below such a part of those
/// before: where H is smooth, ...
const SMOOTH: f64 = 0.1;
const DECAY: f64 = 0.1;
/// ... and elsewhere, around a kink or a jump, in units of the largest of three, as one alone may vanish.
const KINK: f64 = 0.5;

/// The error left by what a series with these last terms leaves out, and whether there is a kink or a jump.
fn left_out(terms: &[f64]) -> (f64, bool) {
    let (before, last) = terms.split_at(terms.len() - 3);
    let largest = |terms: &[f64]| terms.iter().copied().fold(0.0, f64::max);
    if largest(last) < DECAY * largest(before) {
        (SMOOTH * (last[1] + last[2]), false)
    } else {
        (KINK * largest(last), true)
    }
}

/// Weights of values at the points in the coefficient of Chebyshev's polynomial `T_n`.
fn moment(n: usize) -> Vec<f64> {
    (0..NODES)
        .map(|node| chebyshev_weight(n, node, NODES))
        .collect()
}

fn half((low, high): Interval) -> f64 {
    0.5 * (high - low)
}

impl Chooser {
    /// Scalars over the run; none where the bounds do not fit the terms of H.
    ///
    /// # Errors
    /// It was interrupted.
    pub(super) fn new(
        hamiltonian: &Arc<Hamiltonian>,
        nodes: Nodes,
        bounds: TermBounds,
        tolerance: MagnusTolerance,
    ) -> Option<Result<Self, StepError>> {
        if !bounds.is_fitting(hamiltonian.terms().len()) {
            return None;
        }
        let sampler = Sampler::new(hamiltonian.clone(), bounds.clone())?;
        let scan = match sampler.and_then(Sampler::with_scan) {
            Ok(scan) => scan,
            Err(error) => return Some(Err(error)),
        };
        // the third one is the error of a single node
        let letters = (nodes.order / 2 + 1).max(3);
        let current = HamiltonianAt::new(hamiltonian);
        let width = bounds.parts.len() + current.potential().len();
        Some(Ok(Self {
            values: Vec::with_capacity(NODES * width),
            sum: vec![0.0; width],
            current,
            hamiltonian: hamiltonian.clone(),
            scan,
            averages: Averages::new(bounds, NODES),
            points: (0..NODES).map(|k| chebyshev_node(k, NODES)).collect(),
            moments: (0..letters).chain(LAST).map(moment).collect(),
            norms: vec![0.0; letters],
            words: vec![0.0; nodes.order + 2],
            probe: (hamiltonian.is_by_products()).then(|| Probe::new(hamiltonian)),
            last: f64::INFINITY,
            left: SPARE * tolerance.whole,
            nodes,
            tolerance,
        }))
    }

    /// Sets the times at which steps end and H may jump.
    pub(super) fn set_breaks(&mut self, breaks: &[f64]) {
        self.scan.set_breaks(breaks);
    }

    /// The error that a step may have.
    pub(super) fn allowed(&self, h: f64) -> f64 {
        (METHOD * self.tolerance.rate * h.abs()).max(JUMP * self.left)
    }

    /// Whether a step is as short as rounding errors of the time, and whatever error it has is to be taken.
    pub(super) fn is_least(t: f64, h: f64) -> bool {
        h.abs() <= LEAST * t.abs()
    }

    /// Takes a step, one of an interval of which so much is left, with an error that leaves the rest of its share to others.
    pub(super) fn spend(&mut self, (h, left): (f64, f64), error: f64) {
        self.left += METHOD * self.tolerance.rate * h.abs() - error;
        // the last part of an interval says nothing of others
        let is_whole = h.abs() < left.abs();
        if is_whole || self.last < h.abs() || self.last.is_infinite() {
            self.last = h.abs();
        }
    }

    /// Shortens the next step after one that was refused for its error.
    pub(super) fn refuse(&mut self, h: f64, error: f64) {
        let factor = self.factor(error, h).clamp(CHANGE.0, SAFETY);
        self.last = factor * h.abs() / CHANGE.1;
    }

    /// Goes on elsewhere, with a step up to `most` and nothing left by others.
    pub(super) fn restart(&mut self, most: f64) {
        (self.last, self.left) = (most / CHANGE.1, 0.0);
    }

    /// The factor of a step with an error that leads to one within the tolerance.
    fn factor(&self, error: f64, h: f64) -> f64 {
        SAFETY * (self.allowed(h) / error).powf(1.0 / self.nodes.order as f64)
    }

    /// Looks at H at all points of a step.
    fn look(&mut self, t: f64, h: f64) -> Result<(), StepError> {
        self.values.clear();
        for point in &self.points {
            let time = self.scan.within((t, h), *point);
            (self.current).set(&self.hamiltonian, &[(1.0, time)])?;
            let weights = self.averages.bounds.weights(self.current.weights());
            self.values.extend(weights);
            self.values.extend_from_slice(self.current.potential());
        }
        Ok(())
    }

    /// The norm of the part of H h that goes with a row of weights, in the step of length h that was looked at.
    fn norm(&mut self, row: usize, h: f64) -> f64 {
        let (row, bounds) = (&self.moments[row], &self.averages.bounds);
        self.sum.fill(0.0);
        for (a, values) in row.iter().zip(self.values.chunks(self.sum.len())) {
            for (sum, value) in self.sum.iter_mut().zip(values) {
                *sum += a * value;
            }
        }
        let (weights, potential) = self.sum.split_at(bounds.parts.len());
        half(bounds.of_sum(weights, potential, row)) * h.abs()
    }

    /// The error that is left by the part of H h that no α_n has, and whether H has a kink or a jump there.
    fn unresolved(&mut self, t: f64, h: f64) -> Result<(f64, bool), StepError> {
        let first = self.norms.len();
        if let Some(probe) = &mut self.probe {
            let times = self.points.iter().map(|c| t + c * h);
            let pair = (&*self.hamiltonian, &mut self.current);
            let lengths = probe.lengths(pair, times, &self.moments[first..])?;
            let (error, is_kink) = left_out(&lengths);
            return Ok((error * h.abs(), is_kink));
        }
        let noise = self.noise(t, h);
        let mut terms = [0.0; LAST.end - LAST.start];
        for (k, term) in terms.iter_mut().enumerate() {
            *term = self.norm(first + k, h);
        }
        let (error, is_kink) = left_out(&terms);
        let part = if is_kink { KINK } else { SMOOTH };
        Ok(((error - part * noise).max(0.0), is_kink))
    }

    /// How much of the part of H h that no α_n has is roundings, which no shorter step has less of: those of values, and of the
    /// time by their slopes.
    fn noise(&self, t: f64, h: f64) -> f64 {
        let letters = self.norms.iter().enumerate();
        let slopes: f64 = letters.map(|(n, norm)| 2.0 * n as f64 * norm).sum();
        let moved = t.abs().max((t + h).abs()) / h.abs() * slopes;
        ROUNDING * (self.norms.iter().sum::<f64>() + moved)
    }

    /// m of a step; of an H(t) known by its products, whose α_n have no bounds, that of its phase.
    #[expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap)] // of an order
    fn size(&mut self, t: f64, h: f64) -> Result<f64, StepError> {
        let power = self.nodes.order as i32 + 1;
        self.look(t, h)?;
        if self.probe.is_some() {
            self.norms[0] = self.norm(0, h);
            return Ok(self.norms[0].powi(power));
        }
        for row in 0..self.norms.len() {
            self.norms[row] = self.norm(row, h);
        }
        self.words[0] = 1.0;
        for weight in 1..self.words.len() {
            let letters = self.norms.iter().zip(self.words[..weight].iter().rev());
            self.words[weight] = letters.map(|(norm, rest)| norm * rest).sum();
        }
        Ok((self.words[self.nodes.order + 1] - self.norms[0].powi(power)).max(0.0))
    }

    /// The next step, where an error is `constant` times m.
    pub(super) fn propose(
        &mut self,
        (t, left): (f64, f64),
        constant: f64,
    ) -> Result<Proposed, StepError> {
        let mut h = (self.last * CHANGE.1).min(left.abs());
        for _ in 0..TRIES {
            let parts = (left.abs() / h).ceil().max(1.0);
            let step = left / parts;
            let size = self.size(t, step)?;
            let error = constant * size;
            if error.is_finite() && Self::is_least(t, step) {
                return Ok(Proposed {
                    step,
                    size,
                    unresolved: 0.0,
                });
            }
            let allowed = self.allowed(step);
            let is_short = error <= allowed;
            // products are for steps that are short enough
            if is_short || self.probe.is_none() {
                let (unresolved, is_kink) = self.unresolved(t, step)?;
                if unresolved.is_nan() || unresolved > allowed {
                    let shorter = if is_kink {
                        SAFETY * allowed / unresolved
                    } else {
                        0.0
                    };
                    h = step.abs() * shorter.clamp(CHANGE.0, SAFETY);
                    continue;
                }
                if is_short {
                    let unseen = (allowed / SMOOTH + self.noise(t, step)) / step.abs();
                    if self.scan.passes_over((t, step), (NODES, NODES), unseen) {
                        h = CHANGE.0 * step.abs();
                        continue;
                    }
                    return Ok(Proposed {
                        step,
                        size,
                        unresolved: if is_kink { unresolved } else { 0.0 },
                    });
                }
            }
            if !error.is_finite() {
                let (theta, most) = (self.norms[0], f64::INFINITY);
                return Err(StepError::Spectrum { theta, most, t });
            }
            h = step.abs() * self.factor(error, step).clamp(CHANGE.0, 0.95);
        }
        let error = f64::INFINITY;
        Err(StepError::StepTooSmall { h, error })
    }

    /// Ends of so many parts of an interval, of equal shares of its time, its phase and what functions of time change.
    pub(super) fn strata(&self, interval: (f64, f64), count: usize) -> Vec<f64> {
        self.scan.strata(interval, count)
    }

    /// Products of a step made as one and as two halves, with half of its phases each, and its phase.
    ///
    /// # Errors
    /// It was interrupted.
    pub(super) fn products(&mut self, t: f64, h: f64) -> Result<(usize, f64), StepError> {
        let tolerance = SERIES * self.tolerance.rate * h.abs() / self.nodes.rows.len() as f64;
        let (mut products, mut theta) = (0, 0.0);
        for row in &self.nodes.rows {
            let row = (&self.nodes.nodes[..], &row[..]);
            let bounds = (self.averages).set(&mut self.current, &self.hamiltonian, row, (t, h))?;
            let phase = half(bounds) * h.abs();
            products += degree(phase, tolerance) + 2 * degree(0.5 * phase, 0.5 * tolerance);
            theta += phase;
        }
        Ok((products, theta))
    }
}
