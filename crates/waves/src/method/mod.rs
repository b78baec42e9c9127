//! The Schrödinger equation i ψ' = H ψ, as q' = H p, p' = −H q of ψ = q + i p with real symmetric H.
//!
//! Methods step e^{iσt} ψ(t), by H − σ with σ in the middle of the spectrum; a state keeps σt.

mod arnoldi;
pub mod bessel;
mod blocks;
mod chebyshev;
mod derivative;
mod diagonal;
mod doubled;
mod doubling;
mod driven;
mod lanczos;
mod magnus;
mod observe;
mod phases;
mod processed;
mod processor;
mod shears;
mod spectral_range;
mod sweep;
mod term_bounds;
mod windows;

pub use arnoldi::Arnoldi;
pub use chebyshev::Chebyshev;
pub use derivative::{AtNodes, Derivative, Recorder, Wanted};
pub use diagonal::{Diagonal, Eigenpairs};
pub use doubled::Doubled;
pub use driven::{Driven, DrivenCost, DrivenSeries};
pub use lanczos::Lanczos;
pub use magnus::{Magnus, MagnusCost, MagnusSteps, MagnusTolerance, Nodes, ShearProgram};
pub use observe::{Observable, Observer};
pub use phases::{BegunRun, Looks, Phases, SplitSteps, SplitTolerance};
pub use processed::Processed;
pub use processor::Processor;
pub use shears::Shears;
pub use spectral_range::{Ritz, asymmetry, ritz};
pub use sweep::{Move, Outputs, Sink, Sweeper, TermBlock};
pub use term_bounds::TermBounds;
pub use windows::Windows;

use liouville_base::error::StepError;
use liouville_base::real::Scalar;
use std::f64::consts::TAU;

/// A wave function ψ = e^{−i phase} (q + i p), or several in lock-step.
#[derive(Clone, Debug, PartialEq)]
pub struct Wave<S> {
    /// Real part.
    pub q: Vec<S>,
    /// Imaginary part.
    pub p: Vec<S>,
    /// Phase still to be removed, below 2π.
    pub phase: f64,
    /// Sum of the squares at the start.
    pub start: S,
}

impl<S: Scalar> Wave<S> {
    /// A wave function at the start of a run.
    ///
    /// # Panics
    /// When its parts differ in length.
    pub fn new(q: Vec<S>, p: Vec<S>) -> Self {
        assert_eq!(q.len(), p.len(), "parts of a wave function");
        let start = squares(&q, &p);
        Self {
            q,
            p,
            phase: 0.0,
            start,
        }
    }

    /// Copies the real parts, then the imaginary ones, for [`Wave::put_back`] where a step fails.
    pub(super) fn keep(&self, before: &mut Vec<S>) {
        before.clear();
        before.extend(self.q.iter().chain(&self.p));
    }

    /// Takes the parts from before a step that failed.
    pub(super) fn put_back(&mut self, before: &[S]) {
        let (q, p) = before.split_at(self.q.len());
        self.q.copy_from_slice(q);
        self.p.copy_from_slice(p);
    }

    /// Adds to the phase to be removed.
    pub fn add_phase(&mut self, angle: f64) {
        self.phase = (self.phase + angle) % TAU;
    }

    /// Multiplies by e^{i phase}, and sets the phase to zero.
    pub fn remove_phase(&mut self) {
        let (sin, cos) = std::mem::take(&mut self.phase).sin_cos();
        for (q, p) in self.q.iter_mut().zip(&mut self.p) {
            for member in 0..S::MEMBERS {
                let (a, b) = (q.member(member), p.member(member));
                q.set_member(member, a * cos + b * sin);
                p.set_member(member, b * cos - a * sin);
            }
        }
    }

    /// The same wave function with a phase to be removed.
    ///
    /// Shears do not commute with a change of phase: e^{iσt} ψ, with the phase σt, must be the same at a time t for all
    /// runs that lead there, so that the next one undoes or continues them.
    #[must_use]
    pub fn with_phase(mut self, phase: f64) -> Self {
        self.add_phase(-phase);
        self.remove_phase();
        self.add_phase(phase);
        self
    }
}

/// Σ q² + p², member by member, summed block by block so that rounding errors stay small.
pub(super) fn squares<S: Scalar>(q: &[S], p: &[S]) -> S {
    const BLOCK: usize = 256;
    let mut total = S::splat(0.0);
    for (q, p) in q.chunks(BLOCK).zip(p.chunks(BLOCK)) {
        for member in 0..S::MEMBERS {
            let terms = q.iter().zip(p);
            let sum = terms.fold(0.0, |sum, (q, p)| {
                let (q, p) = (q.member(member), p.member(member));
                sum + (q * q + p * p)
            });
            total.set_member(member, total.member(member) + sum);
        }
    }
    total
}

/// Refuses sums of squares `now` unless `is_fine` for their roots and those of `start`.
fn refuse<S: Scalar>(
    now: S,
    start: S,
    t: f64,
    is_fine: impl Fn(f64, f64) -> bool,
) -> Result<(), StepError> {
    for member in 0..S::MEMBERS {
        let (norm, start) = (now.member(member).sqrt(), start.member(member).sqrt());
        if !is_fine(norm, start) {
            let error = StepError::Norm { norm, start, t };
            return Err(if S::IS_SINGLE {
                error
            } else {
                error.of_member(member)
            });
        }
    }
    Ok(())
}

/// Refuses sums of squares `now` whose roots differ from those of `start` by more than `tolerance`, relatively.
fn guard<S: Scalar>(now: S, start: S, tolerance: f64, t: f64) -> Result<(), StepError> {
    refuse(now, start, t, |now, start| {
        (now - start).abs() <= tolerance * start
    })
}

/// Refuses a norm that has changed by more than `tolerance`, relatively.
pub(super) fn check_norm<S: Scalar>(
    t: f64,
    tolerance: f64,
    state: &Wave<S>,
) -> Result<(), StepError> {
    guard(squares(&state.q, &state.p), state.start, tolerance, t)
}

/// Refuses a norm that has grown by more than `tolerance`, relatively.
pub(super) fn check_growth<S: Scalar>(
    t: f64,
    tolerance: f64,
    state: &Wave<S>,
) -> Result<(), StepError> {
    refuse(squares(&state.q, &state.p), state.start, t, |now, start| {
        now <= (1.0 + tolerance) * start
    })
}

liouville_base::checkpoint!([S: Scalar] Wave<S> { q, p, phase, start });
