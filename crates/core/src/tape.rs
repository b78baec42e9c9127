//! A tape: a flat program of scalar operations, evaluated over any [`Real`].
//!
//! A program arrives as [`Line`]s in the numbering of the symbolic front end, which reuses its work
//! slots. [`Tape::new`] checks every index once and gives each value a register:
//!
//!     inputs | outputs | constants and what depends on parameters alone | temporaries
//!
//! so that evaluation copies neither inputs nor constants nor outputs through instructions of their
//! own. The last input group is the parameters; [`Tape::bind`] runs what depends on them alone, once.
//! The order of operations is the program's own, hence its values bit for bit.

use crate::linalg::copy;
use crate::real::{Lanes, Real, WIDTH};
use std::ops::Range;

macro_rules! operations {
    ($($name:ident $text:literal $arity:literal,)*) => {
        /// An operation of the tape, with the meaning it has in C's `math.h`.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u32)]
        #[allow(missing_docs)]
        pub enum Op { $($name,)* }

        impl Op {
            /// Every operation, in the order of its code.
            pub const ALL: &'static [Op] = &[$(Op::$name,)*];

            /// The name the front end knows it by.
            pub fn name(self) -> &'static str {
                match self { $(Op::$name => $text,)* }
            }

            /// How many operands it reads: 1 or 2.
            pub fn arity(self) -> usize {
                match self { $(Op::$name => $arity,)* }
            }
        }
    };
}

operations! {
    Assign "assign" 1, Add "add" 2, Sub "sub" 2, Mul "mul" 2, Div "div" 2, Neg "neg" 1,
    Exp "exp" 1, Log "log" 1, Pow "pow" 2, Constpow "constpow" 2, Sqrt "sqrt" 1, Sq "sq" 1,
    Twice "twice" 1, Sin "sin" 1, Cos "cos" 1, Tan "tan" 1, Asin "asin" 1, Acos "acos" 1,
    Atan "atan" 1, Lt "lt" 2, Le "le" 2, Eq "eq" 2, Ne "ne" 2, Not "not" 1, And "and" 2, Or "or" 2,
    Floor "floor" 1, Ceil "ceil" 1, Fmod "fmod" 2, Fabs "fabs" 1, Sign "sign" 1,
    Copysign "copysign" 2, IfElseZero "if_else_zero" 2, Fmin "fmin" 2, Fmax "fmax" 2, Inv "inv" 1,
    Sinh "sinh" 1, Cosh "cosh" 1, Tanh "tanh" 1, Asinh "asinh" 1, Acosh "acosh" 1, Atanh "atanh" 1,
    Atan2 "atan2" 2, Log1p "log1p" 1, Expm1 "expm1" 1, Hypot "hypot" 2,
}

/// One line of an incoming program. Slots are numbered by the program and may be reused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Line {
    /// `slot = inputs[group][element]`
    Input {
        slot: usize,
        group: usize,
        element: usize,
    },
    /// `slot = value`
    Constant { slot: usize, value: f64 },
    /// `slot = op(a, b)`; `b` is ignored when the operation has one operand.
    Apply {
        op: Op,
        slot: usize,
        a: usize,
        b: usize,
    },
    /// `outputs[element] = slot`
    Output { element: usize, slot: usize },
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
    #[error("the program needs more than 2^31 registers")]
    TooLarge,
}

#[derive(Clone, Copy, Debug)]
struct Instr {
    op: Op,
    out: u32,
    a: u32,
    b: u32,
}

/// A validated program, read-only and shared.
#[derive(Clone, Debug)]
pub struct Tape {
    inputs: Vec<usize>,
    outputs: Range<usize>,
    constants: Vec<(u32, f64)>,
    prologue: Vec<Instr>,
    body: Vec<Instr>,
    registers: usize,
}

/// The memory one evaluation works in, with the parameters already bound.
#[derive(Clone, Debug)]
pub struct Registers<R>(Vec<R>);

