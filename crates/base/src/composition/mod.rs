//! Compositions of parts: a step is a list of flows, made once from a scheme.
//!
//! With parts ψ¹ .. ψᵐ the basic step is Φ_h = ψᵐ_h ∘ … ∘ ψ¹_h, and its adjoint
//! Φ*_h = ψ¹*_h ∘ … ∘ ψᵐ*_h; a scheme composes them (see [`crate::tableau::composition`]). Where Φ and Φ*
//! meet, equal parts do: exact flows add up, ψ_{βh} ∘ ψ_{αh} = ψ_{(α+β)h}, and are made as one. So do the
//! last flow of a step and the first of the next: the last is deferred to the next step, or until the state is
//! synchronized. A composition of a symmetric method has that method as its only part.
//!
//! Time dependence: the flows of a map with weight α begin at the time where the map begins and last α h.

mod symmetric;

use crate::checkpoint::{Checkpoint, CheckpointMismatch};
use crate::error::StepError;
use crate::method::{Stats, Stepper};
use crate::tableau::Scheme;
pub use symmetric::Base;

/// Flows of a state that a step is composed of.
pub trait Parts: Checkpoint {
    /// The state that they move.
    type State: Checkpoint;

    /// How many parts there are.
    fn count(&self) -> usize;

    /// Whether the part is an exact flow: its own adjoint, and flows of it add up.
    fn is_exact(&self, part: usize) -> bool;

    /// Moves `state` by a part, or its adjoint, from `t` to `t + h`.
    ///
    /// # Errors
    /// Why it failed; the state is undefined then.
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
    /// Why it failed; the state is undefined then.
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
    /// Called after each step where copies are kept, otherwise after some, and always when a state is
    /// synchronized.
    ///
    /// # Errors
    /// Which variable is not finite.
    fn check(&self, t: f64, state: &Self::State) -> Result<(), StepError>;

    /// Keeps a copy of the state before a step, and returns whether it has; large states are not copied.
    fn keep(&mut self, state: &Self::State) -> bool;

    /// Restores the last copy.
    fn put_back(&mut self, state: &mut Self::State);

    /// Forgets the flows before; see [`Stepper::forget`].
    fn forget(&mut self) {}

    /// Statistics, given the number of flows.
    fn stats(&self, flows: usize) -> Stats {
        Stats {
            evaluations: flows,
            ..Stats::default()
        }
    }

    /// Statistics of a member in lock-step; see [`Stepper::stats_of`].
    fn stats_of(&self, _member: usize, flows: usize) -> Stats {
        self.stats(flows)
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
    /// At which fraction of the step it begins.
    pub offset: f64,
}

/// A flow about to be made.
#[derive(Clone, Copy, Debug, Default)]
struct Deferred {
    part: usize,
    is_adjoint: bool,
    t: f64,
    h: f64,
}

impl Flow {
    fn at(self, t: f64, h: f64) -> Deferred {
        Deferred {
            part: self.part,
            is_adjoint: self.is_adjoint,
            t: t + self.offset * h,
            h: self.weight * h,
        }
    }
}

/// Steps between two checks of a state of which no copy is kept.
const CHECKED_EVERY: usize = 16;

/// A composition at work.
#[derive(Clone, Debug)]
pub struct Composed<P: Parts> {
    parts: P,
    program: Vec<Flow>,
    /// Whether the last flow of a step and the first of the next are one.
    is_cyclic: bool,
    /// The last flow of the step before, deferred.
    deferred: Option<Deferred>,
    /// The error that left the state undefined, if there was one.
    lost: Option<StepError>,
    /// Where the last step ended, and how many were made since the state was checked.
    end: f64,
    unchecked: usize,
    flows: usize,
}

/// A scheme of Φ and Φ* for a method that is its own adjoint.
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
            deferred: None,
            lost: None,
            end: 0.0,
            unchecked: 0,
            flows: 0,
        }
    }

    /// The parts.
    pub fn parts(&self) -> &P {
        &self.parts
    }

    /// The parts, to change them between steps.
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

    /// All flows of a step, the last one deferred if it can be.
    fn walk(&mut self, t: f64, h: f64, state: &mut P::State) -> Result<(), StepError> {
        let Self { parts, program, .. } = self;
        let last = program.len() - usize::from(self.is_cyclic);
        let mut deferred = self.deferred.take();
        if last > 0 {
            let before = deferred.take().map_or(0.0, |deferred| deferred.h);
            parts.flows(&program[..last], before, t, h, state)?;
            self.flows += last;
        }
        if self.is_cyclic {
            let now = program[last].at(t, h);
            // a program of one flow has none before it
            self.deferred = Some(deferred.map_or(now, |before| before.joined(now)));
        }
        Ok(())
    }

    /// Checks that the state is finite, unless it is large and was checked lately.
    fn check(&mut self, t: f64, is_kept: bool, state: &P::State) -> Result<(), StepError> {
        self.end = t;
        self.unchecked += 1;
        if is_kept || self.unchecked >= CHECKED_EVERY {
            self.unchecked = 0;
            return self.parts.check(t, state);
        }
        Ok(())
    }

    /// Makes the deferred flow, and checks the state.
    fn finish(&mut self, state: &mut P::State) -> Result<(), StepError> {
        if let Some(now) = self.deferred.take() {
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
    /// Writes to `out` the synchronized state, and leaves `state` as it is.
    ///
    /// # Errors
    /// Why the deferred flow could not be made.
    pub fn peek(&mut self, state: &P::State, out: &mut P::State) -> Result<(), StepError> {
        out.clone_from(state);
        let flow = |now: Deferred| (self.parts).flow(now.part, now.is_adjoint, now.t, now.h, out);
        self.deferred.map_or(Ok(()), flow)
    }
}

impl Deferred {
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

    /// Where no copy of the state is kept, a failed step leaves it undefined: [`Stepper::synchronize`] fails from then
    /// on.
    fn step(&mut self, t: f64, h: f64, state: &mut P::State) -> Result<(), StepError> {
        if let Some(error) = &self.lost {
            return Err(error.clone());
        }
        let is_kept = self.parts.keep(state);
        let deferred = self.deferred;
        let outcome = self
            .walk(t, h, state)
            .and_then(|()| self.check(t + h, is_kept, state));
        outcome.inspect_err(|error| {
            self.deferred = deferred;
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
        if self.deferred.is_none() && self.unchecked == 0 {
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

    fn stats_of(&self, member: usize) -> Stats {
        self.parts.stats_of(member, self.flows)
    }
}

crate::checkpoint!(Deferred {
    part,
    is_adjoint,
    t,
    h
});

crate::checkpoint!([P: Parts] Composed<P> { parts, deferred, end, unchecked } then |composed| {
    match composed.deferred {
        Some(flow) if flow.part >= composed.parts.count() => Err(CheckpointMismatch),
        _ => Ok(()),
    }
});
