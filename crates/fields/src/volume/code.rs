//! Polynomials as short programs over two accumulators.
//!
//! The terms of a row are grouped by their common factors, all but one of each,
//!
//!     R = Σ_groups (c_1 x_a + c_2 x_b + …) x_p x_q …,
//!
//! which costs one product a term and one for each common factor. Constant and linear terms are a
//! group without common factors.
#![allow(clippy::inline_always)] // the program runs in the loop around it

use liouville_base::simd::Number;
use std::collections::HashMap;

/// The effect of an instruction on the running bracket and the running sum; x is its variable, y another.
#[derive(Clone, Copy, Debug, PartialEq)]
enum CodeOp {
    /// sum = factor
    Constant,
    /// sum = factor x
    Only,
    /// sum = x
    OnlyPlain,
    /// sum += factor x
    Linear,
    /// sum += x
    LinearPlain,
    /// sum -= x
    LinearMinus,
    /// sum += factor x y
    Product,
    /// sum += x y
    ProductPlain,
    /// sum -= x y
    ProductMinus,
    /// bracket = factor x
    Start,
    /// bracket = x
    StartPlain,
    /// bracket += factor x
    Add,
    /// bracket *= x
    Times,
    /// sum += bracket x
    Close,
    /// sum += (bracket + factor x) y
    AddClose,
    /// sum += (bracket + x) y
    AddPlainClose,
    /// sum += (bracket - x) y
    SubtractClose,
}

/// An instruction, and where its variables are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Code {
    factor: f64,
    x: u32,
    y: u32,
    op: CodeOp,
}

/// The variables that a program reads.
pub(super) trait Variables {
    /// The type in registers.
    type Number: Number;

    /// Reads a variable.
    fn load(&self, place: u32) -> Self::Number;
}

/// Runs a program.
#[inline(always)]
pub(super) fn evaluate<X: Variables>(program: &[Code], zero: X::Number, from: &X) -> X::Number {
    let (mut bracket, mut sum) = (zero, zero);
    for code in program {
        let Code { factor, x, y, op } = *code;
        match op {
            CodeOp::Constant => sum = zero.like(factor),
            CodeOp::Only => sum = from.load(x).scaled(factor),
            CodeOp::OnlyPlain => sum = from.load(x),
            CodeOp::Linear => sum = sum + from.load(x).scaled(factor),
            CodeOp::LinearPlain => sum = sum + from.load(x),
            CodeOp::LinearMinus => sum = sum - from.load(x),
            CodeOp::Product => sum = sum + from.load(x).scaled(factor) * from.load(y),
            CodeOp::ProductPlain => sum = sum + from.load(x) * from.load(y),
            CodeOp::ProductMinus => sum = sum - from.load(x) * from.load(y),
            CodeOp::Start => bracket = from.load(x).scaled(factor),
            CodeOp::StartPlain => bracket = from.load(x),
            CodeOp::Add => bracket = bracket + from.load(x).scaled(factor),
            CodeOp::Times => bracket = bracket * from.load(x),
            CodeOp::Close => sum = sum + bracket * from.load(x),
            CodeOp::AddClose => sum = sum + (bracket + from.load(x).scaled(factor)) * from.load(y),
            CodeOp::AddPlainClose => sum = sum + (bracket + from.load(x)) * from.load(y),
            CodeOp::SubtractClose => sum = sum + (bracket - from.load(x)) * from.load(y),
        }
    }
    sum
}

/// A term of a row: coefficient, and the places of its factors, ascending.
pub(super) type RowTerm = (f64, Vec<u32>);

/// Appends the program of a row.
pub(super) fn compile(terms: &[RowTerm], program: &mut Vec<Code>) {
    let start = program.len();
    let mut push = |op, factor, x, y| program.push(Code { factor, x, y, op });
    let (constant, linear, groups) = in_groups(terms);
    let mut is_first = constant == 0.0;
    if !is_first {
        push(CodeOp::Constant, constant, 0, 0);
    }
    for (x, factor) in linear {
        let op = match (is_first, factor) {
            (true, 1.0) => CodeOp::OnlyPlain,
            (true, _) => CodeOp::Only,
            (false, 1.0) => CodeOp::LinearPlain,
            (false, -1.0) => CodeOp::LinearMinus,
            (false, _) => CodeOp::Linear,
        };
        push(op, factor, x, 0);
        is_first = false;
    }
    for (common, bracket) in groups {
        write_group(&bracket, &common, &mut push);
    }
    if program.len() == start {
        program.push(Code {
            factor: 0.0,
            x: 0,
            y: 0,
            op: CodeOp::Constant,
        });
    }
}

