//! Reactions −Gᵀ λ and the matrices of their multipliers: G W Gᵀ by elimination where W is diagonal,
//! otherwise by the saddle-point matrix it is the Schur complement of.

use super::inertia::Inertia;
use crate::problem::{Saddle, SeparableModel, diagnose_rank};
use liouville_base::error::StepError;
use liouville_base::linalg::{Gram, Pattern, Singular, copy, max_norm};

/// G at the start of a step, and what solves for multipliers.
#[derive(Clone, Debug)]
pub(super) struct Reactions {
    /// G where a step starts, column by column, and `g_t` there.
    gradient: Vec<f64>,
    drift: Vec<f64>,
    columns: Columns,
    solver: Solver,
    multipliers: Vec<f64>,
}

/// Where the entries of each column start, and their rows.
#[derive(Clone, Debug)]
struct Columns {
    starts: Vec<u32>,
    rows: Vec<u32>,
}

#[derive(Clone, Debug)]
enum Solver {
    Eliminated(Box<Eliminated>),
    /// The saddle-point matrix at the start, kept for the step; zero.
    Saddle(Box<Saddle>, Vec<f64>),
}

/// G(t1, ỹ1) W G0ᵀ for positions and G W Gᵀ for velocities.
#[derive(Clone, Debug)]
struct Eliminated {
    /// W of each entry of G, and W times that entry at the start.
    mobility: Vec<f64>,
    moved: Vec<f64>,
    of_positions: Gram,
    of_velocities: Gram,
    /// Nothing changes where G is constant.
    is_constant: bool,
    is_ready: bool,
}

impl Columns {
    #[allow(clippy::cast_possible_truncation)] // a pattern of so many entries would fill memory
    fn new(pattern: &Pattern) -> Self {
        let entries = pattern.entries();
        let start = |col: usize| entries.partition_point(|entry| entry.1 < col) as u32;
        Self {
            starts: (0..=pattern.shape().1).map(start).collect(),
            rows: entries.iter().map(|(row, _)| *row as u32).collect(),
        }
    }

    /// Hands out the elements of Gᵀ x, one after another.
    #[inline]
    fn transposed(&self, values: &[f64], x: &[f64], mut take: impl FnMut(usize, f64)) {
        let mut start = 0;
        for (col, end) in self.starts[1..].iter().enumerate() {
            let entries = start..*end as usize;
            start = entries.end;
            // two bonds hold most coordinates of most molecules
            let sum = match (&self.rows[entries.clone()], &values[entries]) {
                ([i, j], [a, b]) => a * x[*i as usize] + b * x[*j as usize],
                ([i], [a]) => a * x[*i as usize],
                (rows, values) => {
                    let products = rows.iter().zip(values);
                    products.map(|(row, value)| value * x[*row as usize]).sum()
                }
            };
            take(col, sum);
        }
    }

    /// `out += G x`
    #[inline]
    fn multiply_add(&self, values: &[f64], x: &[f64], out: &mut [f64]) {
        let mut start = 0;
        for (x, end) in x.iter().zip(&self.starts[1..]) {
            let entries = start..*end as usize;
            start = entries.end;
            for (row, value) in self.rows[entries.clone()].iter().zip(&values[entries]) {
                out[*row as usize] += value * x;
            }
        }
    }
}

impl Reactions {
    pub(super) fn new(model: &SeparableModel, inertia: &Inertia) -> Self {
        let general = &model.problem.mechanical;
        let pattern = &general.patterns.g_y;
        let solver = match inertia.mobility() {
            Some(mobility) => {
                let gram = Gram::new(pattern);
                let cols = pattern.entries().iter().map(|(_, col)| *col);
                Solver::Eliminated(Box::new(Eliminated {
                    mobility: cols.map(|col| mobility[col]).collect(),
                    moved: vec![0.0; pattern.len()],
                    of_positions: gram.clone(),
                    of_velocities: gram,
                    is_constant: model.problem.gradient.is_empty(),
                    is_ready: false,
                }))
            }
            None => Solver::Saddle(Box::new(Saddle::new(&model.general)), vec![0.0; general.n]),
        };
        Self {
            gradient: vec![0.0; pattern.len()],
            drift: vec![0.0; general.m],
            columns: Columns::new(pattern),
            multipliers: vec![0.0; general.m],
            solver,
        }
    }

