//! Chebyshev series of the propagator, evaluated at all outputs of a window:
//!
//!     ψ(t + s) = e^{−iσs} Σ_k (2 − δ_k0) (−i)^k J_k(βs) T_k(G) ψ(t),   G = (H − σ)/β,
//!
//! with σ the middle of the bounds of the spectrum and β half their distance.
//!
//! The terms T_k(G) ψ(t) do not depend on s, and the tail Σ_{k>M} 2 |J_k(βs)| is largest at the end of the window, so
//! that outputs inside it take no products of their own and are as exact as its end.
//! T_{k+1} = 2 G T_k − T_{k−1} overwrites T_{k−1}: even and odd k take turns in two arrays. Even terms are
//! real multiples of the start of the series, odd ones imaginary; a real ψ thus needs one recurrence of
//! real vectors, any other ψ two, one after another. The terms of a complex H are complex vectors. At one output terms are added up where they are made, at
//! several in blocks of copies.
//!
//! Within the bounds no T_k(G) u is longer than u. One that is proves that the spectrum reaches out of them, and is
//! almost an eigenvector there: the window begins again with wider bounds. Source: talezer1984.

mod expand;

use super::derivative::{Output, Piece, SeriesPiece, flat};
use super::driven::choice::{Form, Window};
use super::driven::polynomials::NodeMap;
use super::driven::whole::Fit;
use super::sweep::{Outputs, TermBlock};
use super::windows::{Place, Windows};
use super::{Move, Sweeper, Wave, guard, squares};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use liouville_base::simd::Stored;

/// The coefficients of a window of these lengths, for each of its outputs.
#[derive(Clone, Debug, Default)]
struct Series {
    lengths: Vec<f64>,
    c: Vec<Vec<f64>>,
}

/// The state at the start of a window, from which a run that was saved within it goes on.
#[derive(Clone, Debug)]
struct Start<S: Stored> {
    parts: [Vec<S>; 2],
    phase: f64,
}

/// Steps by Chebyshev series.
#[derive(Clone)]
pub struct Chebyshev<S: Stored> {
    sweeper: Sweeper<S>,
    bounds: (f64, f64),
    sigma: f64,
    beta: f64,
    rate: f64,
    guard: f64,
    kept: Vec<Series>,
    /// Memory of coefficients that are of no more use.
    spare: Vec<Series>,
    moves: Vec<Move>,
    /// T_k(G) u of even k, and of odd k.
    turns: [Vec<S>; 2],
    /// The next ψ: real and imaginary part.
    next: [Vec<S>; 2],
    windows: Windows,
    place: Place,
    start: Start<S>,
    /// Whether the outputs of the present window are not there, as the run was restored within it.
    is_lost: bool,
    lengths: Vec<f64>,
    outputs: Outputs<S>,
    block: TermBlock<S>,
    /// Windows begun again with wider bounds.
    again: usize,
    /// Products for outputs that were made before the run was saved.
    repeated: usize,
}

impl<S: Stored> Chebyshev<S> {
    /// Series for a spectrum within bounds, off by `rate` in each unit of time; the norm may be off by
    /// `guard`, relatively, before a state is refused.
    ///
    /// # Panics
    /// When the bounds are not in order.
    pub fn new(sweeper: Sweeper<S>, bounds: (f64, f64), rate: f64, guard: f64) -> Self {
        let empty = || [Vec::new(), Vec::new()];
        let mut series = Self {
            sweeper,
            bounds,
            sigma: 0.0,
            beta: 0.0,
            rate,
            guard,
            kept: Vec::new(),
            spare: Vec::new(),
            moves: Vec::new(),
            turns: empty(),
            next: empty(),
            windows: Windows::default(),
            place: Place::default(),
            start: Start {
                parts: empty(),
                phase: 0.0,
            },
            is_lost: false,
            lengths: Vec::new(),
            outputs: Outputs::default(),
            block: TermBlock::default(),
            again: 0,
            repeated: 0,
        };
        series.set_bounds(bounds);
        series
    }

    /// The same with several outputs from a series; steps are from each output to the next.
    #[must_use]
    pub fn with_windows(self, windows: Windows) -> Self {
        let mut series = Self { windows, ..self };
        if series.windows.most() > 1 {
            let n = series.sweeper.hamiltonian().places();
            series.start.parts = [vec![S::splat(0.0); n], vec![S::splat(0.0); n]];
        }
        series
    }

    /// The sweeper of the products.
    pub fn sweeper_mut(&mut self) -> &mut Sweeper<S> {
        &mut self.sweeper
    }

    /// The bounds of the spectrum, wider ones where an energy was outside of those given.
    pub fn bounds(&self) -> (f64, f64) {
        self.bounds
    }