/// The constant, the linear terms by place, and the other terms in groups: the order in which they are added.
pub(super) fn in_groups(terms: &[RowTerm]) -> (f64, Vec<(u32, f64)>, Vec<Group>) {
    let constants = terms.iter().filter(|(_, factors)| factors.is_empty());
    let constant = constants.map(|(coefficient, _)| coefficient).sum();
    let linear = terms.iter().filter(|(_, factors)| factors.len() == 1);
    let mut linear: Vec<(u32, f64)> = linear.map(|(c, factors)| (factors[0], *c)).collect();
    linear.sort_by_key(|(x, _)| *x);
    (constant, linear, groups(terms))
}

/// A bracket times the common factors of its terms, at least one.
#[allow(clippy::float_cmp)] // factors of exactly one need no product
fn write_group(
    bracket: &[(f64, u32)],
    common: &[u32],
    push: &mut impl FnMut(CodeOp, f64, u32, u32),
) {
    let [(first, x), others @ ..] = bracket else {
        return;
    };
    let (Some((&y, others_in_common)), Some((last, between))) =
        (common.split_last(), others.split_last())
    else {
        return write_product((*first, *x), common, push);
    };
    if *first == 1.0 {
        push(CodeOp::StartPlain, 1.0, *x, 0);
    } else {
        push(CodeOp::Start, *first, *x, 0);
    }
    for (factor, x) in between {
        push(CodeOp::Add, *factor, *x, 0);
    }
    if others_in_common.is_empty() {
        let op = match last.0 {
            1.0 => CodeOp::AddPlainClose,
            -1.0 => CodeOp::SubtractClose,
            _ => CodeOp::AddClose,
        };
        return push(op, last.0, last.1, y);
    }
    push(CodeOp::Add, last.0, last.1, 0);
    for &x in others_in_common {
        push(CodeOp::Times, 1.0, x, 0);
    }
    push(CodeOp::Close, 1.0, y, 0);
}

/// A single term of degree 2 or more.
#[allow(clippy::float_cmp)]
fn write_product(
    (factor, x): (f64, u32),
    common: &[u32],
    push: &mut impl FnMut(CodeOp, f64, u32, u32),
) {
    let Some((&last, others)) = common.split_last() else {
        return;
    };
    if others.is_empty() {
        let op = match factor {
            1.0 => CodeOp::ProductPlain,
            -1.0 => CodeOp::ProductMinus,
            _ => CodeOp::Product,
        };
        return push(op, factor, x, last);
    }
    push(CodeOp::Start, factor, x, 0);
    for &x in others {
        push(CodeOp::Times, 1.0, x, 0);
    }
    push(CodeOp::Close, 1.0, last, 0);
}

/// Common factors, and the terms that have them: coefficients and the other factor.
pub(super) type Group = (Vec<u32>, Vec<(f64, u32)>);

/// Terms of degree 2 and more by common factors, those of most terms first.
fn groups(terms: &[RowTerm]) -> Vec<Group> {
    let terms: Vec<&RowTerm> = terms.iter().filter(|(_, f)| f.len() > 1).collect();
    let mut candidates: Vec<Candidate> = Vec::new();
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
                candidates.push(Candidate {
                    common,
                    terms,
                    left,
                });
                candidates.len() - 1
            });
            candidates[at].terms.push((last, k));
            candidates[at].left += 1;
            mine.push(at);
        }
        of_term.push(mine);
    }
    let mut is_taken = vec![false; terms.len()];
    let mut groups = Vec::new();
    while let Some(best) = candidates
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
                candidates[at].left -= 1;
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
    /// The number of them in no group yet.
    left: usize,
}
