//! Gauss–Lobatto SPARK: three ways to one solution, and what happens where there is none.

use liouville_base::error::{Quantity, StepError};
use liouville_base::method::Stepper;
use liouville_problem::Model;
use liouville_spark::{Solver, Spark};
use liouville_tests::walk::{SOLVERS, apart, driven, general, walk};
use liouville_tests::{Functions, LAM, PENDULUM, T, Y, Z, input, inputs, pendulum};

#[test]
fn three_solvers_find_one_solution() {
    for (functions, params) in [
        (pendulum(), &PENDULUM[..]),
        (driven(), &[]),
        (general(), &[]),
    ] {
        let problem = functions.build();
        for s in 1..=6 {
            let end = |solver| walk(&problem, params, s, solver, 0.025).steps(40);
            let [auto, schur, newton] = SOLVERS.map(end);
            let error = apart(&auto.state, &newton.state).max(apart(&schur.state, &newton.state));
            assert!(error < 1e-13, "{error:e} apart for s = {s}");
            assert_eq!(
                (schur.stats().newton_steps, newton.stats().newton_steps),
                (0, 40)
            );
        }
    }
}

#[test]
fn reactions_may_be_any_growing_function_of_the_multiplier() {
    let plain = Functions {
        r: None,
        ..general()
    }
    .build();
    let grown = general().build();
    for s in 1..=4 {
        let end = |problem| walk(problem, &[], s, Solver::Auto, 0.05).steps(20).state;
        let error = apart(&end(&plain), &end(&grown));
        assert!(error < 1e-13, "{error:e} apart for s = {s}");
    }
}

#[test]
fn full_newton_solves_a_linear_problem_at_once() {
    // every block of the Newton matrix is there and constant: p_y, p_z, f_y, f_z, v_y, v_z, g_y, r_y, r_λ
    let (t, y, z, lam) = (input(T, 0), inputs(Y, 3), inputs(Z, 3), input(LAM, 0));
    let functions = Functions {
        v: Some(vec![
            &z[0] * 1.5 + &y[2] * 0.4,
            &z[1] + &z[2] * 0.3 - &y[0] * 0.5,
            &z[2] * 0.8 + &y[1] * 0.6,
        ]),
        p: vec![
            &z[0] + &z[1] * 0.2 + &y[1] * 0.7,
            &z[1] * 1.3 - &y[2] * 0.4,
            &z[2] + &z[0] * 0.1 + &y[0] * 0.3,
        ],
        f: vec![
            &y[1] * -2.0 + &z[2] * 0.9,
            &y[0] * 1.1 - &z[0] * 1.4 + 1.0,
            &y[2] * -3.0 - &z[1] * 0.5,
        ],
        r: Some(vec![
            -&lam + &y[2] * 0.8,
            &lam * -0.5 - &y[0] * 0.9,
            &lam * 0.25 + &y[1] * 1.2,
        ]),
        g: vec![&y[0] + &y[1] * 0.5 - &y[2] * 0.25 - &t * 0.1],
        params: 0,
    };
    let problem = functions.build();
    for s in 1..=5 {
        let mut model = Model::new(problem.clone(), &[]);
        let mut state = model.state(0.0, &[0.0; 3], &[0.1 / 1.5, 0.0, 0.0]);
        let mut spark = Spark::new(model, s, Solver::Newton);
        spark
            .step(0.0, 0.5, &mut state)
            .expect("a step can be made");
        assert_eq!(
            spark.stats().iterations,
            3,
            "one correction, one without the roundings of g, and one with them, s = {s}"
        );
    }
}

#[test]
fn stiff_forces_are_left_to_full_newton() {
    // a spring across the circle: h² k is 100, where node Schur diverges
    let mut functions = pendulum();
    functions.f[0] = input(Y, 0) * -1e6;
    let problem = functions.build();
    let end = |solver| {
        let mut walk = walk(&problem, &PENDULUM, 3, solver, 0.01);
        walk.state = walk.model.state(0.0, &[0.0, -1.0], &[0.1, 0.0]);
        walk
    };
    assert!(end(Solver::NodeSchur).step().is_err());
    let (auto, newton) = (end(Solver::Auto).steps(50), end(Solver::Newton).steps(50));
    assert!(apart(&auto.state, &newton.state) < 1e-12);
    assert!(auto.stats().newton_steps > 45, "{:?}", auto.stats());
}

