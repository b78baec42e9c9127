//! The coefficients satisfy what defines them, for any number of stages.

use liouville_base::linalg::Matrix;
use liouville_base::tableau::{Force, Spark};

const MOST: usize = 20;

/// The largest defect of a set of equations.
fn worst(defects: impl IntoIterator<Item = f64>) -> f64 {
    defects.into_iter().map(f64::abs).fold(0.0, f64::max)
}

fn holds(name: &str, tolerance: f64, defect: impl Fn(&Spark) -> f64) {
    for s in 1..=MOST {
        let size = defect(&Spark::gauss(s));
        assert!(size <= tolerance, "{name} is off by {size:e} for s = {s}");
    }
}

fn real(k: usize) -> f64 {
    f64::from(u8::try_from(k).expect("a small number"))
}

/// x^k, with 0^0 = 1.
fn power(x: f64, k: usize) -> f64 {
    x.powi(i32::try_from(k).expect("a small number"))
}

/// Σ_j w_j c_j^(k−1) − 1/k for k = 1..most.
fn quadrature(weights: &[f64], nodes: &[f64], most: usize) -> f64 {
    worst((1..=most).map(|k| {
        let sum: f64 = weights
            .iter()
            .zip(nodes)
            .map(|(w, c)| w * power(*c, k - 1))
            .sum();
        sum - 1.0 / real(k)
    }))
}

/// Σ_j a_ij c_j^(k−1) − x_i^k / k for each row and k = 1..most.
fn stage_order(a: &Matrix, nodes: &[f64], ends: &[f64], most: usize) -> f64 {
    worst((1..=most).flat_map(|k| {
        ends.iter().enumerate().map(move |(i, x)| {
            let sum: f64 = a
                .row(i)
                .iter()
                .zip(nodes)
                .map(|(a, c)| a * power(*c, k - 1))
                .sum();
            sum - power(*x, k) / real(k)
        })
    }))
}

/// Σ_i b_i c_i^(k−1) a_ij − w_j (1 − x_j^k) / k for each column and k = 1..most.
fn adjoint_order(t: &Spark, a: &Matrix, weights: &[f64], ends: &[f64], most: usize) -> f64 {
    worst((1..=most).flat_map(|k| {
        weights
            .iter()
            .zip(ends)
            .enumerate()
            .map(move |(j, (w, x))| {
                let sum: f64 = (0..t.stages)
                    .map(|i| t.b[i] * power(t.c[i], k - 1) * a[(i, j)])
                    .sum();
                sum - w * (1.0 - power(*x, k)) / real(k)
            })
    }))
}

#[test]
fn gauss_quadrature_is_exact_to_degree_2s_minus_1() {
    holds("B(2s)", 4e-16, |t| quadrature(&t.b, &t.c, 2 * t.stages));
}

#[test]
fn lobatto_quadrature_is_exact_to_degree_2s_minus_1() {
    holds("B(2s)", 4e-16, |t| {
        quadrature(&t.b_hat, &t.c_hat, 2 * t.stages)
    });
}

#[test]
fn gauss_quadrature_is_not_exact_beyond() {
    for s in 1..=5 {
        let t = Spark::gauss(s);
        assert!(quadrature(&t.b, &t.c, 2 * s + 1) > 1e-7);
        assert!(quadrature(&t.b_hat, &t.c_hat, 2 * s + 1) > 1e-7);
    }
}

#[test]
fn gauss_stages_integrate_polynomials_of_degree_s_minus_1() {
    holds("C(s)", 4e-16, |t| stage_order(&t.a_v, &t.c, &t.c, t.stages));
    holds("D(s)", 4e-16, |t| {
        adjoint_order(t, &t.a_v, &t.b, &t.c, t.stages)
    });
}

#[test]
fn lobatto_nodes_integrate_polynomials_of_degree_s() {
    holds("C(s+1)", 4e-16, |t| {
        stage_order(&t.a_bar, &t.c, &t.c_hat, t.stages + 1)
    });
}

