//! A function of the state whose zeros are events.

use super::Reset;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::run::{EventRule, WatchedFunction};
use liouville_base::tape::Tape;

/// A function e(t, y, z, λ), which of its zeros count, and how many of them end the run.
#[derive(Clone, Debug)]
pub struct Event {
    pub(super) function: WatchedFunction,
    /// Whether the function depends on λ.
    pub(super) needs_lam: bool,
    /// The law of the state after it, if it changes the motion.
    pub(super) reset: Option<Reset>,
    /// Whether steps end at it, where it is a switch of the forces.
    pub(super) is_switch: bool,
}

impl Event {
    /// The event of a tape (t, y, z, λ, params).
    ///
    /// # Panics
    /// When these are not the tape's inputs.
    pub fn new(tape: Tape, params: &[f64], rule: EventRule, needs_lam: bool) -> Self {
        assert_eq!(tape.inputs().len(), 5, "inputs of an event");
        Self {
            function: WatchedFunction::new(tape, params, rule),
            needs_lam,
            reset: None,
            is_switch: false,
        }
    }

    /// The same event with a reset of the state.
    #[must_use]
    pub fn with_reset(self, reset: Option<Reset>) -> Self {
        Self { reset, ..self }
    }

    /// A switch of the forces, at which steps end; it comes behind all events.
    #[must_use]
    pub fn switch(index: usize, tape: Tape, params: &[f64]) -> Self {
        let rule = EventRule {
            index,
            ..EventRule::default()
        };
        Self {
            is_switch: true,
            ..Self::new(tape, params, rule, false)
        }
    }

    /// Whether it changes no step.
    pub(super) fn is_plain(&self) -> bool {
        self.reset.is_none() && !self.is_switch
    }

    /// e at (t, y, z, λ).
    pub(super) fn at(
        &mut self,
        t: f64,
        (y, z): (&[f64], &[f64]),
        lam: &[f64],
    ) -> Result<f64, StepError> {
        self.function.at([&[t], y, z, lam])
    }
}

impl Checkpoint for Event {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.function.save(member, out);
        if let Some(reset) = &self.reset {
            reset.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.function.restore(member, saved)?;
        match &mut self.reset {
            Some(reset) => reset.restore(member, saved),
            None => Ok(()),
        }
    }
}
