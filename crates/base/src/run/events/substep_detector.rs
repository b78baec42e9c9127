//! Detection of events, and states at given times, by substeps: shorter steps of the same method from the last end of a
//! step.
//!
//! A substep has the order of the method and keeps its invariants, which an interpolation does not. Zeros are first
//! located on the polynomial through the last ends of steps.

use super::super::{Ending, EventDetector, Events, Hits, Outcome, Records, reserve};
use super::interpolant::{Interpolant, KNOTS};
use super::{
    Crossing, FunctionInStep, InterpolationAccuracy, SAMPLES, Search, Substep, WatchedFunction,
    is_met_at, met_at_end,
};
use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::method::Stepper;
use crate::observe::Observe;

/// A time that exceeds the end of a step by this part of it, from roundoff, is of that step.
const ROUNDOFF: f64 = 1e-9;

/// Finds events, and records a run at given times, in the order of the run.
pub struct SubstepDetector<State: Checkpoint> {
    substep: Substep<State>,
    observer: Box<dyn Observe<State>>,
    times: Option<Vec<f64>>,
    next: usize,
    /// An observer of hits, whose row is kept beside that of the run, and the state that it observes.
    beside: Option<(Box<dyn Observe<State>>, State)>,
    interpolant: Interpolant<State>,
    functions: Vec<WatchedFunction>,
    search: Search,
    found: Vec<Crossing>,
    hits: Vec<Hits>,
    end: Option<Ending>,
}

/// An event's function in a step that is over.
struct InStep<'a, State: Checkpoint> {
    substep: &'a mut Substep<State>,
    interpolant: &'a mut Interpolant<State>,
    function: &'a mut WatchedFunction,
    end: &'a State,
}

impl<State: Checkpoint + Clone> FunctionInStep for InStep<'_, State> {
    fn function(&mut self) -> &mut WatchedFunction {
        self.function
    }

    fn interpolated(&mut self, x: f64) -> Result<f64, StepError> {
        let t = self.substep.t + x * self.substep.h;
        self.interpolant.interpolate(t);
        self.function.at([&[t], self.interpolant.point()])
    }

    fn exact(&mut self, x: f64) -> Result<f64, StepError> {
        let t = self.substep.advance_to_fraction(x, self.end)?;
        self.interpolant.read(t, &self.substep.state)?;
        self.function.at([&[t], self.interpolant.point()])
    }

    fn near(&mut self, x: f64, parts: [f64; 2]) -> Result<f64, StepError> {
        let t = self.substep.advance_to_fraction(x, self.end)?;
        self.interpolant.read(t, &self.substep.state)?;
        self.interpolant.perturb(parts);
        self.function.at([&[t], self.interpolant.point()])
    }
}

impl<State: Checkpoint + Clone> SubstepDetector<State> {
    /// Finds events of functions (t, x) of what `reader` reads from a state, and records by `observer` at `times` if they
    /// are given; steps are made by `stepper`, a copy of the run's.
    pub fn new(
        stepper: Box<dyn Stepper<State = State>>,
        state: &State,
        (reader, functions): (Box<dyn Observe<State>>, Vec<WatchedFunction>),
        (observer, times): (Box<dyn Observe<State>>, Option<Vec<f64>>),
    ) -> Self {
        Self {
            substep: Substep::new(stepper, state),
            observer,
            times,
            next: 0,
            beside: None,
            interpolant: Interpolant::new(reader, state),
            search: Search::default(),
            found: Vec::new(),
            hits: vec![Hits::default(); functions.len()],
            end: None,
            functions,
        }
    }

    /// The same with rows of an observer behind those of hits, of states that are always ends of parts.
    #[must_use]
    pub fn beside_hits(mut self, observer: Box<dyn Observe<State>>, state: &State) -> Self {
        self.beside = Some((observer, state.clone()));
        self
    }

    /// The zeros of all functions in a step that led to `end`, perhaps that of the run, in the order of time.
    fn find(&mut self, end: &State, is_last: bool) -> Result<(), StepError> {
        let (t, h) = (self.substep.t, self.substep.h);
        // of the first step there are no ends before
        for part in 1..if self.interpolant.len() == 1 {
            KNOTS - 1
        } else {
            1
        } {
            let t = self
                .substep
                .advance_to_fraction(part as f64 / (KNOTS - 1) as f64, end)?;
            self.interpolant.push(t, &self.substep.state)?;
        }
        self.interpolant.push(self.substep.end, end)?;
        self.sample(end)?;
        self.found.clear();
        for index in 0..self.functions.len() {
            let mut function = InStep {
                substep: &mut self.substep,
                interpolant: &mut self.interpolant,
                function: &mut self.functions[index],
                end,
            };
            self.search.find(
                &mut function,
                index,
                (t, h),
                InterpolationAccuracy::COARSE,
                &mut self.found,
            )?;
            if is_last {
                self.found.extend(met_at_end(&mut function, index, (t, h))?);
            }
        }
        self.found.sort_by(|a, b| a.x.total_cmp(&b.x));
        Ok(())
    }