    /// Changes the bounds of the spectrum, between two windows.
    ///
    /// # Panics
    /// When they are not in order.
    pub fn set_bounds(&mut self, (low, high): (f64, f64)) {
        assert!(low <= high, "bounds of a spectrum: {low}, {high}");
        self.bounds = (low, high);
        self.sigma = f64::midpoint(low, high);
        // a spectrum of one number is known to rounding errors
        let least = (8.0 * f64::EPSILON * self.sigma.abs()).max(1e-290);
        self.beta = (0.5 * (high - low)).max(least);
        self.spare.append(&mut self.kept);
    }
}

impl<S: Stored> Chebyshev<S> {
    /// Leaves the window that begins at a state to a run that is to be differentiated, as one of Bessel functions with
    /// weights of the terms that do not depend on time.
    fn keep(&self, t: f64, state: &Wave<S>) -> Result<(), StepError> {
        let Some(recorder) = self.sweeper.recorder() else {
            return Ok(());
        };
        let series = self.kept.iter().rfind(|kept| kept.lengths == self.lengths);
        let series = series.ok_or(StepError::NoMemory)?;
        let output = |(s, c): (&f64, &Vec<f64>)| Output {
            s: *s,
            factors: (c.iter().enumerate())
                .map(|(k, c)| if k == 0 { *c } else { 0.5 * c })
                .collect(),
        };
        let outputs: Vec<Output> = self.lengths.iter().zip(&series.c).map(output).collect();
        let start = flat(state)?;
        let terms = self.sweeper.hamiltonian().terms().len();
        let current = self.sweeper.current.as_ref();
        recorder.add(Piece::Series(SeriesPiece {
            start,
            phase: state.phase,
            window: Window {
                h: outputs[outputs.len() - 1].s,
                form: Form::Bessel,
                degree: 0,
                last: 0,
                sigma: self.sigma,
                beta: self.beta,
            },
            fit: Fit {
                degree: 0,
                weights: current.map_or_else(|| vec![1.0; terms], |at| at.weights().to_vec()),
                potential: current.map_or_else(Vec::new, |at| at.potential().to_vec()),
            },
            sizes: Vec::new(),
            tail: self.rate * self.lengths[self.lengths.len() - 1].abs(),
            nodes: vec![t],
            map: NodeMap::constant(),
            steps: outputs.len(),
            parts: 1.0,
            outputs,
            is_by_terms: true,
        }))
    }
}

impl<S: Stored> Stepper for Chebyshev<S> {
    type State = Wave<S>;

    fn step(&mut self, t: f64, h: f64, state: &mut Wave<S>) -> Result<(), StepError> {
        let output = self.place.output;
        if output == 0 || self.is_lost {
            let mut lengths = std::mem::take(&mut self.lengths);
            self.place.lengths(&self.windows, (t, h), &mut lengths);
            self.lengths = lengths;
            if output == 0 {
                self.make(t, [&state.q, &state.p])?;
                self.keep(t, state)?;
                self.place.start = t;
                self.start.phase = state.phase;
                if self.lengths.len() > 1 {
                    self.start.parts[0].copy_from_slice(&state.q);
                    self.start.parts[1].copy_from_slice(&state.p);
                }
            } else {
                let (before, again) = (self.sweeper.products(), self.again);
                let parts = std::mem::take(&mut self.start.parts);
                let made = self.make(t, [&parts[0], &parts[1]]);
                self.start.parts = parts;
                self.repeated += self.sweeper.products() - before;
                self.again = again;
                made?;
            }
            self.is_lost = false;
        }
        self.read(output, state.q.len())?;
        let [q, p] = &self.next;
        guard(squares(q, p), state.start, self.guard, t + h)?;
        state.q.copy_from_slice(q);
        state.p.copy_from_slice(p);
        state.phase = self.start.phase;
        state.add_phase(self.sigma * self.lengths[output]);
        self.place.advance(&self.windows);
        Ok(())
    }

    /// Windows begun again with wider bounds are cold starts.
    fn stats(&self) -> Stats {
        Stats {
            evaluations: self.sweeper.products() - self.repeated,
            cold_starts: self.again,
            ..Stats::default()
        }
    }
}

liouville_base::checkpoint!([S: Stored] Start<S> { parts, phase });

/// Within a window its start is saved, and its outputs are made again.
impl<S: Stored> Checkpoint for Chebyshev<S> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.bounds.save(member, out);
        self.place.save(member, out);
        self.start.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let mut bounds = self.bounds;
        bounds.restore(member, saved)?;
        self.place.restore(member, saved)?;
        self.start.restore(member, saved)?;
        self.place.check(&self.windows)?;
        let is_ordered = bounds.0 <= bounds.1;
        if !is_ordered {
            return Err(CheckpointMismatch);
        }
        self.set_bounds(bounds);
        self.is_lost = self.place.output > 0;
        Ok(())
    }
}
