//! Coefficients of SPARK methods: s stages for the motion, k + 1 nodes for constraints and reactions.
//!
//!     aᵛ_ij, aᶠ_ij, aʳ_ij           i, j = 1..s              of v, of f, and of reactions at stages
//!     ā_ij  = ∫_0^{ĉ_i} ℓ_j        i = 0..k, j = 1..s       node, stage
//!     â_ij  = b̂_j (1 − ā_ji / b_i)  i = 1..s, j = 0..k       stage, node
//!
//! with ℓ_j the Lagrange polynomials of the stages. â is the symplectic conjugate of ā. Where stages
//! and nodes are symmetric it is computed as b̂_j ā_{k−j, s+1−i} / b_i, which is the same by the
//! reflection of both formulas and free of cancellation. Source: jay2007.
//!
//! The (s,s)-Gauss–Lobatto method has the Gauss points as stages, the s + 1 Lobatto points as nodes,
//! and aᵛ = aᶠ = aʳ = ∫_0^{c_i} ℓ_j; Lobatto pairs and Radau stages are next door.
//!
//! Steps use the coefficients divided by their weights, μ_ij = a_ij / b_j, μ̄_ij = ā_ij / b_j and
//! μ̂_ij = â_ij / b̂_j, for which symplecticity reads
//!
//!     μᶠ_ij + μᵛ_ji = 1,    μ̂_ij + μ̄_ji = 1
//!
//! and holds exactly in f64: of each pair the larger is rounded, and 1 minus it is exact. Rounded
//! coefficients without that would cost a linear drift of the energy. Source: hairer2008,
//! antonana2017.

use super::collocation::{Quadrature, gauss, integrals, lobatto};
use super::known::{Family, Key, Known};
use crate::linalg::Matrix;
use std::ops::Deref;
use twofloat::TwoFloat;

static COEFFICIENTS: Known<Coefficients> = Known::new();

/// A SPARK method, whose coefficients are computed once a process.
#[derive(Clone, Debug)]
pub struct Spark {
    /// Which one it is.
    pub key: Key,
    coefficients: &'static Coefficients,
}

impl Deref for Spark {
    type Target = Coefficients;

    fn deref(&self) -> &Coefficients {
        self.coefficients
    }
}

/// Coefficients of a SPARK method; see the module for the letters.
#[derive(Clone, Debug)]
pub struct Coefficients {
    /// Number s of stages.
    pub stages: usize,
    /// Number k of intervals between the nodes.
    pub intervals: usize,
    /// b, the weights of the stages.
    pub b: Vec<f64>,
    /// c, the stages.
    pub c: Vec<f64>,
    /// b̂, the weights of the nodes.
    pub b_hat: Vec<f64>,
    /// ĉ, the nodes, from 0 to 1.
    pub c_hat: Vec<f64>,
    /// aᵛ, s by s.
    pub a_v: Matrix,
    /// aᶠ, s by s.
    pub a_f: Matrix,
    /// aʳ, s by s.
    pub a_r: Matrix,
    /// ā, (k+1) by s; its first row is zero, its last is b.
    pub a_bar: Matrix,
    /// â, s by (k+1); its last column is zero.
    pub a_hat: Matrix,
    /// μᵛ = aᵛ / b, s by s.
    pub mu_v: Matrix,
    /// μᶠ = aᶠ / b, s by s.
    pub mu_f: Matrix,
    /// μʳ = aʳ / b, s by s.
    pub mu_r: Matrix,
    /// μ̄ = ā / b, (k+1) by s.
    pub mu_bar: Matrix,
    /// μ̂ = â / b̂, s by (k+1).
    pub mu_hat: Matrix,
}

/// Rows of coefficients between stages, and their quotients: a and μ = a / b.
#[derive(Clone)]
pub(super) struct Between {
    pub(super) a: Matrix,
    pub(super) mu: Matrix,
}

