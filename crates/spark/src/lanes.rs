//! Several members in lock-step, each with the bits it has alone.
//!
//! The common path makes nearly all steps of all members at once: the extrapolated start, node Schur, the update. Each
//! member has its own convergence test. For a step off this path, such as the first one or one by full Newton, the
//! member with its checkpoint is moved to a stepper of one member, and back afterwards.

use super::equations::StageEquations;
use super::node_schur::NodeSchur;
use super::predictor::Predictor;
use super::stages::Stages;
use super::update::Update;
use super::{Solver, Spark};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::linalg::choice::{FEWEST_MEMBERS, LARGEST_MEMBER};
use liouville_base::method::{Stats, Stepper, Symmetric};
use liouville_base::newton::{self, Backoff, Member};
use liouville_base::real::{BATCH, Scalar};
use liouville_base::tableau;
use liouville_problem::{Mechanical, MemberLanes, Model, State, Step};
use liouville_small::Small;
use std::sync::Arc;

/// Whether steps of this system by this solver have members in lock-step.
pub fn supports_batch(problem: &Mechanical, solver: Solver) -> bool {
    problem.is_linear
        && problem.l() == 0
        && solver != Solver::Newton
        && problem.n + problem.m <= LARGEST_MEMBER
}

/// A SPARK method at work on as many members as there are lanes.
#[derive(Clone, Debug)]
pub struct SparkBatch {
    problem: Arc<Mechanical>,
    solver: Solver,
    pub(super) model: Model<MemberLanes>,
    small: Option<Small<MemberLanes>>,
    pub(super) stages: Stages<MemberLanes>,
    schur: NodeSchur<MemberLanes>,
    pub(super) predictor: Predictor<MemberLanes>,
    update: Update<MemberLanes>,
    /// Parameters, and steppers of one member from its first step alone on: one for each, or a single one where all have
    /// the same parameters.
    params: Vec<MemberLanes>,
    alone: Vec<Option<Spark>>,
    state: State,
    /// Rests of node Schur and of the modified iteration, of each.
    backoffs: [[Backoff; 2]; BATCH],
    members: [Member; BATCH],
    /// The number of members; the lanes left over repeat the last one.
    count: usize,
    saved: Vec<f64>,
    /// Statistics of each member.
    stats: [Stats; BATCH],
}

impl SparkBatch {
    /// The method of these coefficients, for parameters of each of so many members; the last one is to fill the
    /// places that are left.
    pub fn of(
        problem: &Arc<Mechanical>,
        (params, members): (&[MemberLanes], usize),
        tableau: tableau::Spark,
        solver: Solver,
    ) -> Self {
        let mut model = Model::new(problem.clone(), params);
        let small = Small::new(&mut model, &tableau, solver.matrices());
        let is_common =
            |x: &MemberLanes| x.0.iter().all(|value| value.to_bits() == x.0[0].to_bits());
        let count = if params.iter().all(is_common) {
            1
        } else {
            BATCH
        };
        let stages = Stages::new(&model, tableau);
        let mut batch = Self {
            solver,
            small,
            schur: NodeSchur::new(&model, &stages),
            predictor: Predictor::new(&model, &stages.tableau),
            update: Update::new(&model),
            params: params.to_vec(),
            alone: vec![None; count],
            state: State::zeros(problem.n),
            backoffs: Default::default(),
            members: [Member::Inactive; BATCH],
            count: members.clamp(1, BATCH),
            saved: Vec::new(),
            stats: [Stats::default(); BATCH],
            stages,
            model,
            problem: problem.clone(),
        };
        let mut saved = Vec::new();
        batch.save(0, &mut saved);
        saved.reserve_exact(BATCH * (saved.len() + 5 * problem.n));
        batch.saved = saved;
        batch
    }

    /// The same, with stage equations solved to this fraction of the velocities instead of to roundoff.
    #[must_use]
    pub fn to_tolerance(mut self, tolerance: f64) -> Self {
        self.stages.stop.tolerance = tolerance;
        self
    }

    /// The members' state at `t`, from y and z.
    pub fn state(&mut self, t: f64, y: &[MemberLanes], z: &[MemberLanes]) -> State<MemberLanes> {
        self.model.state(t, y, z)
    }

