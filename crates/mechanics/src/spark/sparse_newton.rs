//! The full simplified Newton iteration of large systems: the matrix of `full_newton` as it stands, sparse,
//! in the unknowns dZ_i, dΛ_k and, where v is not z, dV_j:
//!
//!     Σ_j (δ_ij p_z(i) − h aᶠ_ij f_z(j)) dZ_j + Σ_j C_ij dV_j − Σ_k â_ik r_λ(k) dΛ_k = −R2_i
//!     Σ_j (δ_ij − h aᵛ_ij v_y(i)) dV_j − v_z(i) dZ_i                                  = −R1_i
//!     Σ_j ā_kj g_y(k) dV_j                                                             = −g_k/h
//!
//! Its order of elimination is found once, and a step factors it once.

use super::stages::{Stages, Step};
use crate::problem::{Mass, Mechanical, Model, diagnose_rank, finite};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Assembly, Factor, Matrix, Pattern, add_scaled, copy, max_norm};
use liouville_base::newton::{Equations, Stop};

/// From this order on, the sparse matrix is the faster one.
const LARGE: usize = 160;

/// The matrix and its factors.
#[derive(Clone, Debug)]
pub(super) struct SparseNewton {
    places: Places,
    matrix: Assembly,
    factor: Factor,
    /// dV_i itself.
    ones: Vec<f64>,
    /// What tells the size of a multiplier, where r is not linear.
    mass: Mass,
    r_lam: Matrix,
    unknowns: Vec<f64>,
}

/// Which blocks of the matrix the derivatives go to: `of[kind][row][col]`.
#[derive(Clone, Debug)]
struct Places {
    p_z: Vec<usize>,
    f_z: Vec<Vec<usize>>,
    p_y: Vec<Vec<usize>>,
    f_y: Vec<Vec<usize>>,
    r_y: Vec<Vec<usize>>,
    r_lam: Vec<Vec<usize>>,
    g_y: Vec<Vec<usize>>,
    v_y: Vec<Vec<usize>>,
    v_z: Vec<usize>,
    one: Vec<usize>,
}

/// The stage equations of one step, solved by sparse full Newton.
pub(super) struct Solve<'a> {
    solver: &'a mut SparseNewton,
    stages: &'a mut Stages,
    model: &'a mut Model,
    step: Step<'a>,
    is_frozen: bool,
}

/// Blocks of a matrix in the making.
struct Layout<'a> {
    n: usize,
    blocks: Vec<(&'a Pattern, usize, usize)>,
}

impl<'a> Layout<'a> {
    fn add(&mut self, pattern: &'a Pattern, row: usize, col: usize) -> usize {
        self.blocks.push((pattern, row, col));
        self.blocks.len() - 1
    }

    /// A block for each of `rows` by `cols` stages, from a corner on.
    fn grid(
        &mut self,
        pattern: &'a Pattern,
        (rows, cols): (usize, usize),
        (row, col): (usize, usize),
    ) -> Vec<Vec<usize>> {
        let (height, width) = pattern.shape();
        (0..rows)
            .map(|i| {
                let place = |j| self.add(pattern, row + i * height, col + j * width);
                (0..cols).map(place).collect()
            })
            .collect()
    }

    fn diagonal(&mut self, pattern: &'a Pattern, s: usize, row: usize, col: usize) -> Vec<usize> {
        let n = self.n;
        let place = |i| self.add(pattern, row + i * n, col + i * n);
        (0..s).map(place).collect()
    }
}

impl SparseNewton {
    /// Whether the matrix of these stages is a large one.
    pub(super) fn is_for(problem: &Mechanical, stages: &Stages) -> bool {
        let (s, k) = (stages.tableau.stages, stages.tableau.intervals);
        s * problem.n + k * problem.m >= LARGE
    }

