//! Events, and states at given times, as ends of steps of their own from the end of the last whole step before.
//!
//! A shorter step by the same method keeps what the method keeps, as no interpolation does, and has its order. Where zeros
//! of events may be is seen on the polynomial through the last ends of steps.

use super::super::{Ending, EventDetector, Events, Hits, Outcome, Records, reserve};
use super::trail::{KNOTS, Trail};
use super::{Crossing, PartialStep, SAMPLES, Scene, Search, Trust, WatchedFunction};
use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::method::Stepper;
use crate::observe::Observe;

/// A time that exceeds the end of a step by this part of it, from roundoff, is of that step.
const ROUNDOFF: f64 = 1e-9;

/// Finds events, and records a run at given times, in the order of the run.
pub struct PartDetector<State: Checkpoint> {
    partial: PartialStep<State>,
    observer: Box<dyn Observe<State>>,
    times: Option<Vec<f64>>,
    next: usize,
    trail: Trail<State>,
    functions: Vec<WatchedFunction>,
    search: Search,
    found: Vec<Crossing>,
    hits: Vec<Hits>,
    end: Option<Ending>,
}

/// An event's function in a step that is over.
struct InStep<'a, State: Checkpoint> {
    partial: &'a mut PartialStep<State>,
    trail: &'a mut Trail<State>,
    function: &'a mut WatchedFunction,
    end: &'a State,
}

impl<State: Checkpoint + Clone> Scene for InStep<'_, State> {
    fn function(&mut self) -> &mut WatchedFunction {
        self.function
    }

    fn rough(&mut self, x: f64) -> Result<f64, StepError> {
        let t = self.partial.t + x * self.partial.h;
        self.trail.move_to(t);
        self.function.at([&[t], self.trail.point()])
    }

    fn exact(&mut self, x: f64) -> Result<f64, StepError> {
        let t = self.partial.go(x, self.end)?;
        self.trail.move_on(t, &self.partial.state)?;
        self.function.at([&[t], self.trail.point()])
    }

    fn near(&mut self, parts: [f64; 2]) -> Result<f64, StepError> {
        let t = self.partial.t;
        self.trail.move_on(t, &self.partial.start)?;
        self.trail.change(parts);
        self.function.at([&[t], self.trail.point()])
    }
}

impl<State: Checkpoint + Clone> PartDetector<State> {
    /// Finds events of functions (t, x) of what `reader` reads from a state, and records by `observer` at `times` if they
    /// are given; steps are made by `stepper`, a copy of the run's.
    pub fn new(
        stepper: Box<dyn Stepper<State = State>>,
        state: &State,
        (reader, functions): (Box<dyn Observe<State>>, Vec<WatchedFunction>),
        (observer, times): (Box<dyn Observe<State>>, Option<Vec<f64>>),
    ) -> Self {
        Self {
            partial: PartialStep::new(stepper, state),
            observer,
            times,
            next: 0,
            trail: Trail::new(reader, state),
            search: Search::default(),
            found: Vec::new(),
            hits: vec![Hits::default(); functions.len()],
            end: None,
            functions,
        }
    }

    /// The zeros of all functions in a step that led to `end`, in the order of time.
    fn find(&mut self, end: &State) -> Result<(), StepError> {
        let (t, h) = (self.partial.t, self.partial.h);
        // of the first step there are no ends before
        for part in 1..if self.trail.len() == 1 { KNOTS - 1 } else { 1 } {
            let t = self.partial.go(part as f64 / (KNOTS - 1) as f64, end)?;
            self.trail.push(t, &self.partial.state)?;
        }
        self.trail.push(self.partial.end, end)?;
        self.sample(end)?;
        self.found.clear();
        for index in 0..self.functions.len() {
            let mut scene = InStep {
                partial: &mut self.partial,
                trail: &mut self.trail,
                function: &mut self.functions[index],
                end,
            };
            self.search
                .find(&mut scene, index, (t, h), Trust::LOOSE, &mut self.found)?;
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
            let mut t = self.partial.t + k as f64 / SAMPLES as f64 * self.partial.h;
            if k == SAMPLES {
                t = self.partial.end;
                self.trail.move_on(t, end)?;
            } else {
                self.trail.move_to(t);
            }
            for function in &mut self.functions {
                let value = match function.at([&[t], self.trail.point()]) {
                    // beyond the step a value only shows whether the function has turned
                    Err(_) if k > SAMPLES => f64::NAN,
                    value => value?,
                };
                function.samples.push(value);
            }
        }
        Ok(())
    }

    /// Keeps the events of a step, up to one that ends the run.
    fn keep(&mut self, state: &mut State) -> Result<Outcome, StepError> {
        for k in 0..self.found.len() {
            let Crossing {
                x, index, counts, ..
            } = self.found[k];
            if !counts {
                continue;
            }
            let t = self.partial.go(x, state)?;
            self.trail.move_on(t, &self.partial.state)?;
            let hits = &mut self.hits[index];
            reserve(&mut hits.times, 1)?;
            reserve(&mut hits.rows, self.trail.point().len())?;
            hits.times.push(t);
            hits.rows.extend_from_slice(self.trail.point());
            let function = &mut self.functions[index];
            function.count += 1;
            if function.count == function.rule.terminal {
                self.end = Some(Ending {
                    event: index,
                    t,
                    limit: None,
                    member: 0,
                });
                state.clone_from(&self.partial.state);
                return Ok(Outcome::End(t));
            }
        }
        Ok(Outcome::Continue)
    }

    /// Records at the given times up to `end`.
    fn emit(&mut self, end: f64, records: &mut Records) -> Result<(), StepError> {
        let (t, h) = (self.partial.t, self.partial.h);
        let times = self.times.as_deref().unwrap_or_default();
        while let Some(&wanted) = times.get(self.next) {
            if (wanted - end) / h > ROUNDOFF {
                break;
            }
            self.partial.by(wanted - t)?;
            records.push(&mut *self.observer, wanted, &self.partial.state)?;
            self.next += 1;
        }
        Ok(())
    }
}

impl<State: Checkpoint + Clone> EventDetector<State> for PartDetector<State> {
    fn is_recording(&self) -> bool {
        self.times.is_some()
    }

    fn start(&mut self, t: f64, state: &State) -> Result<(), StepError> {
        if self.functions.is_empty() {
            return Ok(());
        }
        self.trail.push(t, state)?;
        self.trail.move_on(t, state)?;
        for function in &mut self.functions {
            function.last = function.at([&[t], self.trail.point()])?;
        }
        Ok(())
    }

    fn before(&mut self, t: f64, state: &mut State) {
        self.partial.t = t;
        self.partial.start.clone_from(state);
    }

    fn after(
        &mut self,
        t: f64,
        state: &mut State,
        records: &mut Records,
    ) -> Result<Outcome, StepError> {
        (self.partial.end, self.partial.h) = (t, t - self.partial.t);
        let mut outcome = Outcome::Continue;
        if !self.functions.is_empty() {
            self.find(state)?;
            outcome = self.keep(state)?;
        }
        let end = match outcome {
            Outcome::End(end) => end,
            _ => t,
        };
        self.emit(end, records)?;
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
    [State: Checkpoint] PartDetector<State> { partial.stepper, trail, functions, end, observer, next }
    then |detector| {
        for hits in &mut detector.hits {
            hits.times.clear();
            hits.rows.clear();
        }
        Ok(())
    }
);
