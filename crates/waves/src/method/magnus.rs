//! Commutator-free Magnus methods for H(t): exponentials of sums of H at nodes, one after another.
//!
//!     ψ ← Π_k e^{−ih Ĥ_k} ψ,    Ĥ_k = Σ_j a_kj H(t + c_j h)
//!
//!     order 2    c = 1/2,            a = 1
//!     order 4    c = 1/2 ∓ √3/6,     a = (1/4 ± √3/6, 1/4 ∓ √3/6), the first exponential with the upper signs
//!
//! Each exponential is made by equal steps of a list of shears, which is for matrices that do not depend on time, or by a
//! Chebyshev series of the degree that it takes. Its shift and the number of steps come from the bounds of the terms,
//! weighted and added up. Source: alvermann2011.

use super::derivative::{Piece, Recorder, ShearsPiece, flat};
use super::driven::fit::NodeMap;
use super::{Chebyshev, Shears, Sweeper, Wave};
use crate::problem::HamiltonianAt;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::composition::{Composed, Flow};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use liouville_base::simd::Stored;

/// The longest series, in units of 1/β.
const LONGEST: f64 = 1e5;

/// The nodes c, and the weights a of each exponential, first to last.
#[derive(Clone, Debug, PartialEq)]
pub struct Nodes {
    /// c_j
    pub nodes: Vec<f64>,
    /// a_kj
    pub rows: Vec<Vec<f64>>,
}

impl Nodes {
    /// The exponential midpoint rule.
    pub fn midpoint() -> Self {
        Self {
            nodes: vec![0.5],
            rows: vec![vec![1.0]],
        }
    }

    /// Two exponentials at two Gauss nodes, of order 4.
    pub fn gauss() -> Self {
        let apart = 3.0_f64.sqrt() / 6.0;
        let (more, less) = (0.25 + apart, 0.25 - apart);
        Self {
            nodes: vec![0.5 - apart, 0.5 + apart],
            rows: vec![vec![more, less], vec![less, more]],
        }
    }
}

/// A list of shears, and its limit of stability.
#[derive(Clone, Debug, PartialEq)]
pub struct ShearProgram {
    /// The shears: part 0 moves q, part 1 moves p.
    pub program: Vec<Flow>,
    /// The most that half the width of the spectrum times a step of it may be.
    pub theta: f64,
    /// The relative error of the norm above which a state is refused.
    pub tolerance: f64,
}

/// The propagator of a matrix that does not depend on time.
#[derive(Clone)]
enum Exponential<S: Stored> {
    Shears {
        shears: Box<Composed<Shears<S>>>,
        theta: f64,
    },
    Series(Box<Chebyshev<S>>),
}

impl<S: Stored> Exponential<S> {
    fn sweeper_mut(&mut self) -> &mut Sweeper<S> {
        match self {
            Self::Shears { shears, .. } => shears.parts_mut().sweeper_mut(),
            Self::Series(series) => series.sweeper_mut(),
        }
    }

    /// Multiplies a state by e^{−ihH}, with these bounds of H.
    fn apply(
        &mut self,
        (low, high): (f64, f64),
        t: f64,
        h: f64,
        state: &mut Wave<S>,
    ) -> Result<(), StepError> {
        let theta = (high - low) / 2.0 * h.abs();
        let most = match self {
            Self::Shears { theta, .. } => *theta,
            Self::Series(_) => LONGEST,
        };
        let steps = theta / most;
        if !steps.is_finite() {
            return Err(StepError::Spectrum { theta, most, t });
        }
        let steps = steps.ceil().max(1.0);
        match self {
            Self::Shears { shears, .. } => {
                let shift = low.midpoint(high);
                shears.parts_mut().set_shift(shift);
                // half of the phase before the shears and half after them, so that a step back in time is the inverse
                state.add_phase(shift * h / 2.0);
                state.remove_phase();
                let recorder = shears.parts_mut().sweeper_mut().recorder().cloned();
                let start = recorder.as_ref().map(|_| flat(state)).transpose()?;
                let mut left = steps;
                while left > 0.0 {
                    shears.step(t, h / steps, state)?;
                    left -= 1.0;
                }
                if let (Some(recorder), Some(start)) = (recorder, start) {
                    let piece = shears_piece(shears, [start, flat(state)?], h, steps);
                    recorder.add(Piece::Shears(piece))?;
                }
                state.add_phase(-shift * h / 2.0);
                shears.synchronize(state)
            }
            Self::Series(series) => {
                series.set_bounds((low, high));
                let mut left = steps;
                while left > 0.0 {
                    series.step(t, h / steps, state)?;
                    left -= 1.0;
                }
                Ok(())
            }
        }
    }

