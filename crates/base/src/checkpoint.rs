//! What is brought from one step to the next, as numbers.
//!
//! Counters and flags are among them as whole numbers, exact below 2⁵³.

use crate::real::Scalar;

/// Whole numbers below this have a number each.
const LARGEST: f64 = 9_007_199_254_740_992.0;

/// What is brought from one step to the next, as numbers.
///
/// Whoever restores what was saved goes on with the same bits: after a checkpoint, or as a stepper of one
/// member that goes on where a stepper of several in lock-step was. Memory that a step overwrites before it reads it is
/// not saved, and neither is what only counts. Who brings nothing implements nothing.
pub trait Checkpoint {
    /// Appends what a member brings.
    fn save(&self, _member: usize, _out: &mut Vec<f64>) {}

    /// Takes what a member brings from the front of `saved`, as [`Checkpoint::save`] wrote it.
    ///
    /// # Errors
    /// It was saved by something of another size.
    fn restore(&mut self, _member: usize, _saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        Ok(())
    }
}

/// What was saved belongs to something else.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("what was saved is of another run")]
pub struct CheckpointMismatch;

/// The first `count` numbers of what was saved.
///
/// # Errors
/// There are not so many left.
pub fn split_front<'a>(
    saved: &mut &'a [f64],
    count: usize,
) -> Result<&'a [f64], CheckpointMismatch> {
    let (head, tail) = saved.split_at_checked(count).ok_or(CheckpointMismatch)?;
    *saved = tail;
    Ok(head)
}

impl<M: Checkpoint + ?Sized> Checkpoint for Box<M> {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        (**self).save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        (**self).restore(member, saved)
    }
}

impl Checkpoint for f64 {
    fn save(&self, _: usize, out: &mut Vec<f64>) {
        out.push(*self);
    }

    fn restore(&mut self, _: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        *self = split_front(saved, 1)?[0];
        Ok(())
    }
}

impl Checkpoint for usize {
    #[allow(clippy::cast_precision_loss)] // nobody counts that far
    fn save(&self, _: usize, out: &mut Vec<f64>) {
        out.push(*self as f64);
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // seen to be whole
    fn restore(&mut self, _: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let found = split_front(saved, 1)?[0];
        if !(0.0..LARGEST).contains(&found) || found.fract() != 0.0 {
            return Err(CheckpointMismatch);
        }
        *self = found as Self;
        Ok(())
    }
}

impl Checkpoint for bool {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        usize::from(*self).save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let mut found = 0_usize;
        found.restore(member, saved)?;
        *self = match found {
            0 => false,
            1 => true,
            _ => return Err(CheckpointMismatch),
        };
        Ok(())
    }
}

impl<S: Scalar> Checkpoint for [S] {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        out.extend(self.iter().map(|x| x.member(member)));
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let values = split_front(saved, self.len())?;
        for (x, value) in self.iter_mut().zip(values) {
            x.set_member(member, *value);
        }
        Ok(())
    }
}

impl<S: Scalar> Checkpoint for Vec<S> {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.as_slice().save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.as_mut_slice().restore(member, saved)
    }
}

impl<M: Checkpoint, const N: usize> Checkpoint for [M; N] {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        for x in self {
            x.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.iter_mut().try_for_each(|x| x.restore(member, saved))
    }
}

impl<A: Checkpoint, B: Checkpoint> Checkpoint for (A, B) {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.0.save(member, out);
        self.1.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.0.restore(member, saved)?;
        self.1.restore(member, saved)
    }
}

impl<M: Checkpoint + Default> Checkpoint for Option<M> {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.is_some().save(member, out);
        if let Some(found) = self {
            found.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let mut is_some = false;
        is_some.restore(member, saved)?;
        if is_some {
            self.get_or_insert_default().restore(member, saved)?;
        } else {
            *self = None;
        }
        Ok(())
    }
}
