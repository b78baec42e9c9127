//! Gauss, Radau and Lobatto quadrature on [0, 1], and the integrals of their basis polynomials.
//!
//! P_k are the Legendre polynomials shifted to [0, 1]; c_1..c_s are the zeros of P_s (Gauss) or of
//! P_s − P_{s−1} (Radau, c_s = 1), and 0, 1 with the zeros of P_s' the s + 1 Lobatto nodes. With the Christoffel weights
//!
//!     b_j = 1 / Σ_{k<s} (2k+1) P_k(c_j)²
//!     ∫_0^x ℓ_j = b_j Σ_{k<s} P_k(c_j) I_k(x),   I_0 = x,  I_k = (P_{k+1}(x) − P_{k−1}(x)) / 2
//!
//! On the s + 1 Lobatto points the sum goes to k = s; the quadrature takes ∫ P_s² for (2s+1)/s times
//! what it is, and the last term is divided by that.
//!
//! Source: hairer2006, II.1.3 and IV.

use twofloat::TwoFloat;

/// Nodes and weights of a quadrature formula on [0, 1].
pub(super) struct Quadrature {
    pub(super) nodes: Vec<TwoFloat>,
    pub(super) weights: Vec<TwoFloat>,
    /// ∫ P² over what the formula takes it for, P the Legendre polynomial one degree below the number
    /// of points.
    norm: TwoFloat,
}

/// The s-point Gauss formula, exact to degree 2s − 1.
pub(super) fn gauss(s: usize) -> Quadrature {
    let nodes: Vec<_> = (1..=s)
        .map(|i| {
            let guess = -(std::f64::consts::PI * (real(i) - 0.25) / (real(s) + 0.5)).cos();
            newton(guess, |u| {
                let p = legendre(s, u);
                (p[s], derivative(s, u, &p))
            })
        })
        .collect();
    christoffel(nodes)
}

/// The s-point Radau formula with its last point at 1, exact to degree 2s − 2.
pub(super) fn radau(s: usize) -> Quadrature {
    let inner = (1..s).map(|i| {
        let guess = (std::f64::consts::TAU * real(s - i) / real(2 * s - 1)).cos();
        newton(guess, |u| {
            let p = legendre(s, u);
            let slope = derivative(s, u, &p) - derivative(s - 1, u, &p);
            (p[s] - p[s - 1], slope)
        })
    });
    christoffel(inner.chain(std::iter::once(TwoFloat::from(1.0))).collect())
}

/// The formula on these points, exact at least to degree 2s − 2.
fn christoffel(nodes: Vec<TwoFloat>) -> Quadrature {
    let s = nodes.len();
    let weights = nodes
        .iter()
        .map(|c| {
            let p = legendre(s, *c * 2.0 - 1.0);
            let norm = (0..s).fold(TwoFloat::from(0.0), |sum, k| {
                sum + p[k] * p[k] * real(2 * k + 1)
            });
            TwoFloat::from(1.0) / norm
        })
        .collect();
    Quadrature {
        nodes,
        weights,
        norm: TwoFloat::from(1.0),
    }
}

/// The Lobatto formula with s + 1 points, both ends among them; exact to degree 2s − 1.
pub(super) fn lobatto(s: usize) -> Quadrature {
    let interior = (1..s).map(|i| {
        let guess = -(std::f64::consts::PI * real(i) / real(s)).cos();
        newton(guess, |u| {
            let p = legendre(s, u);
            let slope = derivative(s, u, &p);
            // Legendre's equation: (1 − u²) P'' = 2 u P' − s(s+1) P
            let second =
                (u * slope * 2.0 - p[s] * real(s * (s + 1))) / (TwoFloat::from(1.0) - u * u);
            (slope, second)
        })
    });
    let ends = (TwoFloat::from(0.0), TwoFloat::from(1.0));
    let nodes: Vec<_> = std::iter::once(ends.0)
        .chain(interior)
        .chain(std::iter::once(ends.1))
        .collect();
    let weights = nodes
        .iter()
        .map(|c| {
            let p = legendre(s, *c * 2.0 - 1.0)[s];
            TwoFloat::from(1.0) / (p * p * real(s * (s + 1)))
        })
        .collect();
    Quadrature {
        nodes,
        weights,
        norm: TwoFloat::from(real(s)) / real(2 * s + 1),
    }
}

/// The Legendre polynomial one degree below the number of points, at each of them.
pub(super) fn top(points: &Quadrature) -> Vec<TwoFloat> {
    let degree = points.nodes.len() - 1;
    let at = |x: &TwoFloat| legendre(degree, *x * 2.0 - 1.0)[degree];
    points.nodes.iter().map(at).collect()
}

/// ∫_0^x ℓ_j for each basis polynomial ℓ_j of these points.
pub(super) fn integrals(points: &Quadrature, x: TwoFloat) -> Vec<TwoFloat> {
    let s = points.nodes.len();
    let at_x = legendre(s, x * 2.0 - 1.0);
    let integral = |k: usize| {
        if k == 0 {
            x
        } else {
            (at_x[k + 1] - at_x[k - 1]) / 2.0
        }
    };
    points
        .nodes
        .iter()
        .zip(&points.weights)
        .map(|(c, b)| {
            let mut at_c = legendre(s, *c * 2.0 - 1.0);
            at_c[s - 1] *= points.norm;
            *b * (0..s).fold(TwoFloat::from(0.0), |sum, k| sum + at_c[k] * integral(k))
        })
        .collect()
}

/// P_0 .. P_s at u in [−1, 1].
fn legendre(s: usize, u: TwoFloat) -> Vec<TwoFloat> {
    let mut p = vec![TwoFloat::from(1.0), u];
    for k in 1..s {
        let next = (u * p[k] * real(2 * k + 1) - p[k - 1] * real(k)) / real(k + 1);
        p.push(next);
    }
    p
}

/// P_s' from (1 − u²) P_s' = s (P_{s−1} − u P_s).
fn derivative(s: usize, u: TwoFloat, p: &[TwoFloat]) -> TwoFloat {
    (p[s - 1] - u * p[s]) * real(s) / (TwoFloat::from(1.0) - u * u)
}

/// A simple zero in (−1, 1) near `guess`, moved to [0, 1].
fn newton(guess: f64, f: impl Fn(TwoFloat) -> (TwoFloat, TwoFloat)) -> TwoFloat {
    let mut u = TwoFloat::from(guess);
    for _ in 0..8 {
        let (value, slope) = f(u);
        u -= value / slope;
    }
    (u + 1.0) / 2.0
}

#[allow(clippy::cast_precision_loss)]
fn real(k: usize) -> f64 {
    k as f64
}