    fn stats(&self) -> Stats {
        match self {
            Self::Shears { shears, .. } => shears.stats(),
            Self::Series(series) => series.stats(),
        }
    }
}

/// Steps of shears that were made over a time h, between these ends, for a run that is to be differentiated.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a number of steps, at least 1
fn shears_piece<S: Stored>(
    shears: &mut Composed<Shears<S>>,
    ends: [Vec<f64>; 2],
    h: f64,
    steps: f64,
) -> ShearsPiece {
    let of_flow = |flow: &Flow| (flow.part == 1, flow.weight * h / steps);
    let all = shears.program().iter().map(of_flow).collect();
    let shift = shears.parts_mut().shift();
    let current = shears.parts_mut().sweeper_mut().current.as_ref();
    ShearsPiece {
        shears: all,
        repeats: steps as usize,
        shift,
        angles: (-shift * h / 2.0, -shift * h / 2.0),
        ends,
        weights: current.map_or_else(Vec::new, |at| at.weights().to_vec()),
        potential: current.map_or_else(Vec::new, |at| at.potential().to_vec()),
        nodes: Vec::new(),
        map: NodeMap::default(),
        steps: 0,
    }
}

impl<S: Stored> Checkpoint for Exponential<S> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        match self {
            Self::Shears { shears, .. } => shears.save(member, out),
            Self::Series(series) => series.save(member, out),
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        match self {
            Self::Shears { shears, .. } => shears.restore(member, saved),
            Self::Series(series) => series.restore(member, saved),
        }
    }
}

/// The steps of a Magnus method.
#[derive(Clone)]
pub struct Magnus<S: Stored> {
    exponential: Exponential<S>,
    nodes: Nodes,
    /// The error that made the state unusable, if any.
    lost: Option<StepError>,
    /// Least and largest eigenvalue of each term.
    bounds: Vec<(f64, f64)>,
    /// Weights and times of the nodes of an exponential.
    weighted_nodes: Vec<(f64, f64)>,
}

impl<S: Stored> Magnus<S> {
    /// A method for the Hamiltonian of `sweeper`, given bounds of the eigenvalues of its terms, with exponentials by
    /// shears.
    ///
    /// # Panics
    /// When there are not as many bounds as terms, or a row has not as many weights as there are nodes.
    pub fn new(
        sweeper: Sweeper<S>,
        nodes: Nodes,
        exponential: ShearProgram,
        bounds: Vec<(f64, f64)>,
    ) -> Self {
        let shears = Shears::new(at_times(sweeper), 0.0, exponential.tolerance);
        let exponential = Exponential::Shears {
            shears: Composed::following(shears, exponential.program).into(),
            theta: exponential.theta,
        };
        Self::with(exponential, nodes, bounds)
    }

    /// The same with exponentials by Chebyshev series, which are off by `rate` in each unit of time; the norm may be off
    /// by `tolerance`, relatively.
    ///
    /// # Panics
    /// When there are not as many bounds as terms, or a row has not as many weights as there are nodes.
    pub fn by_series(
        sweeper: Sweeper<S>,
        nodes: Nodes,
        (rate, tolerance): (f64, f64),
        bounds: Vec<(f64, f64)>,
    ) -> Self {
        let series = Chebyshev::new(at_times(sweeper), (0.0, 0.0), rate, tolerance);
        Self::with(Exponential::Series(Box::new(series)), nodes, bounds)
    }

