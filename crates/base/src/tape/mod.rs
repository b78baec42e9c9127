//! A tape: a flat program of scalar operations, evaluated over any [`Real`].
//!
//! A program arrives as [`Line`]s in the numbering of the symbolic front end, which reuses its work
//! slots. [`Tape::new`] checks every index once and gives each value a register:
//!
//!     inputs | outputs | constants and functions of parameters alone | temporaries
//!
//! so that evaluation copies neither inputs nor constants nor outputs through instructions of their
//! own. The last input group is the parameters; [`Tape::bind`] runs the instructions that depend on them alone, once.
//! Repeated computations are left out; operations and their operands are its own,
//! hence its values bit for bit, and their order is one that runs fast.
//!
//! A tape may add [`Term`]s to its program's values: the large matrices of an assembled structure are
//! not written out as instructions.

mod batch;
mod columns;
mod compensate;
mod execute;
mod listing;
mod order;
mod plan;
mod points;
mod program;
mod roundings;
mod terms;
mod values;

pub use batch::BatchRegisters;
pub use columns::Column;
pub use compensate::{CompensatedPoints, CompensatedProgram, CompensatedTape};
pub use execute::Op;
pub use listing::{Listing, Operation};
pub use points::PointRegisters;
pub use terms::Term;

use crate::linalg::copy;
use crate::real::Real;
use execute::{Instr, execute};
use plan::SlotPlan;
use program::Program;
use std::ops::Range;
use terms::Terms;

/// One line of an incoming program. Slots are numbered by the program and may be reused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Line {
    /// `slot = inputs[group][element]`
    Input {
        /// Where the value goes.
        slot: usize,
        /// Which input group.
        group: usize,
        /// Which of its elements.
        element: usize,
    },
    /// `slot = value`
    Constant {
        /// Where the value goes.
        slot: usize,
        /// The constant.
        value: f64,
    },
    /// `slot = op(a, b)`
    Apply {
        /// The operation.
        op: Op,
        /// Where the value goes.
        slot: usize,
        /// Slot of the first operand.
        a: usize,
        /// Slot of the second operand, ignored when there is one only.
        b: usize,
    },
    /// `outputs[element] = slot`
    Output {
        /// Which output.
        element: usize,
        /// Where its value is.
        slot: usize,
    },
}

/// Why a program is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)]
pub enum TapeError {
    #[error("line {line}: slot {slot} is out of range for a program of {lines} lines")]
    Slot {
        line: usize,
        slot: usize,
        lines: usize,
    },
    #[error("line {line} reads slot {slot} before anything was written to it")]
    Unwritten { line: usize, slot: usize },
    #[error("line {line}: there is no element {element} in input {group}")]
    Input {
        line: usize,
        group: usize,
        element: usize,
    },
    #[error("line {line}: there is no output {element} among {outputs}")]
    Output {
        line: usize,
        element: usize,
        outputs: usize,
    },
    #[error("line {line} writes output {element} a second time")]
    Twice { line: usize, element: usize },
    #[error("output {element} is never written")]
    Missing { element: usize },
    #[error("line {line}: {op} takes the number of one of {columns} columns as a constant")]
    Column {
        line: usize,
        op: &'static str,
        columns: usize,
    },
    #[error("the program has more than 2^26 inputs and outputs")]
    TooLarge,
    #[error("there are {found} constants for {outputs} outputs")]
    Constant { found: usize, outputs: usize },
    #[error("term {term}: there is no input {group}")]
    Group { term: usize, group: usize },
    #[error("term {term}: a {rows} by {cols} matrix does not take an input of size {size}")]
    Shape {
        term: usize,
        rows: usize,
        cols: usize,
        size: usize,
    },
    #[error("term {term}: {count} values from output {first} on do not fit {outputs} outputs")]
    Range {
        term: usize,
        first: usize,
        count: usize,
        outputs: usize,
    },
}