impl Spark {
    /// The (s,s)-Gauss–Lobatto method.
    ///
    /// # Panics
    /// When `s` is zero.
    pub fn gauss(s: usize) -> Self {
        assert!(s > 0, "a SPARK method has at least one stage");
        Self::once(Key(Family::Gauss, s), || Coefficients::gauss(s))
    }

    pub(super) fn once(key: Key, compute: impl FnOnce() -> Coefficients) -> Self {
        let coefficients = COEFFICIENTS.once(key, compute);
        Self { key, coefficients }
    }
}

impl Coefficients {
    fn gauss(s: usize) -> Self {
        let (stages, nodes) = (gauss(s), lobatto(s));
        let a = rows(&stages, &stages.nodes);
        let mu = |i: usize, j: usize| a[i][j] / stages.weights[j];
        let all = Between {
            a: Matrix::from_fn(s, s, |i, j| a[i][j].into()),
            mu: Matrix::from_fn(s, s, |i, j| complementary(mu(i, j), mu(j, i))),
        };
        Self::with(&stages, &nodes, [all.clone(), all.clone(), all])
    }

    /// Whether a step back undoes a step: the reflection of stages and nodes turns each coefficient
    /// into its weight less itself.
    pub fn is_symmetric(&self) -> bool {
        let is_reflected = |mu: &Matrix| {
            let (last, cols) = (mu.rows() - 1, mu.cols());
            let entries = (0..=last).flat_map(|i| (0..cols).map(move |j| (i, j)));
            let sum = |(i, j)| mu[(i, j)] + mu[(last - i, cols - 1 - j)];
            entries.map(sum).all(|x: f64| (x - 1.0).abs() < 1e-9)
        };
        let all = [
            &self.mu_v,
            &self.mu_f,
            &self.mu_r,
            &self.mu_bar,
            &self.mu_hat,
        ];
        all.into_iter().all(is_reflected)
    }

    /// The method of these symmetric points whose coefficients of v, of f, and of reactions at stages
    /// are `between`.
    pub(super) fn with(stages: &Quadrature, nodes: &Quadrature, between: [Between; 3]) -> Self {
        let (s, k) = (stages.nodes.len(), nodes.nodes.len() - 1);
        let mut a_bar = rows(stages, &nodes.nodes);
        a_bar[k].clone_from(&stages.weights);
        let a_hat =
            |i: usize, j: usize| nodes.weights[j] * a_bar[k - j][s - 1 - i] / stages.weights[i];
        let mu_bar = |i: usize, j: usize| a_bar[i][j] / stages.weights[j];
        let round = |x: &[TwoFloat]| x.iter().map(|x| f64::from(*x)).collect();
        let [v, f, r] = between;
        Self {
            mu_bar: Matrix::from_fn(k + 1, s, |i, j| {
                complementary(mu_bar(i, j), 1.0 - mu_bar(i, j))
            }),
            mu_hat: Matrix::from_fn(s, k + 1, |i, j| {
                complementary(1.0 - mu_bar(j, i), mu_bar(j, i))
            }),
            stages: s,
            intervals: k,
            b: round(&stages.weights),
            c: round(&stages.nodes),
            b_hat: round(&nodes.weights),
            c_hat: round(&nodes.nodes),
            a_bar: Matrix::from_fn(k + 1, s, |i, j| a_bar[i][j].into()),
            a_hat: Matrix::from_fn(s, k + 1, |i, j| a_hat(i, j).into()),
            a_v: v.a,
            a_f: f.a,
            a_r: r.a,
            mu_v: v.mu,
            mu_f: f.mu,
            mu_r: r.mu,
        }
    }
}

/// ∫_0^x ℓ_j, one row for each x.
pub(super) fn rows(stages: &Quadrature, ends: &[TwoFloat]) -> Vec<Vec<TwoFloat>> {
    ends.iter().map(|x| integrals(stages, *x)).collect()
}

/// `x` as an f64 such that it and its partner, 1 − x, add up to exactly 1.
pub(super) fn complementary(x: TwoFloat, partner: TwoFloat) -> f64 {
    if x > partner {
        f64::from(x)
    } else {
        1.0 - f64::from(partner)
    }
}
