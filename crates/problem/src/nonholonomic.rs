//! Nonholonomic constraints of a mechanical system, and the reactions that keep them:
//!
//!     d/dt p(t, y, z) = f(t, y, z) + r(t, y, λ) + r_n(t, y, z, ν),   0 = k(t, y, z)
//!
//! where k is any function of positions and velocities. Ideal reactions, r_n = −(∂k/∂v)ᵀ ν, do no work
//! where k is linear in v. Source: jay2009lagrange; the paper's ψ is ν.

use super::{Mass, Mechanical, Mismatch, check, check_pattern, cut};
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, Pattern, add_scaled, dependent_rows};
use liouville_base::real::Real;
use liouville_base::tape::{Registers, Tape};

/// The tapes and patterns of l nonholonomic constraints.
///
/// As in [`super::Mechanical`] the tapes' last input is the parameters.
#[derive(Clone, Debug)]
pub struct Nonholonomic {
    /// Number of constraints.
    pub l: usize,
    /// (t, y, z, ν) → k, r_n
    pub values: Tape,
    /// (t, y, z, ν) → k_y, k_z, and of r_n its derivatives by y, z and ν
    pub blocks: Tape,
    /// (t, y, z) → w_y of the hidden holonomic constraints
    pub hidden: Tape,
    /// Where the derivatives are not zero.
    pub patterns: NonholonomicPatterns,
}

/// The sparsity of each derivative; those of r_n are called by `r`.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct NonholonomicPatterns {
    pub k_y: Pattern,
    pub k_z: Pattern,
    pub r_y: Pattern,
    pub r_z: Pattern,
    pub r_nu: Pattern,
    pub w_y: Pattern,
}

impl Nonholonomic {
    /// Sees that the parts fit to n coordinates, m holonomic constraints and the parameters.
    pub(super) fn check(&self, n: usize, m: usize, params: usize) -> Result<(), Mismatch> {
        let (l, at) = (self.l, &self.patterns);
        let shaped = [
            ("k_y", &at.k_y, (l, n)),
            ("k_z", &at.k_z, (l, n)),
            ("rn_y", &at.r_y, (n, n)),
            ("rn_z", &at.r_z, (n, n)),
            ("rn_nu", &at.r_nu, (n, l)),
        ];
        let blocks = shaped.iter().map(|(_, pattern, _)| pattern.len()).sum();
        for (name, tape, outputs) in [
            ("nonholonomic", &self.values, l + n),
            ("nonholonomic_blocks", &self.blocks, blocks),
        ] {
            check(name, tape.inputs().len(), 5)?;
            for (found, wanted) in tape.inputs().iter().zip([1, n, n, l, params]) {
                check(name, *found, wanted)?;
            }
            check(name, tape.outputs(), outputs)?;
        }
        let name = "nonholonomic_hidden";
        check(name, self.hidden.inputs().len(), 4)?;
        for (found, wanted) in self.hidden.inputs().iter().zip([1, n, n, params]) {
            check(name, *found, wanted)?;
        }
        check(name, self.hidden.outputs(), at.w_y.len())?;
        for (name, pattern, shape) in shaped {
            check_pattern(name, pattern, shape)?;
        }
        check_pattern("w_y", &at.w_y, (m, n))
    }
}

/// The memory in which the tapes of [`Nonholonomic`] work.
#[derive(Clone, Debug)]
pub(super) struct Bound<R = f64> {
    values: Registers<R>,
    blocks: Registers<R>,
    hidden: Registers<R>,
}

impl<R: Real> Bound<R> {
    pub(super) fn new(problem: &Nonholonomic, params: &[R]) -> Self {
        Self {
            values: problem.values.bind(params),
            blocks: problem.blocks.bind(params),
            hidden: problem.hidden.bind(params),
        }
    }

    pub(super) fn values(&mut self, problem: &Nonholonomic, args: [&[R]; 4]) -> [&[R]; 2] {
        let n = args[1].len();
        cut(problem.values.eval(&mut self.values, args), [problem.l, n])
    }

    pub(super) fn blocks(&mut self, problem: &Nonholonomic, args: [&[R]; 4]) -> [&[R]; 5] {
        let at = &problem.patterns;
        let sizes = [&at.k_y, &at.k_z, &at.r_y, &at.r_z, &at.r_nu].map(Pattern::len);
        cut(problem.blocks.eval(&mut self.blocks, args), sizes)
    }

    pub(super) fn hidden(&mut self, problem: &Nonholonomic, args: [&[R]; 3]) -> &[R] {
        problem.hidden.eval(&mut self.hidden, args)
    }
}

impl Bound {
    /// How much roundings may change k, and r_n behind it.
    pub(super) fn roundings(&self, problem: &Nonholonomic, args: &[&[f64]]) -> Vec<f64> {
        problem.values.roundings(&self.values, args)
    }
}

/// The constraints, holonomic and then nonholonomic, whose gradients by z are dependent, if any are.
///
/// Of several members nothing is said: each is asked alone.
pub fn diagnose_rank_all<R: Real>(
    problem: &Mechanical,
    mass: &Mass<R>,
    g_y: &[R],
    k_z: &[R],
) -> StepError {
    let (Some(g_y), Some(k_z)) = (R::alone(g_y), R::alone(k_z)) else {
        return StepError::SingularNewton;
    };
    let mut rows = Matrix::zeros(problem.multipliers(), problem.n);
    match mass.v_z() {
        None => problem.patterns.g_y.add_to(g_y, 1.0, &mut rows, 0, 0),
        Some((pattern, values)) => {
            let values = R::alone(values).unwrap_or_default();
            let mut v_z = Matrix::zeros(problem.n, problem.n);
            pattern.add_to(values, 1.0, &mut v_z, 0, 0);
            for (&(row, col), g_y) in problem.patterns.g_y.entries().iter().zip(g_y) {
                add_scaled(rows.row_mut(row), *g_y, v_z.row(col));
            }
        }
    }
    if let Some(own) = &problem.nonholonomic {
        own.patterns.k_z.add_to(k_z, 1.0, &mut rows, problem.m, 0);
    }
    dependent_rows(rows).map_or(StepError::SingularNewton, |constraints| {
        StepError::DependentConstraints { constraints }
    })
}