    /// G and `g_t` at (t, y), where the next step starts.
    pub(super) fn start_at(
        &mut self,
        model: &mut SeparableModel,
        t: f64,
        y: &[f64],
    ) -> Result<(), StepError> {
        if self.drift.is_empty() {
            return Ok(());
        }
        let [gradient, drift] = model.gradient(t, y)?;
        copy(&mut self.gradient, gradient);
        copy(&mut self.drift, drift);
        match &mut self.solver {
            Solver::Eliminated(eliminated) => {
                let entries = self.gradient.iter().zip(&eliminated.mobility);
                for (moved, (g, mobility)) in eliminated.moved.iter_mut().zip(entries) {
                    *moved = g * mobility;
                }
                Ok(())
            }
            Solver::Saddle(saddle, zeros) => {
                let lam = &self.drift; // no block depends on λ
                saddle.update(&mut model.general, t, y, zeros, lam)
            }
        }
    }

    /// Factors what positions are corrected with, at a guess of the step's end; returns how often.
    pub(super) fn factor_at(
        &mut self,
        model: &mut SeparableModel,
        t: f64,
        y: &[f64],
    ) -> Result<usize, StepError> {
        let Solver::Eliminated(eliminated) = &mut self.solver else {
            return Ok(0);
        };
        if eliminated.is_constant {
            return self.factor(model);
        }
        let [gradient, _] = model.gradient(t, y)?;
        let factored = eliminated.of_positions.factor(gradient, &eliminated.moved);
        let Err(singular) = factored else {
            return Ok(1);
        };
        let gradient = gradient.to_vec();
        Err(dependent(model, &gradient, singular))
    }

    /// Factors what velocities are stopped with, at the start last set; returns how often.
    pub(super) fn factor(&mut self, model: &SeparableModel) -> Result<usize, StepError> {
        let Solver::Eliminated(eliminated) = &mut self.solver else {
            return Ok(1);
        };
        if eliminated.is_constant && eliminated.is_ready {
            return Ok(0);
        }
        let gram = &mut eliminated.of_velocities;
        gram.factor_symmetric(&self.gradient, &eliminated.moved)
            .map_err(|singular| dependent(model, &self.gradient, singular))?;
        eliminated.is_ready = true;
        Ok(1)
    }

    /// x with G W Gᵀ x = `x`, as positions want it.
    pub(super) fn solve_positions(&mut self, model: &SeparableModel, x: &mut [f64]) {
        match &mut self.solver {
            Solver::Eliminated(eliminated) if !eliminated.is_constant => {
                eliminated.of_positions.solve(x);
            }
            _ => self.solve_velocities(model, x),
        }
    }

    fn solve_velocities(&mut self, model: &SeparableModel, x: &mut [f64]) {
        match &mut self.solver {
            Solver::Eliminated(eliminated) => eliminated.of_velocities.solve(x),
            Solver::Saddle(saddle, rest) => {
                // its columns are reactions, −Gᵀ
                for x in x.iter_mut() {
                    *x = -*x;
                }
                saddle.solve(&model.general, rest, x);
                rest.fill(0.0);
            }
        }
    }

    /// `out += factor Gᵀ x`
    pub(super) fn push(&self, x: &[f64], factor: f64, out: &mut [f64]) {
        let out = &mut out[..self.columns.starts.len() - 1];
        let columns = &self.columns;
        columns.transposed(&self.gradient, x, |col, sum| out[col] += factor * sum);
    }

    /// `reaction −= factor Gᵀ x`; returns the largest move W Gᵀ x.
    pub(super) fn pull(
        &self,
        inertia: &mut Inertia,
        x: &[f64],
        factor: f64,
        (reaction, moves): (&mut [f64], &mut [f64]),
    ) -> f64 {
        let size = self.columns.starts.len() - 1;
        let (reaction, moves) = (&mut reaction[..size], &mut moves[..size]);
        self.columns.transposed(&self.gradient, x, |col, sum| {
            moves[col] = sum;
            reaction[col] -= factor * sum;
        });
        inertia.move_by(moves);
        max_norm(moves)
    }

    /// Takes from the momenta what makes velocities `v` leave the constraints.
    pub(super) fn stop(&mut self, model: &SeparableModel, v: &[f64], momenta: &mut [f64]) {
        let mut rates = std::mem::take(&mut self.multipliers);
        copy(&mut rates, &self.drift);
        self.columns.multiply_add(&self.gradient, v, &mut rates);
        self.solve_velocities(model, &mut rates);
        self.push(&rates, -1.0, momenta);
        self.multipliers = rates;
    }
}

fn dependent(model: &SeparableModel, gradient: &[f64], _: Singular) -> StepError {
    let pattern = &model.problem.mechanical.patterns.g_y;
    diagnose_rank(pattern, gradient, StepError::SingularNewton)
}
