//! Split operator: e^{−ihT} and e^{−ihV} in turn, each of them exact, for H = T + V(t) on a periodic grid.
//!
//! T is diagonal after a Fourier transform, V before it. A constant coupling C of components commutes with T, and goes
//! with it. Time is a variable that advances with T: V is evaluated at the time that the flows of T before it have
//! reached, so that a list of flows keeps its order where V depends on time (blanes2002). Planes of the grid stay
//! transformed along all axes but the outermost between two flows of V, and a flow of V visits them one by one.

mod jumps;
mod kicks;
mod order;
mod resolution;
mod steps;
mod tolerance;

pub use steps::{BegunRun, SplitSteps};
pub use tolerance::{Looks, SplitTolerance};

use super::{Wave, check_growth, check_norm};
use crate::problem::{Coupling, Hamiltonian, Kinetic, Operator};
use kicks::{KEPT, Kick, Kicks};
use liouville_base::cancel::CancelToken;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::composition::{Flow, Parts};
use liouville_base::error::StepError;
use liouville_base::method::Stats;
use liouville_fourier::{Complex, FourierScratch};
use resolution::Resolution;
use std::sync::Arc;

/// A state is resolved by these wave numbers, as a part of all.
const LOWER: f64 = 2.0 / 3.0;

/// Part 0 is T with a coupling of components, part 1 is V.
#[derive(Clone)]
pub struct Phases {
    kinetic: Arc<Kinetic>,
    coupling: Option<Arc<Coupling>>,
    kicks: Kicks,
    resolution: Option<Resolution>,
    /// The part of the wave numbers that flows of T leave, and factors of the lower two thirds of it where it is not all.
    band: f64,
    within_band: Option<(Vec<Complex>, Vec<Complex>)>,
    tolerance: f64,
    cancel: CancelToken,
    tables: Vec<KineticPhases>,
    psi: Vec<Complex>,
    /// A number for each component.
    point: Vec<Complex>,
    memory: FourierScratch,
    made: usize,
}

/// Phases of T for a length of time.
#[derive(Clone)]
struct KineticPhases {
    s: f64,
    along: Vec<Complex>,
    within: Vec<Complex>,
    /// e^{−iCs} by rows, empty where nothing couples.
    between: Vec<Complex>,
}

impl Phases {
    /// Flows of a Hamiltonian with one kinetic term of weight 1, and at most one coupling of components, whose other terms are
    /// diagonal, none if it is another one; the norm may be off by `tolerance`, relatively, before a state is refused.
    pub fn new(hamiltonian: Arc<Hamiltonian>, tolerance: f64) -> Option<Self> {
        if hamiltonian.is_doubled() {
            return None;
        }
        let kinetic = |(k, term): (usize, &Operator)| Some((k, term.kinetic()?.clone()));
        let coupling = |(k, term): (usize, &Operator)| match term {
            Operator::Coupling(term) => Some((k, term.clone())),
            _ => None,
        };
        let mut terms = hamiltonian.terms().iter().enumerate();
        let (place, kinetic) = terms.clone().find_map(kinetic)?;
        let (other, coupling) = terms.find_map(coupling).unzip();
        let left_out: Vec<usize> = [place].into_iter().chain(other).collect();
        let size = hamiltonian.size();
        let points = (kinetic.size(), kinetic.grid().plane());
        let kicks = Kicks::new(hamiltonian, &left_out, points)?;
        Some(Self {
            resolution: kicks
                .is_nonlinear()
                .then(|| Resolution::new(kinetic.low_pass(LOWER))),
            psi: vec![Complex::default(); size],
            point: vec![Complex::default(); size / kinetic.size()],
            cancel: CancelToken::of_thread(),
            tables: Vec::with_capacity(KEPT),
            memory: FourierScratch::default(),
            band: 1.0,
            within_band: None,
            made: 0,
            kinetic,
            coupling,
            kicks,
            tolerance,
        })
    }

