//! Commutator-free Magnus methods for H(t): exponentials of sums of H at nodes, one after another.
//!
//!     ψ ← Π_k e^{−ih Ĥ_k} ψ,    Ĥ_k = Σ_j a_kj H(t + c_j h)
//!
//! Each exponential is made by equal steps of a list of shears, which is for matrices that do not depend on time, or by a
//! Chebyshev series of the degree that its own phase takes. The shift and the degree come from bounds of Ĥ_k, which has the
//! parts of H with weights of its own. Source: alvermann2011.

mod chooser;
mod control;
mod cost;
mod exponential;
mod nodes;
mod probe;

pub use chooser::MagnusTolerance;
pub use control::MagnusSteps;
pub use cost::MagnusCost;
pub use exponential::ShearProgram;
pub use nodes::Nodes;

use super::derivative::Recorder;
use super::term_bounds::{Interval, TermBounds};
use super::{Chebyshev, Shears, Sweeper, Wave};
use crate::problem::{Hamiltonian, HamiltonianAt};
use exponential::Exponential;
use liouville_base::composition::Composed;
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use liouville_base::simd::Stored;

/// Sums of H at the nodes of a step.
#[derive(Clone, Debug)]
struct Averages {
    bounds: TermBounds,
    /// Weights and times of the nodes of an exponential.
    nodes: Vec<(f64, f64)>,
    weights: Vec<f64>,
}

impl Averages {
    fn new(bounds: TermBounds, count: usize) -> Self {
        Self {
            nodes: Vec::with_capacity(count),
            weights: Vec::with_capacity(bounds.parts.len()),
            bounds,
        }
    }

    /// Sets H to a sum over the nodes of a step from t of length h, and returns its bounds.
    ///
    /// # Errors
    /// It was interrupted.
    fn set(
        &mut self,
        current: &mut HamiltonianAt,
        hamiltonian: &Hamiltonian,
        (nodes, row): (&[f64], &[f64]),
        (t, h): (f64, f64),
    ) -> Result<Interval, StepError> {
        self.nodes.clear();
        let pairs = row.iter().zip(nodes);
        self.nodes.extend(pairs.map(|(a, c)| (*a, t + c * h)));
        current.set(hamiltonian, &self.nodes)?;
        self.weights.clear();
        (self.weights).extend(self.bounds.weights(current.weights()));
        Ok((self.bounds).of_sum(&self.weights, current.potential(), row))
    }
}

/// The steps of a Magnus method.
#[derive(Clone)]
pub struct Magnus<S: Stored> {
    exponential: Exponential<S>,
    nodes: Nodes,
    averages: Averages,
    /// The error that made the state unusable, if any.
    lost: Option<StepError>,
}

impl<S: Stored> Magnus<S> {
    /// A method for the Hamiltonian of `sweeper`, given bounds of the eigenvalues of its parts, with exponentials by
    /// shears.
    ///
    /// # Panics
    /// When the bounds do not fit the terms.
    pub fn new(
        sweeper: Sweeper<S>,
        nodes: Nodes,
        exponential: ShearProgram,
        bounds: TermBounds,
    ) -> Self {
        let shears = Shears::new(at_times(sweeper), 0.0, exponential.tolerance);
        let exponential = Exponential::Shears {
            shears: Composed::following(shears, exponential.program).into(),
            theta: exponential.theta,
        };
        Self::with(exponential, nodes, bounds)
    }

    /// The same with exponentials by Chebyshev series, which are off by `rate` in each unit of time, all together; the
    /// norm may be off by `tolerance`, relatively.
    ///
    /// # Panics
    /// When the bounds do not fit the terms.
    pub fn by_series(
        sweeper: Sweeper<S>,
        nodes: Nodes,
        (rate, tolerance): (f64, f64),
        bounds: TermBounds,
    ) -> Self {
        let each = rate / nodes.rows.len() as f64;
        let series = Chebyshev::new(at_times(sweeper), (0.0, 0.0), each, tolerance);
        Self::with(Exponential::series(series), nodes, bounds)
    }

    fn with(mut exponential: Exponential<S>, nodes: Nodes, bounds: TermBounds) -> Self {
        let terms = exponential.sweeper_mut().hamiltonian().terms().len();
        assert!(bounds.is_fitting(terms), "bounds of the parts");
        Self {
            exponential,
            averages: Averages::new(bounds, nodes.nodes.len()),
            lost: None,
            nodes,
        }
    }

    fn make(&mut self, t: f64, h: f64, state: &mut Wave<S>) -> Result<(), StepError> {
        for (place, row) in self.nodes.rows.iter().enumerate() {
            let sweeper = self.exponential.sweeper_mut();
            let hamiltonian = sweeper.hamiltonian().clone();
            let recorder = sweeper.recorder().cloned();
            let first = recorder.as_ref().map_or(0, Recorder::count);
            let Some(current) = &mut sweeper.current else {
                unreachable!("a sweeper with weights");
            };
            let row = (&self.nodes.nodes[..], &row[..]);
            let bounds = (self.averages).set(current, &hamiltonian, row, (t, h))?;
            self.exponential.apply(bounds, t, h, state)?;
            if let Some(recorder) = recorder {
                keep(&self.nodes, &recorder, (first, place), (t, h));
            }
        }
        Ok(())
    }
}

/// Completes the pieces of an exponential, for a run that is to be differentiated: the last one of a step ends it.
fn keep(nodes: &Nodes, recorder: &Recorder, (first, row): (usize, usize), (t, h): (f64, f64)) {
    let last = recorder.count() - 1;
    let mut place = first;
    recorder.change(first, |piece| {
        let times = nodes.nodes.iter().map(|c| t + c * h).collect();
        let is_end = place == last && row + 1 == nodes.rows.len();
        piece.average(times, &nodes.rows[row], is_end);
        place += 1;
    });
}

/// The same sweeper with weights that may be set.
fn at_times<S: Stored>(mut sweeper: Sweeper<S>) -> Sweeper<S> {
    if sweeper.current.is_none() {
        sweeper.current = Some(HamiltonianAt::new(sweeper.hamiltonian()));
    }
    sweeper
}

impl<S: Stored> Stepper for Magnus<S> {
    type State = Wave<S>;

    /// After a failed step the state is not to be used: [`Stepper::synchronize`] refuses it from then on.
    fn step(&mut self, t: f64, h: f64, state: &mut Wave<S>) -> Result<(), StepError> {
        let made = self.make(t, h, state);
        made.inspect_err(|error| self.lost = Some(error.clone()))
    }

    fn synchronize(&mut self, _: &mut Wave<S>) -> Result<(), StepError> {
        self.lost.clone().map_or(Ok(()), Err)
    }

    fn stats(&self) -> Stats {
        self.exponential.stats()
    }
}

liouville_base::checkpoint!([S: Stored] Magnus<S> { exponential });
