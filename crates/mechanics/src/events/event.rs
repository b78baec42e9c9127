//! A function of the state whose zeros are events.

use super::Reset;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::{Quantity, StepError};
use liouville_base::tape::{Registers, Tape};

/// A function e(t, y, z, λ), which of its zeros count, and how many of them end the run.
#[derive(Clone, Debug)]
pub struct Event {
    tape: Tape,
    registers: Registers<f64>,
    /// Its number in the user's list.
    index: usize,
    direction: i8,
    /// So many end the run; none do if it is 0.
    pub(super) terminal: usize,
    /// Whether the function depends on λ.
    pub(super) needs_lam: bool,
    /// What it does to the motion.
    pub(super) reset: Option<Reset>,
    /// Whether steps end at it, where it is a switch of the forces.
    pub(super) is_switch: bool,
    /// The sign of e where it was last clear, 0 before that.
    pub(super) sign: f64,
    /// e at the end of the step before, and shortly before it: (how long before, e).
    pub(super) last: f64,
    pub(super) earlier: Option<(f64, f64)>,
    /// e at the samples of a step.
    pub(super) samples: Vec<f64>,
    pub(super) count: usize,
}

impl Event {
    /// The event number `index`. `direction` is 1 where e must grow along the run, −1 where it must fall,
    /// 0 for both; `terminal` of them end the run, if it is not 0.
    ///
    /// # Panics
    /// When the tape's inputs are not (t, y, z, λ, params).
    pub fn new(
        index: usize,
        tape: Tape,
        params: &[f64],
        direction: i8,
        terminal: usize,
        needs_lam: bool,
    ) -> Self {
        assert_eq!(tape.inputs().len(), 5, "inputs of an event");
        Self {
            registers: tape.bind(params),
            tape,
            index,
            direction,
            terminal,
            needs_lam,
            reset: None,
            is_switch: false,
            sign: 0.0,
            last: f64::NAN,
            earlier: None,
            samples: Vec::new(),
            count: 0,
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
        Self {
            is_switch: true,
            ..Self::new(index, tape, params, 0, 0, false)
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
        let value = self.tape.eval(&mut self.registers, [&[t], y, z, lam])[0];
        if value.is_finite() {
            return Ok(value);
        }
        Err(StepError::NotFinite {
            quantity: Quantity::Event,
            index: self.index,
            t,
        })
    }

    /// Whether a zero counts where the sign becomes this one.
    pub(super) fn wants(&self, sign: f64) -> bool {
        f64::from(self.direction) * sign >= 0.0
    }
}

impl Checkpoint for Event {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        (self.sign, self.last).save(member, out);
        (self.earlier, self.count).save(member, out);
        if let Some(reset) = &self.reset {
            reset.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.sign.restore(member, saved)?;
        self.last.restore(member, saved)?;
        self.earlier.restore(member, saved)?;
        self.count.restore(member, saved)?;
        match &mut self.reset {
            Some(reset) => reset.restore(member, saved),
            None => Ok(()),
        }
    }
}