    /// The same, stopping where `cancel` is set, not that of the thread.
    #[must_use]
    pub fn with_cancel(self, cancel: CancelToken) -> Self {
        Self { cancel, ..self }
    }

    /// Leaves a part of the wave numbers alone, or all.
    fn set_band(&mut self, band: f64) {
        self.band = band;
        self.within_band = (band < 1.0).then(|| self.kinetic.low_pass(LOWER * band));
        self.tables.clear();
    }

    /// The share of |ψ|² beyond two thirds of the band, where it is not all.
    fn share_beyond(&mut self, state: &Wave<f64>) -> Result<f64, StepError> {
        let Some(factors) = self.within_band.take() else {
            return Ok(0.0);
        };
        let outcome = self.lower(state, &factors);
        self.within_band = Some(factors);
        outcome.map(|()| resolution::share_beyond(&self.psi, state))
    }

    /// Makes room for the tables of flows of other lengths.
    fn forget_tables(&mut self) {
        self.tables.clear();
        self.kicks.forget_tables();
    }

    /// The place of the table for a flow of T.
    fn table(&mut self, s: f64) -> usize {
        let is_this = |table: &KineticPhases| table.s.to_bits() == s.to_bits();
        self.tables.iter().position(is_this).unwrap_or_else(|| {
            let (along, within) = self.kinetic.phases(s, self.band);
            if self.tables.len() == KEPT {
                self.tables.clear();
            }
            let coupling = self.coupling.as_ref();
            let between = coupling.map_or(Vec::new(), |coupling| coupling.phases(s));
            let table = KineticPhases {
                s,
                along,
                within,
                between,
            };
            self.tables.push(table);
            self.tables.len() - 1
        })
    }

    /// All planes, transformed first or last or both, with a flow of V between if there is one.
    fn planes(&mut self, from: bool, kick: Option<Kick>, to: bool) -> Result<(), StepError> {
        let grid = self.kinetic.grid();
        let (points, size) = (self.kinetic.size(), grid.plane());
        for first in (0..points).step_by(size) {
            if self.cancel.is_cancelled() {
                return Err(StepError::Interrupted);
            }
            if from {
                for psi in self.psi.chunks_exact_mut(points) {
                    grid.inverse(&mut psi[first..][..size], &mut self.memory);
                }
            }
            if let Some(kick) = kick {
                self.kicks.act(kick, first, &mut self.psi);
            }
            if to {
                for psi in self.psi.chunks_exact_mut(points) {
                    grid.forward(&mut psi[first..][..size], &mut self.memory);
                }
            }
        }
        Ok(())
    }

    /// Multiplies planes that are transformed by factors of their wave numbers.
    fn multiply(&mut self, factors: (&[Complex], &[Complex])) -> Result<(), StepError> {
        let cancel = &mut self.cancel;
        let mut go_on = || !cancel.is_cancelled();
        let grid = self.kinetic.grid();
        let mut components = self.psi.chunks_exact_mut(self.kinetic.size());
        let is_whole =
            components.all(|psi| grid.multiply(psi, &mut self.memory, factors, &mut go_on));
        is_whole.then_some(()).ok_or(StepError::Interrupted)
    }

    /// Multiplies the components at each point by a matrix, if there is one.
    fn mix(&mut self, matrix: &[Complex]) {
        if matrix.is_empty() {
            return;
        }
        let (points, count) = (self.kinetic.size(), self.point.len());
        for i in 0..points {
            for (part, psi) in self
                .point
                .iter_mut()
                .zip(self.psi[i..].iter().step_by(points))
            {
                *part = *psi;
            }
            let rows = matrix.chunks_exact(count);
            for (psi, row) in self.psi[i..].iter_mut().step_by(points).zip(rows) {
                *psi = row.iter().zip(&self.point).map(|(a, b)| a * b).sum();
            }
        }
    }

    fn load(&mut self, state: &Wave<f64>) {
        for (psi, (q, p)) in self.psi.iter_mut().zip(state.q.iter().zip(&state.p)) {
            *psi = Complex::new(*q, *p);
        }
    }

