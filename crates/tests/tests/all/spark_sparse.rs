//! Large mechanisms: sparse solvers find what dense ones do, and say the same of what they refuse.

use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_problem::Model;
use liouville_problem::{Mechanical, State};
use liouville_spark::{Solver, Spark};
use liouville_tests::walk::{SOLVERS, Walk, apart, distance};
use liouville_tests::{Expr, FOURTH, Functions, PARAMS, Y, Z, dot, input, inputs};
use std::sync::Arc;

const LINKS: usize = 24;

/// A chain in the plane, its ends tied where it is closed. Each mass is a block that depends on y, and a
/// parameter couples masses all along the chain: a structure without small blocks, whatever its value.
fn chain(is_closed: bool, is_coupled: bool) -> Functions {
    let n = 2 * LINKS;
    let (y, z) = (inputs(Y, n), inputs(Z, n));
    let coupling = input(PARAMS, 0);
    let momentum = |k: usize| {
        let (own, other) = (k, k ^ 1);
        let mass = y[k - k % 2].sin() * 0.2;
        let p = &z[own] + mass * &z[other] * 0.5;
        if is_coupled && k + 2 < n {
            p + &coupling * &z[k + 2]
        } else {
            p
        }
    };
    let length = |a: Option<usize>, b: usize| {
        let arm: Vec<Expr> = (0..2)
            .map(|axis| {
                let end = y[2 * b + axis].clone();
                match a {
                    Some(a) => end - &y[2 * a + axis],
                    None => end,
                }
            })
            .collect();
        (dot(&arm, &arm) - 1.0) * 0.5
    };
    let mut g: Vec<Expr> = (0..LINKS).map(|k| length(k.checked_sub(1), k)).collect();
    if is_closed {
        g.push(length(Some(2), 6) - 4.62);
    }
    Functions {
        v: None,
        p: (0..n).map(momentum).collect(),
        f: (0..n)
            .map(|k| {
                if k % 2 == 1 {
                    (-9.81).into()
                } else {
                    y[k].sin() * -0.3
                }
            })
            .collect(),
        r: None,
        g,
        params: 1,
    }
}

/// The chain in a zigzag, falling.
fn falling(functions: &Functions, s: usize, solver: Solver, steps: u32) -> Walk {
    let mut model = Model::new(functions.build(), &[0.0]);
    let bead = |k: usize| [0.8 * k as f64, 0.6 * (k % 2) as f64];
    let y: Vec<f64> = (1..=LINKS).flat_map(bead).collect();
    let walk = Walk {
        spark: Spark::new(model.clone(), s, solver),
        state: model.state(0.0, &y, &[0.0; 2 * LINKS]),
        model,
        t0: 0.0,
        h: 2e-3,
        n: 0,
    };
    walk.steps(steps)
}

#[test]
fn sparse_and_dense_solvers_find_one_solution() {
    for s in 1..=4 {
        let dense = falling(&chain(false, true), s, Solver::NodeSchur, 20);
        for solver in SOLVERS {
            let sparse = falling(&chain(false, false), s, solver, 20);
            let error = apart(&sparse.state, &dense.state);
            assert!(error < 1e-12, "{error:e} apart with {solver:?}, s = {s}");
        }
        let sparse = falling(&chain(false, false), s, Solver::NodeSchur, 20);
        let (found, wanted) = (sparse.stats().iterations, dense.stats().iterations);
        assert!(
            10 * found.abs_diff(wanted) <= wanted,
            "{found} and {wanted} corrections"
        );
    }
}

#[test]
fn what_is_neither_sparse_nor_small_is_left_to_newton() {
    let functions = chain(false, false);
    let most = falling(&functions, 18, Solver::NodeSchur, 3);
    // a start that fails is tried again, and counted
    assert!(most.stats().newton_steps >= 3, "{:?}", most.stats());
    let error = apart(&most.state, &falling(&functions, 8, Solver::Auto, 3).state);
    assert!(error < 1e-12, "{error:e} apart");
}

