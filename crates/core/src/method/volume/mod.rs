//! Volume-preserving steps of split polynomial fields: the flow of each piece, with det = 1.
//!
//! The pieces' own formulas stand in [`crate::problem::polynomial`] and in the files of this folder; all
//! are explicit. They are compiled once to short programs ([`code`]), which run over registers of
//! whatever is stored: trajectories in lock-step, or neighbouring variables of one large state. A
//! trajectory has the same bits alone, in lock-step, and on any machine.
//! Source: mclachlan2008, xue2013.

mod affine;
mod code;
mod exponential;
mod kernel;
mod motion;
mod observe;
mod order;
mod rows;
mod section;
mod stages;
mod triangular;

pub use observe::{Observer, Seen};
pub use section::{Direction, Plane, Section};

use super::{Flow, Parts};
use crate::problem::polynomial::{Piece, Split};
use crate::trouble::Trouble;
use crate::vector::{Kernel, Machine, Stored, Visit, Window, Windows};
use kernel::{Flows, Scratch};
use motion::{Layout, Motion};
use order::Order;
use rows::Rows;
use std::sync::Arc;

/// Where the variables are.
#[derive(Debug, PartialEq)]
pub struct State<S> {
    /// The variables in the order of the stepper, and room for waves.
    x: Vec<S>,
    /// What they have lost to rounding, where that is kept.
    low: Vec<S>,
}

impl<S: Clone> Clone for State<S> {
    fn clone(&self) -> Self {
        Self {
            x: self.x.clone(),
            low: self.low.clone(),
        }
    }

    /// Into the memory there is: steps keep copies.
    fn clone_from(&mut self, source: &Self) {
        self.x.clone_from(&source.x);
        self.low.clone_from(&source.low);
    }
}

/// The flows of a split field's pieces, for one trajectory or several in lock-step.
#[derive(Clone, Debug)]
pub struct Volume<S> {
    split: Arc<Split>,
    plan: Arc<Plan>,
    machine: Machine,
    is_compensated: bool,
    scratch: Scratch<S>,
    /// The changes of affine flows by length and part, the oldest first.
    affine: Vec<(u64, usize, Rows)>,
    kept: Option<State<S>>,
}

/// A split, compiled.
#[derive(Debug)]
struct Plan {
    order: Order,
    motions: Vec<Motion>,
    /// How many waves a piece has at most.
    waves: usize,
    has_affine: bool,
}

/// States above this size are not copied before each step.
const LARGEST_KEPT: usize = 1 << 14;
/// Affine flows of so many lengths are remembered.
const MOST_AFFINE: usize = 256;

impl<S: Stored> Volume<S> {
    /// The flows of the pieces of `split`, with or without compensated sums.
    pub fn new(split: Arc<Split>, is_compensated: bool) -> Self {
        let order = Order::new(&split);
        let layout = Layout {
            split: &split,
            order: &order,
            in_runs: S::MEMBERS == 1,
        };
        let motions: Vec<Motion> = split
            .pieces()
            .iter()
            .map(|piece| layout.motion(piece))
            .collect();
        let waves = split.pieces().iter().map(|piece| match piece {
            Piece::Natural { waves, .. } | Piece::Shear { waves, .. } => waves.len(),
            _ => 0,
        });
        let waves = waves.max().unwrap_or(0);
        let n = split.n();
        let zeros = |n: usize| vec![S::splat(0.0); n];
        let stages = motions.iter().map(|motion| match motion {
            Motion::Triangular(piece) if !piece.is_euler() => piece.stages,
            _ => 0,
        });
        let stages = stages.max().unwrap_or(0);
        let has_affine = motions
            .iter()
            .any(|motion| matches!(motion, Motion::Affine(_)));
        let scratch = Scratch {
            change: zeros(if has_affine { n } else { 0 }),
            stages: (0..stages).map(|_| [zeros(n + waves), zeros(n)]).collect(),
        };
        let plan = Arc::new(Plan {
            order,
            motions,
            waves,
            has_affine,
        });
        Self {
            split,
            plan,
            machine: Machine::default(),
            is_compensated,
            scratch,
            affine: Vec::new(),
            kept: None,
        }
    }

