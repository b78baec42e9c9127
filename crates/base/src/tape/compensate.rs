//! Values of a tape near a root, where they are smaller than their own roundings: those are found and added.
#![allow(clippy::inline_always)] // a call would lack the instruction set
#![allow(clippy::needless_bitwise_bool)] // short-circuiting would end the loop over members

use super::columns::{Column, entry, search};
use super::execute::{Cheap, Instr, Op};
use super::{PointRegisters, Registers, Tape, groups};
use crate::compensated::Compensated;
use crate::real::{Lanes, Real, Scalar};
use crate::simd::{dispatch_fused, dispatch_simd};
use std::ops::Range;
use std::sync::Arc;

/// Points of one member that are evaluated side by side: registers of eight numbers would slow the clock of many
/// processors for a while, which so few operations do not repay.
const POINTS: usize = 4;

/// The part of a tape that makes its first outputs of time and its second argument, in compensated numbers.
#[derive(Clone, Debug)]
pub struct CompensatedProgram {
    instrs: Vec<Instr>,
    columns: Box<[Column]>,
    argument: Range<usize>,
    outputs: Range<usize>,
}

/// A compensated program with the parameters bound.
#[derive(Clone, Debug)]
pub struct CompensatedTape<R> {
    program: Arc<CompensatedProgram>,
    memory: Memory<R>,
}

/// Registers with the parameters bound.
#[derive(Clone, Debug)]
enum Memory<R> {
    /// Of one member, at several points.
    Points(Vec<Compensated<Lanes<POINTS>>>),
    /// Of several members, at one point.
    Members(Vec<Compensated<R>>),
}

/// [`CompensatedTape`] for points that stand in [`PointRegisters`].
#[derive(Clone, Debug)]
pub struct CompensatedPoints<P> {
    program: Arc<CompensatedProgram>,
    registers: Vec<Compensated<P>>,
}

impl Tape {
    /// The part that makes the first so many outputs in compensated numbers; `None` where they take more than arithmetic,
    /// square roots and lookups.
    pub fn compensated(&self, outputs: usize) -> Option<CompensatedProgram> {
        if self.terms.is_some() {
            return None;
        }
        let outputs = self.outputs.start..self.outputs.start + outputs;
        let instrs = self.body.needed_for(&outputs);
        let is_known = |instr: &Instr| {
            instr.op == Op::Sqrt || exact(instr.op).is_some() || Cheap::of(instr.op).is_some()
        };
        if !instrs.iter().all(is_known) {
            return None;
        }
        Some(CompensatedProgram {
            instrs,
            columns: self.columns.clone(),
            argument: groups(&self.inputs).get(1)?.clone(),
            outputs,
        })
    }
}

impl CompensatedProgram {
    /// With the parameters of `bound`.
    pub fn bind<R: Real>(self: &Arc<Self>, Registers(bound): &Registers<R>) -> CompensatedTape<R> {
        let memory = match R::alone(bound) {
            Some(bound) => Memory::Points(all_exact(bound.iter().map(|x| Lanes::splat(*x)))),
            None => Memory::Members(all_exact(bound.iter().copied())),
        };
        CompensatedTape {
            program: self.clone(),
            memory,
        }
    }

    /// The same for points that stand in registers.
    pub fn bind_points<P: Real>(
        self: &Arc<Self>,
        bound: &PointRegisters<P>,
    ) -> CompensatedPoints<P> {
        CompensatedPoints {
            program: self.clone(),
            registers: all_exact(bound.first_point()),
        }
    }
}

fn all_exact<R: Real>(values: impl Iterator<Item = R>) -> Vec<Compensated<R>> {
    values.map(Compensated::exact).collect()
}

impl<R: Real> CompensatedTape<R> {
    /// Adds to values of members their rounding errors, `times` 1 or 0, at points that have the times of `time` and stand
    /// row by row in `high + low`. Errors that are not finite are not added.
    ///
    /// # Panics
    /// When the arguments are not of this tape's sizes.
    pub fn add_low(
        &mut self,
        time: impl Fn(usize) -> f64,
        [high, low]: [&[R]; 2],
        (values, times): (&mut [R], R),
    ) {
        if times.all(|times| times == 0.0) {
            return;
        }
        let program = &self.program;
        match &mut self.memory {
            Memory::Members(registers) => dispatch_simd::<R, _>(
                #[inline(always)]
                || program.add_of_members(registers, time, [high, low], (values, times)),
            ),
            Memory::Points(registers) => {
                let parts = (R::alone(high), R::alone(low), R::alone_mut(values));
                if let (Some(high), Some(low), Some(values)) = parts {
                    dispatch_fused(
                        #[inline(always)]
                        || program.add_at_points(registers, time, [high, low], values),
                    );
                }
            }
        }
    }
}