/// A validated program, read-only and shared.
#[derive(Clone, Debug)]
pub struct Tape {
    inputs: Vec<usize>,
    outputs: Range<usize>,
    constants: Vec<(u32, f64)>,
    prologue: Vec<Instr>,
    body: Program,
    registers: usize,
    columns: Box<[Column]>,
    terms: Option<Box<Terms>>,
}

/// The memory one evaluation works in, with the parameters already bound.
#[derive(Clone, Debug)]
pub struct Registers<R>(Vec<R>);

impl Tape {
    /// Checks a program and lays out its registers.
    ///
    /// `inputs` are the sizes of the input groups, the last of which is the parameters.
    ///
    /// # Errors
    /// [`TapeError`] names the first line that cannot be trusted.
    pub fn new(inputs: &[usize], outputs: usize, lines: &[Line]) -> Result<Self, TapeError> {
        Self::with_columns(inputs, outputs, lines, Box::default())
    }

    /// The same for a program that looks numbers up in columns: [`Op::Search`] and [`Op::Entry`] take the number of one
    /// as a constant, their second operand.
    ///
    /// # Errors
    /// [`TapeError`] names the first line that cannot be trusted.
    pub fn with_columns(
        inputs: &[usize],
        outputs: usize,
        lines: &[Line],
        columns: Box<[Column]>,
    ) -> Result<Self, TapeError> {
        SlotPlan::new(inputs, outputs, lines, columns.len())?;
        let lines = &values::once(lines)[..];
        let plan = SlotPlan::new(inputs, outputs, lines, columns.len())?;
        let groups = groups(inputs);
        let first_output = groups.last().map_or(0, |group| group.end);
        let first_temporary = first_output + outputs + plan.pinned;
        let registers = first_temporary + plan.slots;
        let mut tape = Self {
            inputs: inputs.to_vec(),
            outputs: first_output..first_output + outputs,
            constants: Vec::new(),
            prologue: Vec::new(),
            body: Program::Plain(Vec::new()),
            registers,
            columns,
            terms: None,
        };
        let mut body = Vec::new();
        let mut held = vec![0_u32; plan.slots];
        let mut next_pinned = first_output + outputs;
        let mut pin = || {
            next_pinned += 1;
            next_pinned - 1
        };
        #[allow(clippy::cast_possible_truncation)] // 2^26 values, and no more slots than lines
        for (k, line) in lines.iter().enumerate() {
            match *line {
                Line::Input {
                    slot,
                    group,
                    element,
                } => held[slot] = (groups[group].start + element) as u32,
                Line::Constant { slot, value } => {
                    held[slot] = pin() as u32;
                    tape.constants.push((held[slot], value));
                }
                Line::Apply { op, slot, a, b } => {
                    let out = match (plan.direct[k], plan.fixed[k]) {
                        (_, true) => pin(), // outputs written once are not read: terms may add to them
                        (Some(element), false) => first_output + element,
                        (None, false) => first_temporary + slot,
                    } as u32;
                    let b = if op.arity() == 2 { b } else { a };
                    let instr = Instr {
                        op,
                        out,
                        a: held[a],
                        b: held[b],
                    };
                    let part = if plan.fixed[k] {
                        &mut tape.prologue
                    } else {
                        &mut body
                    };
                    part.push(instr);
                    held[slot] = out;
                }
                Line::Output { element, slot } => {
                    let out = (first_output + element) as u32;
                    if held[slot] != out {
                        let instr = Instr {
                            op: Op::Assign,
                            out,
                            a: held[slot],
                            b: held[slot],
                        };
                        let part = if plan.fixed[k] {
                            &mut tape.prologue
                        } else {
                            &mut body
                        };
                        part.push(instr);
                    }
                }
            }
        }
        match order::ordered(&body, &groups, &tape.outputs, first_temporary..registers) {
            None => tape.body = Program::Plain(body),
            Some((program, registers)) => (tape.body, tape.registers) = (program, registers),
        }
        Ok(tape)
    }

