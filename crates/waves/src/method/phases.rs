//! Split operator: e^{−ihT} and e^{−ihV} in turn, each of them exact, for H = T + V(t) on a periodic grid.
//!
//! T is diagonal after a Fourier transform, V before it. Time is a variable that advances with T: V is evaluated at the
//! time that the flows of T before it have reached, so that a list of flows keeps its order where V depends on time
//! (blanes2002). Planes of the grid stay transformed along all axes but the outermost between two flows of V, and a
//! flow of V visits them one by one.

use super::{Wave, check_norm};
use crate::problem::{Hamiltonian, HamiltonianAt, Kinetic, Operator, RowBlock, Update};
use liouville_base::cancel::CancelToken;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::composition::{Flow, Parts};
use liouville_base::error::StepError;
use liouville_base::method::Stats;
use liouville_base::simd::{ForEach, InstructionSet, Kernel, Number, SimdView, SimdViews, Stored};
use liouville_fourier::{Complex, FourierScratch};
use std::sync::Arc;

/// Part 0 is T, part 1 is V.
#[derive(Clone)]
pub struct Phases {
    hamiltonian: Arc<Hamiltonian>,
    kinetic: Arc<Kinetic>,
    /// The other terms, each with its place among all.
    diagonals: Vec<(usize, Vec<f64>)>,
    current: Option<HamiltonianAt>,
    potential: Vec<f64>,
    tolerance: f64,
    cancel: CancelToken,
    machine: InstructionSet,
    of_kinetic: Vec<KineticPhases>,
    of_potential: Vec<PotentialPhases>,
    psi: Vec<Complex>,
    cos_sin: [Vec<f64>; 2],
    memory: FourierScratch,
    made: usize,
}

/// Phases of T for a length of time.
#[derive(Clone)]
struct KineticPhases {
    s: f64,
    along: Vec<Complex>,
    within: Vec<Complex>,
}

/// cos and sin of V s for a length of time, where V does not depend on it.
#[derive(Clone)]
struct PotentialPhases {
    s: f64,
    cos_sin: [Vec<f64>; 2],
}

/// Tables kept: a step of any list has fewer distinct flows.
const KEPT: usize = 64;

/// Points that tables of V may have in all: half a gigabyte.
const POINTS: usize = 1 << 25;

impl Phases {
    /// Flows of a Hamiltonian with one kinetic term of weight 1 whose other terms are diagonal, none if it is
    /// another one; the norm may be off by `tolerance`, relatively, before a state is refused.
    pub fn new(hamiltonian: Arc<Hamiltonian>, tolerance: f64) -> Option<Self> {
        let machine = InstructionSet::default();
        let (mut kinetic, mut diagonals) = (None, Vec::new());
        for (k, term) in hamiltonian.terms().iter().enumerate() {
            match term {
                Operator::Kinetic(term) if kinetic.is_none() => kinetic = Some(term.clone()),
                _ => diagonals.push((k, diagonal(machine, term)?)),
            }
        }
        let kinetic = kinetic?;
        let n = kinetic.size();
        let mut potential = vec![0.0; n];
        sum(&diagonals, |_| 1.0, &mut potential);
        Some(Self {
            current: hamiltonian.current(),
            cos_sin: [0, 1].map(|_| vec![0.0; kinetic.grid().plane()]),
            psi: vec![Complex::default(); n],
            cancel: CancelToken::of_thread(),
            of_kinetic: Vec::with_capacity(KEPT),
            of_potential: Vec::new(),
            memory: FourierScratch::default(),
            made: 0,
            hamiltonian,
            kinetic,
            diagonals,
            potential,
            tolerance,
            machine,
        })
    }

    /// The same, stopping where `cancel` is set, not that of the thread.
    #[must_use]
    pub fn with_cancel(self, cancel: CancelToken) -> Self {
        Self { cancel, ..self }
    }

    /// Sets the potential to that at `t`, if it depends on time.
    fn take_potential(&mut self, t: f64) -> Result<(), StepError> {
        if let Some(current) = &mut self.current {
            current.set(&self.hamiltonian, &[(1.0, t)])?;
            if current.potential().is_empty() {
                self.potential.fill(0.0);
            } else {
                self.potential.copy_from_slice(current.potential());
            }
            let weights = current.weights();
            sum(&self.diagonals, |k| weights[k], &mut self.potential);
        }
        Ok(())
    }

    /// The place of the table for a flow of T.
    fn kinetic_phase(&mut self, s: f64) -> usize {
        let is_this = |kinetic_phase: &KineticPhases| kinetic_phase.s.to_bits() == s.to_bits();
        self.of_kinetic.iter().position(is_this).unwrap_or_else(|| {
            let (along, within) = self.kinetic.phases(s);
            if self.of_kinetic.len() == KEPT {
                self.of_kinetic.clear();
            }
            self.of_kinetic.push(KineticPhases { s, along, within });
            self.of_kinetic.len() - 1
        })
    }

    /// The place of the table for a flow of V; none where V depends on time, or the grid is too large.
    fn potential_phase(&mut self, s: f64) -> Option<usize> {
        if self.current.is_some() {
            return None;
        }
        let is_this =
            |potential_phase: &PotentialPhases| potential_phase.s.to_bits() == s.to_bits();
        self.of_potential.iter().position(is_this).or_else(|| {
            if self.of_potential.len() >= KEPT.min(POINTS / self.potential.len()) {
                return None;
            }
            let mut cos_sin = [0, 1].map(|_| vec![0.0; self.potential.len()]);
            turn(self.machine, &self.potential, s, &mut cos_sin);
            self.of_potential.push(PotentialPhases { s, cos_sin });
            Some(self.of_potential.len() - 1)
        })
    }

