//! A stepper on its way, over systems in which nothing can cancel.

use super::{Functions, LAM, T, Y, Z, dot, input, inputs};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use liouville_problem::{Mechanical, Model, State};
use liouville_spark::{Solver, Spark};
use std::sync::Arc;

pub const SOLVERS: [Solver; 3] = [Solver::Auto, Solver::NodeSchur, Solver::Newton];

/// A ball of radius 1 around a moving centre, with a momentum that is nonlinear in z and depends on
/// t and y, and forces that depend on everything: nothing can cancel here.
pub fn driven() -> Functions {
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

/// The same ball with a mass matrix M(t, y), for methods that want one.
pub fn heavy() -> Functions {
    let (t, y, z) = (input(T, 0), inputs(Y, 3), inputs(Z, 3));
    let mass = t.sin() * 0.3 + &y[0] * &y[0] * 0.1 + 1.0;
    Functions {
        p: vec![
            &mass * &z[0] + &y[1] * &z[2] * 0.2,
            &mass * &z[1] + y[0].sin() * &z[1] * 0.1,
            &mass * &z[2] + &y[1] * &z[0] * 0.2,
        ],
        ..driven()
    }
}

/// The same ball with v ≠ z and a reaction that is nonlinear in λ.
pub fn general() -> Functions {
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

pub const START: f64 = 0.3;

/// A start of [`driven`] at t = 0.3: g = 0 and g_t + g_y z = 0.
pub fn driven_start() -> ([f64; 3], [f64; 3]) {
    let (centre, speed) = (0.3 * START.sin(), 0.3 * START.cos());
    ([centre + 0.6, 0.0, -0.8], [speed + 0.8, 1.1, 0.6])
}

/// A start of [`general`] at t = 0.3, with the velocities of [`driven_start`].
pub fn general_start() -> ([f64; 3], [f64; 3]) {
    let (y, v) = driven_start();
    let size: f64 = y.iter().map(|y| y * y).sum();
    let mut z1 = v[1];
    for _ in 0..60 {
        z1 -= (z1 + 0.3 * z1.sin() - v[1]) / (1.0 + 0.3 * z1.cos());
    }
    (y, [v[0] - 0.2 * y[1] * z1, z1, v[2] / (1.0 + 0.1 * size)])
}

/// A stepper on its way.
pub struct Walk {
    pub spark: Spark,
    pub model: Model,
    pub state: State,
    pub t0: f64,
    pub h: f64,
    pub n: u32,
}

pub fn walk(problem: &Arc<Mechanical>, params: &[f64], s: usize, solver: Solver, h: f64) -> Walk {
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
    pub fn t(&self) -> f64 {
        self.t0 + f64::from(self.n) * self.h
    }

    pub fn step(&mut self) -> Result<(), StepError> {
        self.spark.step(self.t(), self.h, &mut self.state)?;
        self.n += 1;
        Ok(())
    }

    pub fn steps(mut self, count: u32) -> Self {
        for _ in 0..count {
            self.step().expect("a step can be made");
        }
        self
    }

    pub fn stats(&self) -> Stats {
        self.spark.stats()
    }

    /// The largest of g and of w = g_t + g_y v.
    pub fn violation(&mut self) -> f64 {
        let (t, State { y, z, .. }) = (self.t(), &self.state);
        let lam = vec![0.0; self.model.problem.m];
        let g = largest(self.model.node(t, y, &lam)[0]);
        g.max(largest(self.model.end(t, y, z)[1]))
    }
}

pub fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |largest, x| x.abs().max(largest))
}

pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter()
        .zip(b)
        .fold(0.0, |most, (a, b)| (a - b).abs().max(most))
}

pub fn apart(a: &State, b: &State) -> f64 {
    distance(&a.y, &b.y).max(distance(&a.z, &b.z))
}
