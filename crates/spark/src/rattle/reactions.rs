//! Reactions −Gᵀ λ and the matrices of their multipliers: G W Gᵀ by elimination where W is diagonal and the
//! couplings are sparse, otherwise by the saddle-point matrix it is the Schur complement of.

use super::mass::ConstantMass;
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, NodeGram, Pattern, Rows, copy, max_norm};
use liouville_problem::{Saddle, SeparableModel, diagnose_rank};

/// G at the start of a step, and the solver for multipliers.
#[derive(Clone, Debug)]
pub(super) struct RattleReactions {
    /// Gᵀ where a step starts, and `g_t` there.
    gradient: Rows,
    drift: Vec<f64>,
    solver: MultiplierSolver,
    multipliers: Vec<f64>,
}

#[derive(Clone, Debug)]
enum MultiplierSolver {
    Eliminated(Box<GramMatrices>),
    /// The saddle-point matrix at the start, kept for the step, and zeros.
    Saddle(Box<Saddle>, Vec<f64>),
}

/// G(t1, ỹ1) W G0ᵀ for positions and G W Gᵀ for velocities.
#[derive(Clone, Debug)]
struct GramMatrices {
    /// W of each entry of Gᵀ, and W Gᵀ at the start.
    inverse_mass: Vec<f64>,
    inverse_mass_gt: Vec<f64>,
    of_positions: NodeGram,
    of_velocities: NodeGram,
    /// Whether G is constant, so that one factorisation serves all steps.
    is_constant: bool,
    is_ready: bool,
}

impl GramMatrices {
    /// Memory for the gradient `g_y` with this transpose; `None` where there is much fill-in.
    fn new(g_y: &Pattern, transposed: &Pattern, inverse_mass: &[f64]) -> Option<Self> {
        let one = Matrix::from_fn(1, 1, |_, _| 1.0);
        let coordinates = transposed.entries().iter().map(|(row, _)| *row);
        Some(Self {
            inverse_mass: coordinates.map(|row| inverse_mass[row]).collect(),
            inverse_mass_gt: vec![0.0; transposed.len()],
            of_positions: NodeGram::new(g_y, transposed, &one)?,
            of_velocities: NodeGram::new(&transposed.transposed(), transposed, &one)?,
            is_constant: false,
            is_ready: false,
        })
    }
}

impl RattleReactions {
    pub(super) fn new(model: &SeparableModel, mass: &ConstantMass) -> Self {
        let general = &model.problem.mechanical;
        let g_y = &general.patterns.g_y;
        let gradient = Rows::of(&g_y.transposed(), 1);
        let matrices = mass
            .inverse_mass()
            .and_then(|inverse_mass| GramMatrices::new(g_y, &gradient.pattern(), inverse_mass));
        let solver = if let Some(matrices) = matrices {
            MultiplierSolver::Eliminated(Box::new(GramMatrices {
                is_constant: model.problem.gradient.is_empty(),
                ..matrices
            }))
        } else {
            let saddle = Saddle::new(&model.general);
            MultiplierSolver::Saddle(Box::new(saddle), vec![0.0; general.n])
        };
        Self {
            gradient,
            drift: vec![0.0; general.m],
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
        self.gradient.set(1, |_| gradient);
        copy(&mut self.drift, drift);
        match &mut self.solver {
            MultiplierSolver::Eliminated(matrices) => {
                let entries = self.gradient.values().iter().zip(&matrices.inverse_mass);
                for (out, (g, inverse_mass)) in matrices.inverse_mass_gt.iter_mut().zip(entries) {
                    *out = g * inverse_mass;
                }
                Ok(())
            }
            MultiplierSolver::Saddle(saddle, zeros) => {
                let lam = &self.drift; // no block depends on λ
                saddle.update(&mut model.general, t, y, zeros, lam)
            }
        }
    }

    /// Factors the matrix that positions are corrected with, at a guess of the step's end; returns how often.
    pub(super) fn factor_at(
        &mut self,
        model: &mut SeparableModel,
        t: f64,
        y: &[f64],
    ) -> Result<usize, StepError> {
        let MultiplierSolver::Eliminated(matrices) = &mut self.solver else {
            return Ok(0);
        };
        if matrices.is_constant {
            return self.factor();
        }
        let [gradient, _] = model.gradient(t, y)?;
        let factored = (matrices.of_positions).factor(gradient, &matrices.inverse_mass_gt);
        if factored.is_ok() {
            return Ok(1);
        }
        let problem = model.problem.clone();
        let [gradient, _] = model.gradient(t, y)?;
        let pattern = &problem.mechanical.patterns.g_y;
        Err(diagnose_rank(pattern, gradient, StepError::SingularNewton))
    }

    /// Factors the matrix that projects velocities, at the start last set; returns how often.
    pub(super) fn factor(&mut self) -> Result<usize, StepError> {
        let MultiplierSolver::Eliminated(matrices) = &mut self.solver else {
            return Ok(1);
        };
        if matrices.is_constant && matrices.is_ready {
            return Ok(0);
        }
        let gradient = self.gradient.values();
        let factored = (matrices.of_velocities).factor(gradient, &matrices.inverse_mass_gt);
        factored.map_err(|_| {
            let pattern = self.gradient.pattern().transposed();
            diagnose_rank(&pattern, gradient, StepError::SingularNewton)
        })?;
        matrices.is_ready = true;
        Ok(1)
    }

    /// Solves G(t1, ỹ1) W G0ᵀ x = b in place.
    pub(super) fn solve_positions(&mut self, model: &SeparableModel, x: &mut [f64]) {
        match &mut self.solver {
            MultiplierSolver::Eliminated(matrices) if !matrices.is_constant => {
                matrices.of_positions.solve(x);
            }
            _ => self.solve_velocities(model, x),
        }
    }

    fn solve_velocities(&mut self, model: &SeparableModel, x: &mut [f64]) {
        match &mut self.solver {
            MultiplierSolver::Eliminated(matrices) => matrices.of_velocities.solve(x),
            MultiplierSolver::Saddle(saddle, rest) => {
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
    pub(super) fn apply_gt(&self, x: &[f64], factor: f64, out: &mut [f64]) {
        for (out, sum) in out.iter_mut().zip(self.gradient.products(x)) {
            *out += factor * sum;
        }
    }

    /// `reaction −= factor Gᵀ x`; returns the largest move W Gᵀ x.
    pub(super) fn correct(
        &self,
        mass: &mut ConstantMass,
        x: &[f64],
        factor: f64,
        (reaction, moves): (&mut [f64], &mut [f64]),
    ) -> f64 {
        let out = reaction.iter_mut().zip(&mut *moves);
        for ((reaction, moved), sum) in out.zip(self.gradient.products(x)) {
            *moved = sum;
            *reaction -= factor * sum;
        }
        mass.apply_inverse(moves);
        max_norm(moves)
    }

    /// Projects the momenta, so that the velocities `v` satisfy the hidden constraints.
    pub(super) fn project(&mut self, model: &SeparableModel, v: &[f64], momenta: &mut [f64]) {
        let mut rates = std::mem::take(&mut self.multipliers);
        copy(&mut rates, &self.drift);
        self.gradient.add_transposed_product(v, &mut rates);
        self.solve_velocities(model, &mut rates);
        self.apply_gt(&rates, -1.0, momenta);
        self.multipliers = rates;
    }
}
