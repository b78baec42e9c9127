//! Series in time for H(t) = Σ f_k(t) B_k + V(t), evaluated at all outputs of a window.
//!
//! On a window the f_k and V are polynomials of time, and ψ is a power series, or a series of Bessel functions: the next
//! term takes one product. Windows are chosen before any product, so long that the terms per time are fewest and
//! the fit and the tail keep to the tolerance.

mod ahead;
pub(super) mod choice;
mod cost;
pub(super) mod factors;
pub(super) mod fit;
mod levels;
mod looks;
pub(super) mod polynomials;
mod scan;
pub(super) mod terms;
pub(super) mod whole;

pub use cost::{Driven, DrivenCost};
pub(super) use cost::{next_break, next_time};
pub(super) use fit::Sampler;

use super::bessel::{END, LESS, ROUNDING};
use super::observe::dot;
use super::sweep::{Outputs, TermBlock};
use super::{Sweeper, Wave, guard, squares};
use choice::{Form, Share, Window, rest_of_powers};
use cost::Found;
use factors::Factors;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use std::f64::consts::TAU;
use std::sync::Arc;
use terms::Terms;
use whole::Fit;

/// Terms that are added to the outputs at once.
const AT_ONCE: usize = 8;

/// Bessel functions that are taken for zero, all together.
const CUT: f64 = 1e10 * LESS;

/// Most outputs of a window.
const OUTPUTS: usize = 256;

/// A state at a time: its parts one after the other, and the phase to be removed.
#[derive(Clone, Debug, Default)]
struct Point {
    t: f64,
    parts: Vec<f64>,
    phase: f64,
}

liouville_base::checkpoint!(Point { t, parts, phase });

/// Steps by series in time, from each output to the next.
#[derive(Clone)]
pub struct DrivenSeries {
    driven: Driven,
    sampler: Sampler,
    terms: Terms,
    fit: Fit,
    times: Vec<f64>,
    /// The start of the present window, and its end.
    start: Point,
    end: Point,
    /// The first output of the present window, the first behind it, and the next of all.
    first: usize,
    behind: usize,
    next: usize,
    /// Whether the present window is to be made again, as the run was restored within it.
    is_lost: bool,
    has_begun: bool,
    /// Number of windows made.
    made: usize,
    /// The start of the run, and its windows once they are known.
    t0: f64,
    windows: Option<Arc<Found>>,
    sigma: f64,
    outputs: Outputs<f64>,
    block: TermBlock<f64>,
    /// Coefficients of the terms at each output.
    factors: Vec<Factors>,
    state: Vec<f64>,
    found: Vec<f64>,
}

impl DrivenSeries {
    /// Series with outputs at these times; none where the parts do not fit the Hamiltonian.
    ///
    /// # Errors
    /// It was interrupted.
    pub fn new(
        sweeper: &Sweeper<f64>,
        driven: Driven,
        times: Vec<f64>,
    ) -> Option<Result<Self, StepError>> {
        let hamiltonian = sweeper.hamiltonian();
        let sampler = match driven.sampler(hamiltonian)? {
            Ok(sampler) => sampler,
            Err(error) => return Some(Err(error)),
        };
        let size = 2 * hamiltonian.places();
        let empty = || Point {
            parts: vec![0.0; size],
            ..Point::default()
        };
        Some(Ok(Self {
            terms: Terms::new(sweeper, &driven.bounds.groups),
            sampler,
            fit: Fit::default(),
            times,
            start: empty(),
            end: empty(),
            first: 0,
            behind: 0,
            next: 0,
            is_lost: false,
            has_begun: false,
            made: 0,
            t0: 0.0,
            windows: None,
            sigma: 0.0,
            outputs: Outputs::default(),
            block: TermBlock::default(),
            factors: Vec::new(),
            state: vec![0.0; size],
            found: vec![0.0; size],
            driven,
        }))
    }

