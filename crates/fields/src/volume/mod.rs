//! Volume-preserving steps of split polynomial fields: the flow of each piece, with det = 1.
//!
//! The formulas of pieces are in [`crate::problem`] and in the files of this folder; all are explicit. They are compiled
//! once to short programs ([`code`]) over registers of trajectories in lock-step, or of neighbouring variables of one
//! large state. Results are bitwise independent of lock-step and of the machine.
//! Source: mclachlan2008, xue2013.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

mod affine;
mod changes;
mod code;
mod compiled;
mod determinant;
mod exponential;
mod flow;
mod functions;
mod kernel;
mod layout;
mod linear;
mod observe;
mod order;
mod plane;
mod programs;
mod rows;
mod section;
mod shared;
mod short;
mod stages;
mod state;
mod tangents;
mod triangular;
mod turn;
mod views;

pub use determinant::{Determinant, Determined};
pub use observe::{Observer, UserVariables};
pub use section::{Direction, Plane, Section};
pub use state::State;
pub use tangents::{TangentObserver, TangentRows, Tangential, Tangents, WithoutTangents};

use crate::problem::Split;
use changes::Changes;
use compiled::CompiledSplit;
use flow::PieceFlow;
use functions::FunctionScratch;
use kernel::FlowKernel;
pub(crate) use linear::{LinearSteps, count_coefficients};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::composition::{Flow, Parts};
use liouville_base::error::StepError;
use liouville_base::parallel::Workers;
use liouville_base::simd::{ForEach, InstructionSet, Kernel, SimdView, SimdViews, Stored};
use liouville_gridded::Memory;
use std::sync::Arc;
use views::FlowScratch;

/// The flows of a split field's pieces, for one trajectory or several in lock-step.
#[derive(Clone, Debug)]
pub struct Volume<S: Stored> {
    split: Arc<Split>,
    compiled: Arc<CompiledSplit>,
    machine: InstructionSet,
    workers: Option<Workers>,
    is_compensated: bool,
    scratch: FlowScratch<S>,
    function_scratch: FunctionScratch,
    /// Memory of each piece that is a plane.
    planes: Vec<Vec<Memory<S::Group>>>,
    changes: Changes,
    clock: Option<u32>,
    kept: Option<State<S>>,
}

/// States above this size are not copied before each step.
const LARGEST_KEPT: usize = 1 << 14;

impl<S: Stored> Volume<S> {
    /// The flows of the pieces of `split`, with or without compensated sums.
    pub fn new(split: Arc<Split>, is_compensated: bool) -> Self {
        let compiled = Arc::new(CompiledSplit::new(&split, S::IS_SINGLE));
        let n = split.n();
        let zeros = |n: usize| vec![S::splat(0.0); n];
        let stages =
            (0..compiled.stages).map(|_| [zeros(n + compiled.functions.places()), zeros(n)]);
        let scratch = FlowScratch {
            change: zeros(if compiled.has_affine { n } else { 0 }),
            stages: stages.collect(),
        };
        let planes = compiled.piece_flows.iter().map(PieceFlow::memory::<S>);
        Self {
            function_scratch: FunctionScratch::new::<S>(&compiled.functions),
            planes: planes.collect(),
            split,
            compiled,
            machine: InstructionSet::default(),
            workers: None,
            is_compensated,
            scratch,
            changes: Changes::default(),
            clock: None,
            kept: None,
        }
    }

    /// The same with another instruction set, which gives the same bits.
    #[must_use]
    pub fn on(mut self, machine: InstructionSet) -> Self {
        self.machine = machine;
        self
    }

    /// The same with so many threads for large states, which give the same bits.
    #[must_use]
    pub fn with_threads(mut self, threads: usize) -> Self {
        let is_long = shared::has_long_runs(&self.compiled.piece_flows);
        self.workers = Workers::new(threads).filter(|_| is_long);
        self
    }

    /// The same for trajectories that have the same value of a variable, [`Split::is_clock`]: functions of it alone are
    /// computed once.
    #[must_use]
    pub fn with_clock(mut self, variable: Option<usize>) -> Self {
        self.clock = variable.map(|variable| rows::narrow(self.compiled.order.place_of(variable)));
        self
    }

    /// The split field.
    pub fn split(&self) -> &Split {
        &self.split
    }

    /// How many numbers a trajectory has: variables, and functions of them.
    pub fn places(&self) -> usize {
        self.split.n() + self.compiled.functions.places()
    }

    /// The state at these values of the variables.
    ///
    /// # Panics
    /// When there are not as many as variables.
    pub fn state(&self, x: &[S]) -> State<S> {
        let n = self.split.n();
        let zeros = |n: usize| vec![S::splat(0.0); n];
        let mut state = State {
            x: zeros(self.places()),
            low: zeros(if self.is_compensated { n } else { 0 }),
        };
        self.set(x, &mut state);
        state
    }

    /// Makes a state the one at these values of the variables.
    ///
    /// # Panics
    /// When there are not as many as variables.
    pub fn set(&self, x: &[S], state: &mut State<S>) {
        assert_eq!(x.len(), self.split.n(), "size of a state");
        for (variable, x) in x.iter().enumerate() {
            state.x[self.compiled.order.place_of(variable)] = *x;
        }
        state.low.fill(S::splat(0.0));
    }

    /// Writes the values of the variables, in the order of the split.
    ///
    /// # Panics
    /// When there are not as many places as variables.
    pub fn values(&self, state: &State<S>, x: &mut [S]) {
        assert_eq!(x.len(), self.split.n(), "size of a state");
        for (variable, x) in x.iter_mut().enumerate() {
            *x = state.x[self.compiled.order.place_of(variable)];
        }
    }