/// Who wrote a slot's current value, and whether that depends on parameters alone.
#[derive(Clone, Copy)]
struct Held {
    writer: usize,
    fixed: bool,
}

impl Tape {
    /// Checks a program and lays out its registers.
    ///
    /// `inputs` are the sizes of the input groups, the last of which is the parameters.
    ///
    /// # Errors
    /// [`TapeError`] names the first line that cannot be trusted.
    pub fn new(inputs: &[usize], outputs: usize, lines: &[Line]) -> Result<Self, TapeError> {
        let plan = Plan::new(inputs, outputs, lines)?;
        let starts: Vec<usize> = inputs
            .iter()
            .scan(0, |next, size| Some(std::mem::replace(next, *next + size)))
            .collect();
        let first_output = starts.last().zip(inputs.last()).map_or(0, |(a, b)| a + b);
        let first_temporary = first_output + outputs + plan.pinned;
        let registers = first_temporary + plan.slots;
        if registers > 1 << 31 {
            return Err(TapeError::TooLarge);
        }
        let mut tape = Self {
            inputs: inputs.to_vec(),
            outputs: first_output..first_output + outputs,
            constants: Vec::new(),
            prologue: Vec::new(),
            body: Vec::new(),
            registers,
        };
        let mut held = vec![0_u32; plan.slots];
        let mut next_pinned = first_output + outputs;
        let mut pin = || {
            next_pinned += 1;
            next_pinned - 1
        };
        #[allow(clippy::cast_possible_truncation)] // registers fit, as checked above
        for (k, line) in lines.iter().enumerate() {
            match *line {
                Line::Input {
                    slot,
                    group,
                    element,
                } => held[slot] = (starts[group] + element) as u32,
                Line::Constant { slot, value } => {
                    held[slot] = pin() as u32;
                    tape.constants.push((held[slot], value));
                }
                Line::Apply { op, slot, a, b } => {
                    let out = match (plan.direct[k], plan.fixed[k]) {
                        (Some(element), _) => first_output + element,
                        (None, true) => pin(),
                        (None, false) => first_temporary + slot,
                    } as u32;
                    let b = if op.arity() == 2 { b } else { a };
                    let instr = Instr {
                        op,
                        out,
                        a: held[a],
                        b: held[b],
                    };
                    tape.place(instr, plan.fixed[k]);
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
                        tape.place(instr, plan.fixed[k]);
                    }
                }
            }
        }
        Ok(tape)
    }

    fn place(&mut self, instr: Instr, fixed: bool) {
        if fixed {
            self.prologue.push(instr);
        } else {
            self.body.push(instr);
        }
    }

    /// Number of instructions one evaluation runs.
    pub fn len(&self) -> usize {
        self.body.len()
    }

    /// Whether an evaluation has nothing to run: every output depends on parameters alone.
    pub fn is_empty(&self) -> bool {
        self.body.is_empty()
    }

    /// Sizes of the input groups; the last is the parameters.
    pub fn inputs(&self) -> &[usize] {
        &self.inputs
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs.len()
    }

    /// Takes memory for evaluations with these parameters, and runs what depends on them alone.
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
        execute(&self.prologue, &mut registers);
        Registers(registers)
    }

    /// Evaluates the tape at `args`, one slice for each input group but the parameters.
    ///
    /// # Panics
    /// When the arguments or the registers are not of this tape's sizes.
    #[inline]
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
        execute(&self.body, registers);
        &registers[self.outputs.clone()]
    }

    /// Evaluates the tape at `k` points, eight at a time.
    ///
    /// Each argument holds `k` rows of its group's size; the result holds `k` rows of outputs.
    ///
    /// # Panics
    /// When an argument has not `k` rows.
    pub fn map(&self, params: &[f64], args: &[&[f64]], k: usize) -> Vec<f64> {
        for (arg, size) in args.iter().zip(&self.inputs) {
            assert_eq!(arg.len(), k * size, "size of an argument");
        }
        let bound: Vec<Lanes> = params.iter().map(|p| Lanes::splat(*p)).collect();
        let Registers(mut registers) = self.bind(&bound);
        let width = self.outputs();
        let mut result = vec![0.0; k * width];
        for first in (0..k).step_by(WIDTH) {
            let mut start = 0;
            for (arg, size) in args.iter().zip(&self.inputs) {
                for element in 0..*size {
                    // the last block repeats its last point
                    let at = |i: usize| arg[(first + i).min(k - 1) * size + element];
                    registers[start + element] = Lanes(std::array::from_fn(at));
                }
                start += size;
            }
            execute(&self.body, &mut registers);
            let values = &registers[self.outputs.clone()];
            let rows = result[first * width..].chunks_mut(width.max(1));
            for (i, row) in rows.take(WIDTH).enumerate() {
                for (out, value) in row.iter_mut().zip(values) {
                    *out = value.0[i];
                }
            }
        }
        result
    }
}

