//! Events of a mechanical or semi-explicit system, and its states at given times.

mod cut;
mod event;
mod function;
mod hits;
mod impulse;
mod linear_reset;
mod reset;
mod semi_explicit;
mod sides;
mod slopes;
mod tangents;
mod times;

pub use event::Event;
pub use impulse::Impulses;
pub use linear_reset::LinearReset;
pub use reset::{Law, Reset};
pub use semi_explicit::HiddenMoves;
pub use slopes::{Before, EventSlopes, FollowEvents, Meeting, SlopesModel};
pub use tangents::{MotionDerivatives, TangentEvents};
pub use times::Given;

use function::{at, interpolated};
use hits::Restarts;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::observe::Observe;
use liouville_base::run::{
    Crossing, Ending, EventDetector, Events, FunctionInStep, Hits, InterpolationAccuracy, Outcome,
    Records, SAMPLES, Search, Substep, WatchedFunction, is_met_at, met_at_end,
};
use liouville_problem::{Carried, Dynamics, Model, Path, Point, Restart};

/// A step in which a zero cannot be located is made as short as this part of it, ...
const PART: f64 = 0.25;
/// ... again and again, so many times.
const MOST_PARTS: usize = 12;

/// Finds events on the interpolated trajectory, and makes and records the states at given times by parts of steps.
pub struct DenseDetector<State: Checkpoint, M: Dynamics = Model> {
    path: Path<M>,
    substep: Substep<State>,
    events: Vec<Event>,
    search: Search,
    /// Zeros of all events in a step.
    found: Vec<Crossing>,
    /// Crossings at the time at which the run ends or begins anew.
    same: Vec<usize>,
    /// Signs and values of their functions before the step.
    sides: Vec<Signs>,
    met: Met,
    /// The solver of states after resets, y and z by the law of a reset, and the number of holonomic constraints.
    restart: Restarts<State>,
    jump: [Vec<f64>; 2],
    holonomic: usize,
    /// The follower that differentiates events and states at given times, if they are differentiated.
    follower: Option<Box<dyn FollowEvents<State>>>,
    /// The derivatives of all events then.
    slopes: Vec<SlopesModel>,
    observer: Box<dyn Observe<State>>,
    /// Times of the records, where they are the detector's.
    times: Option<Vec<f64>>,
    next: usize,
}

/// The sign of a function where it was last clear, its value, and that shortly before.
type Signs = (f64, f64, Option<(f64, f64)>);

/// The events met, and the one that ended the run.
#[derive(Debug, Default)]
struct Met {
    found: Vec<Hits>,
    end: Option<Ending>,
}

/// An event's function in a step that is over.
struct InStep<'a, State: Checkpoint, M: Dynamics> {
    path: &'a mut Path<M>,
    substep: &'a mut Substep<State>,
    event: &'a mut Event,
    end: &'a State,
}

impl<State: Carried + Checkpoint + Clone, M: Dynamics> FunctionInStep for InStep<'_, State, M> {
    fn function(&mut self) -> &mut WatchedFunction {
        &mut self.event.function
    }

    fn interpolated(&mut self, x: f64) -> Result<f64, StepError> {
        interpolated(self.path, self.event, self.substep.t + x * self.substep.h)
    }

    fn exact(&mut self, x: f64) -> Result<f64, StepError> {
        let t = self.substep.advance_to_fraction(x, self.end)?;
        at(self.path, self.event, t, &self.substep.state)
    }

    fn near(&mut self, x: f64, parts: [f64; 2]) -> Result<f64, StepError> {
        let t = self.substep.advance_to_fraction(x, self.end)?;
        self.path.move_near(t, &self.substep.state, parts);
        if self.event.needs_lam {
            self.path.solve_there()?;
        }
        let Point { y, z, .. } = self.path.point();
        self.event.at(t, (y, z), self.path.lam())
    }
}

impl<State: Carried + Checkpoint + Clone, M: Dynamics> DenseDetector<State, M> {
    /// A detector of events along a path, which records what `observer` reads at `times` if they are given.
    ///
    /// `stepper` makes the same steps as the run, whose state has the size of `state`.
    pub fn new(
        path: Path<M>,
        stepper: Box<dyn Stepper<State = State>>,
        state: &State,
        events: Vec<Event>,
        (observer, times): (Box<dyn Observe<State>>, Option<Vec<f64>>),
    ) -> Self {
        let met = Met {
            found: vec![Hits::default(); events.iter().filter(|event| !event.is_switch).count()],
            end: None,
        };
        Self {
            path,
            substep: Substep::new(stepper, state),
            events,
            search: Search::default(),
            found: Vec::new(),
            same: Vec::new(),
            sides: Vec::new(),
            met,
            restart: Restarts(None),
            jump: [Vec::new(), Vec::new()],
            holonomic: 0,
            follower: None,
            slopes: Vec::new(),
            observer,
            times,
            next: 0,
        }
    }