    /// Makes flows on this thread.
    fn single_thread(
        &mut self,
        flows: &[Flow],
        before: f64,
        (t, h): (f64, f64),
        state: &mut State<S>,
    ) -> Result<(), StepError> {
        let kernel = FlowKernel {
            piece_flows: &self.compiled.piece_flows,
            functions: &self.compiled.functions,
            function_scratch: &mut self.function_scratch,
            clock: self.clock,
            changes: &self.changes,
            flows,
            before,
            t,
            h,
            state,
            scratch: &mut self.scratch,
        };
        S::run(self.machine, kernel)
    }

    /// Makes flows one after another, those of planes for each group of members.
    fn by_planes(
        &mut self,
        flows: &[Flow],
        before: f64,
        (t, h): (f64, f64),
        state: &mut State<S>,
    ) -> Result<(), StepError> {
        let mut before = before;
        for flow in flows {
            match &self.compiled.piece_flows[flow.part] {
                PieceFlow::Plane(piece) => {
                    let start = t + flow.offset * h;
                    let length = before + flow.weight * h;
                    let memory = &mut self.planes[flow.part];
                    let span = (start, length);
                    piece.flow(self.machine, flow.is_adjoint, span, state, memory)?;
                }
                _ => self.single_thread(std::slice::from_ref(flow), before, (t, h), state)?,
            }
            before = 0.0;
        }
        Ok(())
    }

    /// Makes a flow of length `h` on all threads, if it changes rows level after level.
    fn shared(&self, flow: &Flow, h: f64, state: &mut State<S>) -> bool {
        let Some(workers) = &self.workers else {
            return false;
        };
        let piece = &self.compiled.piece_flows[flow.part];
        let Some(levels) = piece.levels(flow.is_adjoint) else {
            return false;
        };
        if self.compiled.functions.has(flow.part) {
            return false;
        }
        let (x, low) = state.parts();
        let (Some(x), Some(low)) = (S::alone_mut(x), S::alone_mut(low)) else {
            return false;
        };
        for rows in levels.iter() {
            let of = (workers, self.machine);
            shared::change_rows(of, levels.change, rows, h, (&mut *x, &mut *low));
        }
        true
    }
}

impl<S: Stored> Parts for Volume<S> {
    type State = State<S>;

    fn count(&self) -> usize {
        self.compiled.piece_flows.len()
    }

    fn is_exact(&self, part: usize) -> bool {
        let piece = &self.compiled.piece_flows[part];
        !matches!(piece, PieceFlow::Triangular(_) | PieceFlow::Plane(_))
    }

    fn flow(
        &mut self,
        part: usize,
        is_adjoint: bool,
        t: f64,
        h: f64,
        state: &mut State<S>,
    ) -> Result<(), StepError> {
        let flow = Flow {
            part,
            is_adjoint,
            weight: 1.0,
            offset: 0.0,
        };
        self.flows(&[flow], 0.0, t, h, state)
    }

    fn flows(
        &mut self,
        flows: &[Flow],
        before: f64,
        t: f64,
        h: f64,
        state: &mut State<S>,
    ) -> Result<(), StepError> {
        if self.compiled.has_affine {
            self.changes
                .prepare(&self.compiled.piece_flows, flows, before, h);
        }
        if self.compiled.has_planes {
            return self.by_planes(flows, before, (t, h), state);
        }
        if self.workers.is_none() {
            return self.single_thread(flows, before, (t, h), state);
        }
        let mut before = before;
        for flow in flows {
            if !self.shared(flow, before + flow.weight * h, state) {
                self.single_thread(std::slice::from_ref(flow), before, (t, h), state)?;
            }
            before = 0.0;
        }
        Ok(())
    }

    fn check(&self, t: f64, state: &State<S>) -> Result<(), StepError> {
        let n = self.split.n();
        let x = &state.x[..n];
        if S::run(self.machine, IsFinite { x }) {
            return Ok(());
        }
        // in the order of the split, so that each storage of a state names the same variable
        let members = 0..S::MEMBERS;
        let bad = members.flat_map(|member| (0..n).map(move |index| (member, index)));
        let is_bad = |(member, index): &(usize, usize)| {
            !x[self.compiled.order.place_of(*index)]
                .member(*member)
                .is_finite()
        };
        let (member, index) = bad.into_iter().find(is_bad).unwrap_or((0, 0));
        Err(StepError::Overflow { index, member, t })
    }

    fn keep(&mut self, state: &State<S>) -> bool {
        if state.x.len() > LARGEST_KEPT {
            return false;
        }
        match &mut self.kept {
            Some(kept) => kept.clone_from(state),
            none => *none = Some(state.clone()),
        }
        true
    }

    fn put_back(&mut self, state: &mut State<S>) {
        if let Some(kept) = &self.kept {
            state.clone_from(kept);
        }
    }
}

/// Whether all numbers are finite.
struct IsFinite<'a, S> {
    x: &'a [S],
}

impl<S> ForEach<S> for IsFinite<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        use liouville_base::simd::Number;
        view.load(self.x, 0).is_finite()
    }
}

impl<S> Kernel<S> for IsFinite<'_, S> {
    type Output = bool;

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(mut self, views: W) -> bool {
        views.each(self.x.len(), &mut self)
    }
}

impl<S: Stored> Checkpoint for Volume<S> {}
