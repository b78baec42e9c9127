//! States at given times: the ends of parts of steps.

use super::DenseDetector;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::StepError;
use liouville_base::run::Records;
use liouville_problem::{Carried, Dynamics};

/// A given time, to which a part of a step has led.
#[derive(Clone, Copy, Debug)]
pub struct Given {
    /// When.
    pub t: f64,
    /// The part of the step, 0 and 1 for its ends.
    pub part: f64,
    /// The length of the whole step.
    pub h: f64,
    /// Whether the state there is that after a reset.
    pub is_after: bool,
    /// Whether the time is that at which a step ends, as the run has it.
    pub is_of_step: bool,
}

impl<State: Carried + Checkpoint + Clone, M: Dynamics> DenseDetector<State, M> {
    /// The time at which so large a part of the step ends.
    #[allow(clippy::float_cmp)] // 1 is the end of the step
    pub(super) fn time_of(&self, part: f64) -> f64 {
        if part == 1.0 {
            return self.substep.end;
        }
        self.substep.t + part * self.substep.h
    }

    /// Records at the wanted times before `t`, and at that itself if the state `there` is that of the run. Other states
    /// are made by parts of the step; those of its ends serve at times that differ from these by roundoff, also where a
    /// time is that much beyond the end.
    #[allow(clippy::float_cmp)] // a time is that of the end, or is not
    pub(super) fn record_times(
        &mut self,
        t: f64,
        there: Option<&State>,
        records: &mut Records,
    ) -> Result<(), StepError> {
        let way = self.substep.h.signum();
        while let Some(wanted) = self.wanted() {
            let substep = &self.substep;
            let (part, near) = self.snapped((wanted - substep.t) / substep.h);
            let left = (t - wanted) * way;
            let is_at_end = t == substep.end && -left <= near * substep.h.abs();
            if (left < 0.0 && !is_at_end) || (left <= 0.0 && there.is_none()) {
                break;
            }
            let substep = &mut self.substep;
            match (part, there) {
                (1.0, Some(end)) => substep.state.clone_from(end),
                (0.0, _) => substep.state.clone_from(&substep.start),
                _ => substep.advance_by(wanted - substep.t)?,
            }
            let at = Given {
                t: wanted,
                part,
                h: self.substep.h,
                is_after: false,
                is_of_step: false,
            };
            self.record_one(at, records)?;
        }
        Ok(())
    }

    /// Records the state after a reset at `t`, if that is a wanted time, in the place of the state before.
    pub(super) fn record_after(
        &mut self,
        t: f64,
        state: &State,
        records: &mut Records,
    ) -> Result<(), StepError> {
        let is_recorded = self.times.is_some() && records.last() == Some(t);
        if !is_recorded && self.wanted() != Some(t) {
            return Ok(());
        }
        self.next -= usize::from(is_recorded);
        self.substep.state.clone_from(state);
        let at = Given {
            t,
            part: 0.0,
            h: self.substep.h,
            is_after: true,
            is_of_step: false,
        };
        self.record_one(at, records)
    }

    /// The next of the wanted times.
    fn wanted(&self) -> Option<f64> {
        self.times.as_ref()?.get(self.next).copied()
    }

    /// Records the state that a part of the step has led to.
    fn record_one(&mut self, at: Given, records: &mut Records) -> Result<(), StepError> {
        let state = &mut self.substep.state;
        if let Some(follower) = &mut self.follower {
            follower.hold(at, state)?;
        }
        if records.last() == Some(at.t) {
            records.replace(&mut *self.observer, at.t, state)?;
        } else {
            records.push(&mut *self.observer, at.t, state)?;
        }
        self.next += 1;
        Ok(())
    }
}