impl<P: Real> CompensatedPoints<P> {
    /// Adds to the values at the points from `first` on their rounding errors, `times` 1 or 0; each number of the second
    /// argument has a low part at each point.
    #[inline(never)]
    pub fn add_low(
        &mut self,
        first: usize,
        points: &mut PointRegisters<P>,
        times: P,
        low: impl Fn(usize, usize) -> P,
    ) {
        let Self { program, registers } = self;
        dispatch_simd::<P, _>(
            #[inline(always)]
            || {
                for i in first..points.points() {
                    registers[0] = Compensated::exact(points.argument(0)[i]);
                    for (q, place) in program.argument.clone().enumerate() {
                        let high = points.argument(place)[i];
                        registers[place] = Compensated {
                            high,
                            low: low(q, i),
                        };
                    }
                    program.run(registers);
                    for (c, result) in registers[program.outputs.clone()].iter().enumerate() {
                        let value = &mut points.value_mut(c)[i];
                        *value = P::each([*value, result.low, times], sum);
                    }
                }
            },
        );
    }
}

impl CompensatedProgram {
    #[inline(always)]
    fn add_of_members<R: Real>(
        &self,
        registers: &mut [Compensated<R>],
        time: impl Fn(usize) -> f64,
        points: [&[R]; 2],
        (values, times): (&mut [R], R),
    ) {
        let n = self.argument.len();
        for (i, values) in values.chunks_exact_mut(self.outputs.len()).enumerate() {
            let [high, low] = points.map(|part| &part[i * n..][..n]);
            registers[0] = Compensated::exact(R::splat(time(i)));
            let point = registers[self.argument.clone()].iter_mut();
            for (register, (high, low)) in point.zip(high.iter().zip(low)) {
                (register.high, register.low) = (*high, *low);
            }
            self.run(registers);
            for (value, result) in values.iter_mut().zip(&registers[self.outputs.clone()]) {
                *value = R::each([*value, result.low, times], sum);
            }
        }
    }

    #[inline(always)]
    fn add_at_points(
        &self,
        registers: &mut [Compensated<Lanes<POINTS>>],
        time: impl Fn(usize) -> f64,
        [high, low]: [&[f64]; 2],
        values: &mut [f64],
    ) {
        let (n, width) = (self.argument.len(), self.outputs.len());
        let points = values.len() / width;
        for first in (0..points).step_by(POINTS) {
            let count = POINTS.min(points - first);
            for lane in 0..count {
                let point = first + lane;
                registers[0].high.0[lane] = time(point);
                let rows = high[point * n..].iter().zip(&low[point * n..]);
                let argument = registers[self.argument.clone()].iter_mut();
                for (register, (high, low)) in argument.zip(rows) {
                    (register.high.0[lane], register.low.0[lane]) = (*high, *low);
                }
            }
            self.run(registers);
            let results = &registers[self.outputs.clone()];
            let rows = values[first * width..].chunks_exact_mut(width);
            for (lane, row) in rows.take(count).enumerate() {
                for (value, result) in row.iter_mut().zip(results) {
                    *value = sum([*value, result.low.0[lane], 1.0]);
                }
            }
        }
    }

    /// As long as the operation is the same, no jump has to be predicted.
    #[inline(always)]
    fn run<R: Real>(&self, registers: &mut [Compensated<R>]) {
        for same in self.instrs.chunk_by(|a, b| a.op == b.op) {
            macro_rules! each {
                (|$a:ident, $b:ident| $value:expr) => {
                    for instr in same {
                        let ($a, $b) = (registers[instr.a as usize], registers[instr.b as usize]);
                        registers[instr.out as usize] = $value;
                    }
                };
            }
            match Cheap::of(same[0].op) {
                Some(Cheap::Assign) => each!(|a, _b| a),
                Some(Cheap::Add) => each!(|a, b| a + b),
                Some(Cheap::Sub) => each!(|a, b| a - b),
                Some(Cheap::Mul) => each!(|a, b| a * b),
                Some(Cheap::Div) => each!(|a, b| a / b),
                Some(Cheap::Neg) => each!(|a, _b| -a),
                Some(Cheap::Sq) => each!(|a, _b| a * a),
                Some(Cheap::Twice) => each!(|a, _b| a + a),
                Some(Cheap::Inv) => each!(|a, _b| Compensated::exact(R::splat(1.0)) / a),
                None => match exact(same[0].op) {
                    None => each!(|a, _b| a.sqrt()),
                    Some(f) => each!(|a, b| Compensated::exact(a.high.zip(b.high, |x, y| f(
                        &self.columns,
                        x,
                        y
                    )))),
                },
            }
        }
    }
}

/// An operation on a value and the number of a column, or on two values.
type Exact = fn(&[Column], f64, f64) -> f64;

/// Operations of tables, whose values are exact. Neighbouring pieces have the same value where they meet: low parts do
/// not choose between them.
fn exact(op: Op) -> Option<Exact> {
    Some(match op {
        Op::Search => |columns, x, column| search(columns, column, x),
        Op::Entry => |columns, place, column| entry(columns, column, place),
        Op::Lt => |_, x, y| f64::from(u8::from(x < y)),
        Op::Floor => |_, x, _| x.floor(),
        _ => return None,
    })
}

/// The sum, or the value alone where the other is not finite or not wanted.
#[inline(always)]
fn sum([value, low, times]: [f64; 3]) -> f64 {
    if low.is_finite() & (times != 0.0) {
        value + low
    } else {
        value
    }
}