    /// The window that begins at `start`, as it was planned, its end, and its share of the tolerance.
    fn planned(&mut self) -> Result<(Window, f64, Share), StepError> {
        let (t, last) = (self.start.t, self.times[self.times.len() - 1]);
        if self.windows.is_none() {
            let (hamiltonian, span) = (self.sampler.hamiltonian(), (self.t0, last));
            self.windows = self.driven.windows(hamiltonian, span).transpose()?;
        }
        let planned = self.windows.as_ref().and_then(|found| found.at(t));
        let planned = planned.ok_or(StepError::Interrupted)?;
        let (rate, whole) = (self.driven.rate, self.driven.rate * (last - self.t0).abs());
        let (end, share) = (planned.next, Share::after(0, rate, whole));
        let window = Window {
            h: end - t,
            ..planned.window
        };
        Ok((window, end, share))
    }

    /// Makes the window that begins at `start`, and the outputs in it.
    fn make(&mut self) -> Result<(), StepError> {
        let t = self.start.t;
        let (mut window, end, share) = self.planned()?;
        let recorder = self.terms.sweeper().recorder().cloned();
        let mut count = None;
        if let Some(recorder) = &recorder {
            let (start, phase) = (&self.start.parts, self.start.phase);
            let (form, terms, parts) = recorder.begin(self.made, start, phase)?;
            (window.form, count) = (form, Some(terms));
            window.h /= parts;
        }
        loop {
            let next = self.lay_out(t, end, window);
            window.h = self.factors[self.factors.len() - 1].s;
            if self.expand(&window, share.tail(window.h), count)? {
                if let Some(recorder) = &recorder {
                    let all = self.terms.taken();
                    let unkept = recorder.keep(self.made, all);
                    self.terms.reuse(unkept);
                }
                self.made += 1;
                let mut parts = std::mem::take(&mut self.end.parts);
                self.read(self.factors.len() - 1, &mut parts);
                self.end.parts = parts;
                self.finish(&window, next);
                return Ok(());
            }
            // where Bessel functions do not converge, powers do
            window = self.sampler.window(t, end - t, share, true)?.window;
        }
    }

    /// Ends a window.
    fn finish(&mut self, window: &Window, next: f64) {
        self.sigma = window.sigma;
        self.end.t = next;
        self.end.phase = (self.start.phase + window.sigma * window.h) % TAU;
    }

    /// Finds the outputs of a window, no more than there may be, and its end.
    fn lay_out(&mut self, t: f64, end: f64, window: Window) -> f64 {
        let mut next = next_time(t, window.h, end);
        let is_in = |time: &f64| (time - t).abs() <= (next - t).abs();
        let inside = self.times[self.first..].iter().take_while(|x| is_in(x));
        self.behind = self.first + inside.count();
        if self.behind > self.first + OUTPUTS {
            self.behind = self.first + OUTPUTS;
            next = self.times[self.behind - 1];
        }
        let window = Window {
            h: next - t,
            ..window
        };
        let times = self.times[self.first..self.behind].iter().copied();
        self.factors.clear();
        let lengths = times.map(|time| time - t).chain([next - t]);
        self.factors
            .extend(lengths.map(|s| Factors::new(&window, s)));
        next
    }

    /// Makes so many terms and keeps them, or terms until they are below the share of the tolerance; false where these do not
    /// fall.
    fn expand(
        &mut self,
        window: &Window,
        share: f64,
        count: Option<usize>,
    ) -> Result<bool, StepError> {
        let at = (self.start.t, window.h);
        self.sampler.fit(at, window.degree, &mut self.fit)?;
        let size = self.start.parts.len();
        self.outputs.reset(size, self.factors.len())?;
        self.block.reset(size, AT_ONCE)?;
        let (degree, start) = (self.fit.degree, &self.start.parts);
        self.terms
            .begin_keeping(count.unwrap_or(0), window, degree, start);
        let theta = window.beta * window.h.abs();
        let norm = dot(&self.start.parts, &self.start.parts).sqrt();
        let share_of_norm = share.max(f64::EPSILON / 8.0) * norm;
        let sizes = match window.form {
            Form::Powers => self.sampler.sizes_from_start(at.0, window, &self.fit),
            Form::Bessel => Vec::new(),
        };
        let (mut n, mut small, mut lengths) = (0, 0, Vec::new());
        loop {
            let newest = self.terms.newest();
            self.block.set(n % AT_ONCE, newest);
            let factor = match self.factors.last() {
                Some(last) => last.of(window, n).abs(),
                None => 1.0,
            };
            let length = dot(newest, newest).sqrt();
            let size = length * factor;
            // Bessel functions that are taken for zero at any output are nothing for terms below this
            let is_lost = ROUNDING * size > share * norm || CUT * length > share * norm;
            if window.form == Form::Bessel && is_lost && count.is_none() {
                return Ok(false);
            }
            lengths.push(length);
            let is_small = n as f64 > theta && size <= END * share_of_norm;
            small = if is_small { small + 1 } else { 0 };
            let is_last = match (count, window.form) {
                (Some(count), _) => n + 1 == count,
                (None, Form::Powers) => rest_of_powers(&sizes, &lengths) <= share_of_norm,
                (None, Form::Bessel) => small == 2,
            };
            if is_last || n % AT_ONCE == AT_ONCE - 1 {
                self.add(window, n)?;
            }
            if is_last {
                return Ok(true);
            }
            let is_endless = count.is_none() && n > 3 * window.last + 50;
            if !size.is_finite() || is_endless {
                if window.form == Form::Bessel && count.is_none() {
                    return Ok(false);
                }
                let (t, start) = (self.start.t, norm);
                return Err(StepError::Norm {
                    norm: size,
                    start,
                    t,
                });
            }
            self.terms.advance(window, &self.fit)?;
            n += 1;
        }
    }

