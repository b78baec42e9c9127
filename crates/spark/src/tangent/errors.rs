//! Errors of tangents in random directions, where errors control the steps.
//!
//! A tangent is a motion of its own, whose velocities at the ends and stages of a step are δv0, δV_1..δV_s and δv1. Its
//! error is that of a motion with these, see [`Estimate`] and [`Kinks`], by a tolerance of its own, see [`TangentSizes`].
//! The step follows the largest error of these and of the motion, which may rest where they do not.

use super::super::Spark;
use super::super::kinks::{self, Judged, Kinks, Roundoff};
use super::super::stages::Stages;
use super::equations::LinearEquations;
use super::forward::{Forward, StepAlong};
use super::linear_step::LinearStep;
use liouville_base::checkpoint;
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, copy};
use liouville_problem::{
    Acceleration, AccelerationTangents, Carried, Directions, Estimate, Mass, MechanicalStart,
    Model, MomentumTangents, RandomTangents, SensitivityModel, State, Step, StepVelocities,
    TangentState, TangentStep,
};

/// The errors of tangents, and what is known of the steps before.
#[derive(Clone, Debug)]
pub(super) struct TangentErrors {
    pub(super) tangents: RandomTangents<MechanicalStart<MomentumTangents>, State>,
    of: Vec<DirectionErrors>,
    accelerations: EndAccelerations,
    impulse: Vec<f64>,
    /// The quantity whose roundoff defects of velocities may be.
    roundoff: Roundoff,
}

/// Of one direction.
#[derive(Clone, Debug)]
struct DirectionErrors {
    estimate: Estimate,
    kinks: Kinks,
    /// The unit of errors; zero where there is no tangent.
    unit: f64,
    /// δv0, δV_1..δV_s, δv1; and the same of z, where v is not z.
    velocities: Matrix,
    momenta: Option<Matrix>,
}

/// δz' at a point.
#[derive(Clone, Debug)]
struct EndAccelerations {
    solver: Acceleration,
    tangents: AccelerationTangents,
    /// A row for each direction.
    rates: Matrix,
}

/// A tangent state, and its time.
type At<'a> = (f64, &'a TangentState);

impl TangentErrors {
    /// The errors of a method that estimates its own, for a motion with these parameters.
    pub(super) fn new(
        spark: &Spark,
        sensitivity: &SensitivityModel,
        (motion, params): (&State, &[f64]),
    ) -> Option<Self> {
        let (estimate, model) = (spark.estimate.as_ref()?, &spark.model);
        let (n, is_velocity) = (model.problem.n, model.problem.patterns.v_z.is_none());
        let rows = Matrix::zeros(spark.tableau.stages + 2, n);
        let momenta = MomentumTangents {
            model: model.clone(),
            sensitivity: sensitivity.clone(),
        };
        let starts = MechanicalStart::new(model.clone(), sensitivity.clone(), momenta);
        let at = (motion, params);
        let tangents = RandomTangents::new(starts, at, [n; 3], &estimate.tolerance);
        let directions = tangents.directions.count();
        let of = DirectionErrors {
            estimate: (**estimate).clone(),
            kinks: Kinks::of_tangent(model, &spark.tableau),
            unit: 0.0,
            momenta: (!is_velocity).then(|| rows.clone()),
            velocities: rows,
        };
        Some(Self {
            tangents,
            of: vec![of; directions],
            accelerations: EndAccelerations {
                solver: Acceleration::new(model),
                tangents: AccelerationTangents::new(model.clone(), sensitivity.clone()),
                rates: Matrix::zeros(directions, n),
            },
            impulse: vec![0.0; n],
            roundoff: if model.problem.multipliers() == 0 {
                Roundoff::Velocities
            } else {
                Roundoff::Positions
            },
        })
    }

    /// Forgets the steps before, as of another motion.
    pub(super) fn forget(&mut self) {
        self.tangents.forget();
        self.of.iter_mut().for_each(|of| of.kinks.forget());
    }

