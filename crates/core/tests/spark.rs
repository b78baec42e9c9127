//! Gauss–Lobatto SPARK: the seed scheme, the order, what is kept, and three ways to one solution.

mod support;

use liouville_core::method::spark::{Solver, Spark};
use liouville_core::method::{Stats, Stepper};
use liouville_core::problem::mechanical::{Acceleration, Mechanical, Model, State};
use liouville_core::trouble::{Quantity, Trouble};
use std::sync::Arc;
use support::{Expr, Functions, LAM, PENDULUM, T, Y, Z, dot, input, inputs, pendulum};

const SOLVERS: [Solver; 3] = [Solver::Auto, Solver::NodeSchur, Solver::Newton];

/// A ball of radius 1 around a moving centre, with a momentum that is nonlinear in z and depends on
/// t and y, and forces that depend on everything: nothing can cancel here.
fn driven() -> Functions {
    let (t, y, z) = (input(T, 0), inputs(Y, 3), inputs(Z, 3));
    let mass = t.sin() * 0.3 + dot(&z, &z) * 0.1 + 1.0;
    let arm = [&y[0] - t.sin() * 0.3, y[1].clone(), y[2].clone()];
    Functions {
        v: None,
        p: vec![
            &mass * &z[0] + &y[1] * 0.2,
            &mass * &z[1] + y[0].sin() * &z[1] * 0.1,
            &mass * &z[2],
        ],
        f: vec![
            &y[1] * &y[2] - &z[0] * 0.2,
            t.cos() - &z[1] * &z[2] * 0.1,
            y[0].cos() * -3.0 - &z[2] * 0.1,
        ],
        r: None,
        g: vec![(dot(&arm, &arm) - 1.0) * 0.5],
        params: 0,
    }
}

/// The same ball with v ≠ z and a reaction that is nonlinear in λ.
fn general() -> Functions {
    let (y, z) = (inputs(Y, 3), inputs(Z, 3));
    let driven = driven();
    let lam = input(LAM, 0);
    let grown = &lam + lam.sin() * 0.1;
    let slope = |k: usize| driven.g[0].d(Y, k);
    Functions {
        v: Some(vec![
            &z[0] + &y[1] * &z[1] * 0.2,
            &z[1] + z[1].sin() * 0.3,
            &z[2] * (dot(&y, &y) * 0.1 + 1.0),
        ]),
        r: Some((0..3).map(|k| -(slope(k) * &grown)).collect()),
        ..driven
    }
}

const START: f64 = 0.3;

/// A start of [`driven`] at t = 0.3: g = 0 and g_t + g_y z = 0.
fn driven_start() -> ([f64; 3], [f64; 3]) {
    let (centre, speed) = (0.3 * START.sin(), 0.3 * START.cos());
    ([centre + 0.6, 0.0, -0.8], [speed + 0.8, 1.1, 0.6])
}

/// A start of [`general`] at t = 0.3, with the velocities of [`driven_start`].
fn general_start() -> ([f64; 3], [f64; 3]) {
    let (y, v) = driven_start();
    let size: f64 = y.iter().map(|y| y * y).sum();
    let mut z1 = v[1];
    for _ in 0..60 {
        z1 -= (z1 + 0.3 * z1.sin() - v[1]) / (1.0 + 0.3 * z1.cos());
    }
    (y, [v[0] - 0.2 * y[1] * z1, z1, v[2] / (1.0 + 0.1 * size)])
}

/// A stepper on its way.
struct Walk {
    spark: Spark,
    model: Model,
    state: State,
    t0: f64,
    h: f64,
    n: u32,
}

fn walk(problem: &Arc<Mechanical>, params: &[f64], s: usize, solver: Solver, h: f64) -> Walk {
    let (y, z, t0) = match (problem.n, problem.patterns.v_z.is_some()) {
        (2, _) => (vec![1.0, 0.0], vec![0.0, 0.0], 0.0),
        (_, false) => (driven_start().0.to_vec(), driven_start().1.to_vec(), START),
        (_, true) => (
            general_start().0.to_vec(),
            general_start().1.to_vec(),
            START,
        ),
    };
    let mut model = Model::new(problem.clone(), params);
    Walk {
        spark: Spark::new(model.clone(), s, solver),
        state: model.state(t0, &y, &z),
        model,
        t0,
        h,
        n: 0,
    }
}

