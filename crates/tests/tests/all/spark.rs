//! Gauss–Lobatto SPARK: the seed scheme, the order, and what is kept.

use liouville_base::method::Stepper;
use liouville_problem::{Acceleration, Model, State};
use liouville_spark::{Solver, Spark};
use liouville_tests::walk::{SOLVERS, apart, distance, driven, general, largest, walk};
use liouville_tests::{Expr, Functions, PENDULUM, Y, Z, input, inputs, pendulum};

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
    let pade_1 = (1.0 - h * h / 4.0, h); // (1 + ih/2) / (1 − ih/2), times |1 − ih/2|²
    let pade_2 = {
        let (re, im) = (1.0 - h * h / 12.0, h / 2.0);
        (re * re - im * im, 2.0 * re * im)
    };
    let norms = [
        1.0 + h * h / 4.0,
        (1.0 - h * h / 12.0).powi(2) + h * h / 4.0,
    ];
    for solver in SOLVERS {
        for (s, (re, im)) in [(1, pade_1), (2, pade_2)] {
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
fn expressions_are_differentiated() {
    let (x, y) = (input(Y, 0), input(Y, 1));
    let expr: Expr = (&x * &y).sin() * &x - -&y;
    let tape = liouville_tests::tape([0, 2, 0, 0], &[expr.d(Y, 0), expr.d(Y, 1)]);
    let (a, b) = (0.7_f64, -1.3_f64);
    let wanted = [
        (a * b).cos() * b * a + (a * b).sin(),
        (a * b).cos() * a * a + 1.0,
    ];
    let mut registers = tape.bind(&[]);
    assert!(distance(tape.eval(&mut registers, [&[], &[a, b], &[]]), &wanted) < 1e-15);
}
