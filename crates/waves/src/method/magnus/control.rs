//! Steps of a Magnus method to a tolerance.
//!
//! A step is made as two halves, which are kept, and as one; the difference of both is the error of the halves times
//! 2^p − 1. The next step follows from the last one by a prediction C m of its error, where m adds up by norms all words
//! of weight p + 1, but that of α_1 alone, in the parts of H
//!
//!     H(t + s h) h = Σ_n α_n T_{n−1}(2s − 1),    α_n of weight n,
//!
//! which are found by Chebyshev's nodes, the ends of the step among them. So a step into a pulse is shortened before it is
//! made, and one around a jump, which leaves much to the last α_n; and a plan counts steps by a C that none was found to
//! exceed.

use super::{Averages, Magnus, Nodes};
use crate::method::bessel::degree;
use crate::method::driven::next_time;
use crate::method::driven::polynomials::{chebyshev_node, chebyshev_weight};
use crate::method::term_bounds::{Interval, TermBounds};
use crate::method::{Sweeper, Wave, squares};
use crate::problem::{Hamiltonian, HamiltonianAt};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use std::sync::Arc;

/// The parts of the tolerance: for all exponentials, and for the Magnus method itself.
const SERIES: f64 = 0.1;
const METHOD: f64 = 0.8;

/// A step, as one around a jump, may be off by this part of the whole tolerance.
const JUMP: f64 = 0.01;

/// C of a plan, and of the first step, by the order: ten times the largest of those found and more.
fn constant(order: usize) -> f64 {
    match order {
        2 => 0.5,
        4 => 1e-3,
        6 => 1e-6,
        _ => 1e-7,
    }
}

/// The most that the error of one step is taken to be above that of its halves.
const RATIO: f64 = 40.0;

/// New steps are so much shorter than those that just keep to the tolerance, ...
const SAFETY: f64 = 0.9;
/// ... change by such factors at once, ...
const CHANGE: (f64, f64) = (0.3, 3.0);
/// ... and are shortened so often before they are refused.
const TRIES: usize = 200;

/// Rounding errors of a step for each unit of its phase.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// The tolerance of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MagnusTolerance {
    /// Error allowed in a unit of time.
    pub rate: f64,
    /// In all.
    pub whole: f64,
    /// Of the norm.
    pub norm: f64,
}

/// Steps and products of a run, at most.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MagnusCost {
    /// Steps.
    pub steps: usize,
    /// Products H ψ.
    pub products: usize,
    /// The longest step, in units of 1/β.
    pub theta: f64,
}

/// The choice of steps by scalars.
#[derive(Clone)]
struct Chooser {
    hamiltonian: Arc<Hamiltonian>,
    current: HamiltonianAt,
    averages: Averages,
    nodes: Nodes,
    /// Points, and weights of values there in α_n / h.
    points: Vec<f64>,
    moments: Vec<Vec<f64>>,
    tolerance: MagnusTolerance,
    /// Norms of α_n / h, and sums of all words of each weight.
    norms: Vec<f64>,
    words: Vec<f64>,
}

/// Points of a step at which H is looked at, and the last terms of its series there.
const NODES: usize = 9;
const LAST: std::ops::Range<usize> = NODES - 2..NODES;

