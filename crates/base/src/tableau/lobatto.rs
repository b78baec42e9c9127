//! Lobatto pairs: the S Lobatto points are stages and nodes at once, order 2S − 2.
//!
//!     A    ∫_0^{c_i} ℓ_j                                   positions, always
//!     B    b_j (1 − A_ji / b_i)                            reactions, always
//!     C    A_ij + (1 − A_i1 / b_1) b_j P(c_j) / P(0)       Σ_j C_ij c_j^{n−1} = c_i^n / n for n < S,  C_i1 = b_1
//!     C*   b_j (1 − C_ji / b_i)
//!     D    (C + C*) / 2
//!
//! with P the Legendre polynomial of degree S − 1: what is added to A in a row of C is a multiple of
//! the one vector b_j P(c_j) that annihilates all polynomials of degree S − 2. Forces take any of the
//! five; with B the pair is symplectic, A and D leave it symmetric. Source: jay1996, jay1998.

use super::collocation::{lobatto, top};
use super::known::{Family, Force, Key};
use super::spark::{Between, Coefficients, Spark, complementary, rows};
use crate::linalg::Matrix;
use twofloat::TwoFloat;

impl Spark {
    /// The Lobatto IIIA–IIIB pair with `points` stages, and these coefficients of the forces.
    ///
    /// # Panics
    /// When there are fewer than two points.
    pub fn lobatto(points: usize, force: Force) -> Self {
        assert!(points > 1, "a Lobatto pair has at least two stages");
        let key = Key(Family::Lobatto(force), points);
        Self::once(key, || Coefficients::lobatto(points, force))
    }
}

impl Coefficients {
    fn lobatto(points: usize, force: Force) -> Self {
        let quadrature = lobatto(points - 1);
        let mut a = rows(&quadrature, &quadrature.nodes);
        a[points - 1].clone_from(&quadrature.weights);
        let p = top(&quadrature);
        let one = TwoFloat::from(1.0);
        let first = |i: usize, j: usize| a[i][j] / quadrature.weights[j];
        let third = |i: usize, j: usize| first(i, j) + (one - first(i, 0)) * p[j] / p[0];
        let mu = |which: Force, i: usize, j: usize| match which {
            Force::A => first(i, j),
            Force::B => one - first(j, i),
            Force::C => third(i, j),
            Force::CStar => one - third(j, i),
            Force::D => (third(i, j) + one - third(j, i)) / 2.0,
        };
        let between = |which: Force| {
            let mu = Matrix::from_fn(points, points, |i, j| {
                let mu = mu(which, i, j);
                complementary(mu, one - mu)
            });
            let b = |j: usize| f64::from(quadrature.weights[j]);
            Between {
                a: Matrix::from_fn(points, points, |i, j| b(j) * mu[(i, j)]),
                mu,
            }
        };
        let parts = [Force::A, force, Force::B].map(between);
        Self::with(&quadrature, &quadrature, parts)
    }
}
