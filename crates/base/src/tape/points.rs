//! A tape at several points at once, in registers of its own: arguments are written to where it reads them.
#![allow(clippy::inline_always)] // a call would lack the instruction set

use super::execute::{Instr, execute, execute_points};
use super::{Program, Registers, Tape};
use crate::real::Real;

/// The values of each register at several points, one point after another.
#[derive(Clone, Debug)]
pub struct PointRegisters<R> {
    registers: Vec<R>,
    points: usize,
    first_output: usize,
}

impl<R: Real> PointRegisters<R> {
    /// One argument, counted through all groups, at all points.
    #[inline(always)]
    pub fn argument(&mut self, place: usize) -> &mut [R] {
        &mut self.registers[place * self.points..][..self.points]
    }

    /// One value at all points.
    #[inline(always)]
    pub fn value(&self, place: usize) -> &[R] {
        &self.registers[(self.first_output + place) * self.points..][..self.points]
    }

    /// The same, to be changed.
    #[inline(always)]
    pub fn value_mut(&mut self, place: usize) -> &mut [R] {
        &mut self.registers[(self.first_output + place) * self.points..][..self.points]
    }

    /// How many points there are.
    #[inline(always)]
    pub fn points(&self) -> usize {
        self.points
    }

    /// The values of the registers at the first point.
    pub(super) fn first_point(&self) -> impl Iterator<Item = R> {
        self.registers.iter().copied().step_by(self.points)
    }
}

impl Tape {
    /// Memory for evaluations at so many points with the parameters of `one`, each number of which becomes one at a
    /// point; `None` where the tape is a large one, with batches or terms.
    pub fn at_points<R: Real, P: Real>(
        &self,
        Registers(one): &Registers<R>,
        points: usize,
        number: impl Fn(R) -> P,
    ) -> Option<PointRegisters<P>> {
        self.plain()?;
        // asked for at once: aligned memory that grows is moved each time
        let registers = if points == 1 {
            one.iter().map(|x| number(*x)).collect()
        } else {
            let mut registers = Vec::with_capacity(one.len() * points);
            for x in one {
                registers.extend(std::iter::repeat_n(number(*x), points));
            }
            registers
        };
        Some(PointRegisters {
            registers,
            points,
            first_output: self.outputs.start,
        })
    }

    /// Evaluates the tape at all points, whose arguments have been written.
    ///
    /// # Panics
    /// When the registers are not of this tape's sizes.
    #[inline(always)]
    pub fn run_points<R: Real>(&self, registers: &mut PointRegisters<R>) {
        let PointRegisters {
            registers, points, ..
        } = registers;
        assert!(
            registers.len() == self.registers * *points,
            "registers of another tape"
        );
        match self.plain() {
            Some(instrs) if *points == 1 => execute(instrs, registers, &self.columns),
            Some(instrs) => execute_points(instrs, registers, *points, &self.columns),
            None => {}
        }
    }

    fn plain(&self) -> Option<&[Instr]> {
        match &self.body {
            Program::Plain(instrs) if self.terms.is_none() => Some(instrs),
            _ => None,
        }
    }
}
