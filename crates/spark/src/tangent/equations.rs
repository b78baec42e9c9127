//! Solves with the matrix of a linearised step: by corrections with the matrix of node Schur, as steps themselves are
//! solved, and with its own factors where these do not contract or cost no more.
//!
//!     x ← x + Ja⁻¹ (b − J x),     x ← x + Ja⁻ᵀ (b − Jᵀ x)
//!
//! contract by the same factor, that of the step.

use super::super::derivatives::Derivatives;
use super::super::full_newton::{FullMatrix, Offsets};
use super::super::node_schur::LinearSchur;
use super::super::stages::Stages;
use super::super::{Solver, Spark};
use super::stage_changes::{StageChanges, StageSlopes};
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, copy, max_norm};
use liouville_base::newton::Backoff;
use liouville_base::tableau;
use liouville_problem::{Mechanical, MemberLanes, Model, diagnose_rank};
use std::sync::Arc;

/// The order up to which full Newton's matrix costs no more than corrections.
const SMALL: usize = 40;

/// Right-hand sides up to which corrections of each cost less than factors for all.
///
/// Measured on chains of 100 and 1000: one takes 1.2 runs by corrections after 1.9 for all, and 0.4 by factors after 6.4.
const FEW: usize = 5;

/// Corrections that shrink less than this do not contract, or are roundoff.
const CONTRACTION: f64 = 0.25;

/// Corrections of this size, relative to the solution, are roundoff where they no longer shrink.
const ROUNDOFF: f64 = 1e-10;

const MOST_CORRECTIONS: usize = 30;

/// The matrix of the equations of one step.
pub(super) trait StepMatrix<R> {
    /// Factors the matrix with these derivatives, of a step of this size.
    ///
    /// # Errors
    /// It is singular.
    fn factor_at(
        &mut self,
        at: (&Model<R>, &Stages<R>),
        of: &Derivatives<R>,
        h: f64,
    ) -> Result<(), StepError>;

    /// Solves in place with the matrix of these derivatives, which was factored, or with the transposed one.
    ///
    /// # Errors
    /// It is singular.
    fn solve_at<const TRANSPOSED: bool>(
        &mut self,
        at: (&Model<R>, &Stages<R>),
        of: &Derivatives<R>,
        x: &mut [R],
    ) -> Result<(), StepError>;
}

/// Several members in lock-step: their own factors.
impl StepMatrix<MemberLanes> for FullMatrix<MemberLanes> {
    fn factor_at(
        &mut self,
        _: (&Model<MemberLanes>, &Stages<MemberLanes>),
        of: &Derivatives<MemberLanes>,
        h: f64,
    ) -> Result<(), StepError> {
        self.factor(of, h).map_err(|_| StepError::SingularNewton)
    }

    fn solve_at<const TRANSPOSED: bool>(
        &mut self,
        _: (&Model<MemberLanes>, &Stages<MemberLanes>),
        _: &Derivatives<MemberLanes>,
        x: &mut [MemberLanes],
    ) -> Result<(), StepError> {
        if TRANSPOSED {
            self.solve_transposed(x);
        } else {
            self.solve(x);
        }
        Ok(())
    }
}

/// Whether the equations of a step are solved with their own factors, whatever the directions: members in lock-step are
/// only solved so.
pub(super) fn is_small(problem: &Mechanical, tableau: &tableau::Spark) -> bool {
    Offsets::new(problem, tableau).count() <= SMALL
}

/// The linear equations of one step.
#[derive(Clone, Debug)]
pub(super) struct LinearEquations {
    problem: Arc<Mechanical>,
    h: f64,
    schur: Option<Box<Corrected>>,
    full: Option<Box<FullMatrix>>,
    /// The matrix that is factored.
    is_full: bool,
    backoff: Backoff,
}

/// Node Schur, and the memory of corrections.
#[derive(Clone, Debug)]
struct Corrected {
    matrix: LinearSchur,
    changes: StageChanges,
    right: Vec<f64>,
    change: Vec<f64>,
    product: Vec<f64>,
}