#[test]
fn reactions_satisfy_their_simplifying_assumptions() {
    holds("Ĉ(s)", 4e-16, |t| {
        stage_order(&t.a_hat, &t.c_hat, &t.c, t.stages)
    });
    holds("D̂(s+1)", 4e-16, |t| {
        adjoint_order(t, &t.a_hat, &t.b_hat, &t.c_hat, t.stages + 1)
    });
}

#[test]
fn the_method_is_symplectic() {
    holds("b_i a_ij + b_j a_ji = b_i b_j", 1e-16, |t| {
        let pairs = (0..t.stages).flat_map(|i| (0..t.stages).map(move |j| (i, j)));
        worst(pairs.map(|(i, j)| t.b[i] * t.a_v[(i, j)] + t.b[j] * t.a_v[(j, i)] - t.b[i] * t.b[j]))
    });
    holds("b_i â_ij + b̂_j ā_ji = b_i b̂_j", 1e-16, |t| {
        let pairs = (0..t.stages).flat_map(|i| (0..=t.stages).map(move |j| (i, j)));
        worst(pairs.map(|(i, j)| {
            t.b[i] * t.a_hat[(i, j)] + t.b_hat[j] * t.a_bar[(j, i)] - t.b[i] * t.b_hat[j]
        }))
    });
}

#[test]
fn what_steps_use_is_symplectic_without_rounding() {
    let one = 1.0_f64.to_bits();
    for s in 1..=MOST {
        let t = Spark::gauss(s);
        for i in 0..s {
            for j in 0..s {
                assert_eq!((t.mu_v[(i, j)] + t.mu_v[(j, i)]).to_bits(), one, "s = {s}");
            }
            for j in 0..=s {
                assert_eq!(
                    (t.mu_hat[(i, j)] + t.mu_bar[(j, i)]).to_bits(),
                    one,
                    "s = {s}"
                );
            }
        }
    }
}

#[test]
fn what_steps_use_are_the_coefficients_over_their_weights() {
    let ratio = |mu: f64, a: f64, b: f64| mu - a / b;
    holds("μ = a / b", 4e-16, |t| {
        let s = t.stages;
        let pairs =
            |rows: usize, cols: usize| (0..rows).flat_map(move |i| (0..cols).map(move |j| (i, j)));
        let mu = pairs(s, s).map(|at| ratio(t.mu_v[at], t.a_v[at], t.b[at.1]));
        let mu_bar = pairs(s + 1, s).map(|at| ratio(t.mu_bar[at], t.a_bar[at], t.b[at.1]));
        let mu_hat = pairs(s, s + 1).map(|at| ratio(t.mu_hat[at], t.a_hat[at], t.b_hat[at.1]));
        worst(mu.chain(mu_bar).chain(mu_hat))
    });
}

#[test]
fn the_method_is_symmetric() {
    holds("reflection", 2.3e-16, |t| {
        let s = t.stages;
        let weights = (0..s).map(|i| t.b[i] - t.b[s - 1 - i]);
        let nodes = (0..s).map(|i| t.c[i] + t.c[s - 1 - i] - 1.0);
        let a = (0..s).flat_map(|i| {
            (0..s).map(move |j| t.a_v[(i, j)] + t.a_v[(s - 1 - i, s - 1 - j)] - t.b[j])
        });
        worst(weights.chain(nodes).chain(a))
    });
    holds("reflection at the nodes", 2.3e-16, |t| {
        let s = t.stages;
        let weights = (0..=s).map(|i| t.b_hat[i] - t.b_hat[s - i]);
        let nodes = (0..=s).map(|i| t.c_hat[i] + t.c_hat[s - i] - 1.0);
        let a_bar = (0..=s).flat_map(|i| {
            (0..s).map(move |j| t.a_bar[(i, j)] + t.a_bar[(s - i, s - 1 - j)] - t.b[j])
        });
        let a_hat = (0..s).flat_map(|i| {
            (0..=s).map(move |j| t.a_hat[(i, j)] + t.a_hat[(s - 1 - i, s - j)] - t.b_hat[j])
        });
        worst(weights.chain(nodes).chain(a_bar).chain(a_hat))
    });
}