    /// The same with a solver of states after resets, of a system with so many holonomic constraints.
    #[must_use]
    pub fn resetting(self, restart: Box<dyn Restart<State>>, holonomic: usize) -> Self {
        let restart = Restarts(Some(restart));
        Self {
            restart,
            holonomic,
            ..self
        }
    }

    /// The same with a follower that differentiates its events, which have these derivatives, and its states at given
    /// times.
    #[must_use]
    pub fn followed(
        self,
        follower: Box<dyn FollowEvents<State>>,
        slopes: Vec<SlopesModel>,
    ) -> Self {
        Self {
            follower: Some(follower),
            slopes,
            ..self
        }
    }

    /// All events' functions at the samples of a step, the last of them beyond its end.
    fn sample(&mut self, end: &State) -> Result<(), StepError> {
        let needs_lam = self.events.iter().any(|event| event.needs_lam);
        for event in &mut self.events {
            event.function.samples.clear();
        }
        for k in 1..=SAMPLES + 1 {
            let t = self.substep.t + k as f64 / SAMPLES as f64 * self.substep.h;
            let is_beyond = k > SAMPLES;
            if k == SAMPLES {
                self.path.move_near(self.substep.end, end, [0.0, 0.0]);
            } else {
                self.path.move_to(t);
            }
            let solved = if needs_lam {
                self.path.solve_there()
            } else {
                Ok(())
            };
            let is_solved = solved.is_ok();
            if !is_beyond {
                solved?;
            }
            for event in &mut self.events {
                let Point { y, z, .. } = self.path.point();
                let value = match event.at(t, (y, z), self.path.lam()) {
                    Ok(value) if is_solved || !event.needs_lam => value,
                    // beyond the step a value only shows whether the function has turned
                    _ if is_beyond => f64::NAN,
                    other => other?,
                };
                event.function.samples.push(value);
            }
        }
        Ok(())
    }

    /// The zeros of all events in a step, perhaps the last of the run.
    fn find(&mut self, end: &State, is_last: bool) -> Result<(), StepError> {
        self.found.clear();
        self.sample(end)?;
        for index in 0..self.events.len() {
            if !self.take_side(index)? {
                self.search(index, end, is_last)?;
            }
        }
        Ok(())
    }

    /// [`Self::find`], in a shorter step where parts of the whole one cannot be made to locate a zero, though steps of
    /// this size can; returns whether it is shorter, and leaves `end` at its end.
    fn find_in_step(&mut self, end: &mut State, is_last: bool) -> Result<bool, StepError> {
        let own = |event: &Event| {
            (
                event.function.sign,
                event.function.last,
                event.function.earlier,
            )
        };
        self.sides.clear();
        self.sides.extend(self.events.iter().map(own));
        let is_controlled = self.events.iter().any(|event| event.is_switch);
        let (mut found, mut part, mut is_shorter) = (self.find(end, is_last), 1.0, false);
        for _ in 0..MOST_PARTS {
            match &found {
                Err(error) if is_controlled && self.follower.is_none() && is_of_step(error) => {}
                _ => break,
            }
            part *= PART;
            let Ok(t) = self.substep.advance_to_fraction(part, end) else {
                continue;
            };
            for (event, (sign, last, earlier)) in self.events.iter_mut().zip(&self.sides) {
                let own = &mut event.function;
                (own.sign, own.last, own.earlier) = (*sign, *last, *earlier);
            }
            end.clone_from(&self.substep.state);
            self.path.end_at(t, end)?;
            (self.substep.end, self.substep.h) = (t, t - self.substep.t);
            (found, part, is_shorter) = (self.find(end, false), 1.0, true);
        }
        found.map(|()| is_shorter)
    }