#[test]
fn a_trouble_names_what_it_is_and_leaves_the_state() {
    let nan = [f64::NAN, 1.0, 9.81];
    let heavy = [1.0, 1.0, f64::INFINITY];
    let twice = {
        let mut functions = pendulum();
        functions.g.push(&functions.g[0] * 2.0);
        functions
    };
    let massless = {
        let mut functions = pendulum();
        functions.p[1] = 0.0.into();
        functions
    };
    let not_finite = |quantity, index| StepError::NotFinite {
        quantity,
        index,
        t: 0.0,
    };
    let cases: [(Functions, [f64; 3], StepError); 4] = [
        (pendulum(), nan, not_finite(Quantity::Force, 1)),
        (pendulum(), heavy, not_finite(Quantity::Force, 1)),
        (
            twice,
            PENDULUM,
            StepError::DependentConstraints {
                constraints: vec![0, 1],
            },
        ),
        (
            massless,
            PENDULUM,
            StepError::SingularMass { coordinate: 1 },
        ),
    ];
    for (functions, params, wanted) in cases {
        let problem = functions.build();
        for solver in SOLVERS {
            let mut walk = walk(&problem, &params, 2, solver, 0.1);
            walk.state.p = vec![0.0, 0.0];
            let before = walk.state.clone();
            assert_eq!(walk.step(), Err(wanted.clone()), "with {solver:?}");
            assert_eq!(walk.state, before);
        }
    }
}

#[test]
fn a_step_too_large_is_refused_and_leaves_the_state() {
    let problem = pendulum().build();
    for solver in SOLVERS {
        for s in 1..=4 {
            for h in [2.0, 10.0, 1e6] {
                let mut walk = walk(&problem, &PENDULUM, s, solver, h);
                let before = walk.state.clone();
                let refused = walk.step().expect_err("the bob would pass the pivot");
                let is_too_large = matches!(
                    refused,
                    StepError::StepTooLarge { .. }
                        | StepError::NotConverged { .. }
                        | StepError::SingularNewton
                );
                assert!(is_too_large, "{refused} with {solver:?}, s = {s}, h = {h}");
                assert_eq!(walk.state, before);
            }
        }
    }
}

#[test]
fn a_trouble_is_not_remembered() {
    let problem = pendulum().build();
    for solver in SOLVERS {
        let mut walk = walk(&problem, &PENDULUM, 3, solver, 0.01).steps(5);
        let mut clean = walk.spark.clone();
        let mut state = walk.state.clone();
        walk.spark
            .step(0.05, 1e3, &mut walk.state)
            .expect_err("a step too large");
        walk.step().expect("a step can be made");
        clean
            .step(0.05, 0.01, &mut state)
            .expect("a step can be made");
        let error = apart(&walk.state, &state);
        assert!(error < 1e-15, "{error:e} apart with {solver:?}");
    }
}

#[test]
fn a_stepper_takes_up_another_state() {
    for (functions, params) in [
        (pendulum(), &PENDULUM[..]),
        (driven(), &[]),
        (general(), &[]),
    ] {
        let problem = functions.build();
        for solver in SOLVERS {
            let start = || walk(&problem, params, 3, solver, 0.005);
            // one nearby, for which the polynomials of the last step seem good, and one far away
            for n in [33, 0] {
                let other = start().steps(n);
                let mut used = start().steps(30);
                (used.state, used.n) = (other.state.clone(), n);
                let error = apart(&used.steps(5).state, &other.steps(5).state);
                assert!(
                    error < 1e-14,
                    "{error:e} apart with {solver:?}, at step {n}"
                );
            }
        }
    }
}