#[test]
fn ends_are_exact() {
    for s in 1..=MOST {
        let t = Spark::gauss(s);
        assert_eq!(
            (t.c_hat[0].to_bits(), t.c_hat[s].to_bits()),
            (0, 1.0_f64.to_bits())
        );
        assert_eq!(worst(t.a_bar.row(0).iter().copied()).to_bits(), 0);
        assert_eq!(t.a_bar.row(s), t.b);
        assert!((0..s).all(|i| t.a_hat[(i, s)].abs().to_bits() == 0));
        assert!((0..s).all(|i| (t.a_hat[(i, 0)] / t.b_hat[0] - 1.0).abs() <= f64::EPSILON));
        assert!(t.c.windows(2).all(|c| c[0] < c[1]) && t.c_hat.windows(2).all(|c| c[0] < c[1]));
        assert!(t.b.iter().chain(&t.b_hat).all(|b| *b > 0.0));
        assert_eq!(
            (t.a_v.rows(), t.a_bar.rows(), t.a_hat.rows()),
            (s, s + 1, s)
        );
        assert_eq!(
            (t.b.len(), t.c.len(), t.b_hat.len(), t.c_hat.len()),
            (s, s, s + 1, s + 1)
        );
    }
}

/// Compares with closed forms, which round a few times themselves.
fn is(found: &[f64], wanted: &[f64]) {
    assert_eq!(found.len(), wanted.len());
    for (found, wanted) in found.iter().zip(wanted) {
        assert!(
            (found - wanted).abs() <= 1.2e-16,
            "{found:e} for {wanted:e}"
        );
    }
}

#[test]
fn one_stage_is_the_midpoint_rule_with_the_trapezoidal_one() {
    let t = Spark::gauss(1);
    is(&t.c, &[0.5]);
    is(&t.b, &[1.0]);
    is(t.a_v.flat(), &[0.5]);
    is(&t.c_hat, &[0.0, 1.0]);
    is(&t.b_hat, &[0.5, 0.5]);
    is(t.a_bar.flat(), &[0.0, 1.0]);
    is(t.a_hat.flat(), &[0.5, 0.0]);
}

#[test]
fn two_stages_have_their_closed_forms() {
    let t = Spark::gauss(2);
    let r = 3.0_f64.sqrt();
    is(&t.c, &[0.5 - r / 6.0, 0.5 + r / 6.0]);
    is(&t.b, &[0.5, 0.5]);
    is(t.a_v.flat(), &[0.25, 0.25 - r / 6.0, 0.25 + r / 6.0, 0.25]);
    is(&t.c_hat, &[0.0, 0.5, 1.0]);
    is(&t.b_hat, &[1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0]);
    is(t.a_bar.row(1), &[0.25 + r / 8.0, 0.25 - r / 8.0]);
    is(t.a_hat.row(0), &[1.0 / 6.0, 1.0 / 3.0 - r / 6.0, 0.0]);
    is(t.a_hat.row(1), &[1.0 / 6.0, 1.0 / 3.0 + r / 6.0, 0.0]);
}

