//! A function of the state whose zeros are events.

use crate::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use crate::error::{Quantity, StepError};
use crate::tape::{Registers, Tape};

/// Which zeros of an event's function count, and which of them ends the run.
#[derive(Clone, Copy, Debug, Default)]
pub struct EventRule {
    /// The number of the event in the user's list.
    pub index: usize,
    /// 1 where the function must grow along the run, −1 where it must fall, 0 for both.
    pub direction: i8,
    /// The number of events that ends the run; none does if it is 0.
    pub terminal: usize,
    /// Up to this size a minimum of |e| without a change of sign counts as a zero, of either direction, where e was
    /// larger before; none does if it is 0.
    pub touch: f64,
}

/// A function e of time and state, and its signs and values so far.
#[derive(Clone, Debug)]
pub struct WatchedFunction {
    tape: Tape,
    registers: Registers<f64>,
    /// Which of its zeros count.
    pub rule: EventRule,
    /// The sign of e where it was last clear, 0 before that.
    pub sign: f64,
    /// e at the end of the step before.
    pub last: f64,
    /// e shortly before that: (how long before, e).
    pub earlier: Option<(f64, f64)>,
    /// e at the samples of a step.
    pub samples: Vec<f64>,
    /// The largest size of e in the steps before.
    pub peak: f64,
    /// How many of its zeros have counted.
    pub count: usize,
}

impl WatchedFunction {
    /// The function of a tape, whose last input is the parameters.
    pub fn new(tape: Tape, params: &[f64], rule: EventRule) -> Self {
        Self {
            registers: tape.bind(params),
            tape,
            rule,
            sign: 0.0,
            last: f64::NAN,
            earlier: None,
            samples: Vec::new(),
            peak: 0.0,
            count: 0,
        }
    }

    /// e at these arguments, the time first.
    ///
    /// # Errors
    /// It is not finite.
    ///
    /// # Panics
    /// When they are not those of the tape.
    pub fn at<const K: usize>(&mut self, args: [&[f64]; K]) -> Result<f64, StepError> {
        let value = self.tape.eval(&mut self.registers, args)[0];
        if value.is_finite() {
            return Ok(value);
        }
        Err(StepError::NotFinite {
            quantity: Quantity::Event,
            index: self.rule.index,
            t: args[0][0],
        })
    }

    /// Whether a zero counts where the sign becomes this one.
    pub fn counts(&self, sign: f64) -> bool {
        f64::from(self.rule.direction) * sign >= 0.0
    }
}

impl Checkpoint for WatchedFunction {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        (self.sign, self.last).save(member, out);
        (self.earlier, self.count).save(member, out);
        self.peak.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.sign.restore(member, saved)?;
        self.last.restore(member, saved)?;
        self.earlier.restore(member, saved)?;
        self.count.restore(member, saved)?;
        self.peak.restore(member, saved)
    }
}
