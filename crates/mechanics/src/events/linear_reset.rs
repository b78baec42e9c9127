//! The derivative of a reset: its parts are listed once, and taken forwards for tangents and transposed for cotangents.
//!
//! A law of the state leads to (ŷ, ẑ), coordinates are corrected one after another until they are at the constraints, and
//! z⁺ follows. Each part is a linear map of the changes of x = (t, y, z, λ, θ), with the y and z of the parts before it.

use super::slopes::{Before, SlopesModel};
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, copy, max_norm};
use liouville_base::linear::in_order;
use std::ops::Range;

/// More corrections than a law takes to the constraints.
const MOST_CORRECTIONS: usize = 100;
/// The corrections end with that after one of this part of y.
const NEAR: f64 = 1e-10;

/// A reset that is linearised, for the tangents and cotangents behind it.
pub trait LinearReset: Send + Sync {
    /// Linearises the reset that led from one point to (y, z).
    ///
    /// # Errors
    /// A value that is not finite, a singular matrix, or a law that leaves the constraints.
    fn make(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        after: [&[f64]; 2],
    ) -> Result<(), StepError>;

    /// Writes (dy⁺, dz⁺) along dx.
    ///
    /// # Errors
    /// A derivative that is not finite.
    fn push(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        along: &[f64],
        out: [&mut [f64]; 2],
    ) -> Result<(), StepError>;

    /// Returns cotangents of x, from those of (y⁺, z⁺).
    ///
    /// # Errors
    /// A derivative that is not finite.
    fn pull(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        of: [&[f64]; 2],
    ) -> Result<Vec<f64>, StepError>;
}

/// How a kind of system corrects coordinates, and finds z behind a reset.
pub trait ResetEquations: Send + Sync {
    /// The matrices of a correction.
    type Matrices: Send + Sync;

    /// Moves y by one correction; returns its matrices, and the unknowns that the tapes of moves hold.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    fn correct(
        &mut self,
        t: f64,
        y: &mut [f64],
        z: &[f64],
    ) -> Result<(Self::Matrices, [Vec<f64>; 2]), StepError>;

    /// Adds to dy what changes of a correction's equations move it by; transposed, makes their cotangents of those of dy.
    fn add_move<const TRANSPOSED: bool>(
        &mut self,
        matrices: &mut Self::Matrices,
        equations: &mut [f64],
        dy: &mut [f64],
    );

    /// Linearises what leads from (y⁺, ẑ) to (y⁺, z⁺) after a law of these values.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    fn make_end(
        &mut self,
        slopes: &SlopesModel,
        t: f64,
        law: &[f64],
        states: [&[f64]; 3],
    ) -> Result<(), StepError>;

    /// Makes dz⁺ of the changes of (t, y⁺, ẑ, λ, θ) before it; transposed, adds their cotangents.
    ///
    /// # Errors
    /// A derivative that is not finite.
    fn end<const TRANSPOSED: bool>(
        &mut self,
        slopes: &mut SlopesModel,
        at: (f64, &[f64]),
        changes: &mut [f64],
        dz: &mut [f64],
    ) -> Result<(), StepError>;
}

/// A correction of coordinates: from where, by which unknowns, with the matrices there.
struct Correction<M> {
    matrices: M,
    y: Vec<f64>,
    unknowns: [Vec<f64>; 2],
}

/// A reset as the list of its parts.
pub struct ListedReset<E: ResetEquations> {
    equations: E,
    /// Of the numbers of (t, y, z, λ, θ) those of y, and of y and z.
    coordinates: Range<usize>,
    state: Range<usize>,
    /// How many numbers time and parameters have.
    width: usize,
    /// Corrections from ŷ to y⁺, and ẑ.
    corrections: Vec<Correction<E::Matrices>>,
    z: Vec<f64>,
    /// The changes of (t, y, z, λ, θ).
    changes: Vec<f64>,
}

impl<E: ResetEquations> ListedReset<E> {
    /// A reset of these equations, with so many numbers of y and z, and derivatives by time and parameters.
    pub fn new(equations: E, [n, l]: [usize; 2], width: usize) -> Self {
        Self {
            equations,
            coordinates: 1..1 + n,
            state: 1..1 + n + l,
            width,
            corrections: Vec::new(),
            z: vec![0.0; l],
            changes: Vec::new(),
        }
    }