#[test]
fn three_stages_have_their_closed_forms() {
    let t = Spark::gauss(3);
    let (r, q) = (15.0_f64.sqrt(), 5.0_f64.sqrt());
    is(&t.c, &[0.5 - r / 10.0, 0.5, 0.5 + r / 10.0]);
    is(&t.b, &[5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0]);
    is(
        t.a_v.row(0),
        &[5.0 / 36.0, 2.0 / 9.0 - r / 15.0, 5.0 / 36.0 - r / 30.0],
    );
    is(
        t.a_v.row(1),
        &[5.0 / 36.0 + r / 24.0, 2.0 / 9.0, 5.0 / 36.0 - r / 24.0],
    );
    is(
        t.a_v.row(2),
        &[5.0 / 36.0 + r / 30.0, 2.0 / 9.0 + r / 15.0, 5.0 / 36.0],
    );
    is(&t.c_hat, &[0.0, 0.5 - q / 10.0, 0.5 + q / 10.0, 1.0]);
    is(&t.b_hat, &[1.0 / 12.0, 5.0 / 12.0, 5.0 / 12.0, 1.0 / 12.0]);
    // the integral of each Lagrange polynomial up to 1/2 ∓ √5/10
    let sides = |q: f64| {
        let even = 5.0 / 36.0 - q / 180.0;
        [even + r / 30.0, 2.0 / 9.0 - 4.0 * q / 45.0, even - r / 30.0]
    };
    is(t.a_bar.row(1), &sides(q));
    is(t.a_bar.row(2), &sides(-q));
    let reaction = |q: f64, r: f64| 5.0 / 24.0 + q / 120.0 - r / 20.0;
    let middle = 5.0 / 24.0 + q / 12.0;
    is(
        t.a_hat.row(0),
        &[1.0 / 12.0, reaction(q, r), reaction(-q, r), 0.0],
    );
    is(
        t.a_hat.row(1),
        &[1.0 / 12.0, middle, 5.0 / 12.0 - middle, 0.0],
    );
    is(
        t.a_hat.row(2),
        &[1.0 / 12.0, reaction(q, -r), reaction(-q, -r), 0.0],
    );
}

#[test]
#[should_panic(expected = "at least one stage")]
fn no_stages_are_refused() {
    Spark::gauss(0);
}

#[test]
fn symmetric_is_what_reflection_leaves() {
    for s in [2, 3, 8] {
        assert!(Spark::gauss(s).is_symmetric() && !Spark::radau(s).is_symmetric());
        for (force, is_symmetric) in [
            (Force::A, true),
            (Force::B, true),
            (Force::C, false),
            (Force::CStar, false),
            (Force::D, true),
        ] {
            assert_eq!(Spark::lobatto(s, force).is_symmetric(), is_symmetric);
        }
    }
}

#[test]
fn a_lobatto_pair_begins_where_the_step_does_and_ends_there() {
    for points in 2..=MOST {
        let t = Spark::lobatto(points, Force::B);
        let (s, k) = (t.stages, t.intervals);
        assert_eq!((s, k), (points, points - 1));
        assert_eq!((&t.c, &t.b), (&t.c_hat, &t.b_hat));
        assert_eq!(t.mu_v.flat(), t.mu_bar.flat());
        assert_eq!(worst(t.mu_v.row(0).iter().copied()).to_bits(), 0);
        assert!(
            t.mu_v
                .row(k)
                .iter()
                .all(|mu| mu.to_bits() == 1.0_f64.to_bits())
        );
        assert!((0..s).all(|i| t.mu_hat[(i, k)].abs().to_bits() == 0));
        for i in 0..s {
            for j in 0..s {
                let sum = t.mu_f[(i, j)] + t.mu_v[(j, i)];
                assert_eq!(sum.to_bits(), 1.0_f64.to_bits(), "s = {s}");
            }
        }
    }
}

#[test]
fn radau_stages_end_with_the_step() {
    for s in 1..=MOST {
        let t = Spark::radau(s);
        assert_eq!((t.stages, t.intervals), (s, s));
        assert!(t.c.windows(2).all(|c| c[0] < c[1]) && t.c[s - 1].to_bits() == 1.0_f64.to_bits());
        assert_eq!(t.a_v.row(s - 1), t.b);
        assert!(quadrature(&t.b, &t.c, 2 * s - 1) <= 4e-16);
        assert!(stage_order(&t.a_v, &t.c, &t.c, s) <= 4e-16);
        assert!(stage_order(&t.a_bar, &t.c, &t.c_hat, s) <= 4e-16);
        assert!(stage_order(&t.a_hat, &t.c_hat, &t.c, s - 1) <= 4e-15);
    }
}

#[test]
#[should_panic(expected = "at least two stages")]
fn a_pair_of_one_stage_is_refused() {
    Spark::lobatto(1, Force::B);
}
