//! The events of a step in the order of time.

use super::DenseDetector;
use super::function::noise;
use super::slopes::Meeting;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::{Obstacle, StepError};
use liouville_base::run::{Crossing, Ending, Outcome, Records, reserve, same_time};
use liouville_problem::{Carried, Dynamics, Restart};

/// A switch in so small a first part of a step needs no step of its own: velocities are known to a rounding of the
/// coordinates over the step.
const AT_START: f64 = 1e-6;

/// A motion is on an event where the function is not farther from zero than so many times its roundoff.
pub(super) const HOLDS: f64 = 16.0;

/// The solver of states after resets, if there are any.
pub(super) struct Restarts<State>(pub(super) Option<Box<dyn Restart<State>>>);

impl<State> Checkpoint for Restarts<State> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        if let Some(restart) = &self.0 {
            restart.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        match &mut self.0 {
            Some(restart) => restart.restore(member, saved),
            None => Ok(()),
        }
    }
}

impl<State: Carried + Checkpoint + Clone, M: Dynamics> DenseDetector<State, M> {
    /// Keeps the events of a step, perhaps the last of the run, in the order of time, up to one that ends the run or
    /// changes its motion.
    pub(super) fn keep(
        &mut self,
        state: &mut State,
        records: &mut Records,
        is_last: bool,
    ) -> Result<Outcome, StepError> {
        self.found.sort_by(|a, b| a.x.total_cmp(&b.x));
        for k in 0..self.found.len() {
            let Crossing {
                x, index, counts, ..
            } = self.found[k];
            let is_end = is_last && self.is_end(x);
            if !counts || self.events[index].is_switch && (is_end || self.is_start(x)) {
                continue;
            }
            if let Some(noise) = self.recedes(k, state)? {
                // roundoff of a function that touches zero, or of a hit that cannot be distinguished from the last one
                let (t, h) = (self.substep.t + x * self.substep.h, self.substep.h);
                let reset = self.events[index].reset.as_ref();
                if reset.is_some_and(|reset| reset.intervals.is_short(t, h, noise)) {
                    if self.follower.is_some() {
                        let (event, why) = (index, Obstacle::Flat);
                        return Err(StepError::Undifferentiable { event, t, why });
                    }
                    self.end(index, t, Some(t));
                    self.found[k].counts = false;
                    return self.cut((k, true), state, records);
                }
                continue;
            }
            if !self.events[index].is_plain() || self.ends(index) {
                return self.cut((k, is_end), state, records);
            }
            let t = self.substep.advance_to_fraction(x, state)?;
            self.keep_one(index, (x, t), false)?;
        }
        Ok(Outcome::Continue)
    }

    /// The roundoff of e, where the rate of an event with a reset has the wrong sign for its zero; else none.
    pub(super) fn recedes(&mut self, k: usize, end: &State) -> Result<Option<f64>, StepError> {
        let Crossing { x, index, sign, .. } = self.found[k];
        if self.events[index].reset.is_none() {
            return Ok(None);
        }
        let t = self.substep.advance_to_fraction(x, end)?;
        let (state, way) = (&self.substep.state, self.substep.h.signum());
        let reset = self.events[index].reset.as_mut();
        let rate = match reset {
            Some(reset) => reset.rate(t, (state.y(), state.z()), index)?,
            None => None,
        };
        if rate.is_none_or(|rate| way * rate * sign >= 0.0) {
            return Ok(None);
        }
        let state = &self.substep.state;
        noise(&mut self.path, &mut self.events[index], t, state).map(Some)
    }

    /// Whether the next of these events ends the run.
    pub(super) fn ends(&self, index: usize) -> bool {
        let function = &self.events[index].function;
        function.count + 1 == function.rule.terminal
    }

    /// Keeps an event that changes nothing, to which a part of the step has led; no more of the step may be made.
    pub(super) fn keep_one(
        &mut self,
        index: usize,
        (x, t): (f64, f64),
        is_last: bool,
    ) -> Result<(), StepError> {
        let is_end = self.ends(index);
        let is_last = is_last && is_end && self.met.end.is_none();
        self.follow(index, (x, t), is_last)?;
        self.keep_state(index, t)?;
        self.met.found[index].times.push(t);
        self.events[index].function.count += 1;
        if is_end {
            self.end(index, t, None);
        }
        Ok(())
    }

    /// Differentiates the event that a part of the step has led to, and that may be the last thing done in it.
    pub(super) fn follow(
        &mut self,
        index: usize,
        (part, t): (f64, f64),
        is_last: bool,
    ) -> Result<(), StepError> {
        if self.follower.is_none() {
            return Ok(());
        }
        self.path.solve(t, &self.substep.state)?;
        let obstacle = self.obstacle(index, t);
        let Some(follower) = &mut self.follower else {
            return Ok(());
        };
        let (event, state) = (&self.events[index], &mut self.substep.state);
        let size = |size: f64, x: &f64| size.max(x.abs());
        let met = Meeting {
            event: index,
            hit: event.function.count,
            part,
            t,
            h: self.substep.h,
            lam: self.path.lam(),
            needs_lam: event.needs_lam,
            height: event.function.samples.iter().fold(0.0, size),
            is_last,
            obstacle,
        };
        follower.meet(met, state)
    }

    /// Keeps the state that parts of a step have led to.
    pub(super) fn keep_state(&mut self, index: usize, t: f64) -> Result<(), StepError> {
        let state = &self.substep.state;
        self.path.solve(t, state)?;
        let hits = &mut self.met.found[index];
        let parts = [state.y(), state.z(), self.path.lam()];
        reserve(&mut hits.times, 1)?;
        // the state after it may follow
        reserve(
            &mut hits.rows,
            parts.iter().map(|part| 2 * part.len()).sum(),
        )?;
        for part in parts {
            hits.rows.extend_from_slice(part);
        }
        match &mut self.follower {
            Some(follower) => follower.record(t, state, &mut hits.rows),
            None => Ok(()),
        }
    }

    /// Ends the run by an event, if no other one has.
    pub(super) fn end(&mut self, event: usize, t: f64, limit: Option<f64>) {
        self.met.end.get_or_insert(Ending {
            event,
            t,
            limit,
            member: 0,
        });
    }

    /// Whether a fraction of the step is none of it but for roundoff, or so little that a switch needs no step of its own.
    pub(super) fn is_start(&self, x: f64) -> bool {
        x < AT_START || self.snapped(x).0 == 0.0
    }

    /// Whether a fraction of the step is all of it but for roundoff.
    #[allow(clippy::float_cmp)] // 1 is the end of the step
    pub(super) fn is_end(&self, x: f64) -> bool {
        self.snapped(x).0 == 1.0
    }

    /// A fraction of the step, set to 0 or 1 where it differs from that by roundoff; and the bound of that roundoff.
    pub(super) fn snapped(&self, x: f64) -> (f64, f64) {
        let near = same_time((self.substep.t, self.substep.h));
        let x = match x {
            x if x <= near => 0.0,
            x if 1.0 - x <= near => 1.0,
            x => x,
        };
        (x, near)
    }
}
