//! The watch of every step of a mechanical system, whatever is kept of it: its energy, and constraints that are left
//! out.

use super::{Acceleration, Carried, EnergyWatch, Mass, Mechanical, MemberLanes, Model, State};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::observe::{Finding, Watch};
use liouville_base::real::Real;
use liouville_base::tape::{Registers, Tape};
use std::sync::Arc;

/// A run's first energies are looked at in each step, the others in one of so many: a step of RATTLE on Kepler's problem
/// takes 1950 instructions, and a look at its energy 870.
const FIRST: usize = 16;
const EVERY: usize = 32;
/// A constraint that others imply may miss this part of the size of what it is made of.
const IMPLIED: f64 = 1e-8;
/// Roundings move a state by so many units of the last digit, or by the square root of the number of steps ...
const ROUNDINGS: f64 = 64.0;
/// ... in one of so many patterns of signs.
const PATTERNS: usize = 8;

/// The watch of a run.
#[derive(Clone, Debug, Default)]
pub struct Watched {
    /// A tape (t, y, z, params) → the energy, the kinetic energy and the powers of forces that may be damping, with the
    /// velocities there and with opposite ones; and whether the energy can only fall.
    pub energy: Option<(Arc<Tape>, bool)>,
    /// A tape (t, y, z, params) → the constraints that are left out, their numbers, and for each member the sizes of what
    /// they are made of.
    pub left_out: Option<(Arc<Tape>, Vec<usize>, Vec<f64>)>,
}

/// A tape with its parameters.
#[derive(Clone, Debug)]
struct BoundTape<R> {
    tape: Arc<Tape>,
    registers: Registers<R>,
}

/// Looks at the steps of one motion, or of several in lock-step.
#[derive(Clone, Debug)]
pub struct StepWatch<R = f64> {
    problem: Arc<Mechanical>,
    params: Vec<R>,
    steps: usize,
    energy: Option<BoundTape<R>>,
    /// The energy of each member.
    members: Vec<EnergyWatch>,
    left_out: Option<(BoundTape<R>, Vec<usize>)>,
    /// The sizes of what constraints left out are made of, of one member after another.
    sizes: Vec<f64>,
}

impl<R: Real> BoundTape<R> {
    fn new(tape: &Arc<Tape>, params: &[R]) -> Self {
        Self {
            tape: tape.clone(),
            registers: tape.bind(params),
        }
    }

    fn eval(&mut self, t: f64, y: &[R], z: &[R]) -> &[R] {
        self.tape.eval(&mut self.registers, [&[R::splat(t)], y, z])
    }
}

impl<R: Real> StepWatch<R> {
    /// A watch over these members of a run, none where nothing is to be looked at.
    ///
    /// # Panics
    /// When the inputs of a tape are not (t, y, z, params), or sizes are not there.
    pub fn new(
        problem: &Arc<Mechanical>,
        params: &[R],
        watched: &Watched,
        members: &[usize],
    ) -> Option<Self> {
        let Watched { energy, left_out } = watched;
        if energy.is_none() && left_out.is_none() {
            return None;
        }
        let falls = energy.as_ref().is_some_and(|(_, falls)| *falls);
        let own = |(_, which, sizes): &(_, Vec<usize>, Vec<f64>)| {
            let rows = members.iter().map(|k| k * which.len());
            rows.flat_map(|first| sizes[first..first + which.len()].to_vec())
                .collect()
        };
        Some(Self {
            problem: problem.clone(),
            params: params.to_vec(),
            steps: 0,
            energy: energy
                .as_ref()
                .map(|(tape, _)| BoundTape::new(tape, params)),
            members: vec![EnergyWatch::new(falls); members.len()],
            sizes: left_out.as_ref().map(own).unwrap_or_default(),
            left_out: (left_out.as_ref())
                .map(|(tape, which, _)| (BoundTape::new(tape, params), which.clone())),
        })
    }

    fn is_energy_due(&self, is_last: bool) -> bool {
        is_last || self.steps <= FIRST || self.steps.is_multiple_of(EVERY)
    }

    fn is_due_now(&mut self, is_last: bool) -> bool {
        self.steps += 1;
        self.left_out.is_some() || self.is_energy_due(is_last)
    }

    fn look_at(
        &mut self,
        (t, h, is_last): (f64, f64, bool),
        y: &[R],
        z: &[R],
    ) -> Result<(), StepError> {
        if let Some((left_out, which)) = &mut self.left_out {
            let values = left_out.eval(t, y, z);
            for (member, sizes) in self.sizes.chunks(which.len()).enumerate() {
                let mut pairs = values.iter().zip(sizes);
                let missed =
                    |(value, size): (&R, &f64)| value.member(member).abs() > IMPLIED * size;
                if let Some(place) = pairs.position(missed) {
                    let constraint = which[place];
                    let error = StepError::Contradiction { constraint };
                    return Err(match R::MEMBERS {
                        1 => error,
                        _ => error.of_member(member),
                    });
                }
            }
        }
        if self.is_energy_due(is_last)
            && let Some(energy) = &mut self.energy
        {
            let steps = self.steps;
            let BoundTape { tape, registers } = energy;
            let values = tape.eval(registers, [&[R::splat(t)], y, z]);
            for (member, watch) in self.members.iter_mut().enumerate() {
                let mut own = [0.0; 4];
                for (own, value) in own.iter_mut().zip(values) {
                    *own = value.member(member);
                }
                let [energy_now, kinetic, ref powers @ ..] = own;
                let alone = |x: &[R]| x.iter().map(|x| x.member(member)).collect::<Vec<_>>();
                watch.look(t, [energy_now, kinetic], powers, || {
                    let model = Model::new(self.problem.clone(), &alone(&self.params));
                    let tape = BoundTape::new(tape, &alone(&self.params));
                    roundings((model, tape), (t, h, steps), &alone(y), &alone(z))
                });
            }
        }
        Ok(())
    }

