//! Shears q ← q + c h (H − σ) p and p ← p − c h (H − σ) q, the parts of splittings that use products with H only.

use super::{Move, Sink, Sweeper, Wave, check_norm};
use crate::problem::Update;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::composition::{Flow, Parts};
use liouville_base::error::StepError;
use liouville_base::method::Stats;
use liouville_base::simd::Stored;

/// Part 0 changes q, part 1 changes p.
#[derive(Clone)]
pub struct Shears<S> {
    sweeper: Sweeper<S>,
    shift: f64,
    tolerance: f64,
    moves: Vec<Move>,
}

impl<S: Stored> Shears<S> {
    /// Shears by H − `shift`; the norm may be off by `tolerance`, relatively, before a state is refused.
    pub fn new(sweeper: Sweeper<S>, shift: f64, tolerance: f64) -> Self {
        Self {
            sweeper,
            shift,
            tolerance,
            moves: Vec::new(),
        }
    }

    /// The sweeper of the products.
    pub fn sweeper_mut(&mut self) -> &mut Sweeper<S> {
        &mut self.sweeper
    }

    /// The shift.
    pub fn shift(&self) -> f64 {
        self.shift
    }

    /// Changes the shift, between two steps.
    pub fn set_shift(&mut self, shift: f64) {
        self.shift = shift;
    }

    fn add(&mut self, part: usize, h: f64) {
        let factor = if part == 0 { h } else { -h };
        let update = Update {
            keep: 1.0,
            factor,
            diagonal: -factor * self.shift,
        };
        self.moves.push(Move::new(part == 1, update));
    }

    fn make(&mut self, state: &mut Wave<S>) -> Result<(), StepError> {
        self.sweeper
            .run(&self.moves, &mut state.q, &mut state.p, Sink::Nothing)
    }
}

impl<S: Stored> Parts for Shears<S> {
    type State = Wave<S>;

    fn count(&self) -> usize {
        2
    }

    /// False, so that no flow is held back over the end of a step: the norm between two shears is another one, and the check
    /// would refuse a good state.
    fn is_exact(&self, _: usize) -> bool {
        false
    }

    fn flow(
        &mut self,
        part: usize,
        _: bool,
        _: f64,
        h: f64,
        state: &mut Wave<S>,
    ) -> Result<(), StepError> {
        self.moves.clear();
        self.add(part, h);
        self.make(state)
    }

    fn flows(
        &mut self,
        flows: &[Flow],
        before: f64,
        _: f64,
        h: f64,
        state: &mut Wave<S>,
    ) -> Result<(), StepError> {
        self.moves.clear();
        let mut before = before;
        for flow in flows {
            self.add(flow.part, before + flow.weight * h);
            before = 0.0;
        }
        self.make(state)?;
        state.add_phase(self.shift * h);
        Ok(())
    }

    fn check(&self, t: f64, state: &Wave<S>) -> Result<(), StepError> {
        check_norm(t, self.tolerance, state)
    }

    /// No copy: two vectors are all the memory there is.
    fn keep(&mut self, _: &Wave<S>) -> bool {
        false
    }

    fn put_back(&mut self, _: &mut Wave<S>) {}

    fn stats(&self, _: usize) -> Stats {
        Stats {
            evaluations: self.sweeper.products(),
            ..Stats::default()
        }
    }
}

impl<S: Stored> Checkpoint for Shears<S> {}