    pub(super) fn new(model: &Model, stages: &Stages) -> Self {
        let (problem, at) = (&model.problem, &model.problem.patterns);
        let (n, m) = (problem.n, problem.m);
        let (s, k) = (stages.tableau.stages, stages.tableau.intervals);
        let (has_v, one) = (at.v_z.is_some(), Pattern::diagonal(n));
        // V has columns of its own where it is not Z, and its equations come second
        let velocity = if has_v { s * n } else { 0 };
        let last = velocity + s * n;
        let mut layout = Layout {
            n,
            blocks: Vec::new(),
        };
        let square = (s, s);
        let places = Places {
            p_z: layout.diagonal(&at.p_z, s, 0, 0),
            f_z: layout.grid(&at.f_z, square, (0, 0)),
            p_y: layout.grid(&at.p_y, square, (0, velocity)),
            f_y: layout.grid(&at.f_y, square, (0, velocity)),
            r_y: layout.grid(&at.r_y, square, (0, velocity)),
            r_lam: layout.grid(&at.r_lam, (s, k), (0, last)),
            g_y: layout.grid(&at.g_y, (k, s), (last, velocity)),
            v_y: if has_v {
                layout.grid(&at.v_y, square, (velocity, velocity))
            } else {
                Vec::new()
            },
            v_z: match &at.v_z {
                Some(v_z) => layout.diagonal(v_z, s, velocity, 0),
                None => Vec::new(),
            },
            one: if has_v {
                layout.diagonal(&one, s, velocity, velocity)
            } else {
                Vec::new()
            },
        };
        let order = last + k * m;
        let matrix = Assembly::new((order, order), &layout.blocks);
        Self {
            factor: Factor::new(matrix.pattern()),
            places,
            matrix,
            ones: vec![1.0; n],
            mass: Mass::new(model),
            r_lam: Matrix::zeros(k, at.r_lam.len()),
            unknowns: vec![0.0; order],
        }
    }

    /// The equations of one step, the matrix still to be factored.
    pub(super) fn start<'a>(
        &'a mut self,
        stages: &'a mut Stages,
        model: &'a mut Model,
        step: Step<'a>,
    ) -> Solve<'a> {
        Solve {
            solver: self,
            stages,
            model,
            step,
            is_frozen: false,
        }
    }
}