    fn restart_at(&mut self, t: f64, y: &[R], z: &[R]) {
        if let Some(energy) = &mut self.energy {
            let values = energy.eval(t, y, z);
            for (member, watch) in self.members.iter_mut().enumerate() {
                watch.restart(values[0].member(member));
            }
        }
    }

    fn all_found(&self) -> Vec<(usize, Finding)> {
        let found = self.members.iter().enumerate();
        found
            .filter_map(|(place, watch)| Some((place, watch.found()?)))
            .collect()
    }
}

/// By how much roundings of a state change its energy.
///
/// Coordinates are off by units of the last digit of q, h v and h² b, and velocities by those of v, q/h and h b, with the
/// accelerations b that forces and reactions take from one another. The length whose roundings are those of constraints
/// takes the place of a smaller q.
fn roundings(
    (mut model, mut energy): (Model, BoundTape<f64>),
    (t, h, steps): (f64, f64, usize),
    y: &[f64],
    z: &[f64],
) -> f64 {
    let unit = f64::EPSILON * ROUNDINGS.max((steps as f64).sqrt());
    let h = h.abs();
    let is_velocity = model.problem.patterns.v_z.is_none();
    let zeros = || [vec![0.0; z.len()], vec![0.0; y.len()]];
    let [borne, shift] = borne(&mut model, t, y, z).unwrap_or_else(|_| zeros());
    let length = model.constraint_length(t, y);
    let [_, _, v] = model.end(t, y, z);
    let v = if is_velocity { z } else { v };
    let off_y: Vec<f64> = (y.iter().zip(v).zip(&shift))
        .map(|((y, v), b)| unit * (y.abs().max(length) + h * v.abs() + h * h * b.abs()))
        .collect();
    let off_z = z.iter().zip(&borne).zip(y).map(|((z, b), y)| {
        let of_y = if is_velocity && h > 0.0 {
            y.abs().max(length) / h
        } else {
            0.0
        };
        unit * (z.abs() + h * b + of_y)
    });
    let off_z: Vec<f64> = off_z.collect();
    let first = energy.eval(t, y, z)[0];
    let mut bits = 0x5851_f42d_4c95_7f2d_u64;
    let mut moved = |x: &[f64], off: &[f64]| -> Vec<f64> {
        let each = x.iter().zip(off).map(|(x, off)| {
            bits = bits.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1);
            if bits >> 63 == 0 { x + off } else { x - off }
        });
        each.collect()
    };
    let changes = (0..PATTERNS).map(|_| {
        let (y, z) = (moved(y, &off_y), moved(z, &off_z));
        (energy.eval(t, &y, &z)[0] - first).abs()
    });
    changes.filter(|x| x.is_finite()).fold(0.0, f64::max)
}

/// The rates of z that forces and reactions take from one another, the smaller of both for each coordinate; and the
/// accelerations that these are.
fn borne(model: &mut Model, t: f64, y: &[f64], z: &[f64]) -> Result<[Vec<f64>; 2], StepError> {
    let (mut solver, mut mass) = (Acceleration::new(model), Mass::new(model));
    solver.solve(model, t, y, z)?;
    mass.update(model, t, y, z)?;
    let [force, _, _] = model.acceleration(t, y, z);
    let mut by_forces = force.to_vec();
    mass.solve(&mut by_forces);
    let pairs = by_forces.iter().zip(&solver.z_dot);
    let borne: Vec<f64> = pairs.map(|(f, all)| f.abs().min((all - f).abs())).collect();
    let mut shift = vec![0.0; y.len()];
    mass.add_velocity(&borne, &mut shift);
    Ok([borne, shift])
}

impl<S: Carried> Watch<S> for StepWatch {
    fn is_due(&mut self, is_last: bool) -> bool {
        self.is_due_now(is_last)
    }

    fn look(&mut self, at: (f64, f64, bool), state: &S) -> Result<(), StepError> {
        self.look_at(at, state.y(), state.z())
    }

    fn restart(&mut self, t: f64, state: &S) {
        self.restart_at(t, state.y(), state.z());
    }

    fn found(&self) -> Vec<(usize, Finding)> {
        self.all_found()
    }
}

impl Watch<State<MemberLanes>> for StepWatch<MemberLanes> {
    fn is_due(&mut self, is_last: bool) -> bool {
        self.is_due_now(is_last)
    }

    fn look(&mut self, at: (f64, f64, bool), state: &State<MemberLanes>) -> Result<(), StepError> {
        self.look_at(at, &state.y, &state.z)
    }

    fn restart(&mut self, t: f64, state: &State<MemberLanes>) {
        self.restart_at(t, &state.y, &state.z);
    }

    fn found(&self) -> Vec<(usize, Finding)> {
        self.all_found()
    }
}

impl<R: Real> Checkpoint for StepWatch<R> {
    fn save(&self, _: usize, out: &mut dyn Numbers) {
        self.steps.save(0, out);
        self.members.save(0, out);
    }

    fn restore(&mut self, _: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.steps.restore(0, saved)?;
        self.members.restore(0, saved)
    }
}
