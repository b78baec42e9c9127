//! RATTLE with each of its matrices of multipliers: eliminated, and by the saddle-point matrix.

use liouville_base::linalg::max_norm;
use liouville_base::method::Stepper;
use liouville_problem::{SeparableModel, State};
use liouville_spark::rattle::Rattle;
use liouville_tests::{Expr, Functions, Y, Z, dot, inputs};

/// Beads in the plane, bonded in pairs to one another or to the origin, under gravity.
fn bonded(beads: usize, bonds: &[(Option<usize>, usize)], coupling: f64) -> Functions {
    let (y, z) = (inputs(Y, 2 * beads), inputs(Z, 2 * beads));
    let place = |bead: Option<usize>, axis: usize| match bead {
        Some(bead) => y[2 * bead + axis].clone(),
        None => 0.0.into(),
    };
    let length = |&(from, to): &(Option<usize>, usize)| {
        let arm = [0, 1].map(|axis| &y[2 * to + axis] - place(from, axis));
        (dot(&arm, &arm) - 1.0) * 0.5
    };
    let neighbour =
        |k: usize| &z[(k + 2) % z.len()] * coupling + &z[(k + z.len() - 2) % z.len()] * coupling;
    let gravity = |k: usize| Expr::from(if k % 2 == 1 { -1.0 } else { 0.0 });
    Functions {
        v: None,
        p: (0..z.len()).map(|k| &z[k] + neighbour(k)).collect(),
        f: (0..z.len()).map(gravity).collect(),
        r: None,
        g: bonds.iter().map(length).collect(),
        params: 0,
    }
}

fn model(functions: &Functions) -> SeparableModel {
    SeparableModel::new(functions.separable(), &[])
}

/// The largest constraint, and the largest velocity across one.
fn defects(functions: &Functions, state: &State) -> (f64, f64) {
    let mut model = model(functions);
    let g = max_norm(model.constraint(0.0, &state.y).expect("finite"));
    let pattern = model.problem.mechanical.patterns.g_y.clone();
    let [gradient, _] = model.gradient(0.0, &state.y).expect("finite");
    let mut rates = vec![0.0; pattern.shape().0];
    pattern.multiply_add(gradient, 1.0, &state.z, &mut rates);
    (g, max_norm(&rates))
}

#[test]
fn every_matrix_keeps_the_constraints_and_steps_back() {
    let angle = |k: usize| 0.4 + 0.3 * (k as f64).sin();
    let chain: Vec<_> = (0..14_usize).map(|k| (k.checked_sub(1), k)).collect();
    let mut ends = vec![0.0; 28];
    for k in 0..14_usize {
        let before = k
            .checked_sub(1)
            .map_or([0.0; 2], |b| [ends[2 * b], ends[2 * b + 1]]);
        ends[2 * k] = before[0] + angle(k).cos();
        ends[2 * k + 1] = before[1] - angle(k).sin();
    }
    // all bonds of a star share a bead: its matrix is full
    let star: Vec<_> = (0..32_usize)
        .map(|k| (k.checked_sub(1).map(|_| 0), k))
        .collect();
    let tips = (1..32).flat_map(|k| {
        let around = 0.2 * f64::from(k);
        [1.0 + around.cos(), around.sin()]
    });
    let around: Vec<f64> = [1.0, 0.0].into_iter().chain(tips).collect();
    let cases = [
        (bonded(14, &chain, 0.0), ends.clone()),
        (bonded(14, &chain, 0.1), ends),
        (bonded(32, &star, 0.0), around),
    ];
    for (case, (functions, start)) in cases.iter().enumerate() {
        let mut model = model(functions);
        let mut state = model.general.state(0.0, start, &vec![0.0; start.len()]);
        let mut rattle = Rattle::new(model).expect("a mass");
        for k in 0..40 {
            rattle
                .step(0.01 * f64::from(k), 0.01, &mut state)
                .expect("a step");
        }
        let (g, rate) = defects(functions, &state);
        assert!(g < 1e-13 && rate < 1e-12, "{g:e}, {rate:e} in case {case}");
        let moved = state.y.iter().zip(start).map(|(a, b)| (a - b).abs());
        assert!(moved.fold(0.0, f64::max) > 0.01, "case {case} stays");
        for k in (1..=40).rev() {
            rattle
                .step(0.01 * f64::from(k), -0.01, &mut state)
                .expect("a step back");
        }
        let apart = state.y.iter().zip(start).map(|(a, b)| (a - b).abs());
        let apart = apart.fold(0.0, f64::max);
        assert!(apart < 1e-11, "{apart:e} apart in case {case}");
    }
}
