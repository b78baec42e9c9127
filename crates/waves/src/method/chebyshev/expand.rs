//! The terms of a series, added up at all outputs of a window.

use super::super::bessel::series_into;
use super::super::observe::dot;
use super::super::{Move, Sink, squares};
use super::{Chebyshev, Series};
use crate::problem::Update;
use liouville_base::error::StepError;
use liouville_base::run::{refill, resize};
use liouville_base::simd::Stored;

/// Relative growth of T_k(G) u that is no rounding error, and the part of k² ε that is one.
const GROWTH: (f64, f64) = (1e-9, 4.0);

/// Moves between two checks of the length of T_k(G) u.
const AT_ONCE: usize = 32;

/// Bounds are moved out beyond an energy by this part of their distance.
const BEYOND: f64 = 0.01;

/// A window is begun again with wider bounds so often.
const AGAIN: usize = 16;

/// Windows whose coefficients are kept, where they have one output.
const KEPT: usize = 8;

/// Whether a series went to its end.
#[derive(Clone, Copy, PartialEq)]
enum Expanded {
    Yes,
    /// A term was too long: the newest one, in the array of even or of odd ones.
    Grown(usize),
}

impl<S: Stored> Chebyshev<S> {
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
            self.spare.append(&mut self.kept);
        }
        if self.kept.len() == KEPT {
            self.spare.push(self.kept.remove(0));
        }
        let whole = self.lengths.last().map_or(0.0, |length| length.abs());
        let tolerance = self.rate * whole;
        let mut series = self.spare.pop().unwrap_or_default();
        series.lengths.clone_from(&self.lengths);
        series.c.resize_with(self.lengths.len(), Vec::new);
        let recorder = self.sweeper.recorder();
        let least = recorder.map_or(0, |recorder| recorder.least(self.beta * whole));
        for (c, s) in series.c.iter_mut().zip(&self.lengths) {
            series_into(self.beta * s, (tolerance, least), c);
        }
        self.kept.push(series);
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
        resize(&mut self.turns[1], size, S::splat(0.0))?;
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
        let rows = self.sweeper.hamiltonian().size();
        if self.lengths.len() == 1 {
            for sum in &mut self.next {
                resize(sum, rows, S::splat(0.0))?;
            }
        } else {
            self.outputs.reset(rows, self.lengths.len())?;
            self.block.reset(rows, AT_ONCE)?;
        }
        if self.sweeper.hamiltonian().is_doubled() {
            // the terms are complex vectors (q, p): even ones are summed in (C, C'), odd ones in (S, S')
            refill(&mut self.turns[0], &parts)?;
            return self.expand(series, 0, 1.0);
        }
        for (to, part) in parts.into_iter().enumerate() {
            if is_zero(part) {
                continue;
            }
            refill(&mut self.turns[0], &[part])?;
            // −i q goes to −p, −i (i p) to q
            let expanded = self.expand(series, to, if to == 0 { -1.0 } else { 1.0 })?;
            if expanded != Expanded::Yes {
                return Ok(expanded);
            }
        }
        Ok(Expanded::Yes)
    }

    /// Makes all outputs of the window of a state, with wider bounds where these are wrong.
    pub(super) fn make(&mut self, t: f64, parts: [&[S]; 2]) -> Result<(), StepError> {
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
    pub(super) fn read(&mut self, output: usize, n: usize) -> Result<(), StepError> {
        let [even, odd] = &mut self.next;
        if self.lengths.len() > 1 {
            let rows = self.sweeper.hamiltonian().size();
            for (part, sum) in [&mut *even, &mut *odd].into_iter().enumerate() {
                if sum.len() != rows {
                    resize(sum, rows, S::splat(0.0))?;
                }
                self.outputs.read(output, part, sum);
            }
        }
        if self.sweeper.hamiltonian().is_doubled() {
            // ψ = C + S' + i (C' − S)
            let (q, p) = even.split_at_mut(n);
            add(q, 1.0, &odd[n..]);
            add(p, -1.0, &odd[..n]);
            odd.clear();
            odd.extend_from_slice(p);
            even.truncate(n);
        }
        Ok(())
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