impl Solve<'_> {
    fn freeze(&mut self) -> Result<(), StepError> {
        self.solver.matrix.clear();
        self.add_stage_blocks()?;
        if self.model.problem.m > 0 {
            self.add_node_blocks()?;
        }
        if !self.model.problem.is_linear {
            let (stages, middle) = (&*self.stages, self.stages.tableau.stages / 2);
            let t = stages.stage_time(self.step, middle);
            let (y, z) = (stages.y.row(middle), stages.unknowns.z.row(middle));
            self.solver.mass.update(self.model, t, y, z)?;
        }
        let (solver, stages, model) = (&mut *self.solver, &*self.stages, &mut *self.model);
        let (pattern, values) = (solver.matrix.pattern(), solver.matrix.values());
        solver.factor.factor(pattern, values).map_err(|_| {
            let k = stages.tableau.intervals;
            let t = stages.node_time(self.step, k);
            let problem = model.problem.clone();
            let [g_y, _] = model.node_blocks(t, stages.node_y.row(k), stages.unknowns.lam.row(k));
            diagnose_rank(&problem.patterns.g_y, g_y, StepError::SingularNewton)
        })
    }

    /// Everything that comes from p, f and v.
    fn add_stage_blocks(&mut self) -> Result<(), StepError> {
        let (solver, stages, h) = (&mut *self.solver, &*self.stages, self.step.h);
        let (at, to) = (&solver.places, &mut solver.matrix);
        let (s, a_v, a_f) = (
            stages.tableau.stages,
            &stages.tableau.a_v,
            &stages.tableau.a_f,
        );
        for l in 0..s {
            let t = stages.stage_time(self.step, l);
            let (y, z) = (stages.y.row(l), stages.unknowns.z.row(l));
            let [p_z, v_z] = self.model.stage_blocks(t, y, z);
            finite(p_z, Quantity::Derivative, t)?;
            finite(v_z, Quantity::Derivative, t)?;
            to.add(at.p_z[l], p_z, 1.0);
            if let (Some(v_z_at), Some(one)) = (at.v_z.get(l), at.one.get(l)) {
                to.add(*v_z_at, v_z, -1.0);
                to.add(*one, &solver.ones, 1.0);
            }
            let blocks = self.model.stage_jacobian(t, y, z);
            for values in blocks {
                finite(values, Quantity::Derivative, t)?;
            }
            let [p_y, f_y, f_z, v_y] = blocks;
            for j in 0..s {
                to.add(at.p_y[l][j], p_y, h * a_v[(l, j)]);
                if let Some(row) = at.v_y.get(l) {
                    to.add(row[j], v_y, -h * a_v[(l, j)]);
                }
                for i in 0..s {
                    to.add(at.f_y[i][j], f_y, -h * h * a_f[(i, l)] * a_v[(l, j)]);
                }
            }
            for i in 0..s {
                to.add(at.f_z[i][l], f_z, -h * a_f[(i, l)]);
            }
        }
        Ok(())
    }

    /// Everything that comes from g and r.
    fn add_node_blocks(&mut self) -> Result<(), StepError> {
        let (solver, stages, h) = (&mut *self.solver, &*self.stages, self.step.h);
        let (at, to, tableau) = (&solver.places, &mut solver.matrix, &stages.tableau);
        let (s, a_bar, a_hat) = (tableau.stages, &tableau.a_bar, &tableau.a_hat);
        for k in 0..=tableau.intervals {
            let t = stages.node_time(self.step, k);
            let (y, lam) = (stages.node_y.row(k), stages.unknowns.lam.row(k));
            let [g_y, r_lam] = self.model.node_blocks(t, y, lam);
            finite(g_y, Quantity::Derivative, t)?;
            finite(r_lam, Quantity::Derivative, t)?;
            if let Some(row) = k.checked_sub(1) {
                for j in 0..s {
                    to.add(at.g_y[row][j], g_y, a_bar[(k, j)]);
                }
            }
            if k == tableau.intervals {
                break;
            }
            copy(solver.r_lam.row_mut(k), r_lam);
            for i in 0..s {
                to.add(at.r_lam[i][k], r_lam, -a_hat[(i, k)]);
            }
            let r_y = self.model.node_jacobian(t, y, lam);
            finite(r_y, Quantity::Derivative, t)?;
            for i in 0..s {
                for j in 0..s {
                    let factor = -h * h * a_hat[(i, k)] * a_bar[(k, j)];
                    to.add(at.r_y[i][j], r_y, factor);
                }
            }
        }
        Ok(())
    }

    /// The right-hand sides, then the solution.
    fn solve_unknowns(&mut self) {
        let (solver, stages, h) = (&mut *self.solver, &*self.stages, self.step.h);
        let problem = &self.model.problem;
        let momentum = stages.momentum_residual.flat();
        let velocity = match problem.patterns.v_z {
            Some(_) => stages.velocity_residual.flat(),
            None => &[],
        };
        let residuals = momentum.iter().chain(velocity).map(|r| -r);
        let constraint = stages.g.flat()[problem.m..].iter().map(|g| -g / h);
        for (out, value) in solver.unknowns.iter_mut().zip(residuals.chain(constraint)) {
            *out = value;
        }
        solver.factor.solve(&mut solver.unknowns);
    }

    /// Everything corrected; returns the largest velocity.
    fn correct_stages(&mut self) -> f64 {
        let (solver, unknowns) = (&mut *self.solver, &mut self.stages.unknowns);
        let problem = &self.model.problem;
        let count = unknowns.z.flat().len();
        let (d_z, rest) = solver.unknowns.split_at(count);
        let (d_v, d_lam) = match problem.patterns.v_z {
            Some(_) => rest.split_at(count),
            None => (d_z, rest),
        };
        add_scaled(unknowns.z.flat_mut(), 1.0, d_z);
        add_scaled(unknowns.v.flat_mut(), 1.0, d_v);
        add_scaled(unknowns.lam.flat_mut(), 1.0 / self.step.h, d_lam);
        let mut size = max_norm(d_v);
        if !problem.is_linear && problem.m > 0 {
            for (l, d_lam) in d_lam.chunks_exact(problem.m).enumerate() {
                size = size.max(solver.mass.velocity_of(solver.r_lam.row(l), d_lam));
            }
        }
        size
    }
}

impl Equations for Solve<'_> {
    fn stop(&self) -> Stop {
        self.stages.stop
    }

    fn correct(&mut self) -> Result<f64, StepError> {
        self.stages.evaluate(self.model, self.step)?;
        if !self.is_frozen {
            self.freeze()?;
            self.is_frozen = true;
        }
        self.solve_unknowns();
        let size = self.correct_stages();
        Ok(self.stages.relative(size, self.step))
    }
}
