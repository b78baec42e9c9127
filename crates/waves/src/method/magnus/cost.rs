//! The cost of steps of a Magnus method in advance: counted one by one, or estimated where they are many.
//!
//! The rest of a long run is cut into strata of equal shares of its time, of its phase, and of the changes of its
//! functions of time, so that a pulse has strata of its own. Steps are counted in a window of each, the same part of
//! all; the windows grow until there are enough of them. A step over the end of a window counts as the part of it inside.

use super::Nodes;
use super::chooser::{Chooser, MagnusTolerance};
use super::control::{MagnusSteps, constant};
use crate::method::driven::next_time;
use crate::method::term_bounds::TermBounds;
use crate::problem::Hamiltonian;
use liouville_base::cancel;
use liouville_base::error::StepError;
use std::sync::Arc;

/// Steps that are counted before others are estimated.
const COUNTED: f64 = 256.0;

/// Strata of the rest, ...
const STRATA: usize = 64;
/// ... steps in their windows, about and at least, ...
const STEPS: f64 = 512.0;
const ENOUGH: f64 = 0.5 * STEPS;
/// ... and the part of a stratum that its first window is.
const LEAST: f64 = 1e-20;

/// The place of a window within its stratum changes by this, so that a period is not met at one phase alone.
const SHIFT: f64 = 0.618_033_988_749_894_9;

/// One step in four is rejected at most.
const REJECTED: f64 = 1.25;

/// Steps and products of a run, at most as far as estimates hold.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MagnusCost {
    /// Steps.
    pub steps: f64,
    /// Products H ψ.
    pub products: f64,
    /// The longest step that was looked at, in units of 1/β.
    pub theta: f64,
    /// Whether steps were counted in parts of the run alone.
    pub is_sampled: bool,
}

impl MagnusSteps {
    /// The cost of a run with outputs at these times, the first of which is its start, by a C that none was found to exceed;
    /// none where the bounds do not fit the terms of H.
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
        let constant = constant(nodes.order);
        let chooser = Chooser::new(hamiltonian, nodes, bounds, tolerance)?;
        let counter = chooser.map(|mut chooser| {
            chooser.set_breaks(times);
            Counter {
                constant,
                chooser,
                times,
                cost: MagnusCost::default(),
            }
        });
        Some(counter.and_then(Counter::run))
    }
}

/// Steps that are counted, and the times of the outputs between which they are.
struct Counter<'a> {
    chooser: Chooser,
    constant: f64,
    times: &'a [f64],
    cost: MagnusCost,
}

impl Counter<'_> {
    fn run(mut self) -> Result<MagnusCost, StepError> {
        let (Some(start), Some(end)) = (self.times.first(), self.times.last()) else {
            return Ok(self.cost);
        };
        let (mut t, end) = (*start, *end);
        while t.to_bits() != end.to_bits() && self.cost.steps < COUNTED {
            let next = self.output(t);
            let h = self.step(t, next, f64::INFINITY)?;
            t = next_time(t, h, next);
        }
        if t.to_bits() != end.to_bits() {
            self.sample(t, end)?;
        }
        self.cost.steps = self.cost.steps.ceil();
        self.cost.products = self.cost.products.ceil();
        Ok(self.cost)
    }

    /// The first output after a time.
    fn output(&self, t: f64) -> f64 {
        let (start, end) = (self.times[0], self.times[self.times.len() - 1]);
        let is_past = |time: &f64| (time - t) * (end - start) <= 0.0;
        let place = self.times.partition_point(is_past);
        self.times.get(place).copied().unwrap_or(end)
    }

    /// Counts a step from t to at most `end`, or the part of it in a length that is left, and returns it.
    fn step(&mut self, t: f64, end: f64, left: f64) -> Result<f64, StepError> {
        if cancel::is_cancelled() {
            return Err(StepError::Interrupted);
        }
        let h = self.chooser.propose((t, end - t), self.constant)?.step;
        let (products, theta) = self.chooser.products(t, h)?;
        (self.chooser).spend((h, end - t), self.chooser.allowed(h));
        let part = (left / h.abs()).min(1.0);
        self.cost.steps += part;
        self.cost.products += part * REJECTED * products as f64;
        self.cost.theta = self.cost.theta.max(theta);
        Ok(h)
    }

    /// Adds what the rest of a run takes, by windows of it.
    fn sample(&mut self, t: f64, end: f64) -> Result<(), StepError> {
        let strata = self.chooser.strata((t, end), STRATA);
        let counted = std::mem::take(&mut self.cost);
        let mut part = LEAST;
        loop {
            self.cost = MagnusCost::default();
            self.windows(&strata, part)?;
            if part >= 1.0 || self.cost.steps >= ENOUGH {
                break;
            }
            part = (part * STEPS / self.cost.steps).min(1.0);
        }
        self.cost = MagnusCost {
            steps: counted.steps + self.cost.steps / part,
            products: counted.products + self.cost.products / part,
            theta: counted.theta.max(self.cost.theta),
            is_sampled: part < 1.0,
        };
        Ok(())
    }

    /// Counts the steps in such a part of each stratum.
    fn windows(&mut self, strata: &[f64], part: f64) -> Result<(), StepError> {
        let end = self.times[self.times.len() - 1];
        for (k, ends) in strata.windows(2).enumerate() {
            let length = ends[1] - ends[0];
            let mut left = part * length.abs();
            let mut t = ends[0] + (k as f64 * SHIFT).fract() * (1.0 - part) * length;
            self.chooser.restart(length.abs());
            while left > 0.0 && t.to_bits() != end.to_bits() {
                let next = self.output(t);
                let h = self.step(t, next, left)?;
                left -= h.abs();
                t = next_time(t, h, next);
            }
        }
        Ok(())
    }
}