/// The error of a step, in units of the part of H h that its α_n do not have.
const UNRESOLVED: f64 = 0.1;

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
    fn new(
        hamiltonian: &Arc<Hamiltonian>,
        nodes: Nodes,
        bounds: TermBounds,
        tolerance: MagnusTolerance,
    ) -> Option<Self> {
        if !bounds.is_fitting(hamiltonian.terms().len()) {
            return None;
        }
        // the third one is the error of a single node
        let letters = (nodes.order / 2 + 1).max(3);
        Some(Self {
            current: HamiltonianAt::new(hamiltonian),
            hamiltonian: hamiltonian.clone(),
            averages: Averages::new(bounds, NODES),
            points: (0..NODES).map(|k| chebyshev_node(k, NODES)).collect(),
            moments: (0..letters).chain(LAST).map(moment).collect(),
            norms: vec![0.0; letters],
            words: vec![0.0; nodes.order + 2],
            nodes,
            tolerance,
        })
    }

    /// The error that a step may have.
    fn allowed(&self, h: f64) -> f64 {
        let MagnusTolerance { rate, whole, .. } = self.tolerance;
        METHOD * (rate * h.abs()).max(JUMP * whole)
    }

    /// The factor of a step with an error that leads to one within the tolerance.
    fn factor(&self, error: f64, h: f64) -> f64 {
        SAFETY * (self.allowed(h) / error).powf(1.0 / self.nodes.order as f64)
    }

    /// The norm of the part of H h that goes with a row of weights.
    fn norm(&mut self, row: usize, t: f64, h: f64) -> f64 {
        let row = (&self.points[..], &self.moments[row][..]);
        let bounds = (self.averages).set(&mut self.current, &self.hamiltonian, row, (t, h));
        half(bounds) * h.abs()
    }

    /// The part of H h that no α_n has, as where H jumps.
    fn unresolved(&mut self, t: f64, h: f64) -> f64 {
        let letters = self.norms.len();
        (letters..self.moments.len())
            .map(|row| self.norm(row, t, h))
            .sum()
    }

    /// m of a step.
    fn size(&mut self, t: f64, h: f64) -> f64 {
        for row in 0..self.norms.len() {
            self.norms[row] = self.norm(row, t, h);
        }
        self.words[0] = 1.0;
        for weight in 1..self.words.len() {
            let letters = self.norms.iter().zip(self.words[..weight].iter().rev());
            self.words[weight] = letters.map(|(norm, rest)| norm * rest).sum();
        }
        let weight = self.nodes.order + 1;
        #[expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap)]
        let alone = self.norms[0].powi(weight as i32);
        (self.words[weight] - alone).max(0.0)
    }

    /// The next step, not above `most`, and its m, where an error is `constant` times m.
    fn propose(
        &mut self,
        (t, left): (f64, f64),
        constant: f64,
        most: f64,
    ) -> Result<(f64, f64), StepError> {
        let mut h = most.min(left.abs());
        for _ in 0..TRIES {
            let parts = (left.abs() / h).ceil().max(1.0);
            let step = left / parts;
            if UNRESOLVED * self.unresolved(t, step) > self.allowed(step) {
                h = CHANGE.0 * step.abs();
                continue;
            }
            let size = self.size(t, step);
            let error = constant * size;
            if error <= self.allowed(step) {
                return Ok((step, size));
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

    /// Products of a step, and its phase.
    fn products(&mut self, t: f64, h: f64) -> (usize, f64) {
        let tolerance = SERIES * self.tolerance.rate * h.abs() / self.nodes.rows.len() as f64;
        let (mut products, mut theta) = (0, 0.0);
        for row in &self.nodes.rows {
            let row = (&self.nodes.nodes[..], &row[..]);
            let bounds = (self.averages).set(&mut self.current, &self.hamiltonian, row, (t, h));
            products += degree(half(bounds) * h.abs(), tolerance);
            theta += half(bounds) * h.abs();
        }
        (products, theta)
    }
}

/// A Magnus method with steps as long as a tolerance allows.
#[derive(Clone)]
pub struct MagnusSteps {
    magnus: Magnus<f64>,
    chooser: Chooser,
    /// The constant C, and the last step.
    constant: f64,
    last: f64,
    before: Wave<f64>,
    coarse: Wave<f64>,
}

impl MagnusSteps {
    /// Steps with exponentials by series; none where the bounds do not fit the terms of H.
    pub fn new(
        sweeper: Sweeper<f64>,
        nodes: Nodes,
        bounds: TermBounds,
        tolerance: MagnusTolerance,
    ) -> Option<Self> {
        let hamiltonian = sweeper.hamiltonian().clone();
        let places = hamiltonian.places();
        let order = nodes.order;
        let chooser = Chooser::new(&hamiltonian, nodes.clone(), bounds.clone(), tolerance)?;
        let rate = (SERIES * tolerance.rate, tolerance.norm);
        let empty = || Wave::new(vec![0.0; places], vec![0.0; places]);
        Some(Self {
            magnus: Magnus::by_series(sweeper, nodes, rate, bounds),
            chooser,
            constant: constant(order),
            last: f64::INFINITY,
            before: empty(),
            coarse: empty(),
        })
    }

    /// What a run with outputs at these times comes to at most, the first of which is its start; none where the bounds do
    /// not fit the terms of H.
    ///
    /// # Errors
    /// H is not finite.
    pub fn cost(
        hamiltonian: &Arc<Hamiltonian>,
        nodes: Nodes,
        bounds: TermBounds,
        tolerance: MagnusTolerance,
        times: &[f64],
    ) -> Option<Result<MagnusCost, StepError>> {
        let most = constant(nodes.order);
        let mut chooser = Chooser::new(hamiltonian, nodes, bounds, tolerance)?;
        let mut walk = || {
            let mut cost = MagnusCost::default();
            for ends in times.windows(2) {
                let (mut t, end) = (ends[0], ends[1]);
                while t.to_bits() != end.to_bits() {
                    let (h, _) = chooser.propose((t, end - t), most, f64::INFINITY)?;
                    let (products, theta) = chooser.products(t, h);
                    let (half, _) = chooser.products(t, 0.5 * h);
                    cost.steps += 1;
                    // one step in four is rejected at most
                    cost.products += (products + 2 * half) * 5 / 4;
                    cost.theta = cost.theta.max(theta);
                    t = next_time(t, h, end);
                }
            }
            Ok(cost)
        };
        Some(walk())
    }

    /// One step to at most `end`, and where it leads.
    fn advance(&mut self, t: f64, end: f64, state: &mut Wave<f64>) -> Result<f64, StepError> {
        loop {
            let most = self.last * CHANGE.1;
            let (h, size) = self.chooser.propose((t, end - t), self.constant, most)?;
            let error = self.estimate(t, h, state)?;
            if size > 0.0 {
                self.constant = error / size;
            }
            if error <= self.chooser.allowed(h) {
                // the last part of an interval says nothing of others
                let is_whole = h.abs() < (end - t).abs();
                if is_whole || self.last < h.abs() || self.last.is_infinite() {
                    self.last = h.abs();
                }
                return Ok(next_time(t, h, end));
            }
            clone_into(&self.before, state);
            let factor = self.chooser.factor(error, h).clamp(CHANGE.0, SAFETY);
            self.last = factor * h.abs() / CHANGE.1;
        }
    }

    /// Makes a step as two halves, and returns their error, relative to the norm.
    fn estimate(&mut self, t: f64, h: f64, state: &mut Wave<f64>) -> Result<f64, StepError> {
        clone_into(state, &mut self.before);
        clone_into(state, &mut self.coarse);
        self.magnus.step(t, h, &mut self.coarse)?;
        for at in [t, t + 0.5 * h] {
            self.magnus.step(at, 0.5 * h, state)?;
        }
        state.remove_phase();
        self.coarse.remove_phase();
        let pairs = [
            (&mut self.coarse.q, &state.q),
            (&mut self.coarse.p, &state.p),
        ];
        for (coarse, fine) in pairs {
            for (x, y) in coarse.iter_mut().zip(fine) {
                *x -= y;
            }
        }
        let norm = squares(&state.q, &state.p).sqrt();
        let apart = squares(&self.coarse.q, &self.coarse.p).sqrt();
        let theta = self.chooser.norms[0];
        let tail = 2.0 * SERIES * self.chooser.tolerance.rate * h.abs();
        let noise = tail + ROUNDING * (1.0 + theta);
        let found = if norm > 0.0 { apart / norm } else { 0.0 };
        #[expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap)]
        let ratio = 2.0_f64.powi(self.chooser.nodes.order as i32) - 1.0;
        Ok((found - noise).max(0.0) / ratio.min(RATIO))
    }
}

fn clone_into(from: &Wave<f64>, to: &mut Wave<f64>) {
    to.q.copy_from_slice(&from.q);
    to.p.copy_from_slice(&from.p);
    (to.phase, to.start) = (from.phase, from.start);
}

impl Stepper for MagnusSteps {
    type State = Wave<f64>;

    fn step(&mut self, t: f64, h: f64, state: &mut Wave<f64>) -> Result<(), StepError> {
        let (mut now, end) = (t, t + h);
        while now.to_bits() != end.to_bits() {
            now = self.advance(now, end, state)?;
        }
        Ok(())
    }

    fn synchronize(&mut self, state: &mut Wave<f64>) -> Result<(), StepError> {
        self.magnus.synchronize(state)
    }

    fn stats(&self) -> Stats {
        self.magnus.stats()
    }
}

impl Checkpoint for MagnusSteps {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        (self.constant, self.last).save(member, out);
        self.magnus.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let mut place = (0.0, 0.0);
        place.restore(member, saved)?;
        (self.constant, self.last) = place;
        self.magnus.restore(member, saved)
    }
}
