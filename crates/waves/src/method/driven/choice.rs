//! The choice of windows by scalars alone, before any product.
//!
//! With H(t0 + s) = Σ_l H_l (s/h)^l and G_0 = |h| |H_0 − σ|, G_l = |h| |H_l|, the terms of the series in powers of s/h are
//! no longer than e_n of e_0 = 1, e_{n+1} = Σ_l G_l e_{n−l}/(n + 1). H is Hermitian, so that errors of windows add.

use super::fit::{Look, Sampler};
use super::levels::bessel_terms;
use super::polynomials::NODES;
use crate::method::bessel::degree;
use crate::method::term_bounds::{Interval, half};
use liouville_base::error::StepError;
use std::cmp::Ordering;
use std::f64::consts::PI;

/// Lengths of windows in units of 1/β for a series in Bessel functions, ...
const BESSEL: [f64; 6] = [32.0, 24.0, 16.0, 12.0, 8.0, 5.6];
/// ... and for one in powers, of which terms add up to no more than this.
const POWERS: [f64; 7] = [8.0, 5.6, 4.0, 2.8, 2.0, 1.4, 1.0];
pub(in crate::method) const LARGEST: f64 = 1e5;

/// The part of the tolerance for the fit, that for all windows without one, as around jumps, and that for rounding errors;
/// the rest is for the tail.
const FIT: f64 = 0.3;
const JUMPS: f64 = 0.1;
const ROUNDED: f64 = 0.05;

/// A series in Bessel functions may take one term in so many more than that of two levels.
const MORE: usize = 16;

/// This multiple of the products of a series in Bessel functions is taken for a bound.
const BOUND: f64 = 1.05;

/// Bounds by the parts alone are tried, too, where they are so many times as wide. It is of speed only: windows by either
/// keep to the tolerance, and the cheaper one is taken.
const WIDER: f64 = 1.05;

/// Most terms of a series, and halvings of a window.
const TERMS: usize = 400;
const HALVINGS: usize = 60;

/// The series of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::method) enum Form {
    /// In powers of s/h.
    Powers,
    /// In Bessel functions of βs.
    Bessel,
}

/// A window: its length, its series and their sizes.
#[derive(Clone, Copy, Debug)]
pub(in crate::method) struct Window {
    pub(in crate::method) h: f64,
    pub(in crate::method) form: Form,
    /// In time.
    pub(in crate::method) degree: usize,
    /// The last term: of powers at most, of Bessel functions about.
    pub(in crate::method) last: usize,
    pub(in crate::method) sigma: f64,
    pub(in crate::method) beta: f64,
}

impl Window {
    fn new(h: f64, form: Form, degree: usize, bounds: Interval, last: usize) -> Self {
        Self {
            h,
            form,
            degree,
            last,
            sigma: f64::midpoint(bounds.0, bounds.1),
            beta: half(bounds),
        }
    }
}

/// The tolerance of all windows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Share {
    /// Error allowed in a unit of time.
    pub(super) rate: f64,
    /// Share of a window without a fit.
    jump: f64,
}

impl Share {
    /// Share of windows after `jumps` windows without a fit; the shares add up for any number of them.
    pub(super) fn after(jumps: usize, rate: f64, whole: f64) -> Self {
        let count = jumps as f64 + 1.0;
        let jump = JUMPS * whole * 6.0 / (PI * count).powi(2);
        Self { rate, jump }
    }

    /// The error of a window beyond its share: by rounding errors of a sum of terms, and of the time where functions are
    /// fitted.
    fn beyond(self, h: f64, left_out: f64, sum: f64) -> f64 {
        let fit = (left_out - FIT * self.rate).max(0.0);
        let rounded = f64::EPSILON * sum - ROUNDED * self.rate * h.abs();
        fit * h.abs() + rounded.max(0.0)
    }

    /// The error that the tail of a window may have.
    pub(super) fn tail(self, h: f64) -> f64 {
        (1.0 - FIT - JUMPS - ROUNDED) * self.rate * h.abs()
    }
}

