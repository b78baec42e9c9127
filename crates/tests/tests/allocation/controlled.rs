//! Steps of differentiated runs that errors control, whose random tangents are followed too.

use crate::counting::allocations;
use liouville_alpha::{Alpha, AlphaSlopes, AlphaTangents, Reactions};
use liouville_base::linalg::Matrix;
use liouville_base::method::{Estimating, Tolerance};
use liouville_base::tableau;
use liouville_index2::semi_explicit::{SemiExplicitModel, SemiExplicitSensitivityModel};
use liouville_index2::{Index2, Index2Tangents};
use liouville_problem::{Directions, Model, SecondOrderModel, SensitivityModel};
use liouville_spark::{Solver, Spark, SparkTangents};
use liouville_tests::sensitivity::semi_explicit_sensitivity;
use liouville_tests::{
    Expr, Functions, PENDULUM, Y, Z, input, inputs, jacobian, pendulum, semi_explicit, tape,
    turning,
};

const N: usize = 3;

fn tolerance(n: usize) -> Tolerance {
    Tolerance {
        rtol: 1e-6,
        atol: vec![1e-9; n],
        longest: 0.01,
    }
}

/// One direction, by the start.
fn directions(params: usize) -> Directions {
    Directions {
        tau: Matrix::zeros(1, 1 + params),
        stretch: vec![0.0],
    }
}

/// Allocations of steps of different lengths, one of which is made twice, after others.
fn others<M: Estimating>(method: &mut M, state: &mut M::State) -> usize {
    let mut t = 0.0;
    let mut step = |h: f64, is_undone: bool| {
        method.step(t, h, state).expect("a step");
        assert!(method.error().is_finite());
        if is_undone {
            method.undo(state);
        } else {
            t += h;
        }
    };
    let mut steps = || {
        for (h, is_undone) in [(0.01, false), (0.02, true), (0.005, false)] {
            step(h, is_undone);
        }
    };
    steps();
    allocations(|| (0..5).for_each(|_| steps()))
}

#[test]
fn controlled_steps_of_spark_with_tangents_take_no_memory() {
    let (functions, y) = (pendulum(), [1.0, 0.0]);
    for tableau in [
        tableau::Spark::gauss(1),
        tableau::Spark::gauss(3),
        tableau::Spark::lobatto(3, tableau::Force::B),
    ] {
        let problem = functions.build();
        let sensitivity = SensitivityModel::new(functions.sensitivity(&problem), &PENDULUM);
        let mut model = Model::new(problem, &PENDULUM);
        let motion = model.state(0.0, &y, &[0.0; 2]);
        let spark = Spark::of(model, tableau, Solver::Auto).estimating(tolerance(2));
        let start = (Matrix::zeros(1, 2), Matrix::zeros(1, 2), vec![0.0]);
        let at = (0.0, motion, &PENDULUM[..]);
        let made = SparkTangents::new(spark, sensitivity, directions(PENDULUM.len()), at, start);
        let (mut stepper, mut state) = made.expect("derivatives are finite");
        assert_eq!(others(&mut stepper, &mut state), 0);
    }
}

#[test]
fn controlled_steps_of_index_2_with_tangents_take_no_memory() {
    let (f, k) = turning();
    let mut model = SemiExplicitModel::new(semi_explicit(&f, &k), &[]);
    let start = model.state(0.0, &[0.0, 0.0, 1.0], &[0.0], 0.01);
    let motion = start.expect("a start");
    let sensitivity = semi_explicit_sensitivity(&f, &k, &model.problem);
    let sensitivity = SemiExplicitSensitivityModel::new(sensitivity, &[]);
    let tableau = tableau::Spark::gauss(3);
    let index2 = Index2::of(model, &tableau).estimating(&tableau, tolerance(3));
    let (at, y) = ((0.0, motion, &[][..]), Matrix::zeros(1, 3));
    let made = Index2Tangents::new(index2, sensitivity, directions(0), at, y);
    let (mut stepper, mut state) = made.expect("derivatives are finite");
    assert_eq!(others(&mut stepper, &mut state), 0);
}

/// Three masses on springs, of which each pulls the next.
fn springs() -> Functions {
    let (y, z) = (inputs(Y, N), inputs(Z, N));
    Functions {
        v: None,
        f: (0..N).map(|k| &y[(k + 1) % N] - &y[k] * 3.0).collect(),
        p: z,
        r: None,
        g: Vec::new(),
        params: 0,
    }
}