impl Walk {
    fn t(&self) -> f64 {
        self.t0 + f64::from(self.n) * self.h
    }

    fn step(&mut self) -> Result<(), Trouble> {
        self.spark.step(self.t(), self.h, &mut self.state)?;
        self.n += 1;
        Ok(())
    }

    fn steps(mut self, count: u32) -> Self {
        for _ in 0..count {
            self.step().expect("a step can be made");
        }
        self
    }

    fn stats(&self) -> Stats {
        self.spark.stats()
    }

    /// The largest of g and of w = g_t + g_y v.
    fn violation(&mut self) -> f64 {
        let (t, State { y, z, .. }) = (self.t(), &self.state);
        let lam = vec![0.0; self.model.problem.m];
        let g = largest(self.model.node(t, y, &lam)[0]);
        g.max(largest(self.model.end(t, y, z)[1]))
    }
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |largest, x| x.abs().max(largest))
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter()
        .zip(b)
        .fold(0.0, |most, (a, b)| (a - b).abs().max(most))
}

fn apart(a: &State, b: &State) -> f64 {
    distance(&a.y, &b.y).max(distance(&a.z, &b.z))
}

/// Subtracts from `x` its part along `direction`; returns the factor of that part.
fn take_part(x: &mut [f64], direction: &[f64]) -> f64 {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let factor = dot(x, direction) / dot(direction, direction);
    x.iter_mut()
        .zip(direction)
        .for_each(|(x, d)| *x -= factor * d);
    factor
}

#[test]
fn one_stage_is_the_modified_midpoint_rule() {
    // Y1 = y0 + h/2 v(T1, Y1, Z1)
    // p(T1, Y1, Z1) = p(t0, y0, z0) + h/2 f(T1, Y1, Z1) + h/2 r(t0, y0, Ψ0)
    // y1 = y0 + h v(T1, Y1, Z1),   0 = g(t1, y1)
    // p(t1, y1, z1) = p(t0, y0, z0) + h f(T1, Y1, Z1) + h/2 r(t0, y0, Ψ0) + h/2 r(t1, y1, Ψ1)
    // 0 = g_t(t1, y1) + g_y(t1, y1) v(t1, y1, z1)
    let h = 0.125;
    let problem = driven().build();
    let mut walk = walk(&problem, &[], 1, Solver::Auto, h);
    let mut model = walk.model.clone();
    for _ in 0..20 {
        let (t0, before) = (walk.t(), walk.state.clone());
        walk.step().expect("a step can be made");
        let (t1, after) = (walk.t(), walk.state.clone());
        let middle = t0 + h / 2.0;

        // with v = z the first and third equation say what Y1 and Z1 are
        let increment: Vec<f64> = (0..3)
            .map(|k| (after.y[k] - before.y[k]) + (after.y_low[k] - before.y_low[k]))
            .collect();
        let stage_y: Vec<f64> = (0..3).map(|k| before.y[k] + increment[k] / 2.0).collect();
        let stage_z: Vec<f64> = increment.iter().map(|d| d / h).collect();
        let p0 = model.end(t0, &before.y, &before.z)[0].to_vec();
        let p1 = model.end(t1, &after.y, &after.z)[0].to_vec();
        let [p, f, _] = model.stage(middle, &stage_y, &stage_z);

        // what is left of the second must lie along r, which says what Ψ0 is; and so the fourth
        let mut second: Vec<f64> = (0..3).map(|k| p[k] - p0[k] - h / 2.0 * f[k]).collect();
        let mut fourth: Vec<f64> = (0..3).map(|k| p1[k] - p0[k] - h * f[k]).collect();
        let along = model.node(t0, &before.y, &[1.0])[1].to_vec();
        let impulse = take_part(&mut second, &along);
        fourth
            .iter_mut()
            .zip(&along)
            .for_each(|(x, r)| *x -= impulse * r);
        take_part(&mut fourth, model.node(t1, &after.y, &[1.0])[1]);

        let worst = largest(&second).max(largest(&fourth)).max(walk.violation());
        assert!(worst <= 1e-14, "residual {worst:e} at t = {t0}");
        assert!(largest(&along) > 0.1 && impulse.abs() > 1e-3); // the reactions took part
    }
}