impl Sampler {
    /// The next window from t on, where `left` is left to the end.
    ///
    /// # Errors
    /// H is not finite.
    pub(super) fn window(
        &mut self,
        t: f64,
        left: f64,
        share: Share,
        is_plain: bool,
    ) -> Result<Choice, StepError> {
        loop {
            let choice = self.looked(t, left, share, is_plain)?;
            let Window { h, degree, .. } = choice.window;
            // as much as is left out of points that are looked at, and at a jump of the time beside it
            let points = self.misfits((t, h), degree, 2.0 * choice.left_out)?;
            if points.is_empty() {
                return Ok(choice);
            }
            self.look_at(points);
        }
    }

    /// The same by the points of the potential that are looked at.
    fn looked(
        &mut self,
        t: f64,
        left: f64,
        share: Share,
        is_plain: bool,
    ) -> Result<Choice, StepError> {
        let beta = half(self.bounds_at((t, left)));
        if !beta.is_finite() {
            let (theta, most) = (beta, BESSEL[0]);
            return Err(StepError::Spectrum { theta, most, t });
        }
        // equal parts of what is left, each once
        let part = |theta: &f64| left / (left.abs() * beta / theta).ceil().max(1.0);
        let parts = |thetas: &[f64]| {
            let mut parts: Vec<f64> = thetas.iter().map(part).collect();
            parts.dedup();
            parts
        };
        let mut found: Vec<Choice> = Vec::new();
        let mut is_constant = false;
        for h in parts(&BESSEL).into_iter().filter(|_| !is_plain) {
            let Some(window) = self.in_bessel(t, h, share) else {
                continue;
            };
            // constant on the window: no shorter one takes fewer products
            is_constant = window.window.degree == 0 && !self.passes(t, &window);
            found.push(window);
            if is_constant {
                break;
            }
        }
        let powers = parts(&POWERS).into_iter().chain(self.to_knot(t, left));
        for h in powers.filter(|_| !is_constant) {
            found.extend(self.in_powers(t, h, FIT * share.rate, share));
        }
        found.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
        for window in found {
            if !self.passes(t, &window) {
                return Ok(window);
            }
        }
        let mut h = part(&POWERS[POWERS.len() - 1]);
        for _ in 0..HALVINGS {
            let refused = Some(t + h);
            h *= 0.5;
            for (tolerance, is_jump) in [(FIT * share.rate, false), (share.jump / h.abs(), true)] {
                let window = self.in_powers(t, h, tolerance, share);
                if let Some(window) = window.filter(|window| !self.passes(t, window)) {
                    let beyond = if is_jump { 0.0 } else { window.beyond };
                    return Ok(Choice {
                        refused,
                        is_jump,
                        beyond,
                        ..window
                    });
                }
            }
        }
        let (theta, most) = (f64::NAN, BESSEL[0]);
        Err(StepError::Spectrum { theta, most, t })
    }

    /// Whether a window passes over a value that was seen before the run.
    fn passes(&mut self, t: f64, choice: &Choice) -> bool {
        let Window { h, degree, .. } = choice.window;
        // terms that are left out are below that, and what its nodes do not see is no larger
        self.passes_over((t, h), (NODES, degree + 1), 2.0 * choice.left_out)
    }

    fn in_bessel(&mut self, t: f64, h: f64, share: Share) -> Option<Choice> {
        let look = self.look(t, h, FIT * share.rate)?;
        let close = self.in_bessel_by(&look, look.bounds, h, share);
        // where H changes much its terms are smaller in units of a larger β
        let is_wider = half(look.wider) > WIDER * half(look.bounds) && look.degree > 0;
        let wider = is_wider.then(|| self.in_bessel_by(&look, look.wider, h, share));
        let both = close.into_iter().chain(wider.flatten());
        let choice = |window| Choice {
            window,
            left_out: look.left_out,
            refused: None,
            is_jump: false,
            beyond: share.beyond(h, look.left_out, 0.0),
        };
        (both.map(choice)).min_by(|a, b| a.cost().total_cmp(&b.cost()))
    }

