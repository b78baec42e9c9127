//! The adjoints of events, and of states at given times.
//!
//! With (ū, t̄) the cotangents of the state and the time of an event, and w the derivative by the length of the step,
//!
//!     κ̄ = ū w + t̄,   (ū, t̄) −= κ̄ / (e_y w_y + e_z w_z + e_t) (e_y, e_z, e_t),   θ̄ −= κ̄ / (…) e_θ
//!
//! before the part of the step is followed back. The products with w are what an adjoint step says of its length, so that
//! part is followed twice: with (ū, t̄), and with the slopes of e. Of a state at a given time the part of the step is as
//! long as that time is later than its start, so that the cotangent of the time of the start takes −ū w.

use super::journal::{Entry, GivenEntry};
use super::recording::StepAdjoint;
use crate::events::{Before, LinearReset, Meeting, SlopesModel};
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled};
use liouville_problem::{Carried, Cotangents, ObservePoint, Side};

/// The adjoints of events.
pub(super) struct EventAdjoint {
    pub(super) events: Vec<SlopesModel>,
    pub(super) reset: Box<dyn LinearReset>,
    /// Cotangents of each event: of t, y, z and λ, and of y, z and λ after a reset, a row for each time it was met.
    pub(super) rows: Vec<Matrix>,
    /// Of y and z together, of the multipliers of a step, and of all.
    pub(super) sizes: [usize; 3],
}

impl EventAdjoint {
    /// The row of an entry, where cotangents of its event were given.
    fn row<S>(&self, entry: &Entry<S>) -> Option<&[f64]> {
        let rows = self.rows.get(entry.event)?;
        (entry.hit < rows.rows()).then(|| rows.row(entry.hit))
    }

    /// Takes cotangents from behind a reset to before it.
    ///
    /// # Errors
    /// It has no derivative.
    pub(super) fn leave_reset<A: StepAdjoint>(
        &mut self,
        entry: &Entry<A::State>,
        (adjoint, point): (&mut A, &mut A::Point),
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let Some(after) = &entry.after else {
            return Ok(());
        };
        adjoint.leave((entry.t, after), false, point, of)?;
        let [state, m, _] = self.sizes;
        if let Some(row) = self.row(entry).and_then(|row| row.get(1 + state + m..))
            && !row.is_empty()
        {
            point.observe((entry.t, after), row, of)?;
        }
        let slopes = &mut self.events[entry.event];
        let (y, z) = (entry.state.y(), entry.state.z());
        let before: Before<'_> = (entry.t, [y, z, &entry.lam]);
        self.reset.make(slopes, before, [after.y(), after.z()])?;
        let found = self.reset.pull(slopes, before, [&of.y, &of.z])?;
        of.y.fill(0.0);
        of.z.fill(0.0);
        self.add((entry, &found), point, of)
    }

    /// Adds cotangents of (t, y, z, λ, θ) at an event.
    fn add<S: Carried>(
        &self,
        (entry, found): (&Entry<S>, &[f64]),
        point: &mut impl ObservePoint,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let [state, m, multipliers] = self.sizes;
        // of redundant constraints there are more multipliers, which no event depends on
        let row = &found[1..][..state + m.min(multipliers)];
        let row = if m == multipliers {
            row.to_vec()
        } else {
            [&row[..state], &vec![0.0; m]].concat()
        };
        of.tau[0] += found[0];
        add_scaled(&mut of.tau[1..], 1.0, &found[1 + state + multipliers..]);
        point.observe((entry.t, &entry.state), &row, of)
    }

    /// Takes cotangents from an event to the start of the step in which it was met, those of the event included.
    ///
    /// # Errors
    /// It has no derivative.
    pub(super) fn leave<A: StepAdjoint>(
        &mut self,
        entry: &Entry<A::State>,
        (adjoint, point): (&mut A, &mut A::Point),
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let [state, m, _] = self.sizes;
        if let Some(row) = self.row(entry) {
            of.tau[0] += row[0];
            point.observe((entry.t, &entry.state), &row[1..=state + m], of)?;
        }
        let (y, z) = (entry.state.y(), entry.state.z());
        let before: Before<'_> = (entry.t, [y, z, &entry.lam]);
        let gradient = self.events[entry.event].gradient(before)?.to_vec();
        let mut slopes = of.like();
        self.add((entry, &gradient), point, &mut slopes)?;
        let at = (entry.t, &entry.state);
        let (own, slope, length) = if entry.steps.is_empty() {
            let side = Side::Before(entry.h);
            let own = point.rate(at, side, of)?;
            (own, point.rate(at, side, &slopes)?, 1.0)
        } else {
            let before = std::mem::take(&mut of.stretch);
            for step in entry.steps.iter().rev() {
                adjoint.follow(step, point, of)?;
                adjoint.follow(step, point, &mut slopes)?;
            }
            let own = std::mem::replace(&mut of.stretch, before);
            let slope = std::mem::take(&mut slopes.stretch);
            (own, slope, entry.steps.iter().map(|step| step.h).sum())
        };
        entry.meeting().check(slope / length)?;
        of.add_scaled(-own / slope, &slopes);
        Ok(())
    }
}

impl<S> Entry<S> {
    fn meeting(&self) -> Meeting<'_> {
        Meeting {
            event: self.event,
            hit: self.hit,
            part: self.part,
            t: self.t,
            h: self.h,
            lam: &self.lam,
            needs_lam: false,
            height: self.height,
            is_last: self.is_last,
            obstacle: self.obstacle,
        }
    }

    /// The derivative by time of a function with these cotangents of the state that it has led to: along the motion after a
    /// reset, else along that before.
    pub(super) fn rate<A: StepAdjoint<State = S>>(
        &self,
        (adjoint, point): (&mut A, &mut A::Point),
        of: &Cotangents,
    ) -> Result<f64, StepError>
    where
        S: Carried,
    {
        if let Some(after) = &self.after {
            return point.rate((self.t, after), Side::After(self.h), of);
        }
        if self.steps.is_empty() {
            return point.rate((self.t, &self.state), Side::Before(self.h), of);
        }
        let mut back = of.clone();
        for step in self.steps.iter().rev() {
            adjoint.follow(step, point, &mut back)?;
        }
        Ok(back.stretch / self.steps.iter().map(|step| step.h).sum::<f64>())
    }
}

impl<S: Carried> GivenEntry<S> {
    /// Adds cotangents of (y, z, λ) at the given time to those of the state where the part of the step begins.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub(super) fn leave<A: StepAdjoint<State = S>>(
        &self,
        row: &[f64],
        (adjoint, point): (&mut A, &mut A::Point),
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let (mut own, at) = (of.like(), (self.t, &self.state));
        point.observe(at, row, &mut own)?;
        // the time there is held
        own.tau[0] = 0.0;
        own.tau[0] = if self.steps.is_empty() {
            -point.rate(at, Side::After(self.h), &own)?
        } else {
            for step in self.steps.iter().rev() {
                adjoint.follow(step, point, &mut own)?;
            }
            let length: f64 = self.steps.iter().map(|step| step.h).sum();
            own.tau[0] - std::mem::take(&mut own.stretch) / length
        };
        of.add_scaled(1.0, &own);
        Ok(())
    }
}