    /// All functions at the samples of a step, the last of them beyond its end.
    fn sample(&mut self, end: &State) -> Result<(), StepError> {
        for function in &mut self.functions {
            function.samples.clear();
        }
        for k in 1..=SAMPLES + 1 {
            let mut t = self.substep.t + k as f64 / SAMPLES as f64 * self.substep.h;
            if k == SAMPLES {
                t = self.substep.end;
                self.interpolant.read(t, end)?;
            } else {
                self.interpolant.interpolate(t);
            }
            for function in &mut self.functions {
                let value = match function.at([&[t], self.interpolant.point()]) {
                    // beyond the step a value only shows whether the function has turned
                    Err(_) if k > SAMPLES => f64::NAN,
                    value => value?,
                };
                function.samples.push(value);
            }
        }
        Ok(())
    }

    /// Keeps the events of a step, up to one that ends the run and those at the same time.
    fn keep(&mut self, state: &mut State) -> Result<Outcome, StepError> {
        for k in 0..self.found.len() {
            let Crossing {
                x, index, counts, ..
            } = self.found[k];
            if !counts {
                continue;
            }
            let function = &self.functions[index];
            let is_end = function.count + 1 == function.rule.terminal;
            for later in k + 1..self.found.len() {
                if is_end && self.is_met_at(k, later, state)? {
                    let t = self.substep.advance_to_fraction(x, state)?;
                    self.keep_one(t, self.found[later].index)?;
                }
            }
            let t = self.substep.advance_to_fraction(x, state)?;
            self.keep_one(t, index)?;
            if is_end {
                self.end = Some(Ending {
                    event: index,
                    t,
                    limit: None,
                    member: 0,
                });
                state.clone_from(&self.substep.state);
                return Ok(Outcome::End(t));
            }
        }
        Ok(Outcome::Continue)
    }

    /// Whether another event's crossing counts and is met where the crossing `k` before it is.
    fn is_met_at(&mut self, k: usize, later: usize, end: &State) -> Result<bool, StepError> {
        let met = self.found[later];
        if !met.counts || met.index == self.found[k].index {
            return Ok(false);
        }
        let step = (self.substep.t, self.substep.h);
        let mut function = InStep {
            substep: &mut self.substep,
            interpolant: &mut self.interpolant,
            function: &mut self.functions[met.index],
            end,
        };
        is_met_at(&mut function, self.found[k].x, step, met)
    }

    /// Keeps an event that a part of the step has led to.
    fn keep_one(&mut self, t: f64, index: usize) -> Result<(), StepError> {
        self.interpolant.read(t, &self.substep.state)?;
        let hits = &mut self.hits[index];
        reserve(&mut hits.times, 1)?;
        reserve(&mut hits.rows, self.interpolant.point().len())?;
        hits.times.push(t);
        hits.rows.extend_from_slice(self.interpolant.point());
        self.functions[index].count += 1;
        if let Some((observer, kept)) = &mut self.beside {
            kept.clone_from(&self.substep.state);
            self.substep.advance_by(t - self.substep.t)?;
            observer.observe(t, &self.substep.state, &mut hits.rows)?;
            self.substep.state.clone_from(kept);
        }
        Ok(())
    }

    /// Records at the given times up to `end`.
    fn record_times(&mut self, end: f64, records: &mut Records) -> Result<(), StepError> {
        let (t, h) = (self.substep.t, self.substep.h);
        let times = self.times.as_deref().unwrap_or_default();
        while let Some(&wanted) = times.get(self.next) {
            if (wanted - end) / h > ROUNDOFF {
                break;
            }
            self.substep.advance_by(wanted - t)?;
            records.push(&mut *self.observer, wanted, &self.substep.state)?;
            self.next += 1;
        }
        Ok(())
    }
}

impl<State: Checkpoint + Clone> EventDetector<State> for SubstepDetector<State> {
    fn is_recording(&self) -> bool {
        self.times.is_some()
    }

    fn start(&mut self, t: f64, state: &State) -> Result<(), StepError> {
        if self.functions.is_empty() {
            return Ok(());
        }
        self.interpolant.push(t, state)?;
        self.interpolant.read(t, state)?;
        for function in &mut self.functions {
            function.last = function.at([&[t], self.interpolant.point()])?;
        }
        Ok(())
    }

    fn before(&mut self, t: f64, state: &mut State) {
        self.substep.t = t;
        self.substep.start.clone_from(state);
    }

    fn after(
        &mut self,
        (t, is_last): (f64, bool),
        state: &mut State,
        records: &mut Records,
    ) -> Result<Outcome, StepError> {
        (self.substep.end, self.substep.h) = (t, t - self.substep.t);
        let mut outcome = Outcome::Continue;
        if !self.functions.is_empty() {
            self.find(state, is_last)?;
            outcome = self.keep(state)?;
        }
        let end = match outcome {
            Outcome::End(end) => end,
            _ => t,
        };
        self.record_times(end, records)?;
        Ok(outcome)
    }

    fn finish(&mut self, _: &mut Records) {}

    fn take(&mut self) -> Events {
        Events {
            found: self.hits.iter_mut().map(std::mem::take).collect(),
            ends: self.end.into_iter().collect(),
        }
    }
}

// Events are not saved: they were taken before.
crate::checkpoint!(
    [State: Checkpoint] SubstepDetector<State> { substep.stepper, interpolant, functions, end, observer, next }
    then |detector| {
        for hits in &mut detector.hits {
            hits.times.clear();
            hits.rows.clear();
        }
        Ok(())
    }
);