/// The derivatives of a step of [`springs`], whose unknown is φ1: a1 = (0.9 φ1 + 0.1 φ0), and E = φ1 − f(y1).
fn slopes(weights: tableau::Alpha) -> AlphaSlopes {
    let (h, at) = (input(1, 0), |group: usize| inputs(group, N));
    let (y0, z0, a0, phi0, u) = (at(2), at(3), at(4), at(5), at(6));
    let tableau::Alpha {
        alpha_f,
        gamma,
        beta,
        ..
    } = weights;
    let a: Vec<Expr> = (0..N)
        .map(|k| &u[k] * (1.0 - alpha_f) + &phi0[k] * alpha_f)
        .collect();
    let y: Vec<Expr> = (0..N)
        .map(|k| &y0[k] + &h * (&z0[k] + &h * (&a0[k] * (0.5 - beta) + &a[k] * beta)))
        .collect();
    let z: Vec<Expr> = (0..N)
        .map(|k| &z0[k] + &h * (&a0[k] * (1.0 - gamma) + &a[k] * gamma))
        .collect();
    let residual: Vec<Expr> = (0..N)
        .map(|k| &u[k] - (&y[(k + 1) % N] - &y[k] * 3.0))
        .collect();
    let end = [y, z, a].concat();
    let point = [1, 1, N, N, N, N, N];
    let along = |of: &[Expr], first: usize| -> Vec<Expr> {
        // x = (t0, h, y0, z0, a0, φ0)
        let places: Vec<(usize, usize)> = [(0, 1), (1, 1), (2, N), (3, N), (4, N), (5, N)]
            .iter()
            .flat_map(|(group, size)| (0..*size).map(|k| (*group, k)))
            .collect();
        of.iter()
            .map(|x| {
                let each = places.iter().enumerate();
                each.fold(0.0.into(), |sum: Expr, (i, (group, k))| {
                    sum + x.d(*group, *k) * input(first, i)
                })
            })
            .collect()
    };
    let (pattern, values) = jacobian(&residual, 6, N, N);
    let of_end: Vec<Expr> = along(&end, 7)
        .iter()
        .zip(&end)
        .map(|(by_x, x)| (0..N).fold(by_x.clone(), |sum, k| sum + x.d(6, k) * input(8, k)))
        .collect();
    let sizes = |more: &[usize]| [&point[..], more, &[0]].concat();
    let x = 2 + 4 * N;
    let of_start: Vec<Expr> = (0..N)
        .map(|k| {
            let (next, own) = (input(4, 1 + (k + 1) % N), input(4, 1 + k));
            next - own * 3.0
        })
        .collect();
    AlphaSlopes {
        matrix: tape(sizes(&[]), &values),
        pattern,
        equations: tape(sizes(&[x]), &along(&residual, 7)),
        end: tape(sizes(&[x, N]), &of_end),
        start: tape([1, N, N, N, 1 + 2 * N, 0], &of_start),
    }
}

#[test]
fn controlled_steps_of_the_alpha_family_with_tangents_take_no_memory() {
    let weights = tableau::Alpha {
        alpha_m: 0.0,
        alpha_f: 0.1,
        gamma: 0.6,
        beta: 0.3025,
    };
    let functions = springs();
    let model = SecondOrderModel::new(functions.second_order(), &[]);
    let problem = model.general.problem.clone();
    let reactions = Reactions::Extended {
        b: 0.0,
        predicted: false,
    };
    let mut alpha = Alpha::new(model, weights, reactions, Some(tolerance(N)));
    let motion = alpha
        .start(0.0, &[1.0, 0.0, 0.3], &[0.0; N], None)
        .expect("a start");
    let slopes = slopes(weights);
    assert!(slopes.fit((N, 0, 0), reactions));
    let sensitivity = SensitivityModel::new(functions.sensitivity(&problem), &[]);
    let made = AlphaTangents::new(
        alpha,
        (slopes, &[]),
        (sensitivity, directions(0)),
        (0.0, motion, false),
        (Matrix::zeros(1, N), Matrix::zeros(1, N)),
    );
    let (mut stepper, mut state) = made.expect("derivatives are finite");
    assert_eq!(others(&mut stepper, &mut state), 0);
}
