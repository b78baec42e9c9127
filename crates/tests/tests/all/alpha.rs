//! The α family at work: order with changing steps, its error estimate, its matrix, its memory.

use liouville_alpha::{Alpha, AlphaState, Reactions};
use liouville_base::linalg::{Lu, Matrix};
use liouville_base::method::Tolerance;
use liouville_base::method::{Estimating, Stepper};
use liouville_base::tableau;
use liouville_problem::SecondOrderModel;
use liouville_tests::walk::{START, distance, driven_start, heavy};

const EXTENDED: Reactions = Reactions::Extended {
    b: 1.0 / 3.0,
    predicted: false,
};

fn weights(alpha_m: f64, alpha_f: f64) -> tableau::Alpha {
    let delta = alpha_m - alpha_f;
    tableau::Alpha {
        alpha_m,
        alpha_f,
        gamma: 0.5 - delta,
        beta: (1.0 - delta).powi(2) / 4.0,
    }
}

/// The family: HHT with two alphas, and Chung and Hulbert's method with ρ = 0.6.
fn family() -> [tableau::Alpha; 3] {
    [
        weights(0.0, 0.1),
        weights(0.0, 1.0 / 3.0),
        weights(0.125, 0.375),
    ]
}

fn ball(weights: tableau::Alpha, reactions: Reactions, tolerance: bool) -> (Alpha, AlphaState) {
    let model = SecondOrderModel::new(heavy().second_order(), &[]);
    let tolerance = tolerance.then(|| Tolerance {
        rtol: 0.0,
        atol: vec![1.0; 3],
        longest: 0.01,
    });
    let mut alpha = Alpha::new(model, weights, reactions, tolerance);
    let (y, z) = driven_start();
    let state = alpha
        .start(START, &y, &z, None)
        .expect("a consistent start");
    (alpha, state)
}

/// The state after steps of these sizes; `forgets` takes every step for one of the same size as before.
fn walked(
    (mut alpha, mut state): (Alpha, AlphaState),
    sizes: impl IntoIterator<Item = f64>,
    forgets: bool,
) -> AlphaState {
    let mut t = START;
    for h in sizes {
        if forgets {
            state.h = h;
        }
        alpha.step(t, h, &mut state).expect("a step can be made");
        t += h;
    }
    state
}

/// Errors of y and z at START + 1 with 4:1 alternating steps of mean size 1/`pairs`/2.
fn errors(weights: tableau::Alpha, reactions: Reactions, pairs: u32, forgets: bool) -> [f64; 2] {
    let exact = walked(
        ball(weights, EXTENDED, false),
        (0..8192).map(|_| 1.0 / 8192.0),
        false,
    );
    let h = 1.0 / f64::from(pairs);
    let sizes = (0..2 * pairs).map(|k| h * if k % 2 == 0 { 0.8 } else { 0.2 });
    let found = walked(ball(weights, reactions, false), sizes, forgets);
    [distance(&found.y, &exact.y), distance(&found.z, &exact.z)]
}

