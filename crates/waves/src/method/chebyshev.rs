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
//! real vectors, any other ψ two, one after another. At one output terms are added up where they are made, at
//! several in blocks of copies.
//!
//! Within the bounds no T_k(G) u is longer than u. One that is proves that the spectrum reaches out of them, and is
//! almost an eigenvector there: the window begins again with wider bounds. Source: talezer1984.

use super::bessel::series;
use super::observe::dot;
use super::sweep::{Outputs, TermBlock};
use super::windows::{Place, Windows};
use super::{Move, Sink, Sweeper, Wave, guard, squares};
use crate::problem::Update;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use liouville_base::simd::Stored;

/// Relative growth of T_k(G) u that is no rounding error, and the part of k² ε that is one.
const GROWTH: (f64, f64) = (1e-9, 4.0);

/// Moves between two checks of the length of T_k(G) u.
const AT_ONCE: usize = 32;

/// Bounds are moved out beyond an energy by this part of their distance.
const BEYOND: f64 = 0.01;

/// A window is begun again with wider bounds so often.
const AGAIN: usize = 16;

/// The coefficients of a window of these lengths, for each of its outputs.
#[derive(Clone, Debug)]
struct Series {
    lengths: Vec<f64>,
    c: Vec<Vec<f64>>,
}

/// Windows whose coefficients are kept, where they have one output.
const KEPT: usize = 8;

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
    is_doubled: bool,
    kept: Vec<Series>,
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

/// Whether a series went to its end.
#[derive(Clone, Copy, PartialEq)]
enum Expanded {
    Yes,
    /// A term was too long: the newest one, in the array of even or of odd ones.
    Grown(usize),
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
            is_doubled: false,
            kept: Vec::new(),
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

    /// The same for a Hermitian H = A + iB, of which the sweeper knows [[A, −B], [B, A]] by its products
    /// with (q, p): the terms are complex vectors then.
    #[must_use]
    pub fn hermitian(self) -> Self {
        let is_doubled = true;
        Self { is_doubled, ..self }
    }

    /// The same with several outputs from a series; steps are from each output to the next.
    #[must_use]
    pub fn with_windows(self, windows: Windows) -> Self {
        let mut series = Self { windows, ..self };
        if series.windows.most() > 1 {
            let rows = series.sweeper.hamiltonian().size();
            let n = if series.is_doubled { rows / 2 } else { rows };
            series.start.parts = [vec![S::splat(0.0); n], vec![S::splat(0.0); n]];
        }
        series
    }

    /// The sweeper of the products.
    pub fn sweeper_mut(&mut self) -> &mut Sweeper<S> {
        &mut self.sweeper
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
        self.kept.clear();
    }

    /// The place of the coefficients for the present lengths.
    fn series_for(&mut self) -> usize {
        let is_same = |series: &Series| {
            let lengths = series.lengths.iter().zip(&self.lengths);
            series.lengths.len() == self.lengths.len()
                && lengths
                    .map(|(a, b)| (a.to_bits(), b.to_bits()))
                    .all(|(a, b)| a == b)
        };
        if let Some(place) = self.kept.iter().position(is_same) {
            return place;
        }
        if self.lengths.len() > 1 {
            self.kept.clear();
        }
        if self.kept.len() == KEPT {
            self.kept.remove(0);
        }
        let whole = self.lengths.last().map_or(0.0, |length| length.abs());
        let tolerance = self.rate * whole;
        let each = self.lengths.iter();
        let c = each.map(|s| series(self.beta * s, tolerance)).collect();
        let lengths = self.lengths.clone();
        self.kept.push(Series { lengths, c });
        self.kept.len() - 1
    }

    /// The move that makes the term k.
    fn term(&self, k: usize) -> Move {
        let (keep, factor) = if k == 1 { (0.0, 1.0) } else { (-1.0, 2.0) };
        let factor = factor / self.beta;
        Move::new(
            k % 2 == 1,
            Update {
                keep,
                factor,
                diagonal: -factor * self.sigma,
            },
        )
    }

