//! Records of the states of a split field at an output point.

use super::{State, Volume};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Quantity, StepError};
use liouville_base::observe::Observe;
use liouville_base::simd::Stored;
use liouville_base::tape::{Registers, Tape};

/// The variables of the user: all of a split, or the first of them, in coordinates of their own.
#[derive(Clone, Debug)]
pub struct UserVariables {
    /// Their number; a field that depends on time has t as one more.
    pub n: usize,
    /// A, row by row, where the variables are x = A y with the y that is stepped.
    pub basis: Option<Vec<f64>>,
}

impl UserVariables {
    /// A normal to these variables as one to those of the split: the places where it is not zero, and its values.
    ///
    /// # Panics
    /// When it has not as many numbers as there are variables.
    pub(super) fn normal_of_split(&self, normal: &[f64], n: usize) -> Vec<(usize, f64)> {
        assert_eq!(normal.len(), self.n, "size of a normal");
        let normal: Vec<f64> = match &self.basis {
            None => normal.to_vec(),
            Some(basis) => (0..n)
                .map(|j| {
                    normal
                        .iter()
                        .zip(basis.chunks(n))
                        .map(|(a, row)| a * row[j])
                        .sum()
                })
                .collect(),
        };
        let entries = normal.into_iter().enumerate();
        entries.filter(|(_, a)| *a != 0.0).collect()
    }

    /// Adds to cotangents of y those of x.
    pub(crate) fn pull(&self, x: &[f64], y: &mut [f64]) {
        match &self.basis {
            None => y.iter_mut().zip(x).for_each(|(y, x)| *y += x),
            Some(basis) => {
                for (x, row) in x.iter().zip(basis.chunks(y.len())) {
                    y.iter_mut().zip(row).for_each(|(y, a)| *y += a * x);
                }
            }
        }
    }

    pub(super) fn write(&self, y: &[f64], x: &mut [f64]) {
        match &self.basis {
            None => x.copy_from_slice(&y[..self.n]),
            Some(basis) => {
                for (x, row) in x.iter_mut().zip(basis.chunks(y.len())) {
                    *x = row.iter().zip(y).map(|(a, y)| a * y).sum();
                }
            }
        }
    }
}

/// Records x (where states are wanted) and the outputs of a tape (t, x) → quantities, one member
/// after another.
#[derive(Clone, Debug)]
pub struct Observer<S: Stored> {
    volume: Volume<S>,
    variables: UserVariables,
    members: usize,
    states: bool,
    outputs: Option<(Tape, Registers<f64>)>,
    values: Vec<S>,
    y: Vec<f64>,
    x: Vec<f64>,
}

impl<S: Stored> Observer<S> {
    /// An observer of the states of the first `members` trajectories that `volume` steps, and of nothing else.
    ///
    /// # Panics
    /// When there are not so many members.
    pub fn of_states(volume: Volume<S>, variables: UserVariables, members: usize) -> Self {
        assert!(members <= S::MEMBERS, "members of an observer");
        let n = volume.split().n();
        Self {
            outputs: None,
            values: vec![S::splat(0.0); n],
            y: vec![0.0; n],
            x: vec![0.0; variables.n],
            volume,
            variables,
            members,
            states: true,
        }
    }

    /// An observer of the first `members` trajectories that `volume` steps.
    ///
    /// # Panics
    /// When the tape's inputs are not (t, x, params), or there are not so many members.
    pub fn new(
        volume: Volume<S>,
        variables: UserVariables,
        members: usize,
        tape: Tape,
        params: &[f64],
        states: bool,
    ) -> Self {
        assert_eq!(
            tape.inputs(),
            [1, variables.n, params.len()],
            "inputs of an observer"
        );
        let registers = tape.bind(params);
        Self {
            outputs: Some((tape, registers)),
            states,
            ..Self::of_states(volume, variables, members)
        }
    }

    fn append(&mut self, member: usize, t: f64, row: &mut Vec<f64>) -> Result<(), StepError> {
        for (y, value) in self.y.iter_mut().zip(&self.values) {
            *y = value.member(member);
        }
        self.variables.write(&self.y, &mut self.x);
        if self.states {
            row.extend_from_slice(&self.x);
        }
        let Some((tape, registers)) = &mut self.outputs else {
            return Ok(());
        };
        let args: [&[f64]; 2] = [&[t], &self.x];
        let values = tape.eval(registers, args);
        if let Some(index) = values.iter().position(|value| !value.is_finite()) {
            let quantity = Quantity::Observable;
            return Err(StepError::NotFinite { quantity, index, t });
        }
        row.extend_from_slice(values);
        Ok(())
    }
}

impl<S: Stored> Observe<State<S>> for Observer<S> {
    fn width(&self, _: &State<S>) -> usize {
        let states = if self.states { self.variables.n } else { 0 };
        let outputs = self.outputs.as_ref().map_or(0, |(tape, _)| tape.outputs());
        self.members * (states + outputs)
    }

    fn observe(&mut self, t: f64, state: &State<S>, row: &mut Vec<f64>) -> Result<(), StepError> {
        let start = row.len();
        self.volume.values(state, &mut self.values);
        (0..self.members)
            .try_for_each(|member| {
                let appended = self.append(member, t, row);
                appended.map_err(|error| error.of_member(member))
            })
            .inspect_err(|_| row.truncate(start))
    }
}

impl<S: Stored> Checkpoint for Observer<S> {}
