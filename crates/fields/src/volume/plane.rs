//! The flow of a plane, one member after another: each is in a cell of its own, or has an equation of its own.

use super::state::State;
use liouville_base::error::StepError;
use liouville_base::real::Scalar;
use liouville_base::simd::InstructionSet;
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

    /// Memory for flows.
    pub(super) fn memory(&self) -> Memory {
        self.plane.memory()
    }

    /// Moves each member from `t` over `h`.
    #[allow(clippy::float_cmp)] // the same numbers
    pub(super) fn flow<S: Scalar>(
        &self,
        machine: InstructionSet,
        is_adjoint: bool,
        (t, h): (f64, f64),
        state: &mut State<S>,
        memory: &mut Memory,
    ) -> Result<(), StepError> {
        let mut last = None;
        for member in 0..S::MEMBERS {
            let mut x = [0.0; 4];
            for (x, place) in x.iter_mut().zip(&self.places) {
                *x = state.x[*place].member(member);
            }
            if let Some((from, after)) = last
                && x == from
            {
                // a place without a member follows the last one
                self.set(state, member, &x, after);
                continue;
            }
            let mut flow = PlaneFlow {
                plane: &self.plane,
                memory: &mut *memory,
                x,
                is_adjoint,
                h,
            };
            let after = flow.run(machine);
            let after = after.map_err(|fault| self.error(fault, member, &x, t))?;
            self.set(state, member, &x, after);
            last = Some((x, after));
        }
        Ok(())
    }

    /// Sets the two variables that move.
    fn set<S: Scalar>(&self, state: &mut State<S>, member: usize, x: &[f64; 4], after: [f64; 2]) {
        let moved = self.plane.frozen();
        for (k, after) in after.into_iter().enumerate() {
            set(state, self.places[moved + k], member, x[moved + k], after);
        }
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

/// Sets a variable of a member, with its rounding error where that is kept.
#[inline]
fn set<S: Scalar>(state: &mut State<S>, place: usize, member: usize, before: f64, after: f64) {
    let (x, low) = state.parts();
    if low.is_empty() {
        x[place].set_member(member, after);
        return;
    }
    let change = (after - before) + low[place].member(member);
    let sum = before + change;
    let back = sum - before;
    let lost = (before - (sum - back)) + (change - back);
    x[place].set_member(member, sum);
    low[place].set_member(member, lost);
}
