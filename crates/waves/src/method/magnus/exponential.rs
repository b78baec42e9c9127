//! The propagator of a matrix that does not depend on time: shears, or a Chebyshev series of the degree that it takes.

use crate::method::derivative::{Piece, ShearsPiece, flat};
use crate::method::driven::polynomials::NodeMap;
use crate::method::term_bounds::Interval;
use crate::method::{Chebyshev, Shears, Sweeper, Wave};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::composition::{Composed, Flow};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use liouville_base::simd::Stored;

/// The longest series, in units of 1/β.
const LONGEST: f64 = 1e5;

/// A list of shears, and its limit of stability.
#[derive(Clone, Debug, PartialEq)]
pub struct ShearProgram {
    /// The shears: part 0 moves q, part 1 moves p.
    pub program: Vec<Flow>,
    /// The most that half the width of the spectrum times a step of it may be.
    pub theta: f64,
    /// The relative error of the norm above which a state is refused.
    pub tolerance: f64,
}

/// The propagator of a matrix that does not depend on time.
#[derive(Clone)]
pub(super) enum Exponential<S: Stored> {
    Shears {
        shears: Box<Composed<Shears<S>>>,
        theta: f64,
    },
    Series {
        series: Box<Chebyshev<S>>,
        /// The part of the width by which bounds were found to be too close.
        wider: f64,
    },
}

impl<S: Stored> Exponential<S> {
    pub(super) fn series(series: Chebyshev<S>) -> Self {
        let series = Box::new(series);
        Self::Series { series, wider: 0.0 }
    }

    pub(super) fn sweeper_mut(&mut self) -> &mut Sweeper<S> {
        match self {
            Self::Shears { shears, .. } => shears.parts_mut().sweeper_mut(),
            Self::Series { series, .. } => series.sweeper_mut(),
        }
    }

    /// Multiplies a state by e^{−ihH}, with these bounds of H.
    pub(super) fn apply(
        &mut self,
        (low, high): Interval,
        t: f64,
        h: f64,
        state: &mut Wave<S>,
    ) -> Result<(), StepError> {
        let theta = (high - low) / 2.0 * h.abs();
        let most = match self {
            Self::Shears { theta, .. } => *theta,
            Self::Series { .. } => LONGEST,
        };
        let steps = theta / most;
        if !steps.is_finite() {
            return Err(StepError::Spectrum { theta, most, t });
        }
        let steps = steps.ceil().max(1.0);
        match self {
            Self::Shears { shears, .. } => {
                let shift = low.midpoint(high);
                shears.parts_mut().set_shift(shift);
                // half of the phase before the shears and half after them, so that a step back in time is the inverse
                state.add_phase(shift * h / 2.0);
                state.remove_phase();
                let recorder = shears.parts_mut().sweeper_mut().recorder().cloned();
                let start = recorder.as_ref().map(|_| flat(state)).transpose()?;
                let mut left = steps;
                while left > 0.0 {
                    shears.step(t, h / steps, state)?;
                    left -= 1.0;
                }
                if let (Some(recorder), Some(start)) = (recorder, start) {
                    let piece = shears_piece(shears, [start, flat(state)?], h, steps);
                    recorder.add(Piece::Shears(piece))?;
                }
                state.add_phase(-shift * h / 2.0);
                shears.synchronize(state)
            }
            Self::Series { series, wider } => {
                let more = *wider * (high - low);
                let bounds = (low - more, high + more);
                series.set_bounds(bounds);
                let mut left = steps;
                while left > 0.0 {
                    series.step(t, h / steps, state)?;
                    left -= 1.0;
                }
                let (found, width) = (series.bounds(), high - low);
                let beyond = (low - found.0).max(found.1 - high);
                if found != bounds && width > 0.0 {
                    *wider = beyond / width;
                }
                Ok(())
            }
        }
    }

    pub(super) fn stats(&self) -> Stats {
        match self {
            Self::Shears { shears, .. } => shears.stats(),
            Self::Series { series, .. } => series.stats(),
        }
    }
}

/// Steps of shears that were made over a time h, between these ends, for a run that is to be differentiated.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a number of steps, at least 1
fn shears_piece<S: Stored>(
    shears: &mut Composed<Shears<S>>,
    ends: [Vec<f64>; 2],
    h: f64,
    steps: f64,
) -> ShearsPiece {
    let of_flow = |flow: &Flow| (flow.part == 1, flow.weight * h / steps);
    let all = shears.program().iter().map(of_flow).collect();
    let shift = shears.parts_mut().shift();
    let current = shears.parts_mut().sweeper_mut().current.as_ref();
    ShearsPiece {
        shears: all,
        repeats: steps as usize,
        shift,
        angles: (-shift * h / 2.0, -shift * h / 2.0),
        ends,
        weights: current.map_or_else(Vec::new, |at| at.weights().to_vec()),
        potential: current.map_or_else(Vec::new, |at| at.potential().to_vec()),
        nodes: Vec::new(),
        map: NodeMap::default(),
        steps: 0,
    }
}

impl<S: Stored> Checkpoint for Exponential<S> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        match self {
            Self::Shears { shears, .. } => shears.save(member, out),
            Self::Series { series, wider } => {
                wider.save(member, out);
                series.save(member, out);
            }
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        match self {
            Self::Shears { shears, .. } => shears.restore(member, saved),
            Self::Series { series, wider } => {
                wider.restore(member, saved)?;
                series.restore(member, saved)
            }
        }
    }
}
