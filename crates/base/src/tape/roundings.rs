//! How much roundoff may change the values of a tape: to first order, and at most.
//!
//! A value f(a, b) is known to |f(a ± δa, b) − f| + |f(a, b ± δb) − f| + ε |f|, where a and b are to δa and δb.
//! Source: higham2002, section 3.3.

use super::execute::{Instr, execute};
use super::{Registers, Tape, groups};

impl Tape {
    /// How much the roundings of all arguments, parameters and operations may change each output at `args`; those of
    /// terms are left out.
    ///
    /// # Panics
    /// When the arguments or the registers are not of this tape's sizes.
    pub fn roundings(&self, Registers(bound): &Registers<f64>, args: &[&[f64]]) -> Vec<f64> {
        assert_eq!(bound.len(), self.registers, "registers of another tape");
        assert_eq!(args.len() + 1, self.inputs.len(), "number of arguments");
        let mut values = bound.clone();
        for (arg, place) in args.iter().zip(groups(&self.inputs)) {
            values[place].copy_from_slice(arg);
        }
        let mut errors: Vec<f64> = values.iter().map(|x| f64::EPSILON * x.abs()).collect();
        let body = self.body.needed_for(&self.outputs);
        for instr in self.prologue.iter().chain(&body) {
            let (out, a, b) = (instr.out as usize, instr.a as usize, instr.b as usize);
            let of = |a: f64, b: f64| {
                let own = Instr {
                    out: 2,
                    a: 0,
                    b: 1,
                    ..*instr
                };
                let mut registers = [a, b, 0.0];
                execute(&[own], &mut registers, &self.columns);
                registers[2]
            };
            let ([x, y], [dx, dy]) = ([values[a], values[b]], [errors[a], errors[b]]);
            let value = of(x, y);
            // where a function ends, it is known on one side
            let by = |moved: [f64; 2]| {
                let changes = moved.map(|moved| (moved - value).abs());
                changes.into_iter().fold(0.0, f64::max)
            };
            let mut error = f64::EPSILON * value.abs() + by([of(x + dx, y), of(x - dx, y)]);
            if instr.op.arity() == 2 {
                error += by([of(x, y + dy), of(x, y - dy)]);
            }
            (values[out], errors[out]) = (value, error);
        }
        errors[self.outputs.clone()].to_vec()
    }
}