    /// Leaves out the last step, which was rejected or failed.
    pub(super) fn undo(&mut self) {
        self.tangents.undo();
        self.of.iter_mut().for_each(|of| of.kinks.undo());
    }

    /// Begins a step from a motion: the one before stands.
    ///
    /// # Errors
    /// A derivative where the motion begins that is not finite, or a singular matrix.
    pub(super) fn begin(&mut self, t: f64, motion: &State) -> Result<(), StepError> {
        self.of.iter_mut().for_each(|of| of.kinks.begin());
        self.tangents.begin(t, motion)
    }

    /// How many directions there are.
    pub(super) fn count(&self) -> usize {
        self.of.len()
    }

    /// Follows a step to its end, where it was linearised, and measures the errors.
    ///
    /// # Errors
    /// A singular matrix.
    pub(super) fn follow(
        &mut self,
        (forward, equations): (&mut Forward, &mut LinearEquations),
        (linear, model, stages): (&mut LinearStep, &mut Model, &Stages),
        (step, end): (Step, &State),
    ) -> Result<(), StepError> {
        self.tangents.after.motion.clone_from(end);
        for direction in 0..self.count() {
            let RandomTangents {
                directions,
                before,
                after,
                ..
            } = &mut self.tangents;
            let along = StepAlong {
                step,
                direction,
                before,
                stretch: 0.0,
            };
            let (of, at) = ((&mut *linear, &mut *equations), (&*model, stages));
            forward.follow(of, at, directions, along, after)?;
            self.keep(direction, forward.unknowns(linear));
        }
        let lam = stages.unknowns.lam.row(stages.tableau.intervals);
        self.measure((linear, model), (step.t, step.h), lam)
    }

    /// Keeps the unknowns of a step in a direction, δZ_i and δV_i.
    fn keep(&mut self, direction: usize, [z, v]: [&[f64]; 2]) {
        let of = &mut self.of[direction];
        for (rows, found) in of
            .momenta
            .iter_mut()
            .zip([z])
            .chain([(&mut of.velocities, v)])
        {
            let (n, inner) = (rows.cols(), rows.rows() - 2);
            copy(
                &mut rows.flat_mut()[n..(inner + 1) * n],
                &found[..inner * n],
            );
        }
    }

    /// Measures the step, linearised, with the multipliers of its end.
    fn measure(
        &mut self,
        (linear, model): (&mut LinearStep, &mut Model),
        (t0, h): (f64, f64),
        lam: &[f64],
    ) -> Result<(), StepError> {
        let t = t0 + h;
        self.write_end(0, t0, (model, &mut linear.sensitivity));
        self.write_end(1, t, (model, &mut linear.sensitivity));
        let RandomTangents {
            directions,
            before,
            after,
            sizes,
            largest,
            ..
        } = &mut self.tangents;
        let State { y, z, .. } = &after.motion;
        let mass = &mut linear.end.matrix.mass;
        if model.problem.l() > 0 {
            mass.update(model, t, y, z)?;
        }
        for (direction, of) in self.of.iter_mut().enumerate() {
            let tau = directions.tau(direction, 0.0);
            let at = (t, [&y[..], z, lam]);
            let parts = sizes.parts(mass, &mut linear.sensitivity, at, tau);
            let (velocities, last) = (&of.velocities, of.velocities.rows() - 1);
            let y = [&*before, &*after].map(|state| state.y.row(direction));
            let v = [velocities.row(0), velocities.row(last)];
            let step = TangentStep { h, y, v, parts };
            of.unit = sizes.measure(step, &mut of.estimate.tolerance);
            if of.unit > 0.0 {
                let rows = StepVelocities {
                    rows: velocities,
                    noise: &[],
                };
                of.estimate.measure_between(rows, h, y);
                largest.raise(of.estimate.error(), of.estimate.order());
            }
        }
        if self.tangents.largest.error <= 1.0 {
            self.look_for_kinks(mass, (t0, h));
        }
        Ok(())
    }