#[test]
fn a_loop_is_closed_by_sparse_solvers_too() {
    let functions = chain(true, false);
    let [auto, schur, newton] = SOLVERS.map(|solver| falling(&functions, 2, solver, 20));
    let error = apart(&auto.state, &newton.state).max(apart(&schur.state, &newton.state));
    assert!(error < 1e-12, "{error:e} apart");
    assert_eq!(auto.stats().newton_steps, 0);
}

#[test]
fn a_constraint_there_twice_is_named_as_before() {
    let mut functions = chain(false, false);
    functions.g.push(&functions.g[7] * 2.0);
    for solver in SOLVERS {
        let mut walk = falling(&functions, 2, solver, 0);
        let wanted = StepError::DependentConstraints {
            constraints: vec![7, LINKS],
        };
        assert_eq!(walk.step(), Err(wanted), "with {solver:?}");
    }
}

/// Skates on a slope, each with its place, its direction and a rod of unit length to its load above it.
fn skates(count: usize, has_own_velocity: bool) -> Arc<Mechanical> {
    let n = 4 * count;
    let (y, z, nu) = (inputs(Y, n), inputs(Z, n), inputs(FOURTH, count));
    let speed = if has_own_velocity { 1.25 } else { 1.0 };
    let (mut k, mut reactions, mut g) = (Vec::new(), Vec::new(), Vec::new());
    for (i, nu) in nu.iter().enumerate() {
        let (x, angle) = (4 * i, &y[4 * i + 2]);
        k.push((angle.sin() * &z[x] - angle.cos() * &z[x + 1]) * speed);
        reactions.extend([
            -(angle.sin() * nu),
            angle.cos() * nu,
            0.0.into(),
            0.0.into(),
        ]);
        let arm = &y[x + 3] - &y[x] * 0.2;
        g.push((&arm * &arm - 1.0) * 0.5);
    }
    let force = |k: usize| match k % 4 {
        0 => y[k + 1].cos() * 0.5,
        1 => &z[k - 1] * &y[k] * -0.1,
        _ => 0.0.into(),
    };
    let functions = Functions {
        v: has_own_velocity.then(|| z.iter().map(|z| z * 1.25).collect()),
        p: z.clone(),
        f: (0..n).map(force).collect(),
        r: None,
        g,
        params: 0,
    };
    functions.nonholonomic(&k, &reactions)
}

/// Where skates that start in these directions are after a few steps.
fn sliding(angles: &[f64], s: usize, has_own_velocity: bool) -> State {
    let problem = skates(angles.len(), has_own_velocity);
    let place = |angle: &f64| [0.1 * angle, 0.3, *angle, 1.0 + 0.02 * angle];
    let velocity = |angle: &f64| [angle.cos(), angle.sin(), 0.7, 0.2 * angle.cos()];
    let y: Vec<f64> = angles.iter().flat_map(place).collect();
    let z: Vec<f64> = angles.iter().flat_map(velocity).collect();
    let mut model = Model::new(problem, &[]);
    let mut state = model.state(0.0, &y, &z);
    let mut spark = Spark::new(model, s, Solver::Auto);
    for k in 0..10 {
        let stepped = spark.step(f64::from(k) * 0.05, 0.05, &mut state);
        stepped.expect("a step can be made");
    }
    state
}

#[test]
fn many_nonholonomic_systems_move_as_each_alone() {
    let angles: Vec<f64> = (0..12).map(|k| 0.3 + 0.1 * f64::from(k)).collect();
    for s in 1..=3 {
        for has_own_velocity in [false, true] {
            let all = sliding(&angles, s, has_own_velocity);
            for (i, angle) in angles.iter().enumerate() {
                let one = sliding(&[*angle], s, has_own_velocity);
                let error = distance(&all.y[4 * i..4 * i + 4], &one.y)
                    .max(distance(&all.z[4 * i..4 * i + 4], &one.z));
                assert!(error < 1e-13, "{error:e} apart, skate {i}, s = {s}");
            }
        }
    }
}