/// What the first pass over a program learns.
struct Plan {
    slots: usize,
    pinned: usize,
    fixed: Vec<bool>,
    direct: Vec<Option<usize>>,
}

impl Plan {
    fn new(inputs: &[usize], outputs: usize, lines: &[Line]) -> Result<Self, TapeError> {
        let total = inputs
            .iter()
            .try_fold(outputs, |sum, size| sum.checked_add(*size));
        if total.is_none_or(|total| total > 1 << 30) {
            return Err(TapeError::TooLarge);
        }
        if outputs > lines.len() {
            return Err(TapeError::Missing {
                element: outputs - 1,
            });
        }
        let mut plan = Self {
            slots: 0,
            pinned: 0,
            fixed: vec![false; lines.len()],
            direct: vec![None; lines.len()],
        };
        let mut slots: Vec<Option<Held>> = vec![None; lines.len()];
        let mut written = vec![false; outputs];
        for (k, line) in lines.iter().enumerate() {
            let write = |slots: &mut [Option<Held>], slot: usize, fixed| {
                let out_of_range = TapeError::Slot {
                    line: k,
                    slot,
                    lines: lines.len(),
                };
                let place = slots.get_mut(slot).ok_or(out_of_range)?;
                *place = Some(Held { writer: k, fixed });
                Ok(slot + 1)
            };
            let read = |slots: &[Option<Held>], slot: usize| {
                slots
                    .get(slot)
                    .copied()
                    .flatten()
                    .ok_or(TapeError::Unwritten { line: k, slot })
            };
            match *line {
                Line::Input {
                    slot,
                    group,
                    element,
                } => {
                    if inputs.get(group).is_none_or(|size| element >= *size) {
                        return Err(TapeError::Input {
                            line: k,
                            group,
                            element,
                        });
                    }
                    plan.slots =
                        plan.slots
                            .max(write(&mut slots, slot, group + 1 == inputs.len())?);
                }
                Line::Constant { slot, .. } => {
                    plan.pinned += 1;
                    plan.slots = plan.slots.max(write(&mut slots, slot, true)?);
                }
                Line::Apply { op, slot, a, b } => {
                    let mut fixed = read(&slots, a)?.fixed;
                    if op.arity() == 2 {
                        fixed &= read(&slots, b)?.fixed;
                    }
                    plan.fixed[k] = fixed;
                    plan.pinned += usize::from(fixed);
                    plan.slots = plan.slots.max(write(&mut slots, slot, fixed)?);
                }
                Line::Output { element, slot } => {
                    let held = read(&slots, slot)?;
                    match written.get_mut(element) {
                        None => {
                            return Err(TapeError::Output {
                                line: k,
                                element,
                                outputs,
                            });
                        }
                        Some(true) => return Err(TapeError::Twice { line: k, element }),
                        Some(unwritten) => *unwritten = true,
                    }
                    plan.fixed[k] = held.fixed;
                    let target = &mut plan.direct[held.writer];
                    if matches!(lines[held.writer], Line::Apply { .. }) && target.is_none() {
                        *target = Some(element);
                    }
                }
            }
        }
        match written.iter().position(|written| !written) {
            Some(element) => Err(TapeError::Missing { element }),
            None => Ok(plan),
        }
    }
}

