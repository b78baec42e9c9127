//! Several points side by side, in lanes: each has the bits it has alone.
#![allow(clippy::inline_always)] // a call would lack the instruction set

use super::execute::cost;
use super::{Program, Registers, Tape};
use crate::real::{Lanes, Real, Scalar, WIDTH};

/// Cost of a pass beside its instructions and moves, in cheap instructions.
const PASS: usize = 12;

/// Memory for the evaluation of a tape at several points of one trajectory, and its values there.
#[derive(Clone, Debug)]
pub struct BatchRegisters<R> {
    registers: Registers<Lanes>,
    times: Vec<R>,
    /// The values of one point after another.
    values: Vec<R>,
}

impl<R> BatchRegisters<R> {
    /// The values at one point, of which there are `width`.
    #[inline(always)]
    pub fn at(&self, point: usize, width: usize) -> &[R] {
        &self.values[point * width..][..width]
    }
}

impl Tape {
    /// Memory for evaluations at so many points with the parameters of `one`; `None` where one point after another
    /// is no slower, or where there are several members already.
    pub fn batch<R: Real>(&self, one: &Registers<R>, points: usize) -> Option<BatchRegisters<R>> {
        let one = R::alone(&one.0)?;
        let Program::Plain(instrs) = &self.body else {
            return None;
        };
        let (in_lanes, singly) = cost(instrs);
        let passes = points.div_ceil(WIDTH);
        let moves = points * self.outputs.end;
        let batch = passes * (PASS + in_lanes + WIDTH * singly) + moves;
        let is_faster = batch < points * (in_lanes + singly);
        if self.terms.is_some() || !is_faster {
            return None;
        }
        let first = self.outputs.start - self.inputs.last()?;
        let params = one[first..self.outputs.start].iter().copied();
        let params: Vec<Lanes> = params.map(Lanes::splat).collect();
        Some(BatchRegisters {
            registers: self.bind(&params),
            times: vec![R::splat(0.0); points],
            values: vec![R::splat(0.0); points * self.outputs()],
        })
    }

    /// Evaluates the tape at the points whose times are those of `time` and whose further arguments stand row by
    /// row in `args`.
    ///
    /// # Panics
    /// When the arguments or the memory are not of this tape's sizes.
    pub fn eval_batch<R: Real>(
        &self,
        batch: &mut BatchRegisters<R>,
        time: impl Fn(usize) -> f64,
        [a, b]: [&[R]; 2],
    ) {
        for (i, t) in batch.times.iter_mut().enumerate() {
            *t = R::splat(time(i));
        }
        let points = batch.times.len();
        let arguments = (R::alone(&batch.times), R::alone(a), R::alone(b));
        let values = R::alone_mut(&mut batch.values);
        if let ((Some(t), Some(a), Some(b)), Some(values)) = (arguments, values) {
            self.eval_rows(&mut batch.registers, &[t, a, b], points, values);
        }
    }

    /// Evaluates the tape at `k` points, eight at a time.
    ///
    /// Each argument holds `k` rows of its group's size; the result holds `k` rows of outputs.
    ///
    /// # Panics
    /// When an argument has not `k` rows.
    pub fn map(&self, params: &[f64], args: &[&[f64]], k: usize) -> Vec<f64> {
        let mut result = vec![0.0; k * self.outputs()];
        let params: Vec<Lanes> = params.iter().map(|p| Lanes::splat(*p)).collect();
        self.eval_rows(&mut self.bind(&params), args, k, &mut result);
        result
    }

    fn eval_rows(
        &self,
        Registers(registers): &mut Registers<Lanes>,
        args: &[&[f64]],
        points: usize,
        values: &mut [f64],
    ) {
        assert!(args.len() + 1 == self.inputs.len(), "number of arguments");
        for (arg, size) in args.iter().zip(&self.inputs) {
            assert!(arg.len() == points * size, "size of an argument");
        }
        let width = self.outputs();
        for first in (0..points).step_by(WIDTH) {
            // the last pass repeats its last point
            let at: [usize; WIDTH] = std::array::from_fn(|lane| (first + lane).min(points - 1));
            let mut start = 0;
            for (arg, &size) in args.iter().zip(&self.inputs) {
                for (element, register) in registers[start..start + size].iter_mut().enumerate() {
                    *register = Lanes(at.map(|point| arg[point * size + element]));
                }
                start += size;
            }
            self.body.run(registers, &self.columns);
            if let Some(terms) = &self.terms {
                self.add_terms(terms, registers);
            }
            let results = &registers[self.outputs.clone()];
            let rows = values[first * width..].chunks_mut(width.max(1));
            for (lane, row) in rows.take(WIDTH).enumerate() {
                for (value, result) in row.iter_mut().zip(results) {
                    *value = result.0[lane];
                }
            }
        }
    }
}