    /// Adds to the program's values a constant (none if empty) and terms, in their order; those it had
    /// are replaced.
    ///
    /// # Errors
    /// [`TapeError`] names the first term that does not fit the inputs and outputs.
    pub fn with_terms(mut self, constant: &[f64], terms: Vec<Term>) -> Result<Self, TapeError> {
        let mut fixed = vec![false; self.outputs()];
        for instr in &self.prologue {
            let out = instr.out as usize;
            if self.outputs.contains(&out) {
                fixed[out - self.outputs.start] = true;
            }
        }
        let terms = Terms::new(&groups(&self.inputs), &fixed, constant, terms)?;
        let earlier = self.terms.map_or(0, |terms| terms.registers());
        self.registers = self.registers - earlier + terms.registers();
        self.terms = Some(Box::new(terms));
        Ok(self)
    }

    /// The same program with other numbers in its columns, as many columns as it has.
    ///
    /// # Panics
    /// When their number differs.
    #[must_use]
    pub fn with_numbers(&self, columns: Box<[Column]>) -> Self {
        assert_eq!(columns.len(), self.columns.len(), "number of columns");
        Self {
            columns,
            ..self.clone()
        }
    }

    /// Number of instructions one evaluation runs.
    pub fn len(&self) -> usize {
        self.body.len()
    }

    /// Whether an evaluation has nothing to run: every output depends on parameters alone.
    pub fn is_empty(&self) -> bool {
        self.len() == 0 && self.terms.as_ref().is_none_or(|terms| terms.is_empty())
    }

    /// StepSizes of the input groups; the last is the parameters.
    pub fn inputs(&self) -> &[usize] {
        &self.inputs
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs.len()
    }

    /// Allocates memory for evaluations with these parameters, and runs the instructions that depend on them alone.
    ///
    /// # Panics
    /// When `params` has not the size of the last input group.
    pub fn bind<R: Real>(&self, params: &[R]) -> Registers<R> {
        assert_eq!(
            params.len(),
            self.inputs.last().copied().unwrap_or(0),
            "size of params"
        );
        let mut registers = vec![R::splat(0.0); self.registers];
        registers[self.outputs.start - params.len()..self.outputs.start].copy_from_slice(params);
        for (register, value) in &self.constants {
            registers[*register as usize] = R::splat(*value);
        }
        execute(&self.prologue, &mut registers, &self.columns);
        if let Some(terms) = &self.terms {
            let (head, kept) = registers.split_at_mut(self.registers - terms.registers());
            terms.bind(&mut head[self.outputs.clone()], kept);
        }
        Registers(registers)
    }

    /// Adds the terms to the values of the program.
    #[inline(never)]
    fn add_terms<R: Real>(&self, terms: &Terms, registers: &mut [R]) {
        let (head, kept) = registers.split_at_mut(self.registers - terms.registers());
        let (inputs, rest) = head.split_at_mut(self.outputs.start);
        terms.add(inputs, &mut rest[..self.outputs.len()], kept);
    }

    /// Evaluates the tape at `args`, one slice for each input group but the parameters.
    ///
    /// # Panics
    /// When the arguments or the registers are not of this tape's sizes.
    #[allow(clippy::inline_always)] // a step evaluates some thirty tapes of a few instructions each
    #[inline(always)]
    pub fn eval<'r, R: Real, const K: usize>(
        &self,
        registers: &'r mut Registers<R>,
        args: [&[R]; K],
    ) -> &'r [R] {
        let registers = &mut registers.0[..];
        assert!(
            registers.len() == self.registers,
            "registers of another tape"
        );
        assert!(K + 1 == self.inputs.len(), "number of arguments");
        let mut start = 0;
        for (arg, size) in args.iter().zip(&self.inputs) {
            assert!(arg.len() == *size, "size of an argument");
            copy(&mut registers[start..start + size], arg);
            start += size;
        }
        self.body.run(registers, &self.columns);
        if let Some(terms) = &self.terms {
            self.add_terms(terms, registers);
        }
        &registers[self.outputs.clone()]
    }
}

/// The registers of each input group.
fn groups(inputs: &[usize]) -> Vec<Range<usize>> {
    let ends = inputs.iter().scan(0, |end, size| {
        *end += size;
        Some(*end - size..*end)
    });
    ends.collect()
}
