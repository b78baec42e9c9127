//! Coefficients of the (s,s)-Gauss–Lobatto SPARK methods.
//!
//!     a_ij  = ∫_0^{c_i} ℓ_j        i, j = 1..s              Gauss stage, Gauss stage
//!     ā_ij  = ∫_0^{ĉ_i} ℓ_j        i = 0..s, j = 1..s       Lobatto node, Gauss stage
//!     â_ij  = b̂_j (1 − ā_ji / b_i)  i = 1..s, j = 0..s       Gauss stage, Lobatto node
//!
//! â is the symplectic conjugate of ā; it is computed as b̂_j ā_{s−j, s+1−i} / b_i, which is the same
//! by the reflection symmetry of both formulas and free of cancellation. Source: jay2007.
//!
//! Steps use the coefficients divided by their weights, μ_ij = a_ij / b_j, μ̄_ij = ā_ij / b_j and
//! μ̂_ij = â_ij / b̂_j, for which symplecticity reads
//!
//!     μ_ij + μ_ji = 1,    μ̂_ij + μ̄_ji = 1
//!
//! and holds exactly in f64: of each pair the larger is rounded, and 1 minus it is exact. Rounded
//! coefficients without that would cost a linear drift of the energy. Source: hairer2008,
//! antonana2017.

use super::collocation::{gauss, integrals, lobatto};
use crate::linalg::Matrix;
use twofloat::TwoFloat;

/// Coefficients of the (s,s)-Gauss–Lobatto SPARK method; see the module for the letters.
#[derive(Clone, Debug)]
pub struct GaussLobatto {
    /// Number s of Gauss stages.
    pub stages: usize,
    /// a, s by s.
    pub a: Matrix,
    /// b, the Gauss weights.
    pub b: Vec<f64>,
    /// c, the Gauss nodes.
    pub c: Vec<f64>,
    /// ā, (s+1) by s.
    pub a_bar: Matrix,
    /// â, s by (s+1); its last column is zero.
    pub a_hat: Matrix,
    /// b̂, the Lobatto weights.
    pub b_hat: Vec<f64>,
    /// ĉ, the Lobatto nodes.
    pub c_hat: Vec<f64>,
    /// μ = a / b, s by s.
    pub mu: Matrix,
    /// μ̄ = ā / b, (s+1) by s.
    pub mu_bar: Matrix,
    /// μ̂ = â / b̂, s by (s+1).
    pub mu_hat: Matrix,
}

impl GaussLobatto {
    /// The coefficients for `s` stages.
    ///
    /// # Panics
    /// When `s` is zero.
    pub fn new(s: usize) -> Self {
        assert!(s > 0, "a SPARK method has at least one stage");
        let (gauss, lobatto) = (gauss(s), lobatto(s));
        let rows = |nodes: &[TwoFloat]| -> Vec<Vec<TwoFloat>> {
            nodes.iter().map(|x| integrals(&gauss, *x)).collect()
        };
        let (a, mut a_bar) = (rows(&gauss.nodes), rows(&lobatto.nodes));
        a_bar[s].clone_from(&gauss.weights);
        let a_hat =
            |i: usize, j: usize| lobatto.weights[j] * a_bar[s - j][s - 1 - i] / gauss.weights[i];
        let round = |x: &[TwoFloat]| x.iter().map(|x| f64::from(*x)).collect();
        let mu = |i: usize, j: usize| a[i][j] / gauss.weights[j];
        let mu_bar = |i: usize, j: usize| a_bar[i][j] / gauss.weights[j];
        Self {
            mu: Matrix::from_fn(s, s, |i, j| complementary(mu(i, j), mu(j, i))),
            mu_bar: Matrix::from_fn(s + 1, s, |i, j| {
                complementary(mu_bar(i, j), 1.0 - mu_bar(i, j))
            }),
            mu_hat: Matrix::from_fn(s, s + 1, |i, j| {
                complementary(1.0 - mu_bar(j, i), mu_bar(j, i))
            }),
            stages: s,
            a: Matrix::from_fn(s, s, |i, j| a[i][j].into()),
            b: round(&gauss.weights),
            c: round(&gauss.nodes),
            a_bar: Matrix::from_fn(s + 1, s, |i, j| a_bar[i][j].into()),
            a_hat: Matrix::from_fn(s, s + 1, |i, j| a_hat(i, j).into()),
            b_hat: round(&lobatto.weights),
            c_hat: round(&lobatto.nodes),
        }
    }
}

/// `x` as an f64 such that it and its partner, 1 − x, add up to exactly 1.
fn complementary(x: TwoFloat, partner: TwoFloat) -> f64 {
    if x > partner {
        f64::from(x)
    } else {
        1.0 - f64::from(partner)
    }
}