    fn with(mut exponential: Exponential<S>, nodes: Nodes, bounds: Vec<(f64, f64)>) -> Self {
        let terms = exponential.sweeper_mut().hamiltonian().terms().len();
        assert_eq!(bounds.len(), terms, "number of bounds");
        let mut rows = nodes.rows.iter();
        assert!(rows.all(|row| row.len() == nodes.nodes.len()), "weights");
        Self {
            exponential,
            weighted_nodes: Vec::with_capacity(nodes.nodes.len()),
            lost: None,
            nodes,
            bounds,
        }
    }
}

/// Sets H to the sum of a row's nodes over a step from t of length h, and returns its bounds, by those of its terms.
fn set_average<S: Stored>(
    sweeper: &mut Sweeper<S>,
    (nodes, row): (&Nodes, usize),
    bounds: &[(f64, f64)],
    (t, h): (f64, f64),
    weighted_nodes: &mut Vec<(f64, f64)>,
) -> (f64, f64) {
    let weighted = nodes.rows[row].iter().zip(&nodes.nodes);
    weighted_nodes.clear();
    weighted_nodes.extend(weighted.map(|(a, c)| (*a, t + c * h)));
    let hamiltonian = sweeper.hamiltonian().clone();
    let (mut low, mut high) = (0.0, 0.0);
    let mut add = |weight: f64, (least, largest): (f64, f64)| {
        let (a, b) = (weight * least, weight * largest);
        low += a.min(b);
        high += a.max(b);
    };
    if let Some(current) = &mut sweeper.current {
        current.set(&hamiltonian, weighted_nodes);
        for (weight, bounds) in current.weights().iter().zip(bounds) {
            add(*weight, *bounds);
        }
        let potential = current.potential();
        let least = potential.iter().copied().reduce(f64::min);
        let largest = potential.iter().copied().reduce(f64::max);
        add(1.0, (least.unwrap_or(0.0), largest.unwrap_or(0.0)));
    }
    (low, high)
}

/// The same sweeper with weights that may be set.
fn at_times<S: Stored>(mut sweeper: Sweeper<S>) -> Sweeper<S> {
    if sweeper.current.is_none() {
        sweeper.current = Some(HamiltonianAt::new(sweeper.hamiltonian()));
    }
    sweeper
}

impl<S: Stored> Magnus<S> {
    /// Completes the pieces of an exponential, for a run that is to be differentiated: the last one of a step ends it.
    fn keep(&self, recorder: &Recorder, (first, row): (usize, usize), (t, h): (f64, f64)) {
        let (nodes, last) = (&self.nodes, recorder.len() - 1);
        let mut place = first;
        recorder.change(first, |piece| {
            let times = nodes.nodes.iter().map(|c| t + c * h).collect();
            let is_end = place == last && row + 1 == nodes.rows.len();
            piece.average(times, &nodes.rows[row], is_end);
            place += 1;
        });
    }
}

impl<S: Stored> Stepper for Magnus<S> {
    type State = Wave<S>;

    /// After a failed step the state is not to be used: [`Stepper::synchronize`] refuses it from then on.
    fn step(&mut self, t: f64, h: f64, state: &mut Wave<S>) -> Result<(), StepError> {
        for row in 0..self.nodes.rows.len() {
            let sweeper = self.exponential.sweeper_mut();
            let scratch = &mut self.weighted_nodes;
            let bounds = set_average(sweeper, (&self.nodes, row), &self.bounds, (t, h), scratch);
            let recorder = sweeper.recorder().cloned();
            let first = recorder.as_ref().map_or(0, Recorder::len);
            let made = self.exponential.apply(bounds, t, h, state);
            made.inspect_err(|error| self.lost = Some(error.clone()))?;
            if let Some(recorder) = recorder {
                self.keep(&recorder, (first, row), (t, h));
            }
        }
        Ok(())
    }

    fn synchronize(&mut self, _: &mut Wave<S>) -> Result<(), StepError> {
        self.lost.clone().map_or(Ok(()), Err)
    }

    fn stats(&self) -> Stats {
        self.exponential.stats()
    }
}

liouville_base::checkpoint!([S: Stored] Magnus<S> { exponential });
