//! Coefficients of the (s,s)-Gauss–Lobatto SPARK methods.
//!
//!     a_ij  = ∫_0^{c_i} ℓ_j        i, j = 1..s              Gauss stage, Gauss stage
//!     ā_ij  = ∫_0^{ĉ_i} ℓ_j        i = 0..s, j = 1..s       Lobatto node, Gauss stage
//!     â_ij  = b̂_j (1 − ā_ji / b_i)  i = 1..s, j = 0..s       Gauss stage, Lobatto node
//!
//! â is the symplectic conjugate of ā; it is computed as b̂_j ā_{s−j, s+1−i} / b_i, which is the same
//! by the reflection symmetry of both formulas and free of cancellation. Source: jay2007.

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
        Self {
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