#[test]
fn the_pendulum_converges_to_jacobi_s_functions_with_order_2s() {
    // sin(a/2) = sn(K − ω t, k) / √2 with k² = 1/2, ω² = g/l, at t = 10, by mpmath in 45 digits
    let (q, v) = (
        [0.275_087_462_576_116_9, -0.961_419_205_099_125_1],
        [-4.175_598_100_951_729, -1.194_749_054_560_475_3],
    );
    let problem = pendulum().build();
    for (s, steps) in [(1, 4000), (2, 640), (3, 300), (4, 200)] {
        let errors: Vec<f64> = [steps, 2 * steps]
            .map(|steps| {
                let walk = walk(
                    &problem,
                    &PENDULUM,
                    s,
                    Solver::Auto,
                    10.0 / f64::from(steps),
                );
                let state = walk.steps(steps).state;
                distance(&state.y, &q).max(distance(&state.z, &v))
            })
            .to_vec();
        let (order, wanted) = ((errors[0] / errors[1]).log2(), [2.0, 4.0, 6.0, 8.0][s - 1]);
        assert!(
            (order - wanted).abs() < 0.15,
            "s = {s}: {order} from {errors:?}"
        );
    }
}

#[test]
fn order_2s_survives_a_moving_constraint_and_nonlinear_momenta() {
    for functions in [driven(), general()] {
        let problem = functions.build();
        let end = |s: usize, steps: u32| {
            let walk = walk(&problem, &[], s, Solver::Auto, 1.0 / f64::from(steps));
            walk.steps(steps).state
        };
        let reference = end(6, 40);
        for (s, steps) in [(1, 40), (2, 12), (3, 8), (4, 5)] {
            let error = |steps| apart(&end(s, steps), &reference);
            let order = (error(steps) / error(2 * steps)).log2();
            let wanted = [2.0, 4.0, 6.0, 8.0][s - 1];
            assert!((order - wanted).abs() < 0.15, "s = {s}: order {order}");
        }
    }
}

#[test]
fn both_constraints_hold_to_roundoff() {
    for (functions, params) in [
        (pendulum(), &PENDULUM[..]),
        (driven(), &[]),
        (general(), &[]),
    ] {
        let problem = functions.build();
        for solver in SOLVERS {
            for s in 1..=5 {
                let mut walk = walk(&problem, params, s, solver, 0.02);
                for _ in 0..300 {
                    walk.step().expect("a step can be made");
                    let size = walk.violation();
                    assert!(
                        size <= 4e-15,
                        "{size:e} with {solver:?}, s = {s}, t = {}",
                        walk.t()
                    );
                }
            }
        }
    }
}

#[test]
fn momenta_carried_along_are_those_of_the_state() {
    for (functions, params) in [
        (pendulum(), &PENDULUM[..]),
        (driven(), &[]),
        (general(), &[]),
    ] {
        let problem = functions.build();
        for s in 1..=4 {
            let mut walk = walk(&problem, params, s, Solver::Auto, 0.05);
            for _ in 0..100 {
                walk.step().expect("a step can be made");
                let (t, State { y, z, p, .. }) = (walk.t(), walk.state.clone());
                let error = distance(walk.model.end(t, &y, &z)[0], &p);
                assert!(error < 2e-15, "{error:e} apart at t = {t} for s = {s}");
            }
        }
    }
}

#[test]
fn a_step_back_undoes_a_step() {
    for (functions, params) in [
        (pendulum(), &PENDULUM[..]),
        (driven(), &[]),
        (general(), &[]),
    ] {
        let problem = functions.build();
        for solver in SOLVERS {
            for s in 1..=6 {
                let mut walk = walk(&problem, params, s, solver, 0.05).steps(3);
                let (t, before) = (walk.t(), walk.state.clone());
                walk.step().expect("a step can be made");
                // with the memory of the step just made, and without any
                let fresh = Spark::new(walk.model.clone(), s, solver);
                for mut spark in [walk.spark.clone(), fresh] {
                    let mut state = walk.state.clone();
                    spark
                        .step(walk.t(), -walk.h, &mut state)
                        .expect("a step back can be made");
                    let error = apart(&state, &before);
                    assert!(
                        error < 1e-14,
                        "{error:e} from t = {t} with {solver:?}, s = {s}"
                    );
                }
            }
        }
    }
}

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
            2,
            "one correction and a look, s = {s}"
        );
    }
}