    /// The same with another instruction set, which gives the same bits.
    #[must_use]
    pub fn on(mut self, machine: Machine) -> Self {
        self.machine = machine;
        self
    }

    /// What is split.
    pub fn split(&self) -> &Split {
        &self.split
    }

    /// The state at these values of the variables.
    ///
    /// # Panics
    /// When there are not as many as variables.
    pub fn state(&self, x: &[S]) -> State<S> {
        let n = self.split.n();
        assert_eq!(x.len(), n, "size of a state");
        let order = &self.plan.order;
        let values = (0..n).map(|place| x[order.variable_at(place)]);
        let room = std::iter::repeat_n(S::splat(0.0), self.plan.waves);
        let low = if self.is_compensated { n } else { 0 };
        State {
            x: values.chain(room).collect(),
            low: vec![S::splat(0.0); low],
        }
    }

    /// Writes the values of the variables, in the order of the split.
    ///
    /// # Panics
    /// When there are not as many places as variables.
    pub fn values(&self, state: &State<S>, x: &mut [S]) {
        assert_eq!(x.len(), self.split.n(), "size of a state");
        for (variable, x) in x.iter_mut().enumerate() {
            *x = state.x[self.plan.order.place_of(variable)];
        }
    }

    /// Makes the affine flows among these known.
    fn prepare(&mut self, flows: &[Flow], before: f64, h: f64) {
        let mut before = before;
        for flow in flows {
            let length = before + flow.weight * h;
            before = 0.0;
            if let Motion::Affine(affine) = &self.plan.motions[flow.part] {
                let h = length;
                let bits = h.to_bits();
                let is_known =
                    |(known, part, _): &(u64, usize, Rows)| *known == bits && *part == flow.part;
                if !self.affine.iter().any(is_known) {
                    if self.affine.len() == MOST_AFFINE {
                        self.affine.remove(0);
                    }
                    self.affine.push((bits, flow.part, affine.change(h)));
                }
            }
        }
    }
}

impl<S: Stored> Parts for Volume<S> {
    type State = State<S>;

    fn count(&self) -> usize {
        self.plan.motions.len()
    }

    fn is_exact(&self, part: usize) -> bool {
        !matches!(self.plan.motions[part], Motion::Triangular(_))
    }

    fn flow(
        &mut self,
        part: usize,
        is_adjoint: bool,
        t: f64,
        h: f64,
        state: &mut State<S>,
    ) -> Result<(), Trouble> {
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
    ) -> Result<(), Trouble> {
        if self.plan.has_affine {
            self.prepare(flows, before, h);
        }
        let kernel = Flows {
            motions: &self.plan.motions,
            affine: &self.affine,
            flows,
            before,
            t,
            h,
            state,
            scratch: &mut self.scratch,
        };
        S::run(self.machine, kernel)
    }

    fn check(&self, t: f64, state: &State<S>) -> Result<(), Trouble> {
        let n = self.split.n();
        let x = &state.x[..n];
        if S::run(self.machine, IsFinite { x }) {
            return Ok(());
        }
        // in the order of the split, so that all ways to store a state name the same variable
        let members = 0..S::MEMBERS;
        let bad = members.flat_map(|member| (0..n).map(move |index| (member, index)));
        let is_bad = |(member, index): &(usize, usize)| {
            !x[self.plan.order.place_of(*index)]
                .member(*member)
                .is_finite()
        };
        let (member, index) = bad.into_iter().find(is_bad).unwrap_or((0, 0));
        Err(Trouble::Overflow { index, member, t })
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

    fn restore(&mut self, state: &mut State<S>) {
        if let Some(kept) = &self.kept {
            state.clone_from(kept);
        }
    }
}

/// Whether all numbers are finite.
struct IsFinite<'a, S> {
    x: &'a [S],
}

impl<S> Visit<S> for IsFinite<'_, S> {
    #[inline(always)]
    fn visit<W: Window<Stored = S>>(&mut self, window: W) -> bool {
        use crate::vector::Number;
        window.load(self.x, 0).is_finite()
    }
}

impl<S> Kernel<S> for IsFinite<'_, S> {
    type Output = bool;

    #[inline(always)]
    fn run<W: Windows<Stored = S>>(mut self, windows: W) -> bool {
        windows.each(self.x.len(), &mut self)
    }
}
