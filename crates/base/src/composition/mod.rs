//! Compositions of parts: a step is a list of flows, made once from a scheme.
//!
//! With parts ψ¹ .. ψᵐ the basic step is Φ_h = ψᵐ_h ∘ … ∘ ψ¹_h, and its adjoint
//! Φ*_h = ψ¹*_h ∘ … ∘ ψᵐ*_h; a scheme composes them (see [`crate::tableau::composition`]). Where Φ and Φ*
//! meet, equal parts do: exact flows add up, ψ_{βh} ∘ ψ_{αh} = ψ_{(α+β)h}, and are made as one. So do the
//! last flow of a step and the first of the next: the last is held back until the next step, or until
//! somebody looks at the state. A composition of a symmetric method has that method as its only part.
//!
//! Time dependence: a flow goes from the time its map begins at, and takes α h, as everything else in that map.

mod symmetric;

use crate::checkpoint::{Checkpoint, CheckpointMismatch};
use crate::error::StepError;
use crate::method::{Stats, Stepper};
use crate::tableau::Scheme;
pub use symmetric::Base;

/// What a composed step is made of: flows of a state, one after another.
pub trait Parts: Checkpoint + Send {
    /// What they move.
    type State: Checkpoint;

    /// How many parts there are.
    fn count(&self) -> usize;

    /// Whether the part is an exact flow: its own adjoint, and flows of it add up.
    fn is_exact(&self, part: usize) -> bool;

    /// Moves `state` by a part, or its adjoint, from `t` to `t + h`.
    ///
    /// # Errors
    /// Why that could not be; the state may be anything then.
    fn flow(
        &mut self,
        part: usize,
        is_adjoint: bool,
        t: f64,
        h: f64,
        state: &mut Self::State,
    ) -> Result<(), StepError>;

    /// Moves `state` by flows one after another, of a step from `t` to `t + h`; the first begins `before`
    /// earlier than it says.
    ///
    /// # Errors
    /// Why that could not be; the state may be anything then.
    fn flows(
        &mut self,
        flows: &[Flow],
        before: f64,
        t: f64,
        h: f64,
        state: &mut Self::State,
    ) -> Result<(), StepError> {
        let mut before = before;
        for flow in flows {
            let now = flow.at(t, h);
            let (t, h) = (now.t - before, before + now.h);
            self.flow(now.part, now.is_adjoint, t, h, state)?;
            before = 0.0;
        }
        Ok(())
    }

    /// Refuses a state that is not finite.
    ///
    /// Asked after each step where copies are kept, otherwise now and then, and always before a state is
    /// looked at.
    ///
    /// # Errors
    /// What is not finite.
    fn check(&self, t: f64, state: &Self::State) -> Result<(), StepError>;

    /// Keeps a copy of the state before a step, or says that it is too large for that.
    fn keep(&mut self, state: &Self::State) -> bool;

    /// Puts back what was kept last.
    fn put_back(&mut self, state: &mut Self::State);

    /// Forgets the flows before; see [`Stepper::forget`].
    fn forget(&mut self) {}

    /// What was done, given the number of flows.
    fn stats(&self, flows: usize) -> Stats {
        Stats {
            evaluations: flows,
            ..Stats::default()
        }
    }
}

/// A flow in the list of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flow {
    /// Which part.
    pub part: usize,
    /// Whether its adjoint; never so for an exact flow.
    pub is_adjoint: bool,
    /// How much of the step it takes.
    pub weight: f64,
    /// How much of the step is over when it begins.
    pub offset: f64,
}

/// A flow about to be made.
#[derive(Clone, Copy, Debug)]
struct Held {
    part: usize,
    is_adjoint: bool,
    t: f64,
    h: f64,
}

impl Flow {
    fn at(self, t: f64, h: f64) -> Held {
        Held {
            part: self.part,
            is_adjoint: self.is_adjoint,
            t: t + self.offset * h,
            h: self.weight * h,
        }
    }
}

/// Steps between two looks at a state of which no copy is kept.
const CHECKED_EVERY: usize = 16;

/// A composition at work.
#[derive(Clone, Debug)]
pub struct Composed<P: Parts> {
    parts: P,
    program: Vec<Flow>,
    /// Whether the last flow of a step and the first of the next are one.
    is_cyclic: bool,
    /// The last flow of the step before, not made yet.
    held: Option<Held>,
    /// What made the state unusable, if anything did.
    lost: Option<StepError>,
    /// Where the last step ended, and how many were made since the state was looked at.
    end: f64,
    unchecked: usize,
    flows: usize,
}

