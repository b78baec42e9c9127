//! Bounds of a spectrum, by Lanczos steps from a random vector of normal numbers, which has no preferred direction.
//!
//! Extreme Ritz values lie inside the spectrum, each within its residual β |[u]_m| of an eigenvalue. An extreme eigenvalue is
//! missed only where the random vector is nearly orthogonal to its eigenvectors. Sources: kuczynski1992; zhou2011.

use super::lanczos::{LOST, three_terms};
use super::observe::dot;
use super::{Move, Sink, Sweeper};
use crate::problem::Update;
use liouville_base::elementary::ln_1p;
use liouville_base::error::StepError;
use liouville_base::linalg::Tridiagonal;

/// The smallest and the largest Ritz value, with their residuals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ritz {
    /// The smallest Ritz value, and its residual.
    pub low: (f64, f64),
    /// The largest Ritz value, and its residual.
    pub high: (f64, f64),
    /// The least of all Ritz values less their residuals, and the largest of all with them.
    pub outer: (f64, f64),
}

/// Ritz values of the Krylov space of H and a random vector, after `steps` steps or where it is invariant.
///
/// # Errors
/// A product failed, or was not finite.
///
/// # Panics
/// When there are no steps.
pub fn ritz(sweeper: &mut Sweeper<f64>, steps: usize, seed: u64) -> Result<Ritz, StepError> {
    assert!(steps > 0, "steps to a Ritz value");
    let n = sweeper.hamiltonian().size();
    let mut v = random(n, seed);
    let length = dot(&v, &v).sqrt();
    for x in &mut v {
        *x /= length;
    }
    let mut w = vec![0.0; n];
    let (mut diagonal, mut beside) = (Vec::new(), Vec::new());
    let (mut before, mut largest) = (0.0, 0.0_f64);
    while diagonal.len() < steps.min(n) {
        let (alpha, beta) = three_terms(sweeper, before, &mut v, &mut w)?;
        if !(alpha.is_finite() && beta.is_finite()) {
            return Err(StepError::Norm {
                norm: beta,
                start: 1.0,
                t: 0.0,
            });
        }
        diagonal.push(alpha);
        beside.push(beta);
        largest = largest.max(alpha.abs()).max(beta);
        if beta <= LOST * largest {
            break;
        }
        before = beta;
        std::mem::swap(&mut v, &mut w);
    }
    let m = diagonal.len();
    let mut small = Tridiagonal::new(m);
    small.solve(&diagonal, &beside);
    let of = |k: usize| {
        (
            small.values()[k],
            beside[m - 1] * small.vector(k)[m - 1].abs(),
        )
    };
    let ends = (0..m).map(of);
    let outer = ends.fold(
        (f64::INFINITY, f64::NEG_INFINITY),
        |(least, most), (value, residual)| {
            (least.min(value - residual), most.max(value + residual))
        },
    );
    Ok(Ritz {
        low: of(0),
        high: of(m - 1),
        outer,
    })
}

/// |x·Hy − y·Hx| / max(|x| |Hy|, |y| |Hx|) of random x and y: rounding errors, if H is symmetric.
///
/// # Errors
/// A product failed.
pub fn asymmetry(sweeper: &mut Sweeper<f64>, seed: u64) -> Result<f64, StepError> {
    let n = sweeper.hamiltonian().size();
    let (mut x, mut y) = (random(n, seed), random(n, !seed));
    let mut product = |x: &mut [f64]| {
        let mut out = vec![0.0; n];
        let product = [Move::new(true, Update::added(1.0))];
        let made = sweeper.run(&product, x, &mut out, Sink::Nothing);
        made.map(|()| out)
    };
    let (x_moved, y_moved) = (product(&mut x)?, product(&mut y)?);
    let length = |x: &[f64]| dot(x, x).sqrt();
    let scale = f64::max(length(&x) * length(&y_moved), length(&y) * length(&x_moved));
    let difference = (dot(&x, &y_moved) - dot(&y, &x_moved)).abs();
    Ok(if scale > 0.0 { difference / scale } else { 0.0 })
}

/// Normal numbers, the same for each seed, by Marsaglia's polar method.
pub(super) fn random(n: usize, seed: u64) -> Vec<f64> {
    let mut draw = uniform(seed);
    let mut found = Vec::with_capacity(n + 1);
    while found.len() < n {
        let (u, v) = (draw(), draw());
        let square = u * u + v * v;
        if square < 1.0 && square > 0.0 {
            let factor = (-2.0 * ln_1p(square - 1.0) / square).sqrt();
            found.extend([u * factor, v * factor]);
        }
    }
    found.truncate(n);
    found
}

/// Numbers between −1 and 1: Steele, Lea and Flood's SplitMix64.
#[allow(clippy::cast_precision_loss)]
fn uniform(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = state;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^= bits >> 31;
        (bits >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}
