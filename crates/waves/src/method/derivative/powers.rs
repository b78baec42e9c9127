//! Multiplication of a series by powers of the time, transposed.
//!
//! With z_m of falling m, u^0 = z and u^l = S^T u^{l−1}, where S takes the coefficients of ψ to those of (s/h) ψ:
//!
//!     powers:  u^l_m = z_{m+l}
//!     Bessel:  u^l_m = (2(m + 1)/βh) u^{l−1}_{m+1} − u^l_{m+2}

use crate::method::driven::choice::{Form, Window};

/// The powers u^l_m of the newest m.
pub(super) struct TransposedPowers {
    /// Of powers z of the last m, in a ring; of Bessel functions u^l of even m and of odd m, one l after another.
    kept: Vec<Vec<f64>>,
    m: usize,
}

impl TransposedPowers {
    /// Begins with nothing, for powers up to a degree of vectors of a size.
    pub(super) fn new(form: Form, degree: usize, size: usize) -> Self {
        let count = match form {
            Form::Powers => degree + 1,
            Form::Bessel => 2 * (degree + 1),
        };
        Self {
            kept: vec![vec![0.0; size]; count],
            m: 0,
        }
    }

    fn place(&self, form: Form, l: usize, m: usize) -> usize {
        match form {
            Form::Powers => (m + l) % self.kept.len(),
            Form::Bessel => 2 * l + m % 2,
        }
    }

    /// Goes on to the next lower m, and returns the place for its z.
    pub(super) fn begin(&mut self, window: &Window, m: usize) -> &mut Vec<f64> {
        self.m = m;
        if window.form == Form::Bessel {
            let newer = 2.0 * (m + 1) as f64 / (window.beta * window.h);
            for l in (1..self.kept.len() / 2).rev() {
                let (lower, this) = self.kept.split_at_mut(2 * l);
                let before = &lower[2 * (l - 1) + (m + 1) % 2];
                for (out, x) in this[m % 2].iter_mut().zip(before) {
                    *out = newer * x - *out;
                }
            }
        }
        let place = self.place(window.form, 0, m);
        &mut self.kept[place]
    }

    /// u^l of the newest m.
    pub(super) fn power(&self, form: Form, l: usize) -> &[f64] {
        &self.kept[self.place(form, l, self.m)]
    }
}
