//! The tolerance of a split operator.

use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;

/// Where functions of time are looked at before a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Looks {
    /// Start and end of the run; equal where they are not looked at.
    pub span: (f64, f64),
    /// Times of samples, at which splines bend, in order.
    pub knots: Vec<f64>,
    /// Other times, in order.
    pub outputs: Vec<f64>,
    /// Densities at which a potential of the density is looked at, where it depends on time.
    pub densities: Vec<f64>,
}

/// The tolerance of a split operator, and what is known of its steps.
#[derive(Clone, Debug, PartialEq)]
pub struct SplitTolerance {
    /// Order of the splitting.
    pub order: usize,
    /// Error allowed in a unit of time.
    pub rate: f64,
    /// Half the width of the spectrum.
    pub beta: f64,
    /// How large energies of the state are, by which roundings of its phases are counted.
    pub energy: f64,
    /// The first step; infinite where a pilot is to find it.
    pub first: f64,
    /// The longest step.
    pub longest: f64,
    /// Parts of the wave numbers that a nonlinear equation is to make do with, in rising order, and the longest step of each.
    pub bands: Vec<(f64, f64)>,
    /// Times at which steps end besides, in the order of the run.
    pub breaks: Vec<f64>,
    /// Where functions of time are looked at.
    pub looks: Looks,
}

/// The part of the wave numbers that is taken: the first of some, in rising order, and of all at last.
#[derive(Clone)]
pub(super) struct Band {
    /// Each with its longest step.
    parts: Vec<(f64, f64)>,
    place: usize,
    /// Whether the start of the run has been found to be in it.
    pub(super) is_tried: bool,
}

impl Band {
    pub(super) fn new(tolerance: &SplitTolerance) -> Self {
        let all = (1.0, tolerance.longest);
        Self {
            parts: tolerance.bands.iter().copied().chain([all]).collect(),
            place: 0,
            is_tried: false,
        }
    }

    pub(super) fn part(&self) -> f64 {
        self.parts[self.place].0
    }

    /// The longest step.
    pub(super) fn longest(&self) -> f64 {
        self.parts[self.place].1
    }

    pub(super) fn is_all(&self) -> bool {
        self.place + 1 == self.parts.len()
    }

    /// Takes the next larger part.
    pub(super) fn widen(&mut self) {
        self.place = (self.place + 1).min(self.parts.len() - 1);
    }
}

impl Checkpoint for Band {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.place.save(member, out);
        usize::from(self.is_tried).save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let (mut place, mut is_tried) = (0_usize, 0_usize);
        place.restore(member, saved)?;
        is_tried.restore(member, saved)?;
        if place >= self.parts.len() {
            return Err(CheckpointMismatch);
        }
        (self.place, self.is_tried) = (place, is_tried > 0);
        Ok(())
    }
}

/// A step is short below this part of the time between two outputs, in which so many are made: an unseen jump takes twenty.
const SHORT: f64 = 1e-9;
const MOST_SHORT: usize = 2000;

/// The length below which steps are short, and how many were.
#[derive(Clone, Copy, Default)]
pub(super) struct ShortSteps(f64, usize);

impl ShortSteps {
    /// The short steps between two outputs.
    pub(super) fn new((start, end): (f64, f64)) -> Self {
        Self(SHORT * (end - start).abs(), 0)
    }

    /// Refuses short steps without end.
    pub(super) fn count(&mut self, h: f64, error: f64) -> Result<(), StepError> {
        self.1 += usize::from(h.abs() < self.0);
        let is_many = self.1 > MOST_SHORT;
        (!is_many)
            .then_some(())
            .ok_or(StepError::StepTooSmall { h, error })
    }
}
