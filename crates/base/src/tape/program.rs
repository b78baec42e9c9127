//! A program: instructions one after another, or in the steps of its batches.

use super::columns::Column;
use super::execute::{Instr, Strided, execute, execute_strided};
use crate::real::{BATCH, Lanes, Real};
use crate::simd::dispatch_simd_long;
use std::ops::Range;

/// The instructions of an evaluation.
#[derive(Clone, Debug)]
pub(super) enum Program {
    /// One after another.
    Plain(Vec<Instr>),
    /// In steps, which refer to the instructions that are written out.
    Batched {
        instrs: Vec<Instr>,
        steps: Vec<ProgramStep>,
    },
}

/// Instructions that run as one.
#[derive(Clone, Debug)]
pub(super) enum ProgramStep {
    /// These instructions, one after another.
    Mixed(Range<usize>),
    /// Instructions that are not written out.
    Strided(Strided),
}

impl Program {
    /// Number of instructions.
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Plain(instrs) => instrs.len(),
            Self::Batched { instrs, steps } => {
                let strided = steps.iter().map(|step| match step {
                    ProgramStep::Strided(batch) => batch.count,
                    ProgramStep::Mixed(_) => 0,
                });
                instrs.len() + strided.sum::<usize>()
            }
        }
    }

    /// The instructions that these registers depend on, in their order.
    pub(super) fn needed_for(&self, outputs: &Range<usize>) -> Vec<Instr> {
        let mut instrs = match self {
            Self::Plain(instrs) => instrs.clone(),
            Self::Batched { instrs, steps } => {
                let in_steps = steps.iter().flat_map(|step| match step {
                    ProgramStep::Mixed(range) => instrs[range.clone()].to_vec(),
                    ProgramStep::Strided(batch) => batch.instrs().collect(),
                });
                in_steps.collect()
            }
        };
        let last = instrs.iter().map(|instr| instr.out).max().unwrap_or(0) as usize;
        let mut is_read = vec![false; outputs.end.max(last + 1)];
        is_read[outputs.clone()].fill(true);
        instrs.reverse();
        instrs.retain(|instr| {
            let is_needed = std::mem::take(&mut is_read[instr.out as usize]);
            for operand in [instr.a, instr.b] {
                if let Some(read) = is_read.get_mut(operand as usize) {
                    *read |= is_needed;
                }
            }
            is_needed
        });
        instrs.reverse();
        instrs
    }

    /// Runs the program over the registers that `Tape::new` laid out for it.
    #[inline]
    pub(super) fn run<R: Real>(&self, registers: &mut [R], columns: &[Column]) {
        match self {
            Self::Plain(instrs) => execute(instrs, registers, columns),
            Self::Batched { instrs, steps } => {
                run_steps(instrs, steps, registers, columns);
            }
        }
    }
}

#[inline(never)]
fn run_steps<R: Real>(
    instrs: &[Instr],
    steps: &[ProgramStep],
    registers: &mut [R],
    columns: &[Column],
) {
    dispatch_simd_long::<R, _>(
        registers.len(),
        #[inline(always)]
        || {
            for step in steps {
                match step {
                    ProgramStep::Mixed(range) => {
                        execute(&instrs[range.clone()], registers, columns);
                    }
                    ProgramStep::Strided(batch) => execute_strided(batch, registers),
                }
            }
        },
    );
}

crate::compiled!(R in [f64, Lanes, Lanes<BATCH>] { run_steps::<R> as fn(_, _, _, _) });