    fn in_bessel_by(&self, look: &Look, bounds: Interval, h: f64, share: Share) -> Option<Window> {
        let beta = half(bounds);
        // it ends after two terms that are small
        let mut last = degree(beta * h.abs(), share.tail(h)) + 2;
        if look.degree > 0 {
            for levels in self.levels(&look.fit, bounds) {
                let found = bessel_terms(&levels, beta * h, beta, share.tail(h))?;
                last = last.max(found + found / MORE);
            }
        }
        Some(Window::new(h, Form::Bessel, look.degree, bounds, last))
    }

    fn in_powers(&mut self, t: f64, h: f64, tolerance: f64, share: Share) -> Option<Choice> {
        let look = self.look(t, h, tolerance)?;
        let sigma = f64::midpoint(look.bounds.0, look.bounds.1);
        let (low, high) = look.first;
        let first = (high - sigma).abs().max((low - sigma).abs());
        let sizes: Vec<f64> = std::iter::once(&first)
            .chain(&look.sizes)
            .map(|size| h.abs() * size)
            .collect();
        let (last, sum) = last_term(&sizes, share.tail(h))?;
        let window = Window::new(h, Form::Powers, look.degree, look.bounds, last);
        Some(Choice {
            window,
            left_out: look.left_out,
            refused: None,
            is_jump: false,
            beyond: share.beyond(h, look.left_out, sum),
        })
    }
}

/// A window, and what its polynomials leave out at most, in energies.
#[derive(Clone, Copy, Debug)]
pub(super) struct Choice {
    pub(super) window: Window,
    left_out: f64,
    /// The end of a longer one that was refused, as one over a jump, which is nearer than others then.
    pub(super) refused: Option<f64>,
    /// Whether it is without a fit, as one around a jump.
    pub(super) is_jump: bool,
    /// Its error beyond its share of the tolerance, at most.
    pub(super) beyond: f64,
}

impl Choice {
    /// Products for a length; powers have a bound, for which they may take some more.
    fn cost(&self) -> f64 {
        let factor = if self.window.form == Form::Powers {
            1.0
        } else {
            BOUND
        };
        factor * self.window.last as f64 / self.window.h.abs()
    }
}

/// The term with which a series in powers has ended, where the rest is below a tolerance, and the sum of all. None where
/// terms are too large or too many.
fn last_term(sizes: &[f64], tolerance: f64) -> Option<(usize, f64)> {
    let tolerance = tolerance.max(f64::EPSILON / 8.0);
    let mut terms = vec![1.0];
    let mut sum = 1.0;
    while terms.len() < TERMS {
        if rest_of_powers(sizes, &terms) <= tolerance {
            return Some((terms.len() - 1, sum));
        }
        let products = sizes.iter().zip(terms.iter().rev());
        let next = products.map(|(size, term)| size * term).sum::<f64>() / terms.len() as f64;
        terms.push(next);
        sum += next;
        if sum > LARGEST || sum.is_nan() {
            return None;
        }
    }
    None
}

/// Largest remainder of a series in powers behind terms of these lengths, with G_l = `sizes`.
///
/// The sum of (n + 1) |c_{n+1}| <= Σ_l G_l |c_{n−l}| over all n from the last term on has the rest R on both sides:
/// (n + 1) R <= Σ_l G_l (R + |c_n| + ... + |c_{n−l}|). Single terms say nothing: where H begins with s², two of three are zero.
pub(in crate::method) fn rest_of_powers(sizes: &[f64], terms: &[f64]) -> f64 {
    let all: f64 = sizes.iter().sum();
    let next = terms.len() as f64;
    if all.partial_cmp(&next) != Some(Ordering::Less) {
        return f64::INFINITY;
    }
    let newest = terms.iter().rev().chain(std::iter::repeat(&0.0));
    let pairs = sizes.iter().zip(newest);
    let (_, behind) = pairs.fold((0.0, 0.0), |(sum, behind), (size, term)| {
        let sum = sum + term;
        (sum, size.mul_add(sum, behind))
    });
    behind / (next - all)
}