    /// Moves ŷ to the constraints, and keeps each correction that this takes.
    fn correct(&mut self, t: f64, jumped: &[f64]) -> Result<(), StepError> {
        let (mut now, mut is_near) = (jumped.to_vec(), false);
        for _ in 0..MOST_CORRECTIONS {
            let y = now.clone();
            let (matrices, unknowns) = self.equations.correct(t, &mut now, &self.z)?;
            let moved = y.iter().zip(&now).map(|(a, b)| (a - b).abs());
            let is_over = is_near;
            is_near = moved.fold(0.0, f64::max) <= NEAR * max_norm(&now);
            self.corrections.push(Correction {
                matrices,
                y,
                unknowns,
            });
            if is_over {
                break;
            }
        }
        Ok(())
    }

    /// Takes the changes through all parts, to dz⁺; transposed, takes cotangents back.
    fn apply<const TRANSPOSED: bool>(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        dz: &mut [f64],
    ) -> Result<(), StepError> {
        let (t, [.., lam]) = before;
        let last = self.corrections.len() + 1;
        for part in in_order::<TRANSPOSED>(last + 1) {
            if part == 0 {
                self.jump::<TRANSPOSED>(slopes, before)?;
            } else if part == last {
                let changes = &mut self.changes;
                self.equations
                    .end::<TRANSPOSED>(slopes, (t, lam), changes, dz)?;
            } else {
                self.move_by::<TRANSPOSED>(part - 1, slopes, (t, lam))?;
            }
        }
        Ok(())
    }

    /// From x to (ŷ, ẑ); an impact leaves both to the impulses.
    fn jump<const TRANSPOSED: bool>(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
    ) -> Result<(), StepError> {
        if slopes.is_impact {
            return Ok(());
        }
        let state = self.state.clone();
        if TRANSPOSED {
            let back = self.changes[state.clone()].to_vec();
            self.changes[state].fill(0.0);
            let found = slopes.reset(before, &back, true)?;
            add_scaled(&mut self.changes, 1.0, found);
        } else {
            let found = slopes.reset(before, &self.changes, false)?;
            copy(&mut self.changes[state], found);
        }
        Ok(())
    }

    /// From y before a correction to that behind it.
    fn move_by<const TRANSPOSED: bool>(
        &mut self,
        number: usize,
        slopes: &mut SlopesModel,
        (t, lam): (f64, &[f64]),
    ) -> Result<(), StepError> {
        let Correction {
            matrices,
            y,
            unknowns: [x, mu],
        } = &mut self.corrections[number];
        let (at, held): (Before<'_>, [&[f64]; 2]) = ((t, [y, &self.z, lam]), [x, mu]);
        let (rows, own) = (x.len() + mu.len(), self.coordinates.clone());
        if TRANSPOSED {
            let mut back = vec![0.0; rows];
            let dy = &mut self.changes[own];
            self.equations.add_move::<true>(matrices, &mut back, dy);
            back.extend_from_slice(dy);
            let found = slopes.moves(at, held, &back, true)?;
            add_scaled(&mut self.changes, 1.0, found);
        } else {
            let mut found = slopes.moves(at, held, &self.changes, false)?.to_vec();
            let (equations, change) = found.split_at_mut(rows);
            let dy = &mut self.changes[own];
            add_scaled(dy, 1.0, change);
            self.equations.add_move::<false>(matrices, equations, dy);
        }
        Ok(())
    }
}

impl<E: ResetEquations> LinearReset for ListedReset<E> {
    fn make(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        [y, z]: [&[f64]; 2],
    ) -> Result<(), StepError> {
        let (t, [y0, z0, _]) = before;
        let law = slopes.law(before)?.to_vec();
        let (jumped_y, jumped_z) = if slopes.is_impact {
            (y0, z0)
        } else {
            law.split_at(y.len())
        };
        copy(&mut self.z, jumped_z);
        self.corrections.clear();
        if slopes.has_moves() {
            self.correct(t, jumped_y)?;
        }
        self.equations.make_end(slopes, t, &law, [y, jumped_z, z])
    }

    fn push(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        along: &[f64],
        [dy, dz]: [&mut [f64]; 2],
    ) -> Result<(), StepError> {
        self.changes.clear();
        self.changes.extend_from_slice(along);
        self.apply::<false>(slopes, before, dz)?;
        copy(dy, &self.changes[self.coordinates.clone()]);
        Ok(())
    }

    fn pull(
        &mut self,
        slopes: &mut SlopesModel,
        before: Before<'_>,
        [of_y, of_z]: [&[f64]; 2],
    ) -> Result<Vec<f64>, StepError> {
        let (_, [.., lam]) = before;
        self.changes.clear();
        self.changes
            .resize(self.state.end - 1 + lam.len() + self.width, 0.0);
        copy(&mut self.changes[self.coordinates.clone()], of_y);
        self.apply::<true>(slopes, before, &mut of_z.to_vec())?;
        Ok(self.changes.clone())
    }
}