    /// Flows one after another: (part, time, length of time).
    fn walk(
        &mut self,
        flows: impl Iterator<Item = (usize, f64, f64)>,
        state: &mut Wave<f64>,
    ) -> Result<(), StepError> {
        self.load(state);
        let mut flows = flows.peekable();
        let mut is_transformed = false;
        while let Some((part, t, s)) = flows.next() {
            let next_is_kinetic = flows.peek().is_some_and(|next| next.0 == 0);
            if part == 1 {
                let kick = self.kicks.begin(t, s)?;
                self.planes(is_transformed, Some(kick), next_is_kinetic)?;
                is_transformed = next_is_kinetic;
                continue;
            }
            if !is_transformed {
                self.planes(false, None, true)?;
                is_transformed = true;
            }
            let table = self.table(s);
            let tables = std::mem::take(&mut self.tables);
            let KineticPhases {
                along,
                within,
                between,
                ..
            } = &tables[table];
            let outcome = self.multiply((along, within));
            self.mix(between);
            self.tables = tables;
            outcome?;
            self.made += 1;
        }
        if is_transformed {
            self.planes(true, None, false)?;
        }
        for (psi, (q, p)) in self.psi.iter().zip(state.q.iter_mut().zip(&mut state.p)) {
            (*q, *p) = (psi.re, psi.im);
        }
        Ok(())
    }

    /// Refuses a state that the grid does not resolve.
    fn look(&mut self, t: f64, state: &mut Wave<f64>) -> Result<(), StepError> {
        let Some(mut resolution) = self.resolution.take() else {
            return Ok(());
        };
        let outcome = (self.lower(state, &resolution.factors))
            .and_then(|()| resolution.check(t, &self.psi, state));
        self.resolution = Some(resolution);
        outcome
    }

    /// Makes ψ a state with its wave numbers multiplied by factors.
    fn lower(
        &mut self,
        state: &Wave<f64>,
        (along, within): &(Vec<Complex>, Vec<Complex>),
    ) -> Result<(), StepError> {
        self.load(state);
        self.planes(false, None, true)?;
        self.multiply((along, within))?;
        self.planes(true, None, false)
    }
}

impl Parts for Phases {
    type State = Wave<f64>;

    fn count(&self) -> usize {
        2
    }

    fn is_exact(&self, _: usize) -> bool {
        true
    }

    fn flow(
        &mut self,
        part: usize,
        _: bool,
        t: f64,
        h: f64,
        state: &mut Wave<f64>,
    ) -> Result<(), StepError> {
        self.walk([(part, t, h)].into_iter(), state)?;
        self.look(t + h, state)
    }

    /// The flow held back by the step before is one of V at the same time.
    fn flows(
        &mut self,
        flows: &[Flow],
        before: f64,
        t: f64,
        h: f64,
        state: &mut Wave<f64>,
    ) -> Result<(), StepError> {
        if self.resolution.as_mut().is_some_and(Resolution::is_due) {
            self.look(t, state)?;
        }
        let mut before = before;
        let flows = flows.iter().map(|flow| {
            let length = std::mem::take(&mut before) + flow.weight * h;
            (flow.part, t + flow.offset * h, length)
        });
        self.walk(flows, state)
    }

    fn check(&self, t: f64, state: &Wave<f64>) -> Result<(), StepError> {
        if self.kicks.is_absorbing() {
            return check_growth(t, self.tolerance, state);
        }
        check_norm(t, self.tolerance, state)
    }

    /// No copy, which would be as large as the state.
    fn keep(&mut self, _: &Wave<f64>) -> bool {
        false
    }

    fn put_back(&mut self, _: &mut Wave<f64>) {}

    /// A flow of T is as much as a complex product.
    fn stats(&self, _: usize) -> Stats {
        Stats {
            evaluations: 2 * self.made,
            ..Stats::default()
        }
    }
}

impl Checkpoint for Phases {}