    /// Adds the even terms of the series of u = `turns[0]` to the part `to` of all outputs, the odd ones times `sign`
    /// to the other.
    fn expand(&mut self, series: usize, to: usize, sign: f64) -> Result<Expanded, StepError> {
        let is_alone = self.lengths.len() == 1;
        let length = squares(&self.turns[0], &self.turns[0]);
        let size = self.turns[0].len();
        let count = self.kept[series].c.iter().map(Vec::len).max();
        let count = count.unwrap_or(0);
        self.turns[1].clear();
        self.turns[1].resize(size, S::splat(0.0));
        let mut k = 0;
        while k < count {
            let last = count.min(k + AT_ONCE);
            self.moves.clear();
            for k_now in k.max(1)..last {
                let mut step = self.term(k_now);
                let c = self.kept[series].c[0].get(k_now).unwrap_or(&0.0);
                step.weight = signed(k_now, sign) * c;
                step.copy = k_now - k;
                self.moves.push(step);
            }
            let [u, v] = &mut self.turns;
            if is_alone {
                let [first, second] = &mut self.next;
                let (even, odd) = if to == 0 {
                    (first, second)
                } else {
                    (second, first)
                };
                if k == 0 {
                    add(even, self.kept[series].c[0][0], u);
                }
                (self.sweeper).run(&self.moves, u, v, Sink::Sums(even, odd))?;
            } else {
                if k == 0 {
                    self.block.set(0, u);
                }
                (self.sweeper).run(&self.moves, u, v, self.block.sink())?;
            }
            let newest = (last - 1) % 2;
            if self.has_grown(newest, length, last) {
                return Ok(Expanded::Grown(newest));
            }
            if !is_alone {
                self.block.clear_weights();
                for c in &self.kept[series].c {
                    let c = c.iter().enumerate().skip(k);
                    self.block.push_weights(c.map(|(k, c)| signed(k, sign) * c));
                }
                (self.sweeper).add_terms(&self.block, &mut self.outputs, to == 1)?;
            }
            k = last;
        }
        Ok(Expanded::Yes)
    }

    /// Whether the newest term is longer than the first, whose square is given.
    fn has_grown(&self, newest: usize, first: S, k: usize) -> bool {
        let rounding = GROWTH.1 * f64::EPSILON * (k as f64) * (k as f64);
        let most = (1.0 + GROWTH.0 + rounding).powi(2);
        let now = squares(&self.turns[newest], &self.turns[newest]);
        // not a number is longer, too
        !(0..S::MEMBERS).all(|m| now.member(m) <= most * first.member(m))
    }

    /// Makes all outputs of the window of a state.
    fn expand_parts(&mut self, parts: [&[S]; 2]) -> Result<Expanded, StepError> {
        let series = self.series_for();
        let n = parts[0].len();
        let rows = if self.is_doubled { 2 * n } else { n };
        if self.lengths.len() == 1 {
            for sum in &mut self.next {
                sum.clear();
                sum.resize(rows, S::splat(0.0));
            }
        } else {
            self.outputs.reset(rows, self.lengths.len())?;
            self.block.reset(rows, AT_ONCE)?;
        }
        if self.is_doubled {
            // the terms are complex vectors (q, p): even ones are summed in (C, C'), odd ones in (S, S')
            self.turns[0].clear();
            self.turns[0].extend_from_slice(parts[0]);
            self.turns[0].extend_from_slice(parts[1]);
            return self.expand(series, 0, 1.0);
        }
        for (to, part) in parts.into_iter().enumerate() {
            if is_zero(part) {
                continue;
            }
            self.turns[0].clear();
            self.turns[0].extend_from_slice(part);
            // −i q goes to −p, −i (i p) to q
            let expanded = self.expand(series, to, if to == 0 { -1.0 } else { 1.0 })?;
            if expanded != Expanded::Yes {
                return Ok(expanded);
            }
        }
        Ok(Expanded::Yes)
    }