#[test]
fn alternating_steps_keep_the_order_and_without_moving_a_lose_it() {
    for weights in family() {
        for predicted in [false, true] {
            let reactions = Reactions::Extended {
                b: 1.0 / 3.0,
                predicted,
            };
            for forgets in [false, true] {
                let [coarse, fine] =
                    [128, 256].map(|pairs| errors(weights, reactions, pairs, forgets));
                for (coarse, fine) in coarse.iter().zip(fine) {
                    let order = (coarse / fine).log2();
                    assert!(
                        if forgets {
                            order < 1.2
                        } else {
                            (order - 2.0).abs() < 0.1
                        },
                        "order {order} of {weights:?}, predicted {predicted}, forgets {forgets}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_estimate_is_the_local_error() {
    for weights in family() {
        let b = [0.0, 1.0];
        for reactions in b.map(|b| Reactions::Extended {
            b,
            predicted: false,
        }) {
            let h = 1e-3;
            // a few steps, so that a is the method's own
            let (alpha, start) = ball(weights, reactions, true);
            let (mut alpha, mut state) = (alpha, start);
            for k in 0..20 {
                alpha
                    .step(START + h * f64::from(k), h, &mut state)
                    .expect("a step");
            }
            let (t, before) = (START + 20.0 * h, state.clone());
            alpha.step(t, h, &mut state).expect("a step");
            let (mut fine, _) = ball(weights, EXTENDED, false);
            let mut exact = fine.start(t, &before.y, &before.z, None).expect("a start");
            for k in 0..100 {
                let h = h / 100.0;
                fine.step(t + h * f64::from(k), h, &mut exact)
                    .expect("a step");
            }
            let error: f64 = state
                .y
                .iter()
                .zip(&exact.y)
                .map(|(a, b)| (a - b).powi(2))
                .sum();
            let ratio = alpha.error() / (error / 3.0).sqrt();
            assert!(
                (ratio - 1.0).abs() < 0.05,
                "{ratio} for {weights:?}, {reactions:?}"
            );
        }
    }
}

#[test]
fn undo_restores_the_state_to_the_bit() {
    let (mut alpha, mut state) = ball(family()[0], EXTENDED, true);
    alpha.step(START, 0.01, &mut state).expect("a step");
    let before = state.clone();
    alpha.step(START + 0.01, 0.02, &mut state).expect("a step");
    assert_ne!(state, before);
    alpha.undo(&mut state);
    assert_eq!(state, before);
}

#[test]
fn undo_restores_the_state_of_a_step_that_has_begun_again() {
    for reactions in [EXTENDED, Reactions::Position] {
        let (mut alpha, mut state) = ball(family()[0], reactions, true);
        alpha.step(START, 1e-3, &mut state).expect("a step");
        let before = state.clone();
        // more than eight times as long as the last: a0 is φ0 anew
        alpha.step(START + 1e-3, 0.02, &mut state).expect("a step");
        alpha.undo(&mut state);
        assert_eq!(state, before);
    }
}

#[test]
fn a_step_that_cannot_be_made_leaves_the_state() {
    let (mut alpha, mut state) = ball(family()[0], EXTENDED, true);
    alpha.step(START, 0.01, &mut state).expect("a step");
    let before = state.clone();
    alpha
        .step(START + 0.01, 50.0, &mut state)
        .expect_err("a step much too large");
    assert_eq!(state, before);
    alpha
        .step(START + 0.01, 0.01, &mut state)
        .expect("and on it goes");
}

/// The condition number in the maximum norm.
fn condition(matrix: &Matrix) -> f64 {
    let norm = |rows: Vec<Vec<f64>>| {
        let sums = rows.iter().map(|row| row.iter().map(|x| x.abs()).sum());
        sums.fold(0.0_f64, |most: f64, sum: f64| most.max(sum))
    };
    let n = matrix.rows();
    let mut lu = Lu::new(n);
    lu.matrix_mut().flat_mut().copy_from_slice(matrix.flat());
    lu.factor().expect("a regular matrix");
    let mut inverse = vec![vec![0.0; n]; n];
    for j in 0..n {
        let mut column = vec![0.0; n];
        column[j] = 1.0;
        lu.solve(&mut column);
        (0..n).for_each(|i| inverse[i][j] = column[i]);
    }
    norm((0..n).map(|i| matrix.row(i).to_vec()).collect()) * norm(inverse)
}

#[test]
fn the_condition_of_the_newton_matrix_does_not_grow_as_h_goes_to_zero() {
    for weights in family() {
        let conditions = [1e-1, 1e-2, 1e-4, 1e-6, 1e-8].map(|h| {
            let (mut alpha, mut state) = ball(weights, EXTENDED, false);
            alpha.step(START, h, &mut state).expect("a step");
            condition(&alpha.newton_matrix().expect("a matrix"))
        });
        let limit = conditions[4];
        assert!(limit < 20.0, "{conditions:?}");
        for (k, x) in conditions.iter().enumerate() {
            assert!(
                (x / limit - 1.0).abs() < if k == 0 { 0.5 } else { 0.05 },
                "{conditions:?}"
            );
        }
    }
}
