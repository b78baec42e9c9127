//! Moments of values at the nodes of a quadrature formula.
//!
//!     Σ_j b_j P_{i−1}(c_j) k_j,      i = 1..s−1
//!
//! with P_k the Legendre polynomials shifted to [0, 1]: the same span as powers of c_j, but matrices made
//! of them stay well conditioned. Source: jay2006.

use crate::linalg::Matrix;

/// b_j P_{i−1}(c_j), s − 1 by s.
pub fn moments(b: &[f64], c: &[f64]) -> Matrix {
    let s = c.len();
    let mut weights = Matrix::zeros(s.saturating_sub(1), s);
    for (j, (b, c)) in b.iter().zip(c).enumerate() {
        let u = 2.0 * c - 1.0;
        let (mut p, mut next) = (1.0, u);
        for k in 0..weights.rows() {
            weights[(k, j)] = b * p;
            let degree = k as f64 + 1.0;
            let after = ((2.0 * degree + 1.0) * u * next - degree * p) / (degree + 1.0);
            (p, next) = (next, after);
        }
    }
    weights
}
