//! A tape's program as it runs, for people to read.

use super::program::{Program, ProgramStep};
use super::{Instr, Op, Tape};

/// An operation, the register that it writes, and those that it reads: the second is the first where there is one only.
pub type Operation = (Op, usize, [usize; 2]);

/// The instructions of a tape. The registers of its inputs come first, then those of its outputs.
#[derive(Clone, Debug)]
pub struct Listing {
    /// Registers of constants, with their values.
    pub constants: Vec<(usize, f64)>,
    /// Instructions that run once, when parameters are bound.
    pub once: Vec<Operation>,
    /// Instructions of every evaluation, in this order.
    pub each: Vec<Operation>,
}

impl Tape {
    /// The program; terms are not part of it.
    pub fn listing(&self) -> Listing {
        let constants = self.constants.iter();
        let mut each = Vec::with_capacity(self.len());
        match &self.body {
            Program::Plain(instrs) => each.extend(instrs.iter().map(operation)),
            Program::Batched { instrs, steps } => {
                for step in steps {
                    match step {
                        ProgramStep::Mixed(range) => {
                            each.extend(instrs[range.clone()].iter().map(operation));
                        }
                        ProgramStep::Strided(batch) => {
                            each.extend(batch.instrs().map(|instr| operation(&instr)));
                        }
                    }
                }
            }
        }
        Listing {
            constants: constants
                .map(|(at, value)| (*at as usize, *value))
                .collect(),
            once: self.prologue.iter().map(operation).collect(),
            each,
        }
    }
}

fn operation(instr: &Instr) -> Operation {
    let [out, a, b] = [instr.out, instr.a, instr.b].map(|register| register as usize);
    (instr.op, out, [a, b])
}