/// Runs a program that [`Tape::new`] made, over the registers it laid out.
#[inline]
#[allow(unsafe_code)]
fn execute<R: Real>(program: &[Instr], registers: &mut [R]) {
    let start = registers.as_mut_ptr();
    let truth = |condition: bool| f64::from(u8::from(condition));
    for instr in program {
        // SAFETY: `Tape::new` gives out registers below `self.registers` only, and both callers pass
        // exactly that many.
        let read = |register: u32| unsafe { *start.add(register as usize) };
        let write = |value: R| unsafe { *start.add(instr.out as usize) = value };
        let one = |f: fn(f64) -> f64| write(read(instr.a).map(f));
        macro_rules! two {
            (|$x:ident, $y:ident| $value:expr) => {{
                let ($x, $y) = (read(instr.a), read(instr.b));
                write($value)
            }};
        }
        match instr.op {
            Op::Assign => write(read(instr.a)),
            Op::Add => two!(|x, y| x + y),
            Op::Sub => two!(|x, y| x - y),
            Op::Mul => two!(|x, y| x * y),
            Op::Div => two!(|x, y| x / y),
            Op::Neg => write(-read(instr.a)),
            Op::Sq => two!(|x, _y| x * x),
            Op::Twice => two!(|x, _y| x + x),
            Op::Inv => two!(|x, _y| R::splat(1.0) / x),
            Op::Sqrt => two!(|x, _y| x.map(f64::sqrt)),
            Op::Exp => one(f64::exp),
            Op::Log => one(f64::ln),
            Op::Pow | Op::Constpow => two!(|x, y| x.zip(y, f64::powf)),
            Op::Sin => one(f64::sin),
            Op::Cos => one(f64::cos),
            Op::Tan => one(f64::tan),
            Op::Asin => one(f64::asin),
            Op::Acos => one(f64::acos),
            Op::Atan => one(f64::atan),
            Op::Lt => two!(|x, y| x.zip(y, |a, b| truth(a < b))),
            Op::Le => two!(|x, y| x.zip(y, |a, b| truth(a <= b))),
            Op::Eq => two!(|x, y| x.zip(y, |a, b| truth(a == b))),
            Op::Ne => two!(|x, y| x.zip(y, |a, b| truth(a != b))),
            Op::Not => two!(|x, _y| x.map(|a| truth(a == 0.0))),
            Op::And => two!(|x, y| x.zip(y, |a, b| truth(a != 0.0 && b != 0.0))),
            Op::Or => two!(|x, y| x.zip(y, |a, b| truth(a != 0.0 || b != 0.0))),
            Op::Floor => one(f64::floor),
            Op::Ceil => one(f64::ceil),
            Op::Fmod => two!(|x, y| x.zip(y, |a, b| a % b)),
            Op::Fabs => one(f64::abs),
            Op::Sign => one(|a| {
                if a == 0.0 || a.is_nan() {
                    a
                } else {
                    a.signum()
                }
            }),
            Op::Copysign => two!(|x, y| x.zip(y, f64::copysign)),
            Op::IfElseZero => two!(|x, y| x.zip(y, |a, b| if a == 0.0 { 0.0 } else { b })),
            Op::Fmin => two!(|x, y| x.zip(y, f64::min)),
            Op::Fmax => two!(|x, y| x.zip(y, f64::max)),
            Op::Sinh => one(f64::sinh),
            Op::Cosh => one(f64::cosh),
            Op::Tanh => one(f64::tanh),
            Op::Asinh => one(f64::asinh),
            Op::Acosh => one(f64::acosh),
            Op::Atanh => one(f64::atanh),
            Op::Atan2 => two!(|x, y| x.zip(y, f64::atan2)),
            Op::Log1p => one(f64::ln_1p),
            Op::Expm1 => one(f64::exp_m1),
            Op::Hypot => two!(|x, y| x.zip(y, f64::hypot)),
        }
    }
}
