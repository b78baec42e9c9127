//! The flow of a plane, for groups of members: each is in a cell of its own.

use super::state::State;
use liouville_base::error::StepError;
use liouville_base::real::Scalar;
use liouville_base::simd::{InstructionSet, Stored};
use liouville_gridded::{Fault, Memory, Plane, PlaneFlow};
use std::sync::Arc;

/// A plane, and where its coordinates are.
#[derive(Clone, Debug)]
pub(super) struct PlanePiece {
    plane: Arc<Plane>,
    /// Its number among the pieces.
    number: usize,
    /// The frozen variables, then the two that move, and their places in a state.
    variables: Vec<usize>,
    places: Vec<usize>,
}

impl PlanePiece {
    pub(super) fn new(
        plane: Arc<Plane>,
        number: usize,
        variables: &[usize],
        places: impl Iterator<Item = usize>,
    ) -> Self {
        Self {
            plane,
            number,
            variables: variables.to_vec(),
            places: places.collect(),
        }
    }

    /// Memory for flows, of each group of trajectories or of all.
    pub(super) fn memory<S: Stored>(&self) -> Vec<Memory<S::Group>> {
        let count = if self.plane.has_cells() { S::GROUPS } else { 1 };
        vec![self.plane.memory(); count]
    }

    /// Moves each member from `t` over `h`.
    pub(super) fn flow<S: Stored>(
        &self,
        machine: InstructionSet,
        is_adjoint: bool,
        (t, h): (f64, f64),
        state: &mut State<S>,
        memory: &mut [Memory<S::Group>],
    ) -> Result<(), StepError> {
        let moved = self.plane.frozen();
        // the next group is read early: what is written in short registers is late for long ones
        let mut x = [self.read(state, 0); 2];
        for group in 0..S::GROUPS {
            let kept = group.min(memory.len() - 1);
            let [even, odd] = &mut x;
            let (x, next) = if group % 2 == 0 {
                (even, odd)
            } else {
                (odd, even)
            };
            if group + 1 < S::GROUPS {
                *next = self.read(state, group + 1);
            }
            let mut flow = PlaneFlow {
                plane: &self.plane,
                memory: &mut memory[kept],
                x,
                is_adjoint,
                h,
            };
            if let Err((fault, member)) = flow.run(machine) {
                let x = self.read(state, group).map(|x| x.member(member));
                let member = group * S::Group::MEMBERS + member;
                return Err(self.error(fault, member, &x, t));
            }
            for k in moved..moved + 2 {
                set(state, self.places[k], group, flow.x[k]);
            }
        }
        Ok(())
    }

    /// The coordinates of a group.
    #[inline]
    fn read<S: Stored>(&self, state: &State<S>, group: usize) -> [S::Group; 4] {
        let mut x = [S::Group::splat(0.0); 4];
        for (x, place) in x.iter_mut().zip(&self.places) {
            *x = state.x[*place].group(group);
        }
        x
    }

    #[cold]
    fn error(&self, fault: Fault, member: usize, x: &[f64; 4], t: f64) -> StepError {
        match fault {
            Fault::Outside(k) if !x[k].is_finite() => StepError::Overflow {
                index: self.variables[k],
                member,
                t,
            },
            Fault::Outside(k) => StepError::Outside {
                index: self.variables[k],
                member,
                t,
            },
            Fault::NotFinite => StepError::Function {
                piece: self.number,
                function: 0,
                member,
                t,
            },
            Fault::NotConverged(size) => StepError::Member {
                member,
                error: Box::new(StepError::NotConverged {
                    iterations: liouville_gridded::MOST_CORRECTIONS,
                    size,
                }),
            },
        }
    }
}

/// Sets a variable of a group, with its rounding error where that is kept.
#[inline]
fn set<S: Stored>(state: &mut State<S>, place: usize, group: usize, after: S::Group) {
    let (x, low) = state.parts();
    if low.is_empty() {
        x[place].set_group(group, after);
        return;
    }
    let before = x[place].group(group);
    let change = (after - before) + low[place].group(group);
    let sum = before + change;
    let back = sum - before;
    let lost = (before - (sum - back)) + (change - back);
    x[place].set_group(group, sum);
    low[place].set_group(group, lost);
}