impl LinearEquations {
    /// The equations of a method at work, with so many right-hand sides a step.
    pub(super) fn new((spark, stages): (&Spark, &Stages), directions: usize) -> Self {
        let (model, tableau) = (&spark.model, &spark.tableau);
        let problem = &model.problem;
        let order = Offsets::new(problem, tableau).count();
        let corrected = |matrix| {
            let vector = || vec![0.0; order];
            Box::new(Corrected {
                matrix,
                changes: StageChanges::new(problem, tableau, &stages.force_weights),
                right: vector(),
                change: vector(),
                product: vector(),
            })
        };
        let is_large =
            !is_small(problem, tableau) && directions <= FEW && spark.solver != Solver::Newton;
        let is_large = is_large && problem.l() == 0;
        let schur = is_large.then(|| LinearSchur::new(model, stages));
        Self {
            h: 0.0,
            schur: schur.flatten().map(corrected),
            full: None,
            is_full: true,
            backoff: Backoff::default(),
            problem: problem.clone(),
        }
    }

    fn factor_full(
        &mut self,
        (model, stages): (&Model, &Stages),
        of: &Derivatives,
    ) -> Result<(), StepError> {
        let tableau = &stages.tableau;
        let full = (self.full).get_or_insert_with(|| FullMatrix::new(model, tableau).into());
        self.is_full = true;
        full.factor(of, self.h).map_err(|_| {
            let last = of.g_y.row(of.g_y.rows() - 1);
            let at = &self.problem.patterns.g_y;
            diagnose_rank(at, last, StepError::SingularNewton)
        })
    }

    /// Corrects from zero until corrections are roundoff; says whether they got there. Otherwise `x` is left as it was.
    ///
    /// The two matrices differ in the columns of Z and V only, so only corrections of these decide on convergence.
    fn correct<const TRANSPOSED: bool>(&mut self, of: &Derivatives, x: &mut [f64]) -> bool {
        let Some(schur) = &mut self.schur else {
            return false;
        };
        let Corrected {
            matrix,
            changes,
            right,
            change,
            product,
        } = &mut **schur;
        let slopes = StageSlopes {
            problem: &self.problem,
            of,
            h: self.h,
        };
        let stages = of.p_z.rows() * self.problem.n;
        let sizes = |x: &[f64]| {
            let has_velocity = self.problem.patterns.v_z.is_some();
            let v = if has_velocity { x.len() - stages } else { 0 };
            [max_norm(&x[..stages]), max_norm(&x[v..v + stages])]
        };
        copy(right, x);
        copy(change, right);
        x.fill(0.0);
        let mut last = f64::INFINITY;
        for _ in 0..MOST_CORRECTIONS {
            if TRANSPOSED {
                matrix.solve_transposed(change);
            } else {
                matrix.solve(change);
            }
            add_scaled(x, 1.0, change);
            let parts = sizes(change).into_iter().zip(sizes(x));
            let relative = |(change, x)| if change == 0.0 { 0.0 } else { change / x };
            let size = parts.map(relative).fold(0.0, f64::max);
            // the first correction has no ratio yet
            let shrunk = if last.is_finite() { size / last } else { 1.0 };
            if size * shrunk <= 4.0 * f64::EPSILON {
                self.backoff.succeed();
                return true;
            }
            let is_contracting = shrunk < CONTRACTION;
            if last.is_finite() && !is_contracting {
                if size <= ROUNDOFF {
                    self.backoff.succeed();
                    return true;
                }
                break;
            }
            last = size;
            changes.multiply::<TRANSPOSED>(slopes, x, product);
            for ((change, right), product) in change.iter_mut().zip(&*right).zip(&*product) {
                *change = right - product;
            }
        }
        copy(x, right);
        false
    }
}

impl StepMatrix<f64> for LinearEquations {
    fn factor_at(
        &mut self,
        at: (&Model, &Stages),
        of: &Derivatives,
        h: f64,
    ) -> Result<(), StepError> {
        self.h = h;
        self.is_full = match &mut self.schur {
            Some(schur) if !self.backoff.skip() => schur.matrix.factor(of).is_err(),
            _ => true,
        };
        if self.is_full {
            self.factor_full(at, of)
        } else {
            Ok(())
        }
    }

    fn solve_at<const TRANSPOSED: bool>(
        &mut self,
        at: (&Model, &Stages),
        of: &Derivatives,
        x: &mut [f64],
    ) -> Result<(), StepError> {
        if !self.is_full && self.correct::<TRANSPOSED>(of, x) {
            return Ok(());
        }
        if !self.is_full {
            self.backoff.fail();
            self.factor_full(at, of)?;
        }
        if let Some(full) = &mut self.full {
            if TRANSPOSED {
                full.solve_transposed(x);
            } else {
                full.solve(x);
            }
        }
        Ok(())
    }
}

// How long corrections still rest.
liouville_base::checkpoint!(LinearEquations { backoff });
