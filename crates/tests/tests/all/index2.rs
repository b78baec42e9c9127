//! Specialised Runge–Kutta steps for index 2: what holds at their ends, and what a failed one leaves.

use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::method::{Stats, Stepper};
use liouville_base::tableau::{Spark, moments};
use liouville_index2::Index2;
use liouville_index2::semi_explicit::{SemiExplicitModel, SemiExplicitState};
use liouville_tests::{T, Y, Z, input, inputs, semi_explicit, turning};

fn run(s: usize, h: f64, steps: i32) -> (SemiExplicitState, Stats) {
    let (f, k) = turning();
    let mut model = SemiExplicitModel::new(semi_explicit(&f, &k), &[]);
    let start = model.state(0.0, &[0.0, 0.0, 1.0], &[0.0], h);
    let mut state = start.expect("a start");
    let mut stepper = Index2::new(model, s);
    for n in 0..steps {
        let t = h * f64::from(n);
        stepper.step(t, h, &mut state).expect("a step can be made");
    }
    (state, stepper.stats())
}

#[test]
fn moments_vanish_for_the_polynomials_they_do_not_see() {
    for s in [1, 2, 5, 9] {
        let tableau = Spark::gauss(s);
        let weights = moments(&tableau.b, &tableau.c);
        assert_eq!((weights.rows(), weights.cols()), (s - 1, s));
        for i in 0..weights.rows() {
            for degree in (0..8).take(i) {
                let powers = tableau.c.iter().map(|c| c.powi(degree));
                let sum: f64 = weights.row(i).iter().zip(powers).map(|(w, x)| w * x).sum();
                assert!(
                    sum.abs() < 1e-15,
                    "s = {s}, i = {i}, degree {degree}: {sum:e}"
                );
            }
        }
    }
}

#[test]
fn equations_of_many_stages_stay_well_conditioned() {
    // the rows of (I2) and (I3): Σ_j b_j P_{i−1}(c_j) a_jl, and b_l
    let s = 8;
    let tableau = Spark::gauss(s);
    let weights = moments(&tableau.b, &tableau.c);
    let entry = |i: usize, l: usize| {
        if i == s - 1 {
            tableau.b[l]
        } else {
            (0..s).map(|j| weights[(i, j)] * tableau.a_f[(j, l)]).sum()
        }
    };
    let matrix = Matrix::from_fn(s, s, entry);
    let mut lu = liouville_base::linalg::Lu::new(s);
    lu.matrix_mut().flat_mut().copy_from_slice(matrix.flat());
    lu.factor().expect("a regular matrix");
    let norm = |m: &Matrix| m.flat().iter().map(|x| x * x).sum::<f64>().sqrt();
    let mut inverse = Matrix::from_fn(s, s, |i, j| f64::from(u8::from(i == j)));
    (0..s).for_each(|i| lu.solve(inverse.row_mut(i)));
    // with powers of c in place of P it is 6e5
    assert!(norm(&matrix) * norm(&inverse) < 300.0);
}

#[test]
fn the_constraint_holds_at_the_ends_and_the_length_is_kept() {
    for s in 1..=6 {
        let (state, stats) = run(s, 0.05, 200);
        let y = &state.y;
        assert!((y[0] - 0.25 * 20.0_f64.sin()).abs() < 1e-14, "s = {s}");
        let length: f64 = y.iter().map(|y| y * y).sum();
        assert!((length - 1.0).abs() < 2e-15, "s = {s}: {length}");
        assert_eq!(stats.cold_starts, 0, "s = {s}");
        assert!(stats.factorizations < 200, "s = {s}");
    }
}

#[test]
fn a_forgotten_step_changes_nothing_but_roundoff() {
    let (f, k) = turning();
    let mut model = SemiExplicitModel::new(semi_explicit(&f, &k), &[]);
    let start = model.state(0.0, &[0.0, 0.0, 1.0], &[0.0], 0.1);
    let mut state = start.expect("a start");
    let mut stepper = Index2::new(model, 3);
    for n in 0..10 {
        let t = 0.1 * f64::from(n);
        stepper.forget();
        stepper
            .step(t, 0.1, &mut state)
            .expect("a step can be made");
    }
    let (warm, _) = run(3, 0.1, 10);
    let parts = state.y.iter().chain(&state.z);
    for (cold, warm) in parts.zip(warm.y.iter().chain(&warm.z)) {
        assert!((cold - warm).abs() < 1e-14);
    }
}

#[test]
fn a_failed_step_leaves_the_state_as_it_was() {
    // k_y f_z vanishes with y_1
    let (y, z) = (inputs(Y, 2), inputs(Z, 1));
    let (f, k) = ([&y[1] * &z[0], (-1.0).into()], [&y[0] - input(T, 0)]);
    let mut model = SemiExplicitModel::new(semi_explicit(&f, &k), &[]);
    let start = model.state(0.0, &[0.0, 1.0], &[1.0], 0.5);
    let mut state = start.expect("a start");
    let mut stepper = Index2::new(model.clone(), 2);
    stepper.step(0.0, 0.5, &mut state).expect("a good step");
    let before = state.clone();
    let error = stepper.step(0.5, 0.5, &mut state);
    assert_eq!(error, Err(StepError::SingularHidden { unknown: 0 }));
    assert_eq!(state, before);
    let singular = model.state(1.0, &[1.0, 0.0], &[1.0], 0.5);
    assert_eq!(singular, Err(StepError::SingularHidden { unknown: 0 }));
}

#[test]
fn on_radau_points_the_order_is_2s_less_1_and_the_constraint_holds() {
    let (f, k) = turning();
    let end = |s: usize, steps: i32| {
        let mut model = SemiExplicitModel::new(semi_explicit(&f, &k), &[]);
        let h = 1.0 / f64::from(steps);
        let start = model.state(0.0, &[0.0, 0.0, 1.0], &[0.0], h);
        let mut state = start.expect("a start");
        let mut stepper = Index2::of(model, &Spark::radau(s));
        for n in 0..steps {
            let t = h * f64::from(n);
            stepper.step(t, h, &mut state).expect("a step can be made");
        }
        assert!((state.y[0] - 0.25 * 2.0_f64.sin()).abs() < 1e-14, "s = {s}");
        state
    };
    let (exact, _) = run(6, 0.02, 50);
    for (s, steps) in [(1, 200), (2, 40), (3, 20)] {
        let error = |steps| {
            let state = end(s, steps);
            let apart = |(a, b): (&f64, &f64)| (a - b).abs();
            let y = state.y.iter().zip(&exact.y).map(apart);
            y.chain(state.z.iter().zip(&exact.z).map(apart))
                .fold(0.0, f64::max)
        };
        let order = (error(steps) / error(2 * steps)).log2();
        let wanted = (2 * s - 1) as f64;
        assert!((order - wanted).abs() < 0.2, "s = {s}: order {order}");
    }
}
