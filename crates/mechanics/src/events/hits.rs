//! The events of a step in the order of time, and their effect on the run.

use super::function::noise;
use super::reset::RATE;
use super::slopes::Meeting;
use super::{DenseDetector, at, interpolated};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::{Obstacle, Quantity, StepError};
use liouville_base::run::{Crossing, Ending, NOISE, Outcome, Records, reserve};
use liouville_problem::{Carried, Dynamics, Impact, Jump, Refused, Restart};

/// Times that differ by so many roundings are the same.
const SAME: f64 = 4.0 * f64::EPSILON;
/// A switch in so small a first part of a step needs no step of its own: velocities are known to a rounding of the
/// coordinates over the step.
const AT_START: f64 = 1e-6;
/// Where the motion is looked at after a reset that leaves the rate of e at zero, as a part of a step.
const SHORTLY: f64 = 1.0 / 1024.0;

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
    /// Keeps the events of a step in the order of time, up to one that ends the run or resets its state.
    pub(super) fn keep(
        &mut self,
        state: &mut State,
        records: &mut Records,
    ) -> Result<Outcome, StepError> {
        self.found.sort_by(|a, b| a.x.total_cmp(&b.x));
        for k in 0..self.found.len() {
            let Crossing {
                x, index, counts, ..
            } = self.found[k];
            if !counts {
                continue;
            }
            if self.events[index].is_switch && (x < AT_START || self.snapped(x).0 == 0.0) {
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
                    state.clone_from(&self.substep.state);
                    return Ok(Outcome::End(t));
                }
                continue;
            }
            if !self.events[index].is_plain() {
                return self.cut(k, state, records);
            }
            if let Some(t) = self.keep_one(x, index, state)? {
                state.clone_from(&self.substep.state);
                return Ok(Outcome::End(t));
            }
        }
        Ok(Outcome::Continue)
    }

    /// The roundoff of e, where the rate of an event with a reset has the wrong sign for its zero; else none.
    fn recedes(&mut self, k: usize, end: &State) -> Result<Option<f64>, StepError> {
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

    /// Keeps an event that changes nothing; returns the time, if it ends the run.
    fn keep_one(&mut self, x: f64, index: usize, end: &State) -> Result<Option<f64>, StepError> {
        let t = self.substep.advance_to_fraction(x, end)?;
        self.follow(index, (x, t))?;
        self.keep_state(index, t)?;
        self.met.found[index].times.push(t);
        let event = &mut self.events[index];
        event.function.count += 1;
        if event.function.count != event.function.rule.terminal {
            return Ok(None);
        }
        self.end(index, t, None);
        Ok(Some(t))
    }

    /// Differentiates the event that a part of the step has led to.
    fn follow(&mut self, index: usize, (part, t): (f64, f64)) -> Result<(), StepError> {
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
            is_last: event.function.count + 1 == event.function.rule.terminal || event.is_switch,
            obstacle,
        };
        follower.meet(met, state)
    }

    /// Keeps the state that parts of a step have led to.
    fn keep_state(&mut self, index: usize, t: f64) -> Result<(), StepError> {
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

    fn end(&mut self, event: usize, t: f64, limit: Option<f64>) {
        self.met.end = Some(Ending {
            event,
            t,
            limit,
            member: 0,
        });
    }

    /// A fraction of the step, set to 0 or 1 where it differs from that by roundoff; and the bound of that roundoff.
    pub(super) fn snapped(&self, x: f64) -> (f64, f64) {
        let substep = &self.substep;
        let near = SAME * substep.t.abs().max(substep.end.abs()) / substep.h.abs();
        let x = match x {
            x if x <= near => 0.0,
            x if 1.0 - x <= near => 1.0,
            x => x,
        };
        (x, near)
    }

    /// Goes on anew from the crossing `k`; plain events at the same time come before.
    fn cut(
        &mut self,
        k: usize,
        state: &mut State,
        records: &mut Records,
    ) -> Result<Outcome, StepError> {
        let index = self.found[k].index;
        let (x, near) = self.snapped(self.found[k].x);
        for other in k + 1..self.found.len() {
            let crossing = self.found[other];
            let is_plain = crossing.counts && self.events[crossing.index].is_plain();
            if !is_plain || crossing.x > self.found[k].x + near {
                continue;
            }
            if let Some(t) = self.keep_one(crossing.x, crossing.index, state)? {
                state.clone_from(&self.substep.state);
                return Ok(Outcome::End(t));
            }
        }
        self.record_times(self.time_of(x), None, records)?;
        let t = self.substep.advance_to_fraction(x, state)?;
        self.follow(index, (x, t))?;
        self.path.end_at(t, &self.substep.state)?;
        if self.events[index].is_switch {
            state.clone_from(&self.substep.state);
            self.begin_piece((k, near), t, state)?;
            return Ok(Outcome::Shorten(t));
        }
        self.reset_at((k, near), t, (state, records))
    }

    /// Resets the state at the crossing `k`.
    fn reset_at(
        &mut self,
        (k, near): (usize, f64),
        t: f64,
        (state, records): (&mut State, &mut Records),
    ) -> Result<Outcome, StepError> {
        let Crossing { index, sign, .. } = self.found[k];
        let kept = self.met.found[index].rows.len();
        self.keep_state(index, t)?;
        let reset = self.reset(index, t, state);
        let rates = reset.inspect_err(|_| self.met.found[index].rows.truncate(kept))?;
        let of_time = rates.map_or(0.0, |rates| NOISE * (t * rates[0]).abs());
        let before = &self.substep.state;
        let noise = noise(&mut self.path, &mut self.events[index], t, before)?.max(of_time);
        let event = &mut self.events[index];
        event.function.count += 1;
        let is_last = event.function.count == event.function.rule.terminal;
        let way = self.substep.h.signum();
        let mut limit = event.reset.as_mut().and_then(|reset| {
            let limit = reset.intervals.hit(t, self.substep.h, noise);
            reset.intervals.rate = rates.map_or(f64::NAN, |rates| rates[1]);
            limit
        });
        self.path.begin(t, state)?;
        self.begin_piece((k, near), t, state)?;
        let after = match rates {
            None => 0.0,
            Some([before, after]) if after.abs() > RATE * before.abs() => way * after.signum(),
            Some(_) => {
                let soon = t + SHORTLY * self.substep.h;
                let value = interpolated(&mut self.path, &mut self.events[index], soon)?;
                if value * sign > 0.0 && self.events[index].function.last.abs() <= HOLDS * noise {
                    limit = limit.or(Some(t));
                }
                value.signum()
            }
        };
        self.events[index].function.sign = after;
        self.record_after(t, state, records)?;
        if is_last || limit.is_some() {
            self.end(index, t, limit.filter(|_| !is_last));
            return Ok(Outcome::End(t));
        }
        Ok(Outcome::Restart(t))
    }

    /// Sets `state` by the reset of an event, and records it; returns the rates of e before and after, where
    /// they are known.
    fn reset(
        &mut self,
        index: usize,
        t: f64,
        state: &mut State,
    ) -> Result<Option<[f64; 2]>, StepError> {
        let (event, before) = (&mut self.events[index], &self.substep.state);
        let (Some(reset), Some(restart)) = (&mut event.reset, &mut self.restart.0) else {
            return Ok(None);
        };
        let rate = reset.rate(t, (before.y(), before.z()), index)?;
        let [y, z] = &mut self.jump;
        y.clear();
        z.clear();
        y.extend_from_slice(before.y());
        z.extend_from_slice(before.z());
        let is_impact = reset.is_impact;
        let values = reset.at(t, (before.y(), before.z()), (self.path.lam(), index))?;
        let impact = is_impact.then(|| Impact {
            gradient: &values[1..],
            change: -(1.0 + values[0]) * rate.unwrap_or(0.0),
        });
        if !is_impact {
            let n = y.len();
            y.copy_from_slice(&values[..n]);
            z.copy_from_slice(&values[n..]);
        }
        let jump = Jump { y, z, impact };
        restart.restart(t, before, jump, state).map_err(|refused| {
            let missed = match refused {
                Refused::Failed(error) => return error,
                Refused::Locked => None,
                Refused::Violated(missed) => {
                    let first = match missed.quantity() {
                        Quantity::Nonholonomic => self.holonomic,
                        _ => 0,
                    };
                    Some((missed.quantity(), first + missed.index, missed.value))
                }
            };
            let event = index;
            StepError::Reset { event, t, missed }
        })?;
        if let Some(follower) = &mut self.follower {
            follower.reset((index, t), self.path.lam(), (before, state))?;
        }
        let after = reset.rate(t, (state.y(), state.z()), index)?;
        self.path.solve(t, state)?;
        let hits = &mut self.met.found[index];
        hits.times.push(t);
        for part in [state.y(), state.z(), self.path.lam()] {
            hits.rows.extend_from_slice(part);
        }
        if let Some(follower) = &mut self.follower {
            follower.record(t, state, &mut hits.rows)?;
        }
        Ok(rate.zip(after).map(|(before, after)| [before, after]))
    }

    /// Begins a piece of the motion at a state; an event that was about to be met is met there.
    fn begin_piece(
        &mut self,
        (k, near): (usize, f64),
        t: f64,
        state: &State,
    ) -> Result<(), StepError> {
        let x = self.found[k].x;
        for index in 0..self.events.len() {
            let mut own = self.found.iter().filter(|other| other.index == index);
            let next = own.clone().next();
            let last = own.rfind(|crossing| crossing.x <= x + near);
            let event = &mut self.events[index];
            event.function.sign = match last {
                None => next.map_or(event.function.sign, |crossing| -crossing.sign),
                Some(crossing) if crossing.x < x - near => crossing.sign,
                // a reset at the same time is still to come
                Some(crossing) if event.reset.is_some() && crossing.counts => -crossing.sign,
                Some(_) => 0.0,
            };
            event.function.earlier = None;
            event.function.last = at(&mut self.path, event, t, state)?;
        }
        Ok(())
    }
}