    /// Adds the terms of the present block, up to n, to all outputs.
    fn add(&mut self, window: &Window, n: usize) -> Result<(), StepError> {
        self.block.clear_weights();
        let first = n - n % AT_ONCE;
        for factors in &self.factors {
            let weights = (first..=n).map(|n| factors.of(window, n));
            self.block.push_weights(weights);
        }
        let sweeper = self.terms.sweeper();
        sweeper.add_terms(&self.block, &mut self.outputs, false)
    }

    /// Sets `out` to an output.
    fn read(&mut self, output: usize, out: &mut [f64]) {
        self.outputs.read(output, 0, out);
        self.outputs.read(output, 1, &mut self.state);
        for (out, x) in out.iter_mut().zip(&self.state) {
            *out += x;
        }
    }

    /// Begins at a state, where this is the first step.
    fn begin(&mut self, t: f64, state: &Wave<f64>) {
        if self.has_begun {
            return;
        }
        let n = state.q.len();
        self.end.parts[..n].copy_from_slice(&state.q);
        self.end.parts[n..].copy_from_slice(&state.p);
        (self.end.t, self.end.phase) = (t, state.phase);
        self.t0 = t;
        self.has_begun = true;
    }
}

impl Stepper for DrivenSeries {
    type State = Wave<f64>;

    fn step(&mut self, t: f64, h: f64, state: &mut Wave<f64>) -> Result<(), StepError> {
        self.begin(t, state);
        while self.is_lost || self.next >= self.behind {
            if !self.is_lost {
                self.start.clone_from(&self.end);
                self.first = self.behind;
            }
            let before = self.terms.products;
            self.make()?;
            if self.is_lost {
                // these were counted before the run was saved
                self.terms.products = before;
                self.is_lost = false;
            }
        }
        let output = self.next - self.first;
        let mut parts = std::mem::take(&mut self.found);
        self.read(output, &mut parts);
        self.found = parts;
        let (q, p) = self.found.split_at(state.q.len());
        guard(squares(q, p), state.start, self.driven.tolerance, t + h)?;
        state.q.copy_from_slice(q);
        state.p.copy_from_slice(p);
        state.phase = self.start.phase;
        state.add_phase(self.sigma * self.factors[output].s);
        self.next += 1;
        Ok(())
    }

    fn stats(&self) -> Stats {
        Stats {
            evaluations: 2 * self.terms.products,
            ..Stats::default()
        }
    }
}

/// Within a window its start is saved, and its outputs are made again.
impl Checkpoint for DrivenSeries {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        (self.has_begun, self.t0).save(member, out);
        (self.first, self.next).save(member, out);
        self.start.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let mut place = ((false, 0.0), (0, 0));
        place.restore(member, saved)?;
        ((self.has_begun, self.t0), (self.first, self.next)) = place;
        self.start.restore(member, saved)?;
        let is_fitting = self.first <= self.next && self.next <= self.times.len();
        if !is_fitting {
            return Err(CheckpointMismatch);
        }
        self.is_lost = self.has_begun;
        Ok(())
    }
}
