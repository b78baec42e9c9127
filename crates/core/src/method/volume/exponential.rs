//! The flow of x_i' = c_i x_i m with m = x^j: with α = Σ c_i j_i is m' = α m², hence
//!
//!     x_i *= exp(c_i t*),   t* = −ln(1 − α h m)/α,   or h m where α = 0.
//!
//! Where α ≠ 0 this is (1 − α h m)^(−c_i/α); exponents that are multiples of 1, 1/2 or 1/3, as they are
//! for small integer rates, need a root and some products only.

use crate::real::Scalar;
use crate::vector::Number;

/// A piece of one monomial.
#[derive(Clone, Debug)]
pub(super) struct Exponential {
    /// Places i and rates c_i.
    pub(super) rates: Vec<(u32, f64)>,
    /// The places in x^j, with repetition.
    pub(super) monomial: Vec<u32>,
    pub(super) alpha: f64,
    pub(super) roots: Option<Roots>,
}

/// Exponents −c_i/α = a − b/q.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Roots {
    pub(super) q: u32,
    /// Place, a and b of each variable.
    pub(super) powers: Vec<(u32, u32, u32)>,
}

/// Largest power that is taken by products.
const LARGEST_POWER: f64 = 12.0;

impl Roots {
    fn new(rates: &[(u32, f64)], alpha: f64) -> Option<Self> {
        (1..=3_u32).find_map(|q| {
            let powers = rates.iter().map(|(place, rate)| {
                let wanted = -rate / alpha * f64::from(q);
                let found = wanted.round();
                let is_near = (wanted - found).abs() <= 4.0 * f64::EPSILON * wanted.abs();
                let whole = (found / f64::from(q)).ceil().max(0.0);
                let rest = whole * f64::from(q) - found;
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 to 12
                (is_near && whole <= LARGEST_POWER && rest <= LARGEST_POWER).then_some((
                    *place,
                    whole as u32,
                    rest as u32,
                ))
            });
            let powers = powers.collect::<Option<Vec<_>>>()?;
            Some(Self { q, powers })
        })
    }
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
        let roots = if alpha == 0.0 {
            None
        } else {
            Roots::new(&rates, alpha)
        };
        Self {
            rates,
            monomial,
            alpha,
            roots,
        }
    }
    /// The first trajectory, from `first` on, whose flow of length `h` reaches infinity.
    #[cold]
    pub(super) fn too_long<S: Scalar>(&self, h: f64, x: &[S], first: usize) -> Option<usize> {
        (first..S::MEMBERS).find(|member| {
            let factors = self.monomial.iter();
            let factors = factors.map(|place| x[*place as usize].member(*member));
            !(factors.product::<f64>() * (self.alpha * h)).is_below(1.0)
        })
    }
}
