//! Multiplication of a series by powers of the time, transposed.
//!
//! With z_m of falling m, u^0 = z and u^l = S^T u^{l−1}, where S takes the coefficients of ψ to those of (s/h) ψ:
//!
//!     powers:  u^l_m = z_{m+l}
//!     Bessel:  u^l_m = (2(m + 1)/βh) u^{l−1}_{m+1} − u^l_{m+2}

#![allow(clippy::inline_always)] // a block is compiled for one instruction set as a whole

use crate::method::blocks::take_from;
use crate::method::driven::choice::{Form, Window};
use std::ops::Range;

/// The powers u^l_m of the newest m.
#[derive(Default)]
pub(super) struct TransposedPowers {
    /// Of powers z of the last m, in a ring; of Bessel functions u^l of even m and of odd m, one l after another.
    kept: Vec<Vec<f64>>,
    /// βh, of Bessel functions.
    bessel: Option<f64>,
    m: usize,
}

impl TransposedPowers {
    /// Begins with nothing, for powers up to a degree of vectors of a size.
    pub(super) fn begin(&mut self, window: &Window, degree: usize, size: usize) {
        let is_bessel = window.form == Form::Bessel;
        self.bessel = is_bessel.then_some(window.beta * window.h);
        let count = (degree + 1) * if is_bessel { 2 } else { 1 };
        self.kept.resize_with(count, Vec::new);
        for x in &mut self.kept {
            x.clear();
            x.resize(size, 0.0);
        }
    }

    fn place(&self, l: usize) -> usize {
        match self.bessel {
            None => (self.m + l) % self.kept.len(),
            Some(_) => 2 * l + self.m % 2,
        }
    }

    /// Goes on to the next lower m, and returns the place for its z.
    pub(super) fn advance(&mut self, m: usize) -> &mut Vec<f64> {
        self.m = m;
        let place = self.place(0);
        &mut self.kept[place]
    }

    /// Makes rows of all u^l of the newest m but z.
    #[inline(always)]
    pub(super) fn make(&mut self, rows: Range<usize>) {
        let Some(theta) = self.bessel else { return };
        let (newer, m) = (2.0 * (self.m + 1) as f64 / theta, self.m);
        for place in (2..self.kept.len()).step_by(2) {
            let (lower, this) = self.kept.split_at_mut(place);
            let before = &lower[place - 2 + (m + 1) % 2];
            take_from(&mut this[m % 2][rows.clone()], newer, &before[rows.clone()]);
        }
    }

    /// Rows of u^l of the newest m.
    #[inline(always)]
    pub(super) fn power(&self, l: usize, rows: Range<usize>) -> &[f64] {
        &self.kept[self.place(l)][rows]
    }
}
