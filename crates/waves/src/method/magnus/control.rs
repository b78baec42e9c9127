//! Steps of a Magnus method to a tolerance.
//!
//! A step is made as two halves and as one; the difference of both is the error of the halves times 2^p − 1 where H is
//! smooth. Around a kink it may vanish by chance, and the last terms of the series of H over the step say how large the error
//! may be. The next step follows from the last one by a prediction C m of its error, m of [`Chooser`].

use super::chooser::{Chooser, MagnusTolerance, SERIES};
use super::probe::Probe;
use super::{Magnus, Nodes};
use crate::method::doubling::Doubling;
use crate::method::driven::{next_break, next_time};
use crate::method::term_bounds::TermBounds;
use crate::method::{Sweeper, Wave, squares};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};

/// C of a plan, and of the first step, by the order: ten times the largest of those found and more.
pub(super) fn constant(order: usize) -> f64 {
    match order {
        2 => 0.5,
        4 => 1e-3,
        6 => 1e-6,
        _ => 1e-7,
    }
}

/// The most that the error of one step is taken to be above that of its halves.
const RATIO: f64 = 40.0;

/// Rounding errors of a step for each unit of its phase.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A Magnus method with steps as long as a tolerance allows.
#[derive(Clone)]
pub struct MagnusSteps {
    magnus: Magnus<f64>,
    chooser: Chooser,
    /// The constant C.
    constant: f64,
    doubling: Doubling,
    /// Times at which steps end besides, in the order of the run.
    breaks: Vec<f64>,
}

impl MagnusSteps {
    /// Steps with exponentials by series; none where the bounds do not fit the terms of H.
    ///
    /// # Errors
    /// It was interrupted.
    pub fn new(
        sweeper: Sweeper<f64>,
        nodes: Nodes,
        bounds: TermBounds,
        tolerance: MagnusTolerance,
    ) -> Option<Result<Self, StepError>> {
        let hamiltonian = sweeper.hamiltonian().clone();
        let places = hamiltonian.places();
        let order = nodes.order;
        let chooser = Chooser::new(&hamiltonian, nodes.clone(), bounds.clone(), tolerance)?;
        let rate = (SERIES * tolerance.rate, tolerance.norm);
        Some(chooser.map(|chooser| Self {
            magnus: Magnus::by_series(sweeper, nodes, rate, bounds),
            chooser,
            constant: constant(order),
            doubling: Doubling::new(places),
            breaks: Vec::new(),
        }))
    }

    /// The same with steps that end at these times, too, given in the order of the run.
    #[must_use]
    pub fn with_breaks(mut self, breaks: Vec<f64>) -> Self {
        self.chooser.set_breaks(&breaks);
        Self { breaks, ..self }
    }

    /// One step to at most `end`, and where it leads.
    fn advance(&mut self, t: f64, end: f64, state: &mut Wave<f64>) -> Result<f64, StepError> {
        loop {
            if let Some(probe) = &mut self.chooser.probe {
                probe.take(state);
            }
            let proposed = self.chooser.propose((t, end - t), self.constant)?;
            let (h, size) = (proposed.step, proposed.size);
            let difference = self.estimate(t, h, state)?;
            if size > 0.0 {
                self.constant = difference / size;
            }
            let error = difference.max(proposed.unresolved);
            if error <= self.chooser.allowed(h) || Chooser::is_least(t, h) {
                self.chooser.spend((h, end - t), error);
                return Ok(next_time(t, h, end));
            }
            self.doubling.put_back(state);
            self.chooser.refuse(h, error);
        }
    }

    /// Makes a step as two halves, and returns their error, relative to the norm.
    fn estimate(&mut self, t: f64, h: f64, state: &mut Wave<f64>) -> Result<f64, StepError> {
        let apart = self.doubling.step(&mut self.magnus, (t, h), state)?;
        let norm = squares(&state.q, &state.p).sqrt();
        let theta = self.chooser.norms[0];
        let tail = 2.0 * SERIES * self.chooser.tolerance.rate * h.abs();
        let noise = tail + ROUNDING * (1.0 + theta);
        let found = if norm > 0.0 { apart / norm } else { 0.0 };
        #[expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap)]
        let ratio = 2.0_f64.powi(self.chooser.nodes.order as i32) - 1.0;
        Ok((found - noise).max(0.0) / ratio.min(RATIO))
    }
}

impl Stepper for MagnusSteps {
    type State = Wave<f64>;

    fn step(&mut self, t: f64, h: f64, state: &mut Wave<f64>) -> Result<(), StepError> {
        let (mut now, end) = (t, t + h);
        while now.to_bits() != end.to_bits() {
            let next = next_break(self.breaks.iter(), now, end);
            now = self.advance(now, next, state)?;
        }
        Ok(())
    }

    fn synchronize(&mut self, state: &mut Wave<f64>) -> Result<(), StepError> {
        self.magnus.synchronize(state)
    }

    fn stats(&self) -> Stats {
        let stats = self.magnus.stats();
        let probed = self.chooser.probe.as_ref().map_or(0, Probe::products);
        Stats {
            evaluations: stats.evaluations + probed,
            ..stats
        }
    }
}

impl Checkpoint for MagnusSteps {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        (self.constant, (self.chooser.last, self.chooser.left)).save(member, out);
        self.magnus.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let mut place = (0.0, (0.0, 0.0));
        place.restore(member, saved)?;
        (self.constant, (self.chooser.last, self.chooser.left)) = place;
        self.magnus.restore(member, saved)
    }
}
