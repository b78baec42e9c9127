//! Functions of variables that are programs, of several trajectories in lanes.

use super::functions::{FormulaAt, FunctionAt, FunctionScratch};
use liouville_base::real::{Lanes, WIDTH};
use liouville_base::simd::Stored;

impl FunctionAt {
    /// Computes a tape, in lanes; on failure the first trajectory where it is not finite.
    pub(super) fn set_tape<S: Stored>(
        &self,
        is_shared: bool,
        x: &mut [S],
        scratch: &mut FunctionScratch,
    ) -> Result<(), usize> {
        let FormulaAt::Tape {
            tape,
            number,
            place,
        } = &self.formula
        else {
            return Ok(());
        };
        if is_shared || S::IS_SINGLE {
            let arguments = &mut scratch.arguments[..self.from.len()];
            for (argument, place) in arguments.iter_mut().zip(&self.from) {
                *argument = x[*place as usize].member(0);
            }
            let values = tape.eval(&mut scratch.registers[*number], [arguments]);
            for (x, value) in x[*place..].iter_mut().zip(values) {
                *x = S::splat(*value);
            }
            return if values.iter().all(|value| value.is_finite()) {
                Ok(())
            } else {
                Err(0)
            };
        }
        let arguments = &mut scratch.wide[..self.from.len()];
        let registers = &mut scratch.in_lanes[*number];
        for first in (0..S::MEMBERS).step_by(WIDTH) {
            for (argument, place) in arguments.iter_mut().zip(&self.from) {
                let from = &x[*place as usize];
                *argument = Lanes(std::array::from_fn(|lane| from.member(first + lane)));
            }
            let values = tape.eval(registers, [arguments]);
            for (x, value) in x[*place..].iter_mut().zip(values) {
                for (lane, value) in value.0.iter().enumerate() {
                    x.set_member(first + lane, *value);
                }
            }
            let is_bad = |lane: &usize| values.iter().any(|value| !value.0[*lane].is_finite());
            if let Some(lane) = (0..WIDTH).find(is_bad) {
                return Err(first + lane);
            }
        }
        Ok(())
    }
}