    /// The zeros of one event in a step, appended to `found`.
    fn search(&mut self, index: usize, end: &State, is_last: bool) -> Result<(), StepError> {
        let accuracy = if self.path.is_coarse() {
            InterpolationAccuracy::COARSE
        } else {
            InterpolationAccuracy::FINE
        };
        let step = (self.substep.t, self.substep.h);
        let mut function = InStep {
            path: &mut self.path,
            substep: &mut self.substep,
            event: &mut self.events[index],
            end,
        };
        self.search
            .find(&mut function, index, step, accuracy, &mut self.found)?;
        if is_last && !function.event.is_switch {
            self.found.extend(met_at_end(&mut function, index, step)?);
        }
        Ok(())
    }

    /// Whether another event's crossing counts and is met where the crossing `k` before it is.
    fn is_met_at(&mut self, k: usize, later: usize, end: &State) -> Result<bool, StepError> {
        let (at, met) = (self.found[k], self.found[later]);
        if !met.counts || met.index == at.index {
            return Ok(false);
        }
        let step = (self.substep.t, self.substep.h);
        let mut function = InStep {
            path: &mut self.path,
            substep: &mut self.substep,
            event: &mut self.events[met.index],
            end,
        };
        is_met_at(&mut function, at.x, step, met)
    }
}

impl<State: Carried + Checkpoint + Clone, M: Dynamics> EventDetector<State>
    for DenseDetector<State, M>
{
    fn is_recording(&self) -> bool {
        self.times.is_some()
    }

    fn start(&mut self, t: f64, state: &State) -> Result<(), StepError> {
        if !self.events.is_empty() {
            self.path.push(t, state)?;
        }
        self.substep.t = t;
        for event in &mut self.events {
            event.function.last = at(&mut self.path, event, t, state)?;
        }
        Ok(())
    }

    fn before(&mut self, t: f64, state: &mut State) {
        self.substep.t = t;
        if let Some(follower) = &mut self.follower {
            follower.begin(state);
        }
        self.substep.start.clone_from(state);
    }

    fn after(
        &mut self,
        (t, is_last): (f64, bool),
        state: &mut State,
        records: &mut Records,
    ) -> Result<Outcome, StepError> {
        (self.substep.end, self.substep.h) = (t, t - self.substep.t);
        if let Some(follower) = &mut self.follower {
            follower.align(t, state);
        }
        let mut outcome = Outcome::Continue;
        if !self.events.is_empty() {
            self.path.push(t, state)?;
            let is_shorter = self.find_in_step(state, is_last)?;
            outcome = self.keep(state, records, is_last && !is_shorter)?;
            if is_shorter && outcome == Outcome::Continue {
                outcome = Outcome::Shorten(self.substep.end);
            }
        }
        match outcome {
            Outcome::Continue => self.record_times(t, Some(state), records)?,
            Outcome::Shorten(end) | Outcome::End(end) => {
                self.record_times(end, Some(state), records)?;
            }
            Outcome::Restart(_) => {}
        }
        if let (Outcome::End(_), Some(follower)) = (outcome, &mut self.follower) {
            follower.end();
        }
        Ok(outcome)
    }

    fn hold(
        &mut self,
        (t, outcome): (f64, Outcome),
        state: &State,
    ) -> Result<Option<&State>, StepError> {
        let Some(follower) = &mut self.follower else {
            return Ok(None);
        };
        let at = Given {
            t,
            part: 1.0,
            h: self.substep.h,
            is_after: matches!(outcome, Outcome::Restart(_)),
            is_of_step: true,
        };
        self.substep.state.clone_from(state);
        follower.hold(at, &mut self.substep.state)?;
        Ok(Some(&self.substep.state))
    }

    fn follow(&mut self, t: f64, state: &State) {
        self.observer.follow(t, state);
    }

    fn finish(&mut self, _: &mut Records) {}

    fn take(&mut self) -> Events {
        Events {
            found: self.met.found.iter_mut().map(std::mem::take).collect(),
            ends: self.met.end.into_iter().collect(),
        }
    }
}

/// Whether a shorter step may be made where one could not be.
fn is_of_step(error: &StepError) -> bool {
    matches!(
        error,
        StepError::NotConverged { .. } | StepError::StepTooLarge { .. } | StepError::SingularNewton
    )
}

// Events are not saved: they were taken before.
liouville_base::checkpoint!(
    [State: Checkpoint, M: Dynamics] DenseDetector<State, M> { path, substep.stepper, substep.h, events, met.end, restart, observer, next }
    then |detector| {
        for hits in &mut detector.met.found {
            hits.times.clear();
            hits.rows.clear();
        }
        Ok(())
    }
);
