//! The cost of a run by series in time, in advance.

use super::choice::{Form, Share, Window};
use super::fit::Sampler;
use crate::method::TermBounds;
use crate::problem::Hamiltonian;
use liouville_base::cancel;
use liouville_base::error::StepError;
use std::sync::Arc;

/// The parts of a Hamiltonian, and the tolerance.
#[derive(Clone, Debug, PartialEq)]
pub struct Driven {
    /// The parts, and bounds of their eigenvalues.
    pub bounds: TermBounds,
    /// Whether parts after the first are B_k less the first, of which products are made with B_k.
    pub by_differences: bool,
    /// Times where windows end, besides, in order along the run.
    pub breaks: Vec<f64>,
    /// Error allowed in a unit of time.
    pub rate: f64,
    /// Tolerance relative to the norm.
    pub tolerance: f64,
}

/// The cost of windows: series of powers and of Bessel functions, and the products of all of them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrivenCost {
    /// Windows with a series of powers.
    pub powers: usize,
    /// Windows with a series of Bessel functions.
    pub bessel: usize,
    /// Products: at most of powers, about of Bessel functions.
    pub products: usize,
    /// The longest window, in units of 1/β.
    pub theta: f64,
    /// Errors beyond the tolerance that roundings may add up to.
    pub beyond: f64,
}

/// A window, and where it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Planned {
    pub(super) next: f64,
    pub(super) window: Window,
    beyond: f64,
}

/// The windows of a run.
pub(super) struct Found {
    run: (Driven, (f64, f64)),
    windows: Vec<Planned>,
}

impl Found {
    /// The window that a time is in, up to its end; none outside the run.
    pub(super) fn at(&self, t: f64) -> Option<Planned> {
        let (start, end) = self.run.1;
        let is_past = |planned: &Planned| (planned.next - t) * (end - start) <= 0.0;
        let place = self.windows.partition_point(is_past);
        self.windows.get(place).copied()
    }
}

impl Driven {
    /// The windows of a run, which are kept with its Hamiltonian; none where the parts do not fit.
    ///
    /// # Errors
    /// H is not finite, or the choice was interrupted.
    pub(super) fn windows(
        &self,
        hamiltonian: &Arc<Hamiltonian>,
        span: (f64, f64),
    ) -> Option<Result<Arc<Found>, StepError>> {
        let sampler = self.sampler(hamiltonian)?;
        let run = (self.clone(), span);
        let fits = |found: &Found| found.run == run;
        let make = || {
            let windows = self.walk(sampler?.with_scan()?, span)?;
            let run = run.clone();
            Ok(Found { run, windows })
        };
        Some(hamiltonian.windows().get(fits, make, |_| true))
    }

    /// Chooses one window after another.
    fn walk(&self, mut sampler: Sampler, (t, end): (f64, f64)) -> Result<Vec<Planned>, StepError> {
        let whole = self.rate * (end - t).abs();
        let (mut windows, mut t, mut jumps, mut refused) = (Vec::new(), t, 0, None);
        while t.to_bits() != end.to_bits() {
            if cancel::is_cancelled() {
                return Err(StepError::Interrupted);
            }
            let share = Share::after(jumps, self.rate, whole);
            let is_past = |time: &f64| (time - t) * (end - t) <= 0.0;
            let ahead = &self.breaks[self.breaks.partition_point(is_past)..];
            let breaks = refused.as_slice().iter().chain(ahead.first());
            let end = next_break(breaks, t, end);
            let choice = sampler.window(t, end - t, share, false)?;
            jumps += usize::from(choice.is_jump);
            refused = choice.refused.or(refused);
            let (window, beyond) = (choice.window, choice.beyond);
            let next = next_time(t, window.h, end);
            windows.push(Planned {
                next,
                window,
                beyond,
            });
            t = next;
        }
        Ok(windows)
    }

    pub(super) fn sampler(
        &self,
        hamiltonian: &Arc<Hamiltonian>,
    ) -> Option<Result<Sampler, StepError>> {
        let sampler = Sampler::new(hamiltonian.clone(), self.bounds.clone())?;
        let prepare = |sampler: Sampler| {
            let sampler = sampler.with_differences(self.by_differences);
            sampler.with_breaks(&self.breaks)
        };
        Some(sampler.map(prepare))
    }

    /// The cost of a run from `t` to `end`; none where the parts do not fit.
    ///
    /// # Errors
    /// H is not finite.
    pub fn cost(
        &self,
        hamiltonian: &Arc<Hamiltonian>,
        (t, end): (f64, f64),
    ) -> Option<Result<DrivenCost, StepError>> {
        let found = match self.windows(hamiltonian, (t, end))? {
            Ok(found) => found,
            Err(error) => return Some(Err(error)),
        };
        let mut cost = DrivenCost::default();
        for Planned { window, beyond, .. } in &found.windows {
            cost.beyond += beyond;
            match window.form {
                Form::Powers => cost.powers += 1,
                Form::Bessel => cost.bessel += 1,
            }
            cost.products += window.last * hamiltonian.products();
            cost.theta = cost.theta.max(window.beta * window.h.abs());
        }
        Some(Ok(cost))
    }
}

/// The first of some times, in order along the run, at which windows end after t, or the end of the run.
pub(in crate::method) fn next_break<'a>(
    breaks: impl Iterator<Item = &'a f64>,
    t: f64,
    end: f64,
) -> f64 {
    let is_between = |time: &f64| (time - t) * (end - t) > 0.0 && (time - end) * (t - end) > 0.0;
    breaks.copied().find(is_between).unwrap_or(end)
}

/// The end of a window or of a step, which is that of the run where it is as near as rounding errors, and later than its
/// start however short it is.
pub(in crate::method) fn next_time(t: f64, h: f64, end: f64) -> f64 {
    let next = t + h;
    if (end - next).abs() <= 1e-9 * h.abs() {
        end
    } else if next.to_bits() != t.to_bits() {
        next
    } else if t < end {
        t.next_up()
    } else {
        t.next_down()
    }
}
