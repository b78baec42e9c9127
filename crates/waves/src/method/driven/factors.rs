//! Coefficients of the terms of a series at its outputs.

use super::choice::{Form, Window};
use crate::method::bessel::bessel_to_the_last;

/// The coefficients of the terms at an output, and where it is.
#[derive(Clone, Debug)]
pub(in crate::method) struct Factors {
    /// Time from the start of the window.
    pub(in crate::method) s: f64,
    bessel: Vec<f64>,
}

impl Factors {
    pub(in crate::method) fn new(window: &Window, s: f64) -> Self {
        let mut values = Vec::new();
        if window.form == Form::Bessel {
            let x = window.beta * s;
            values = bessel_to_the_last(x.abs());
            if x < 0.0 {
                values.iter_mut().skip(1).step_by(2).for_each(|x| *x = -*x);
            }
        }
        let bessel = values;
        Self { s, bessel }
    }

    /// The factor of the term n.
    pub(in crate::method) fn of(&self, window: &Window, n: usize) -> f64 {
        match window.form {
            #[expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap)]
            Form::Powers => (self.s / window.h).powi(n as i32),
            Form::Bessel => self.bessel.get(n).copied().unwrap_or(0.0),
        }
    }
}
