//! Radau SPARK: the s Radau points as stages, the s + 1 Lobatto points as nodes, order 2s − 1.
//!
//!     aᵛ = aᶠ = aʳ = ∫_0^{c_i} ℓ_j,    c_s = 1       Radau IIA
//!     ā_ij = ∫_0^{ĉ_i} ℓ_j,    â_ij = b̂_j (1 − ā_ji / b_i)
//!
//! Neither symmetric nor symplectic: without constraints it is Radau IIA, which damps whatever is
//! stiff. Its reactions keep Σ_j â_ij ĉ_j^{q−1} = c_i^q / q for q < s, one power less than with Gauss
//! stages. Source: hairer1996, IV.5.

use super::collocation::{lobatto, radau};
use super::known::{Family, Key};
use super::spark::{Between, Coefficients, Spark, rows};
use crate::linalg::Matrix;

impl Spark {
    /// The method with `s` Radau stages.
    ///
    /// # Panics
    /// When `s` is zero.
    pub fn radau(s: usize) -> Self {
        assert!(s > 0, "a SPARK method has at least one stage");
        Self::once(Key(Family::Radau, s), || Coefficients::radau(s))
    }
}

impl Coefficients {
    fn radau(s: usize) -> Self {
        let stages = radau(s);
        let mut a = rows(&stages, &stages.nodes);
        a[s - 1].clone_from(&stages.weights);
        let all = Between {
            a: Matrix::from_fn(s, s, |i, j| a[i][j].into()),
            mu: Matrix::from_fn(s, s, |i, j| (a[i][j] / stages.weights[j]).into()),
        };
        let method = Self::with(&stages, &lobatto(s), [all.clone(), all.clone(), all]);
        let a_hat = |i: usize, j: usize| method.b_hat[j] * method.mu_hat[(i, j)];
        Self {
            a_hat: Matrix::from_fn(s, s + 1, a_hat),
            ..method
        }
    }
}
