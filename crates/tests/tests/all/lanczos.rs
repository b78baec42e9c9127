//! Lanczos steps and Ritz values: their errors, and what they cost.

use liouville_base::error::StepError;
use liouville_base::linalg::Tridiagonal;
use liouville_base::method::Stepper;
use liouville_tests::waves::{Parts, anyhow, at_site, chain, chain_after, distance, edge, sparse};
use liouville_waves::method::{Lanczos, Sweeper, Wave, asymmetry, ritz};
use liouville_waves::problem::Hamiltonian;
use std::f64::consts::PI;
use std::sync::Arc;

fn wave((q, p): &Parts) -> Wave<f64> {
    Wave::new(q.clone(), p.clone())
}

fn stepper(hamiltonian: &Arc<Hamiltonian>, dimension: usize, rate: f64) -> Lanczos {
    Lanczos::new(Sweeper::new(hamiltonian.clone()), dimension, rate, 1e-2)
}

#[test]
fn small_matrices_are_taken_apart() {
    for n in [1, 2, 5, 40] {
        let mut small = Tridiagonal::new(40);
        small.solve(&vec![0.5; n], &vec![-1.0; n]);
        for k in 0..n {
            let angle = PI * (k as f64 + 1.0) / (n as f64 + 1.0);
            let value = 0.5 - 2.0 * angle.cos();
            assert!((small.values()[k] - value).abs() < 1e-14 * n as f64);
            let u = small.vector(k);
            let sign = u[0].signum();
            for (i, u) in u.iter().enumerate() {
                let exact = (2.0 / (n as f64 + 1.0)).sqrt() * (angle * (i as f64 + 1.0)).sin();
                assert!((sign * u - exact).abs() < 1e-14 * n as f64);
            }
        }
    }
}

#[test]
fn tolerances_hold_in_pieces_of_any_number() {
    let (n, potential) = (60, 0.7);
    let hamiltonian = chain(n, potential);
    for dimension in [5, 12, 20, 30] {
        let most = if dimension > 5 { 1000.0 } else { 100.0 };
        for theta in [1.0, 10.0, 100.0, most] {
            for tolerance in [1e-3, 1e-6, 1e-10] {
                let t = theta / edge(n);
                for start in [anyhow(n), at_site(n, 7)] {
                    let mut lanczos = stepper(&hamiltonian, dimension, tolerance / t);
                    let mut state = wave(&start);
                    lanczos.step(0.0, t, &mut state).expect("a step");
                    let error = distance(&state, &chain_after(potential, t, &start));
                    let products = lanczos.stats().evaluations;
                    let rounding = 1e-15 + 2e-17 * products as f64;
                    assert!(
                        error < tolerance + rounding,
                        "{dimension} {theta} {tolerance}: {error}"
                    );
                    // the tolerance is made use of
                    assert!(error > 1e-5 * tolerance || tolerance < 1e-9);
                }
            }
        }
    }
}

#[test]
fn short_steps_take_few_vectors() {
    let mut lanczos = stepper(&chain(40, 0.0), 20, 1e-8);
    let mut state = wave(&anyhow(40));
    lanczos.step(0.0, 0.01, &mut state).expect("a step");
    let products = lanczos.stats().evaluations;
    assert!((6..=10).contains(&products), "{products}");
    let error = distance(&state, &chain_after(0.0, 0.01, &anyhow(40)));
    assert!(error < 1e-10, "{error}");
}

#[test]
fn an_invariant_subspace_takes_any_time_at_once() {
    let n = 50;
    let mode = |k: f64| -> Vec<f64> {
        let angle = PI * k / f64::from(n + 1);
        (1..=n).map(|i| (angle * f64::from(i)).sin()).collect()
    };
    let start: Parts = (mode(2.0), mode(5.0));
    let mut lanczos = stepper(&chain(50, 0.0), 20, 1e-10);
    let mut state = wave(&start);
    lanczos.step(0.0, 1e4, &mut state).expect("a step");
    assert!(lanczos.stats().evaluations <= 8);
    // |ψ| is 7, and phases of 2·10⁴ are known to 10⁻¹²
    assert!(distance(&state, &chain_after(0.0, 1e4, &start)) < 1e-9);
    // zeros stay zeros
    let mut nothing = Wave::new(vec![0.0; 50], vec![0.0; 50]);
    lanczos.step(0.0, 1.0, &mut nothing).expect("a step");
    assert_eq!(nothing.q, vec![0.0; 50]);
}

#[test]
fn a_step_back_undoes_a_step() {
    let n = 50;
    let mut lanczos = stepper(&chain(n, 0.3), 20, 1e-14);
    let mut state = wave(&anyhow(n));
    lanczos.step(0.0, 13.0, &mut state).expect("a step");
    assert!(distance(&state, &anyhow(n)) > 0.1);
    lanczos.step(13.0, -13.0, &mut state).expect("a step");
    let error = distance(&state, &anyhow(n));
    assert!(error < 1e-12, "{error}");
}

#[test]
fn numbers_that_are_none_are_refused_and_the_state_stays() {
    let broken = sparse(3, &[(0, 0, 1.0), (1, 1, f64::NAN), (2, 2, 1.0)]);
    let mut state = wave(&anyhow(3));
    let outcome = stepper(&broken, 3, 1e-6).step(2.0, 1.0, &mut state);
    assert!(matches!(outcome, Err(StepError::Norm { t: 2.0, .. })));
    assert_eq!((state.q, state.p), anyhow(3));
}

#[test]
fn ritz_values_lie_inside_and_their_residuals_reach_out() {
    for n in [2, 10, 60, 3000] {
        for steps in [1, 5, 20, 40] {
            let mut sweeper = Sweeper::new(chain(n, 0.4));
            let found = ritz(&mut sweeper, steps, 7).expect("products");
            let (low, high) = (0.4 - edge(n), 0.4 + edge(n));
            assert!(found.low.0 >= low - 1e-13 && found.high.0 <= high + 1e-13);
            assert_eq!(found, ritz(&mut sweeper, steps, 7).expect("products"));
            if steps >= 20 {
                let width = 0.01 * (found.high.0 - found.low.0);
                assert!(found.low.0 - found.low.1 - width < low);
                assert!(found.high.0 + found.high.1 + width > high);
            }
        }
    }
    let one = ritz(&mut Sweeper::new(sparse(1, &[(0, 0, 3.0)])), 20, 1).expect("products");
    assert_eq!((one.low, one.high), ((3.0, 0.0), (3.0, 0.0)));
}

#[test]
fn matrices_that_are_not_symmetric_are_seen() {
    let symmetric = asymmetry(&mut Sweeper::new(chain(500, 0.4)), 3).expect("products");
    assert!(symmetric < 1e-15, "{symmetric}");
    let mut entries = vec![(3, 4, 1e-6)];
    for i in 0..499 {
        entries.extend([(i, i + 1, -1.0), (i + 1, i, -1.0)]);
    }
    let other = asymmetry(&mut Sweeper::new(sparse(500, &entries)), 3).expect("products");
    assert!(other > 1e-11, "{other}");
}