    /// All planes, transformed first or last or both, with V between if `s` says how long.
    fn planes(&mut self, from: bool, s: Option<f64>, to: bool) -> Result<(), StepError> {
        let potential_phase = s.and_then(|s| self.potential_phase(s));
        let grid = self.kinetic.grid();
        let size = grid.plane();
        for (k, plane) in self.psi.chunks_exact_mut(size).enumerate() {
            if self.cancel.is_cancelled() {
                return Err(StepError::Interrupted);
            }
            let within = k * size..(k + 1) * size;
            if from {
                grid.inverse(plane, &mut self.memory);
            }
            if let Some(potential_phase) = potential_phase {
                let [cos, sin] = &self.of_potential[potential_phase].cos_sin;
                multiply(plane, &cos[within.clone()], &sin[within]);
            } else if let Some(s) = s {
                turn(self.machine, &self.potential[within], s, &mut self.cos_sin);
                multiply(plane, &self.cos_sin[0], &self.cos_sin[1]);
            }
            if to {
                grid.forward(plane, &mut self.memory);
            }
        }
        Ok(())
    }

    /// Flows one after another: (part, time, length of time).
    fn walk(
        &mut self,
        flows: impl Iterator<Item = (usize, f64, f64)>,
        state: &mut Wave<f64>,
    ) -> Result<(), StepError> {
        for (psi, (q, p)) in self.psi.iter_mut().zip(state.q.iter().zip(&state.p)) {
            *psi = Complex::new(*q, *p);
        }
        let mut flows = flows.peekable();
        let mut is_transformed = false;
        while let Some((part, t, s)) = flows.next() {
            let next_is_kinetic = flows.peek().is_some_and(|next| next.0 == 0);
            if part == 1 {
                self.take_potential(t)?;
                self.planes(is_transformed, Some(s), next_is_kinetic)?;
                is_transformed = next_is_kinetic;
                continue;
            }
            if !is_transformed {
                self.planes(false, None, true)?;
                is_transformed = true;
            }
            let kinetic_phase = self.kinetic_phase(s);
            let KineticPhases { along, within, .. } = &self.of_kinetic[kinetic_phase];
            let grid = self.kinetic.grid();
            let cancel = &mut self.cancel;
            let go_on = || !cancel.is_cancelled();
            if !grid.multiply(&mut self.psi, &mut self.memory, (along, within), go_on) {
                return Err(StepError::Interrupted);
            }
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
}

/// The diagonal of a term that has nothing else.
fn diagonal(machine: InstructionSet, term: &Operator) -> Option<Vec<f64>> {
    if term.reach()? > 0 {
        return None;
    }
    let x = vec![1.0; term.size()];
    let mut out = vec![0.0; x.len()];
    let (row, place) = (0, 0);
    let block = RowBlock {
        row,
        out: &mut out,
        place,
        x: &x,
    };
    term.act(machine, Update::added(1.0), block);
    Some(out)
}

/// Adds weighted diagonals.
fn sum(diagonals: &[(usize, Vec<f64>)], weight: impl Fn(usize) -> f64, out: &mut [f64]) {
    for (k, diagonal) in diagonals {
        let weight = weight(*k);
        for (out, value) in out.iter_mut().zip(diagonal) {
            *out += weight * value;
        }
    }
}

/// Takes phases off: e^{−iφ} psi.
fn multiply(psi: &mut [Complex], cos: &[f64], sin: &[f64]) {
    for ((psi, cos), sin) in psi.iter_mut().zip(cos).zip(sin) {
        let Complex { re, im } = *psi;
        *psi = Complex::new(re * cos + im * sin, im * cos - re * sin);
    }
}

/// cos(v s) and sin(v s)
fn turn(machine: InstructionSet, v: &[f64], s: f64, [cos, sin]: &mut [Vec<f64>; 2]) {
    f64::run(machine, Turns { v, s, cos, sin });
}

struct Turns<'a> {
    v: &'a [f64],
    s: f64,
    cos: &'a mut [f64],
    sin: &'a mut [f64],
}

impl Kernel<f64> for Turns<'_> {
    type Output = ();

    #[allow(clippy::inline_always)] // compiled for one instruction set as a whole
    #[inline(always)]
    fn run<W: SimdViews<Stored = f64>>(mut self, views: W) {
        views.each(self.v.len(), &mut self);
    }
}

impl ForEach<f64> for Turns<'_> {
    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn visit<W: SimdView<Stored = f64>>(&mut self, view: W) -> bool {
        let angle = view.load(self.v, 0).scaled(self.s);
        view.store(self.cos, 0, angle.cos());
        view.store(self.sin, 0, angle.sin());
        true
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
        self.walk([(part, t, h)].into_iter(), state)
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
        let mut before = before;
        let flows = flows.iter().map(|flow| {
            let length = std::mem::take(&mut before) + flow.weight * h;
            (flow.part, t + flow.offset * h, length)
        });
        self.walk(flows, state)
    }

    fn check(&self, t: f64, state: &Wave<f64>) -> Result<(), StepError> {
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
