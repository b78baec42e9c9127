//! Where a run ends in a step, or begins anew: what all events at that time do.

use super::DenseDetector;
use super::function::{at, interpolated, noise};
use super::hits::HOLDS;
use super::reset::RATE;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Quantity, StepError};
use liouville_base::run::{Crossing, NOISE, Outcome, Records};
use liouville_problem::{Carried, Dynamics, Impact, Jump, Refused};

/// Where the motion is looked at after a reset that leaves the rate of e at zero, as a part of a step.
const SHORTLY: f64 = 1.0 / 1024.0;

impl<State: Carried + Checkpoint + Clone, M: Dynamics> DenseDetector<State, M> {
    /// Ends the run at the crossing `k`, or begins it anew, with all events at the same time; `is_end` says that it ends
    /// in any case.
    pub(super) fn cut(
        &mut self,
        (k, is_end): (usize, bool),
        state: &mut State,
        records: &mut Records,
    ) -> Result<Outcome, StepError> {
        let mut same = std::mem::take(&mut self.same);
        let outcome = match self.gather(k, state, &mut same) {
            Ok(()) => self.meet_all((k, &same), is_end, (state, records)),
            Err(error) => Err(error),
        };
        self.same = same;
        outcome
    }

    /// Finds the events at the time of the crossing `k`, that one included, and sets them to that time.
    fn gather(&mut self, k: usize, end: &State, same: &mut Vec<usize>) -> Result<(), StepError> {
        same.clear();
        same.extend(self.found[k].counts.then_some(k));
        for later in k + 1..self.found.len() {
            let Crossing { x, index, .. } = self.found[later];
            let is_idle = self.events[index].is_switch && self.is_start(x);
            if is_idle || !self.is_met_at(k, later, end)? || self.recedes(later, end)?.is_some() {
                continue;
            }
            self.found[later].x = self.found[k].x;
            same.push(later);
        }
        Ok(())
    }

    /// Plain events come first, and then one that changes the motion. Others follow in the next step; where there is none,
    /// they follow at once.
    fn meet_all(
        &mut self,
        (k, same): (usize, &[usize]),
        is_end: bool,
        (state, records): (&mut State, &mut Records),
    ) -> Result<Outcome, StepError> {
        let (x, near) = self.snapped(self.found[k].x);
        let event = |detector: &Self, other: usize| detector.found[other].index;
        let (mut is_end, mut first) = (is_end, None);
        for &other in same {
            let index = event(self, other);
            is_end |= self.events[index].is_plain() && self.ends(index);
        }
        for (place, &other) in same.iter().enumerate().rev() {
            let own = &self.events[event(self, other)];
            if !(own.is_plain() || is_end && own.is_switch) {
                first = Some(place);
            }
        }
        if first.is_some() {
            self.record_times(self.time_of(x), None, records)?;
        }
        let t = self.substep.advance_to_fraction(x, state)?;
        for &other in same {
            let index = event(self, other);
            if self.events[index].is_plain() {
                self.keep_one(index, (x, t), first.is_none())?;
            }
        }
        let Some(first) = first else {
            state.clone_from(&self.substep.state);
            return Ok(Outcome::End(t));
        };
        let index = event(self, same[first]);
        let is_switch = self.events[index].is_switch;
        self.follow(index, (x, t), is_switch || self.ends(index))?;
        self.path.end_at(t, &self.substep.state)?;
        if is_switch {
            state.clone_from(&self.substep.state);
            self.begin_piece((same[first], near), t, state)?;
            return Ok(Outcome::Shorten(t));
        }
        is_end |= self.reset_at((same[first], near), t, (state, records))?;
        for &other in &same[first + 1..] {
            if is_end && self.events[event(self, other)].reset.is_some() {
                self.reset_again((other, near), t, (state, records))?;
            }
        }
        Ok(if self.met.end.is_some() {
            Outcome::End(t)
        } else {
            Outcome::Restart(t)
        })
    }

    /// Resets the state at the crossing `k` after another reset at the time at which the run ends, if the motion after that
    /// one leads to it.
    fn reset_again(
        &mut self,
        (k, near): (usize, f64),
        t: f64,
        (state, records): (&mut State, &mut Records),
    ) -> Result<(), StepError> {
        if let Some(follower) = &mut self.follower {
            follower.begin(state);
        }
        self.substep.t = t;
        self.substep.start.clone_from(state);
        self.found[k].x = 0.0;
        let index = self.found[k].index;
        let event = &mut self.events[index];
        let (last, needs_lam) = (event.function.last, event.needs_lam);
        let noise = HOLDS * noise(&mut self.path, event, t, state)?;
        if last.abs() > noise && !needs_lam || self.recedes(k, state)?.is_some() {
            return Ok(());
        }
        self.follow(index, (0.0, t), self.ends(index))?;
        self.reset_at((k, near), t, (state, records)).map(|_| ())
    }

    /// Resets the state at the crossing `k`; returns whether that ends the run.
    fn reset_at(
        &mut self,
        (k, near): (usize, f64),
        t: f64,
        (state, records): (&mut State, &mut Records),
    ) -> Result<bool, StepError> {
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
        let is_end = is_last || limit.is_some();
        if is_end {
            self.end(index, t, limit.filter(|_| !is_last));
        }
        Ok(is_end)
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
