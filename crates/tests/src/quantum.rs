//! Grids, potentials and lists of flows for Schrödinger equations.

use super::{Expr, T, input, tape};
use liouville_base::composition::Flow;
use liouville_base::linalg::Rows;
use liouville_base::tableau::splitting::split_program;
use liouville_waves::method::Wave;
use liouville_waves::problem::{Hamiltonian, Kinetic, Operator, Potential};
use std::f64::consts::TAU;
use std::sync::Arc;

/// k²/2 of a ring of length 2π in the order of the transform.
pub fn energies(points: u32) -> Vec<f64> {
    let k = |j: u32| f64::from(j.min(points - j));
    (0..points).map(|j| k(j) * k(j) / 2.0).collect()
}

/// Kinetic energy on a torus of these numbers of points.
pub fn kinetic(points: &[u32]) -> Operator {
    let energies: Vec<Vec<f64>> = points.iter().map(|n| energies(*n)).collect();
    Operator::Kinetic(Arc::new(Kinetic::new(&energies).expect("even energies")))
}

/// Places on a ring of length 2π.
pub fn places(points: u32) -> Vec<f64> {
    let place = |j: u32| TAU * f64::from(j) / f64::from(points);
    (0..points).map(place).collect()
}

/// A diagonal matrix.
pub fn diagonal(values: &[f64]) -> Operator {
    let n = values.len();
    let all: Vec<usize> = (0..n).collect();
    let rows = Rows::new((n, n), &all, &all, values).expect("entries inside");
    Operator::Rows(Arc::new(rows))
}

/// A rotor in a field that swings: V = 2 cos x + a sin 3t sin(x + 1).
pub fn rotor(points: u32, a: f64) -> Hamiltonian {
    let x = places(points);
    let fixed: Vec<f64> = x.iter().map(|x| 2.0 * x.cos()).collect();
    let hamiltonian = Hamiltonian::new(vec![kinetic(&[points]), diagonal(&fixed)]);
    if a == 0.0 {
        return hamiltonian;
    }
    let swing = (input(T, 0) * 3.0).sin() * (input(1, 0) + 1.0).sin() * a;
    hamiltonian.with_potential(potential(&x, &swing))
}

/// A potential on a line.
pub fn potential(x: &[f64], v: &Expr) -> Potential {
    let time = Arc::new(tape([1, 0], &[input(T, 0)]));
    let tape = Arc::new(tape([1, 1, 0], std::slice::from_ref(v)));
    Potential::new((time, tape), &[], x).expect("one coordinate")
}

/// A smooth wave function that is neither real nor even.
pub fn packet(points: u32) -> Wave<f64> {
    let x = places(points);
    let envelope = |x: f64| (1.5 * (x - 2.0).cos()).exp() / 4.0;
    let q = x.iter().map(|&x| envelope(x) * x.cos()).collect();
    let p = x.iter().map(|&x| envelope(x) * x.sin()).collect();
    Wave::new(q, p)
}

/// The flows of a splitting by name, of T (part 0) and V (part 1).
pub fn flows(name: &str) -> Vec<Flow> {
    let turns = split_program(name).expect("a splitting of this name");
    let flow = |turn: liouville_base::tableau::splitting::Turn| Flow {
        part: usize::from(turn.is_kick),
        is_adjoint: false,
        weight: turn.weight,
        offset: turn.offset,
    };
    turns.into_iter().map(flow).collect()
}

/// The distance of two wave functions whose phases are taken off.
pub fn distance(a: &Wave<f64>, b: &Wave<f64>) -> f64 {
    assert!(a.q.len() == b.q.len());
    let (sin, cos) = (a.phase - b.phase).sin_cos();
    let squares = (0..a.q.len()).map(|k| {
        // e^{−i(phase of a − phase of b)} a
        let q = a.q[k] * cos + a.p[k] * sin;
        let p = a.p[k] * cos - a.q[k] * sin;
        (q - b.q[k]).powi(2) + (p - b.p[k]).powi(2)
    });
    squares.sum::<f64>().sqrt()
}
