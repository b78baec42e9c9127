//! States of the α family after a jump.

use super::{Alpha, AlphaState};
use liouville_problem::{Impulse, Jump, Refused, Restart};

/// Impulses, and a method that begins with the accelerations after them.
pub struct AlphaRestart {
    impulse: Impulse,
    alpha: Box<Alpha>,
}

impl AlphaRestart {
    /// For states of this method.
    pub fn new(impulse: Impulse, alpha: Alpha) -> Self {
        let alpha = Box::new(alpha);
        Self { impulse, alpha }
    }
}

impl Restart<AlphaState> for AlphaRestart {
    fn restart(
        &mut self,
        t: f64,
        before: &AlphaState,
        mut jump: Jump<'_>,
        state: &mut AlphaState,
    ) -> Result<(), Refused> {
        let has_moved = *jump.y != before.y[..];
        self.impulse.apply(t, &mut jump, has_moved)?;
        let mut start = self.alpha.start(t, jump.y, jump.z, None)?;
        start.work = before.work;
        *state = start;
        Ok(())
    }
}

// Start values of reactions that are nonlinear in their multipliers.
liouville_base::checkpoint!(AlphaRestart { alpha });
