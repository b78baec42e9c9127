//! Polynomials as short programs over two accumulators.
//!
//! The terms of a row are grouped by what they have in common but for one factor each,
//!
//!     R = Σ_groups (c_1 x_a + c_2 x_b + …) x_p x_q …,
//!
//! which costs one product a term and one for each common factor. Constant and linear terms are a
//! group without common factors.
#![allow(clippy::inline_always)] // the program is run by the loop around it

use crate::vector::Number;
use std::collections::HashMap;

/// What an instruction does with the running bracket and the running sum.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Op {
    /// bracket = factor
    Constant,
    /// bracket = factor x
    Start,
    /// bracket = x
    StartPlain,
    /// bracket += factor x
    Add,
    /// bracket += x
    AddPlain,
    /// bracket -= x
    Subtract,
    /// bracket *= x
    Times,
    /// sum = bracket
    Put,
    /// sum = bracket x
    PutTimes,
    /// sum += bracket x
    SumTimes,
}

/// An instruction, and where its variable is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Code {
    factor: f64,
    place: u32,
    op: Op,
}

/// Where a program reads its variables.
pub(super) trait Source {
    /// What it computes with.
    type Number: Number;

    /// Reads a variable.
    fn load(&self, place: u32) -> Self::Number;
}

/// Runs a program.
#[inline(always)]
pub(super) fn evaluate<X: Source>(program: &[Code], zero: X::Number, x: &X) -> X::Number {
    let (mut bracket, mut sum) = (zero, zero);
    for code in program {
        match code.op {
            Op::Constant => bracket = zero.like(code.factor),
            Op::Start => bracket = x.load(code.place).scaled(code.factor),
            Op::StartPlain => bracket = x.load(code.place),
            Op::Add => bracket = bracket + x.load(code.place).scaled(code.factor),
            Op::AddPlain => bracket = bracket + x.load(code.place),
            Op::Subtract => bracket = bracket - x.load(code.place),
            Op::Times => bracket = bracket * x.load(code.place),
            Op::Put => sum = bracket,
            Op::PutTimes => sum = bracket * x.load(code.place),
            Op::SumTimes => sum = sum + bracket * x.load(code.place),
        }
    }
    sum
}

/// A term of a row: coefficient, and the places of its factors, ascending.
pub(super) type Term = (f64, Vec<u32>);

/// Appends the program of a row.
pub(super) fn compile(terms: &[Term], program: &mut Vec<Code>) {
    let mut writer = Writer {
        program,
        is_first: true,
    };
    let constant: f64 = terms
        .iter()
        .filter(|(_, factors)| factors.is_empty())
        .map(|(coefficient, _)| coefficient)
        .sum();
    let linear = terms.iter().filter(|(_, factors)| factors.len() == 1);
    let mut bracket: Vec<(f64, u32)> = linear.map(|(c, factors)| (*c, factors[0])).collect();
    bracket.sort_by_key(|(_, place)| *place);
    if constant != 0.0 || !bracket.is_empty() {
        writer.group(constant, &bracket, &[]);
    }
    for (common, bracket) in groups(terms) {
        writer.group(0.0, &bracket, &common);
    }
    if writer.is_first {
        writer.group(0.0, &[], &[]);
    }
}

struct Writer<'a> {
    program: &'a mut Vec<Code>,
    is_first: bool,
}

impl Writer<'_> {
    fn push(&mut self, op: Op, factor: f64, place: u32) {
        self.program.push(Code { factor, place, op });
    }

    #[allow(clippy::float_cmp)] // factors of exactly one need no product
    fn group(&mut self, constant: f64, bracket: &[(f64, u32)], common: &[u32]) {
        let mut is_empty = constant == 0.0 && !bracket.is_empty();
        if !is_empty {
            self.push(Op::Constant, constant, 0);
        }
        for &(factor, place) in bracket {
            let op = match (is_empty, factor) {
                (true, 1.0) => Op::StartPlain,
                (true, _) => Op::Start,
                (false, 1.0) => Op::AddPlain,
                (false, -1.0) => Op::Subtract,
                (false, _) => Op::Add,
            };
            self.push(op, factor, place);
            is_empty = false;
        }
        match common.split_last() {
            None => self.push(Op::Put, 0.0, 0),
            Some((&last, others)) => {
                for &place in others {
                    self.push(Op::Times, 0.0, place);
                }
                let op = if self.is_first {
                    Op::PutTimes
                } else {
                    Op::SumTimes
                };
                self.push(op, 0.0, last);
            }
        }
        self.is_first = false;
    }
}

/// Terms with the same common factors.
type Group = (Vec<u32>, Vec<(f64, u32)>);

/// Terms of degree 2 and more by common factors; those that serve most terms first.
fn groups(terms: &[Term]) -> Vec<Group> {
    let terms: Vec<&Term> = terms.iter().filter(|(_, f)| f.len() > 1).collect();
    let mut served: Vec<Candidate> = Vec::new();
    let mut index: HashMap<Vec<u32>, usize> = HashMap::new();
    let mut of_term: Vec<Vec<usize>> = Vec::with_capacity(terms.len());
    for (k, (_, factors)) in terms.iter().enumerate() {
        let mut mine = Vec::with_capacity(factors.len());
        for out in 0..factors.len() {
            if out > 0 && factors[out] == factors[out - 1] {
                continue;
            }
            let mut common = factors.clone();
            let last = common.remove(out);
            let at = *index.entry(common.clone()).or_insert_with(|| {
                let terms = Vec::new();
                let left = 0;
                served.push(Candidate {
                    common,
                    terms,
                    left,
                });
                served.len() - 1
            });
            served[at].terms.push((last, k));
            served[at].left += 1;
            mine.push(at);
        }
        of_term.push(mine);
    }
    let mut is_taken = vec![false; terms.len()];
    let mut groups = Vec::new();
    while let Some(best) = served
        .iter()
        .filter(|candidate| candidate.left > 0)
        .max_by(|a, b| a.left.cmp(&b.left).then_with(|| b.common.cmp(&a.common)))
    {
        let mut mine = best.terms.clone();
        mine.retain(|(_, k)| !is_taken[*k]);
        mine.sort_unstable();
        let bracket = mine.iter().map(|(last, k)| (terms[*k].0, *last));
        groups.push((best.common.clone(), bracket.collect()));
        for (_, k) in mine {
            is_taken[k] = true;
            for &at in &of_term[k] {
                served[at].left -= 1;
            }
        }
    }
    groups
}

/// Common factors that could be taken out of some terms.
struct Candidate {
    common: Vec<u32>,
    /// The other factor and the number of each term.
    terms: Vec<(u32, usize)>,
    /// How many of them are in no group yet.
    left: usize,
}