    /// The common path up to the commit; `members` says which of them have converged.
    fn advance(&mut self, step: Step<MemberLanes>) -> Result<(), StepError> {
        let is_newton = self.small.as_ref().is_some_and(Small::is_newton);
        let is_open =
            |[schur, all]: &[Backoff; 2]| !(all.is_active() || schur.is_active() && !is_newton);
        self.members = self.backoffs.map(|backoffs| {
            if is_open(&backoffs) {
                Member::Active
            } else {
                Member::Inactive
            }
        });
        let open = self.backoffs[..self.count].iter();
        let open = open.filter(|backoffs| is_open(backoffs)).count();
        let (stages, model) = (&mut self.stages, &mut self.model);
        if open < FEWEST_MEMBERS {
            self.members = [Member::Inactive; BATCH];
            return Ok(());
        }
        let sizes = (&*self.problem, &stages.tableau);
        let most = self.solver.max_small_iterations(is_newton, sizes);
        if let Some(small) = &mut self.small {
            let (predictor, until) = (&mut self.predictor, (most, stages.stop));
            let made = small.advance(model, predictor.start(), step, until, &mut self.members);
            if made.is_none() {
                self.members = [Member::Inactive; BATCH];
            }
            return Ok(());
        }
        if !(self.predictor).extrapolate(stages, &mut self.update.z, step) {
            self.members = [Member::Inactive; BATCH];
            return Ok(());
        }
        let mut equations = StageEquations::new(&mut self.schur, stages, model, step);
        newton::solve_each(&mut equations, most, &mut self.members)?;
        if !self.members.iter().any(has_converged) {
            return Ok(());
        }
        // the same as in a step of one member
        let last = stages.tableau.intervals - 1;
        stages.evaluate_values(model, step, last);
        if stages.finds_lost_displacements(&self.problem) {
            self.schur.find_lost_displacements(stages, step);
        } else {
            stages.lost_displacements.clear();
        }
        self.update.solve(model, stages, step)
    }

    /// Makes the step of one member alone; its checkpoint after the step is appended to `saved`.
    fn step_alone(
        &mut self,
        member: usize,
        (t, h): (f64, f64),
        state: &State<MemberLanes>,
    ) -> Result<(), StepError> {
        let mut saved = std::mem::take(&mut self.saved);
        let start = saved.len();
        self.save(member, &mut saved);
        let place = member.min(self.alone.len() - 1);
        let alone = self.alone[place].get_or_insert_with(|| {
            let params: Vec<f64> = self.params.iter().map(|x| x.member(place)).collect();
            let (model, tableau) = (
                Model::new(self.problem.clone(), &params),
                self.stages.tableau.clone(),
            );
            Spark::of(model, tableau, self.solver).to_tolerance(self.stages.stop.tolerance)
        });
        let is_own = alone.restore(0, &mut &saved[start..]).is_ok();
        debug_assert!(is_own, "it is of the same problem");
        saved.truncate(start);
        self.state.copy_member(0, state, member);
        let before = alone.stats();
        let made = alone.step(t, h, &mut self.state);
        self.stats[member] = self.stats[member] + (alone.stats() - before);
        if made.is_ok() {
            alone.save(0, &mut saved);
            self.state.save(0, &mut saved);
        }
        self.saved = saved;
        made.map_err(|error| error.of_member(member))
    }

    /// Restores the members that stepped alone among the others.
    fn take_back(&mut self, state: &mut State<MemberLanes>) -> Result<(), CheckpointMismatch> {
        let held = std::mem::take(&mut self.saved);
        let mut saved = &held[..];
        for member in 0..BATCH {
            if has_converged(&self.members[member]) {
                continue;
            }
            let before = saved;
            self.restore(member, &mut saved)?;
            state.restore(member, &mut saved)?;
            if member + 1 >= self.count {
                saved = before; // for the next place to follow
            }
        }
        self.saved = held;
        Ok(())
    }

    fn count_steps(&mut self) {
        let stages = self.stages.tableau.stages;
        let is_newton = self.small.as_ref().is_some_and(Small::is_newton);
        for (member, stands) in self.members.iter().enumerate() {
            if let Member::Converged(iterations) = stands {
                self.backoffs[member].iter_mut().for_each(Backoff::succeed);
                let stats = &mut self.stats[member];
                stats.newton_steps += usize::from(is_newton);
                stats.schur_steps += usize::from(!is_newton);
                stats.iterations += iterations;
                stats.evaluations += (iterations + 1) * stages;
            }
        }
    }
}

fn has_converged(member: &Member) -> bool {
    matches!(member, Member::Converged(_))
}

impl Stepper for SparkBatch {
    type State = State<MemberLanes>;

    fn step(&mut self, t: f64, h: f64, state: &mut State<MemberLanes>) -> Result<(), StepError> {
        if self.advance(Step { t, h, state }).is_err() {
            // the error does not say which member failed: each makes the step alone
            self.members = [Member::Inactive; BATCH];
        }
        self.saved.clear();
        for member in 0..self.count {
            if !has_converged(&self.members[member]) {
                self.step_alone(member, (t, h), state)?;
            }
        }
        if self.members.iter().any(has_converged) {
            let (predictor, update) = (&mut self.predictor, &self.update);
            if let Some(small) = &self.small {
                small.commit(&mut predictor.held, h, state);
            } else {
                predictor.keep(&self.stages, h, &state.z, &update.z, &update.v);
                update.commit(state);
            }
            self.count_steps();
        }
        let is_own = self.take_back(state).is_ok();
        debug_assert!(is_own, "it is of the same problem");
        Ok(())
    }

    fn forget(&mut self) {
        self.predictor.forget();
    }

    fn stats(&self) -> Stats {
        self.stats_of(0)
    }

    fn stats_of(&self, member: usize) -> Stats {
        self.stats[member]
    }
}

impl Symmetric for SparkBatch {}

impl Checkpoint for SparkBatch {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.predictor.save(member, out);
        self.backoffs[member].save(0, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.predictor.restore(member, saved)?;
        self.backoffs[member].restore(0, saved)
    }
}