/// A scheme of Φ and Φ* where there is no Φ*.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0} composes a step with its adjoint, which a symmetric step has no use for")]
pub struct NeedsAdjoint(pub &'static str);

impl<P: Parts> Composed<P> {
    /// These parts, composed by `scheme`.
    pub fn new(parts: P, scheme: &Scheme) -> Self {
        let mut program = Vec::new();
        let mut offset = 0.0;
        for (is_adjoint, alpha) in scheme.flows() {
            for k in 0..parts.count() {
                let part = if is_adjoint { parts.count() - 1 - k } else { k };
                let flow = Flow {
                    part,
                    is_adjoint: is_adjoint && !parts.is_exact(part),
                    weight: alpha,
                    offset,
                };
                append(&mut program, flow, parts.is_exact(part));
            }
            offset += alpha;
        }
        Self::following(parts, program)
    }

    /// These parts, moved by a list of flows.
    pub fn following(parts: P, program: Vec<Flow>) -> Self {
        let is_cyclic = match (program.first(), program.last()) {
            (Some(first), Some(last)) => first.part == last.part && parts.is_exact(first.part),
            _ => false,
        };
        Self {
            parts,
            program,
            is_cyclic,
            held: None,
            lost: None,
            end: 0.0,
            unchecked: 0,
            flows: 0,
        }
    }

    /// What is composed.
    pub fn parts(&self) -> &P {
        &self.parts
    }

    /// The same, to change it between steps.
    pub fn parts_mut(&mut self) -> &mut P {
        &mut self.parts
    }

    /// The flows of a step, first to last; where [`Composed::is_cyclic`], the last waits for the next first.
    pub fn program(&self) -> &[Flow] {
        &self.program
    }

    /// Whether the last flow of a step and the first of the next are made as one.
    pub fn is_cyclic(&self) -> bool {
        self.is_cyclic
    }

    /// All flows of a step, the last one held back if it can be.
    fn walk(&mut self, t: f64, h: f64, state: &mut P::State) -> Result<(), StepError> {
        let Self { parts, program, .. } = self;
        let last = program.len() - usize::from(self.is_cyclic);
        let mut held = self.held.take();
        if last > 0 {
            let before = held.take().map_or(0.0, |held| held.h);
            parts.flows(&program[..last], before, t, h, state)?;
            self.flows += last;
        }
        if self.is_cyclic {
            let now = program[last].at(t, h);
            // a program of one flow has nothing to do before
            self.held = Some(held.map_or(now, |before| before.joined(now)));
        }
        Ok(())
    }

    /// Looks whether the state is finite, unless it is large and was looked at lately.
    fn look(&mut self, t: f64, is_kept: bool, state: &P::State) -> Result<(), StepError> {
        self.end = t;
        self.unchecked += 1;
        if is_kept || self.unchecked >= CHECKED_EVERY {
            self.unchecked = 0;
            return self.parts.check(t, state);
        }
        Ok(())
    }

    /// Makes the flow that was held back, and looks at the state.
    fn finish(&mut self, state: &mut P::State) -> Result<(), StepError> {
        if let Some(now) = self.held.take() {
            self.flows += 1;
            self.parts
                .flow(now.part, now.is_adjoint, now.t, now.h, state)?;
        }
        self.parts.check(self.end, state)
    }
}

impl<P: Parts> Composed<P>
where
    P::State: Clone,
{
    /// Makes `out` what [`Stepper::synchronize`] would make of a state, which goes on as it is.
    ///
    /// # Errors
    /// Why the flow that was held back could not be made.
    pub fn peek(&mut self, state: &P::State, out: &mut P::State) -> Result<(), StepError> {
        out.clone_from(state);
        let flow = |now: Held| (self.parts).flow(now.part, now.is_adjoint, now.t, now.h, out);
        self.held.map_or(Ok(()), flow)
    }
}

impl Held {
    /// This flow and the next, which is one of the same exact part.
    fn joined(self, next: Self) -> Self {
        Self {
            h: self.h + next.h,
            ..self
        }
    }
}

/// Appends a flow, or adds it to the last one if both are of the same exact part.
fn append(program: &mut Vec<Flow>, flow: Flow, is_exact: bool) {
    match program.last_mut() {
        Some(last) if is_exact && last.part == flow.part => last.weight += flow.weight,
        _ => program.push(flow),
    }
}

impl<P: Parts> Stepper for Composed<P> {
    type State = P::State;

    /// Where no copy of the state can be kept, a failed step leaves a state that is not to be used:
    /// [`Stepper::synchronize`] refuses it from then on.
    fn step(&mut self, t: f64, h: f64, state: &mut P::State) -> Result<(), StepError> {
        if let Some(error) = &self.lost {
            return Err(error.clone());
        }
        let is_kept = self.parts.keep(state);
        let held = self.held;
        let outcome = self
            .walk(t, h, state)
            .and_then(|()| self.look(t + h, is_kept, state));
        outcome.inspect_err(|error| {
            self.held = held;
            if is_kept {
                self.parts.put_back(state);
            } else {
                self.lost = Some(error.clone());
            }
        })
    }

    fn synchronize(&mut self, state: &mut P::State) -> Result<(), StepError> {
        if let Some(error) = &self.lost {
            return Err(error.clone());
        }
        if self.held.is_none() && self.unchecked == 0 {
            return Ok(());
        }
        self.unchecked = 0;
        self.finish(state)
            .inspect_err(|error| self.lost = Some(error.clone()))
    }

    fn forget(&mut self) {
        self.parts.forget();
    }

    fn stats(&self) -> Stats {
        self.parts.stats(self.flows)
    }
}

/// What is composed, and what was held back.
impl<P: Parts> Checkpoint for Composed<P> {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.parts.save(member, out);
        let held = self
            .held
            .map(|now| ((now.part, now.is_adjoint), (now.t, now.h)));
        held.save(member, out);
        self.end.save(member, out);
        self.unchecked.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.parts.restore(member, saved)?;
        let mut held = Some(((0, false), (0.0, 0.0)));
        held.restore(member, saved)?;
        self.held = held.map(|((part, is_adjoint), (t, h))| Held {
            part,
            is_adjoint,
            t,
            h,
        });
        if self.held.is_some_and(|now| now.part >= self.parts.count()) {
            return Err(CheckpointMismatch);
        }
        self.end.restore(member, saved)?;
        self.unchecked.restore(member, saved)
    }
}
