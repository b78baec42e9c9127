//! Bessel functions J_k(x) of all orders at once, and how many of them e^{−iθx} on [−1, 1] takes.
//!
//! J_{k−1} = (2k/x) J_k − J_{k+1} is run backwards from an order where J_k is nothing;
//! J_0² + 2 Σ J_k² = 1 then sets the scale, in which nothing cancels. Source: dlmf10, 10.74(iv).

/// Rounding errors of a series, in units of its largest term.
pub(super) const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// A series in Bessel functions ends where two terms in a row are below this part of its share of the tolerance.
pub(super) const END: f64 = 0.3;

/// Orders where J_k is below this are not begun with, ...
const NOTHING: f64 = 1e-40;
/// ... and where factors of them are large.
pub(super) const LESS: f64 = 1e-150;

/// Tails below this would be lost in rounding errors.
const LEAST: f64 = f64::EPSILON / 8.0;

/// Below this x, J_0 = 1 and J_1 = x/2, and the rest is nothing.
const TINY: f64 = 1e-20;

/// ln of Siegel's bound on |J_k(x)|, [x e^s / (k + s)]^k with s² = k² − x² and k > x > 0:
/// dlmf10, 10.14.5.
fn ln_bound(k: f64, x: f64) -> f64 {
    let s = ((k - x) * (k + x)).sqrt();
    s - k * ((k + s) / x).ln()
}

/// The first order from which on |J_k(x)| is below a number.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // orders are whole and not negative
fn first_below(nothing: f64, x: f64) -> usize {
    let is_nothing = |k: usize| ln_bound(k as f64, x) < nothing.ln();
    let mut low = x as usize + 1;
    let mut high = low + 1;
    while !is_nothing(high) {
        (low, high) = (high, 2 * high);
    }
    while high - low > 1 {
        let middle = low.midpoint(high);
        if is_nothing(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

/// A number and its rounding error.
type Pair = (f64, f64);

/// 2k/x · a − b
fn recurred(k: usize, x: f64, a: Pair, b: Pair) -> Pair {
    let two_k = 2.0 * k as f64;
    let factor = two_k / x;
    let left = (-factor).mul_add(x, two_k) / x;
    let product = factor * a.0;
    let small = factor.mul_add(a.0, -product) + (factor * a.1 + left * a.0);
    let sum = product - b.0;
    let part = product - sum;
    let lost = (product - (sum + part)) + (part - b.0) + (small - b.1);
    let whole = sum + lost;
    (whole, lost - (whole - sum))
}

/// J_0(x) .. J_K(x) of x ≥ 0 with the first K where all that follows is nothing.
///
/// Over millions of orders the rounding errors of doubles would add up, hence pairs of them.
pub fn bessel(x: f64) -> Vec<f64> {
    let mut values = Vec::new();
    all_above(NOTHING, x, &mut values);
    values
}

/// The same with orders of which even large multiples are nothing.
pub(super) fn bessel_to_the_last(x: f64) -> Vec<f64> {
    let mut values = Vec::new();
    all_above(LESS, x, &mut values);
    values
}

fn all_above(nothing: f64, x: f64, values: &mut Vec<f64>) {
    values.clear();
    if x < TINY {
        values.extend([1.0, 0.5 * x]);
        return;
    }
    let last = first_below(nothing, x);
    values.resize(last + 1, 0.0);
    let (mut next, mut value) = ((0.0, 0.0), (nothing, 0.0));
    let (mut squares, mut lost) = (0.0, 0.0);
    for k in (1..=last).rev() {
        values[k] = value.0;
        let term = value.0 * value.0 + lost;
        let sum = squares + term;
        (squares, lost) = (sum, term - (sum - squares));
        (next, value) = (value, recurred(k, x, value, next));
    }
    values[0] = value.0;
    let scale = 1.0 / (value.0 * value.0 + 2.0 * squares).sqrt();
    for value in values {
        *value *= scale;
    }
}

/// c_0 .. c_M of e^{−iθx} = Σ (−i)^k c_k T_k(x), c_k = (2 − δ_k0) J_k(θ), with the least M ≥ 1 that leaves
/// Σ_{k>M} |c_k| ≤ `tolerance`.
///
/// A tolerance below rounding errors is raised to them.
pub fn series(theta: f64, tolerance: f64) -> Vec<f64> {
    let mut c = Vec::new();
    series_into(theta, (tolerance, 0), &mut c);
    c
}

/// [`series`] of so many terms at least, in memory that is there.
pub(super) fn series_into(theta: f64, (tolerance, least): (f64, usize), c: &mut Vec<f64>) {
    all_above(NOTHING, theta.abs(), c);
    for (k, c) in c.iter_mut().enumerate().skip(1) {
        *c *= if theta < 0.0 && k % 2 == 1 { -2.0 } else { 2.0 };
    }
    let mut tail = 0.0;
    while c.len() > least.max(2) {
        tail += c[c.len() - 1].abs();
        if tail > tolerance.max(LEAST) {
            break;
        }
        c.pop();
    }
}

/// The degree M of [`series`]: so many products with H a step takes.
pub fn degree(theta: f64, tolerance: f64) -> usize {
    series(theta, tolerance).len() - 1
}
