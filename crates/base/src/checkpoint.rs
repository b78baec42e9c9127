//! Checkpoints: the numbers that one step leaves to the next.
//!
//! Counters and flags are saved as whole numbers, exact below 2⁵³.

/// Whole numbers below this have a number each.
const LARGEST: f64 = 9_007_199_254_740_992.0;

/// Where numbers are saved: to memory, or only counted.
pub trait Numbers {
    /// Takes the next number.
    fn push(&mut self, x: f64);
}

impl Numbers for Vec<f64> {
    fn push(&mut self, x: f64) {
        Self::push(self, x);
    }
}

/// How many numbers are saved, to have room for them before.
#[derive(Clone, Copy, Debug, Default)]
pub struct Count(pub usize);

impl Numbers for Count {
    fn push(&mut self, _: f64) {
        self.0 += 1;
    }
}

/// The numbers that one step leaves to the next.
///
/// A run restored from them goes on with the same bits: after a pause, or in a stepper of one member for a member
/// of several in lock-step. Save only what the next step reads; statistics are left out. The default saves nothing.
pub trait Checkpoint: Send + Sync {
    /// Appends the numbers of a member.
    fn save(&self, _member: usize, _out: &mut dyn Numbers) {}

    /// Takes the numbers of a member from the front of `saved`, as [`Checkpoint::save`] wrote them.
    ///
    /// # Errors
    /// Something of another size saved them.
    fn restore(&mut self, _member: usize, _saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        Ok(())
    }
}

/// Implements [`Checkpoint`] by the fields that are saved, in this order:
/// `checkpoint!([generics] Type { field, field.of_field } then check)`. The function `check` has the restored value
/// and may refuse it, or compute again the values that depend on it.
#[macro_export]
macro_rules! checkpoint {
    (
        [$($generics:tt)*] $type:ty { $($($field:ident).+),* $(,)? } $(then $check:expr)?
    ) => {
        impl<$($generics)*> $crate::checkpoint::Checkpoint for $type {
            fn save(&self, member: usize, out: &mut dyn $crate::checkpoint::Numbers) {
                $($crate::checkpoint::Checkpoint::save(&self.$($field).+, member, out);)*
            }

            fn restore(
                &mut self,
                member: usize,
                saved: &mut &[f64],
            ) -> Result<(), $crate::checkpoint::CheckpointMismatch> {
                $($crate::checkpoint::Checkpoint::restore(&mut self.$($field).+, member, saved)?;)*
                $(
                    let check: fn(&mut Self) -> _ = $check;
                    check(self)?;
                )?
                Ok(())
            }
        }
    };
    ($type:ty { $($fields:tt)* } $($then:tt)*) => {
        $crate::checkpoint!([] $type { $($fields)* } $($then)*);
    };
}

/// The checkpoint of another run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("what was saved is of another run")]
pub struct CheckpointMismatch;

/// The first `count` of the saved numbers.
///
/// # Errors
/// Fewer than `count` numbers are left.
pub fn split_front<'a>(
    saved: &mut &'a [f64],
    count: usize,
) -> Result<&'a [f64], CheckpointMismatch> {
    let (head, tail) = saved.split_at_checked(count).ok_or(CheckpointMismatch)?;
    *saved = tail;
    Ok(head)
}

impl<M: Checkpoint + ?Sized> Checkpoint for Box<M> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        (**self).save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        (**self).restore(member, saved)
    }
}

impl Checkpoint for f64 {
    fn save(&self, _: usize, out: &mut dyn Numbers) {
        out.push(*self);
    }

    fn restore(&mut self, _: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        *self = split_front(saved, 1)?[0];
        Ok(())
    }
}

impl Checkpoint for usize {
    #[allow(clippy::cast_precision_loss)] // counters stay below 2⁵³
    fn save(&self, _: usize, out: &mut dyn Numbers) {
        out.push(*self as f64);
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked to be whole
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
    fn save(&self, member: usize, out: &mut dyn Numbers) {
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

impl<M: Checkpoint> Checkpoint for [M] {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        for x in self {
            x.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.iter_mut().try_for_each(|x| x.restore(member, saved))
    }
}

impl<M: Checkpoint> Checkpoint for Vec<M> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.as_slice().save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.as_mut_slice().restore(member, saved)
    }
}

impl<M: Checkpoint, const N: usize> Checkpoint for [M; N] {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.as_slice().save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.as_mut_slice().restore(member, saved)
    }
}

impl<A: Checkpoint, B: Checkpoint> Checkpoint for (A, B) {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.0.save(member, out);
        self.1.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.0.restore(member, saved)?;
        self.1.restore(member, saved)
    }
}

impl<M: Checkpoint + Default> Checkpoint for Option<M> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
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