#[test]
fn what_rounding_loses_is_carried_along() {
    // p' = 0.1 and y' = z = 0.3 sum up to multiples of what no f64 holds exactly
    let falling = Functions {
        v: Some(vec![0.3.into()]),
        p: inputs(Z, 1),
        f: vec![0.1.into()],
        r: None,
        g: Vec::new(),
        params: 0,
    };
    let (h, steps) = (0.1, 100_000);
    for s in [1, 2, 5] {
        let mut model = Model::new(falling.build(), &[]);
        let mut state = model.state(0.0, &[0.0], &[0.0]);
        let mut spark = Spark::new(model, s, Solver::Auto);
        for n in 0..steps {
            spark
                .step(h * f64::from(n), h, &mut state)
                .expect("a step can be made");
        }
        let wanted = [h * 0.3 * f64::from(steps), h * 0.1 * f64::from(steps)];
        for (found, wanted) in [state.y[0], state.p[0]].into_iter().zip(wanted) {
            assert!(
                (found / wanted - 1.0).abs() < 1e-15,
                "{found} for {wanted}, s = {s}"
            );
        }
    }
}

#[test]
fn without_constraints_the_method_is_gauss_collocation() {
    // an oscillator: one step of s stages is the diagonal Padé approximant of the exponential
    let free = Functions {
        v: None,
        p: inputs(Z, 1),
        f: vec![-input(Y, 0)],
        r: None,
        g: Vec::new(),
        params: 0,
    };
    let h: f64 = 0.5;
    let padé_1 = (1.0 - h * h / 4.0, h); // (1 + ih/2) / (1 − ih/2), times |1 − ih/2|²
    let padé_2 = {
        let (re, im) = (1.0 - h * h / 12.0, h / 2.0);
        (re * re - im * im, 2.0 * re * im)
    };
    let norms = [
        1.0 + h * h / 4.0,
        (1.0 - h * h / 12.0).powi(2) + h * h / 4.0,
    ];
    for solver in SOLVERS {
        for (s, (re, im)) in [(1, padé_1), (2, padé_2)] {
            let mut model = Model::new(free.build(), &[]);
            let mut state = model.state(0.0, &[1.0], &[0.0]);
            let mut spark = Spark::new(model, s, solver);
            spark.step(0.0, h, &mut state).expect("a step can be made");
            let wanted = [re / norms[s - 1], -im / norms[s - 1]];
            assert!(distance(&[state.y[0], state.z[0]], &wanted) < 1e-15);
        }
    }
}

#[test]
fn multipliers_at_the_ends_are_as_accurate_as_the_state() {
    let problem = pendulum().build();
    let mut walk = walk(&problem, &PENDULUM, 6, Solver::Auto, 0.02).steps(500);
    let mut acceleration = Acceleration::new(&walk.model);
    let (t, State { y, z, .. }) = (walk.t(), walk.state.clone());
    acceleration
        .solve(&mut walk.model, t, &y, &z)
        .expect("constraints are independent");
    assert!((acceleration.lam[0] - 28.294_567_206_067_25).abs() < 1e-10);
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
    let not_finite = |quantity, index| Trouble::NotFinite {
        quantity,
        index,
        t: 0.0,
    };
    let cases: [(Functions, [f64; 3], Trouble); 4] = [
        (pendulum(), nan, not_finite(Quantity::Force, 1)),
        (pendulum(), heavy, not_finite(Quantity::Force, 1)),
        (
            twice,
            PENDULUM,
            Trouble::Redundant {
                constraints: vec![0, 1],
            },
        ),
        (massless, PENDULUM, Trouble::SingularMass { coordinate: 1 }),
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
                    Trouble::NotConverged { .. } | Trouble::SingularNewton
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

#[test]
fn expressions_are_differentiated() {
    let (x, y) = (input(Y, 0), input(Y, 1));
    let expr: Expr = (&x * &y).sin() * &x - -&y;
    let tape = support::tape([0, 2, 0, 0], &[expr.d(Y, 0), expr.d(Y, 1)]);
    let (a, b) = (0.7_f64, -1.3_f64);
    let wanted = [
        (a * b).cos() * b * a + (a * b).sin(),
        (a * b).cos() * a * a + 1.0,
    ];
    let mut registers = tape.bind(&[]);
    assert!(distance(tape.eval(&mut registers, [&[], &[a, b], &[]]), &wanted) < 1e-15);
}
