//! The flow of x_i' = c_i x_i m with m = x^j: with α = Σ c_i j_i is m' = α m², hence
//!
//!     x_i *= exp(c_i t*),   t* = −ln(1 − α h m)/α,   or h m where α = 0.

/// A piece of one monomial.
#[derive(Clone, Debug)]
pub(super) struct Exponential {
    /// Places i and rates c_i.
    pub(super) rates: Vec<(u32, f64)>,
    /// The places in x^j, with repetition.
    pub(super) monomial: Vec<u32>,
    pub(super) alpha: f64,
}

impl Exponential {
    pub(super) fn new(rates: Vec<(u32, f64)>, monomial: Vec<u32>) -> Self {
        let power = |at: u32| monomial.iter().filter(|place| **place == at).count() as f64;
        let parts = rates.iter().map(|(place, rate)| rate * power(*place));
        let (alpha, size) = parts.fold((0.0, 0.0), |(sum, size): (f64, f64), part| {
            (sum + part, size + part.abs())
        });
        // what is left of rates that cancel is roundoff
        let alpha = if alpha.abs() <= 4.0 * f64::EPSILON * size {
            0.0
        } else {
            alpha
        };
        Self {
            rates,
            monomial,
            alpha,
        }
    }
}