    /// Writes δz and δv at the start, 0, or at the end, 1.
    fn write_end(
        &mut self,
        end: usize,
        t: f64,
        (model, sensitivity): (&mut Model, &mut SensitivityModel),
    ) {
        let RandomTangents {
            directions,
            before,
            after,
            ..
        } = &mut self.tangents;
        let state = [&*before, &*after][end];
        let State { y, z, .. } = &state.motion;
        let by_tau = sensitivity.problem.clone();
        for (direction, of) in self.of.iter_mut().enumerate() {
            let row = end * (of.velocities.rows() - 1);
            let (dz, out) = (state.z.row(direction), of.velocities.row_mut(row));
            let (Some(momenta), Some(v_tau)) = (&mut of.momenta, &by_tau.patterns.v_tau) else {
                copy(out, dz);
                continue;
            };
            copy(momenta.row_mut(row), dz);
            out.fill(0.0);
            let problem = model.problem.clone();
            let at = &problem.patterns;
            let [_, v_z] = model.stage_blocks(t, y, z);
            if let Some(pattern) = &at.v_z {
                pattern.multiply_add(v_z, 1.0, dz, out);
            }
            let [.., v_y] = model.stage_jacobian(t, y, z);
            (at.v_y).multiply_add(v_y, 1.0, state.y.row(direction), out);
            let tau = directions.tau(direction, 0.0);
            let [.., values] = sensitivity.stage(t, y, z);
            v_tau.multiply_add(values, 1.0, tau, out);
        }
    }

    /// Raises the error where a tangent bends or jumps unseen by the stages.
    fn look_for_kinks(&mut self, mass: &Mass, (t0, h): (f64, f64)) {
        let RandomTangents {
            directions,
            before,
            after,
            sizes,
            largest,
            ..
        } = &mut self.tangents;
        let ends = [(t0, &*before), (t0 + h, &*after)];
        let mut solved = None;
        for (direction, of) in self.of.iter_mut().enumerate() {
            if of.unit == 0.0 {
                continue;
            }
            let accelerations = &mut self.accelerations;
            let are_met = of.kinks.meet(|end, out| {
                if solved != Some(end) {
                    accelerations.solve(ends[end], directions)?;
                    solved = Some(end);
                }
                copy(out, accelerations.rates.row(direction));
                Ok(())
            });
            if !are_met {
                continue;
            }
            of.kinks
                .set_defects(of.momenta.as_ref().unwrap_or(&of.velocities), h);
            if of.momenta.is_some() {
                for defects in &mut of.kinks.defects {
                    copy(&mut self.impulse, defects);
                    defects.fill(0.0);
                    mass.add_velocity(&self.impulse, defects);
                }
            }
            let rows = StepVelocities {
                rows: &of.velocities,
                noise: &[],
            };
            let y = ends.map(|(_, state)| state.y.row(direction));
            let judged = Judged {
                unit: of.unit,
                held: sizes.longest(),
                roundoff: self.roundoff,
            };
            let unseen = of.kinks.judge(rows, h, y, (&of.estimate, &judged));
            if unseen > 1.0 {
                of.estimate.raise(unseen, kinks::ORDER);
                largest.raise(of.estimate.error(), of.estimate.order());
            }
        }
    }
}

impl EndAccelerations {
    /// Solves for them.
    fn solve(&mut self, (t, state): At, directions: &mut Directions) -> Result<(), StepError> {
        let Self {
            solver,
            tangents,
            rates,
        } = self;
        let State { y, z, .. } = &state.motion;
        solver.solve(&mut tangents.model, t, y, z)?;
        let Some(of) = state.tangents() else {
            return Ok(());
        };
        let point = [&y[..], z, &solver.z_dot, &solver.lam];
        tangents.solve((t, point), (of, directions), |direction, rate, _| {
            copy(rates.row_mut(direction), rate);
        })
    }
}

// Multipliers, where the next solve starts from; sizes and kinks of the steps before.
checkpoint!(DirectionErrors { kinks });
checkpoint!(EndAccelerations { solver });
checkpoint!(TangentErrors {
    tangents,
    of,
    accelerations
});