    /// Makes all outputs of the window of a state, with wider bounds where these are wrong.
    fn make(&mut self, t: f64, parts: [&[S]; 2]) -> Result<(), StepError> {
        let mut left = AGAIN;
        loop {
            let Expanded::Grown(newest) = self.expand_parts(parts)? else {
                return Ok(());
            };
            let refused = |series: &Self| {
                let length = |x: &[S], y: &[S]| squares(x, y).member(0).sqrt();
                let term = &series.turns[newest];
                Err(StepError::Norm {
                    norm: length(term, term),
                    start: length(parts[0], parts[1]),
                    t,
                })
            };
            // members of a block, each alone, have bounds of their own
            if !S::IS_SINGLE || left == 0 {
                return refused(self);
            }
            let Some(bounds) = self.wider(newest)? else {
                return refused(self);
            };
            self.set_bounds(bounds);
            (self.again, left) = (self.again + 1, left - 1);
        }
    }

    /// Bounds with the energy that the newest term is almost an eigenvector of; none where it is not a number.
    fn wider(&mut self, newest: usize) -> Result<Option<(f64, f64)>, StepError> {
        let [u, v] = &mut self.turns;
        let (term, product) = if newest == 0 { (u, v) } else { (v, u) };
        let largest = (term.iter()).fold(0.0_f64, |most, x| most.max(x.member(0).abs()));
        for x in &mut *term {
            x.set_member(0, x.member(0) / largest);
        }
        let factor = 1.0 / self.beta;
        let update = Update {
            keep: 0.0,
            factor,
            diagonal: -factor * self.sigma,
        };
        self.sweeper
            .run(&[Move::new(true, update)], term, product, Sink::Nothing)?;
        let numbers = |x: &[S]| -> Vec<f64> { x.iter().map(|x| x.member(0)).collect() };
        let (x, y) = (numbers(term), numbers(product));
        let (xx, xy, yy) = (dot(&x, &x), dot(&x, &y), dot(&y, &y));
        let reach = (yy / xx).sqrt();
        if !(reach.is_finite() && xy.is_finite()) {
            return Ok(None);
        }
        let (low, high) = self.bounds;
        let more = 2.0 * self.beta * BEYOND;
        let out = self.beta * (reach - 1.0).max(0.0) + more;
        Ok(Some(if xy < 0.0 {
            (low - out, high)
        } else {
            (low, high + out)
        }))
    }

    /// Sets `next` to an output.
    fn read(&mut self, output: usize, n: usize) {
        let [even, odd] = &mut self.next;
        if self.lengths.len() > 1 {
            let rows = if self.is_doubled { 2 * n } else { n };
            for (part, sum) in [&mut *even, &mut *odd].into_iter().enumerate() {
                sum.resize(rows, S::splat(0.0));
                self.outputs.read(output, part, sum);
            }
        }
        if self.is_doubled {
            // ψ = C + S' + i (C' − S)
            let (q, p) = even.split_at_mut(n);
            add(q, 1.0, &odd[n..]);
            add(p, -1.0, &odd[..n]);
            odd.clear();
            odd.extend_from_slice(p);
            even.truncate(n);
        }
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
        self.read(output, state.q.len());
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
        // a product of the doubled matrix is four real ones, the counterpart of two with real H
        let each = if self.is_doubled { 2 } else { 1 };
        Stats {
            evaluations: each * (self.sweeper.products() - self.repeated),
            cold_starts: self.again,
            ..Stats::default()
        }
    }
}

/// The sign of the term k: (−i)^k is 1, −i, −1, i and so on, and `sign` that of −i.
fn signed(k: usize, sign: f64) -> f64 {
    let turn = if k % 4 < 2 { 1.0 } else { -1.0 };
    if k % 2 == 1 { turn * sign } else { turn }
}

fn is_zero<S: Stored>(x: &[S]) -> bool {
    x.iter()
        .all(|x| (0..S::MEMBERS).all(|m| x.member(m) == 0.0))
}

/// `out += factor * x`
fn add<S: Stored>(out: &mut [S], factor: f64, x: &[S]) {
    for (out, x) in out.iter_mut().zip(x) {
        for m in 0..S::MEMBERS {
            out.set_member(m, out.member(m) + factor * x.member(m));
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
