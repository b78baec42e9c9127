//! Operations, and the loops that run them: one after another, or the same on many registers.
//!
//! Functions are those of the standard library, which are the C library's; only its inverse
//! hyperbolic functions are formulas of its own that lose digits, and come from `libm` instead.

use super::columns::{Column, entry, search};
use crate::real::{BATCH, Lanes, Real};
use crate::simd::dispatch_simd;

macro_rules! operations {
    ($($name:ident $text:literal $arity:literal,)*) => {
        /// An operation of the tape, with the meaning it has in C's `math.h`; those of tables are in `columns.rs`.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u32)]
        #[allow(missing_docs)]
        pub enum Op { $($name,)* }

        impl Op {
            /// Every operation, in the order of its code.
            pub const ALL: &'static [Op] = &[$(Op::$name,)*];

            /// Its name in the front end.
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
    Search "search" 2, Entry "entry" 2,
}

/// One instruction over registers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instr {
    pub(super) op: Op,
    pub(super) out: u32,
    pub(super) a: u32,
    pub(super) b: u32,
}

/// Costs of instructions in cheap ones: of those that run in lanes, and of those that run lane by lane.
pub(super) fn cost(instrs: &[Instr]) -> (usize, usize) {
    const CALL: usize = 10;
    instrs
        .iter()
        .fold((0, 0), |(cheap, dear), instr| match instr.op {
            Op::Sin | Op::Cos => (cheap + CALL, dear),
            Op::Sqrt | Op::Fabs | Op::IfElseZero | Op::Lt | Op::Le => (cheap + 1, dear),
            op if Cheap::of(op).is_some() => (cheap + 1, dear),
            _ => (cheap, dear + CALL),
        })
}

/// Runs instructions that `Tape::new` made over the registers it laid out. As long as the operation is
/// the same, no jump has to be predicted.
#[inline]
pub(super) fn execute<R: Real>(program: &[Instr], registers: &mut [R], columns: &[Column]) {
    if R::IS_SINGLE {
        run_alone(program, registers, columns);
    } else {
        run_wide(program, registers, columns);
    }
}

#[inline(never)]
fn run_alone<R: Real>(program: &[Instr], registers: &mut [R], columns: &[Column]) {
    run(program, registers, 1, columns);
}

#[inline(never)]
fn run_wide<R: Real>(program: &[Instr], registers: &mut [R], columns: &[Column]) {
    dispatch_simd::<R, _>(
        #[inline(always)]
        || run(program, registers, 1, columns),
    );
}

/// Runs instructions at several points, whose values of a register follow one another.
#[inline(never)]
pub(super) fn execute_points<R: Real>(
    program: &[Instr],
    registers: &mut [R],
    points: usize,
    columns: &[Column],
) {
    dispatch_simd::<R, _>(
        #[inline(always)]
        || run(program, registers, points, columns),
    );
}

#[allow(clippy::inline_always)] // a call would lack the instruction set
#[allow(unsafe_code)]
#[inline(always)]
fn run<R: Real>(program: &[Instr], registers: &mut [R], points: usize, columns: &[Column]) {
    let start = registers.as_mut_ptr();
    let truth = |condition: bool| f64::from(u8::from(condition));
    let mut left = program;
    while let Some((&next, mut rest)) = left.split_first() {
        let mut instr = next;
        macro_rules! two {
            (|$x:ident, $y:ident| $value:expr) => {
                loop {
                    // SAFETY: `Tape::new` gives out registers below `self.registers` only, and callers
                    // pass exactly that many at each point.
                    unsafe {
                        let [a, b, out] =
                            [instr.a, instr.b, instr.out].map(|x| start.add(x as usize * points));
                        for i in 0..points {
                            let ($x, $y) = (*a.add(i), *b.add(i));
                            *out.add(i) = $value;
                        }
                    }
                    match rest.split_first() {
                        Some((&next, after)) if next.op == instr.op => (instr, rest) = (next, after),
                        _ => break,
                    }
                }
            };
        }
        macro_rules! one {
            ($f:expr) => {
                two!(|x, _y| x.map($f))
            };
        }
        match instr.op {
            Op::Assign => two!(|x, _y| x),
            Op::Add => two!(|x, y| x + y),
            Op::Sub => two!(|x, y| x - y),
            Op::Mul => two!(|x, y| x * y),
            Op::Div => two!(|x, y| x / y),
            Op::Neg => two!(|x, _y| -x),
            Op::Sq => two!(|x, _y| x * x),
            Op::Twice => two!(|x, _y| x + x),
            Op::Inv => two!(|x, _y| R::splat(1.0) / x),
            Op::Sqrt => two!(|x, _y| x.map(f64::sqrt)),
            Op::Exp => one!(f64::exp),
            Op::Log => one!(f64::ln),
            Op::Pow | Op::Constpow => two!(|x, y| x.zip(y, f64::powf)),
            Op::Sin => two!(|x, _y| x.sin()),
            Op::Cos => two!(|x, _y| x.cos()),
            Op::Tan => one!(f64::tan),
            Op::Asin => one!(f64::asin),
            Op::Acos => one!(f64::acos),
            Op::Atan => one!(f64::atan),
            Op::Lt => two!(|x, y| x.zip(y, |a, b| truth(a < b))),
            Op::Le => two!(|x, y| x.zip(y, |a, b| truth(a <= b))),
            #[allow(clippy::float_cmp)] // the program compares numbers
            Op::Eq => two!(|x, y| x.zip(y, |a, b| truth(a == b))),
            #[allow(clippy::float_cmp)]
            Op::Ne => two!(|x, y| x.zip(y, |a, b| truth(a != b))),
            Op::Not => two!(|x, _y| x.map(|a| truth(a == 0.0))),
            Op::And => two!(|x, y| x.zip(y, |a, b| truth(a != 0.0 && b != 0.0))),
            Op::Or => two!(|x, y| x.zip(y, |a, b| truth(a != 0.0 || b != 0.0))),
            Op::Floor => one!(f64::floor),
            Op::Ceil => one!(f64::ceil),
            Op::Fmod => two!(|x, y| x.zip(y, |a, b| a % b)),
            Op::Fabs => one!(f64::abs),
            Op::Sign => one!(|a: f64| {
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
            Op::Sinh => one!(f64::sinh),
            Op::Cosh => one!(f64::cosh),
            Op::Tanh => one!(f64::tanh),
            Op::Asinh => one!(|x| apart(libm::asinh, x)),
            Op::Acosh => one!(|x| apart(libm::acosh, x)),
            Op::Atanh => one!(|x| apart(libm::atanh, x)),
            Op::Atan2 => two!(|x, y| x.zip(y, f64::atan2)),
            Op::Log1p => one!(f64::ln_1p),
            Op::Expm1 => one!(f64::exp_m1),
            Op::Hypot => two!(|x, y| x.zip(y, f64::hypot)),
            Op::Search => two!(|x, y| x.zip(y, |a, b| search(columns, b, a))),
            Op::Entry => two!(|x, y| x.zip(y, |a, b| entry(columns, b, a))),
        }
        left = rest;
    }
}

/// The operations that there are batches of: cheap enough for the loop around them to matter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cheap {
    Assign,
    Add,
    Sub,
    Mul,
    Div,
    Neg,
    Sq,
    Twice,
    Inv,
}

impl Cheap {
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub(super) fn of(op: Op) -> Option<Self> {
        Some(match op {
            Op::Assign => Self::Assign,
            Op::Add => Self::Add,
            Op::Sub => Self::Sub,
            Op::Mul => Self::Mul,
            Op::Div => Self::Div,
            Op::Neg => Self::Neg,
            Op::Sq => Self::Sq,
            Op::Twice => Self::Twice,
            Op::Inv => Self::Inv,
            _ => return None,
        })
    }
}

/// Instructions of one operation whose registers walk with constant strides: the first of them, how
/// far apart their registers are (out, a, b), and how many there are.
#[derive(Clone, Debug)]
pub(super) struct Strided {
    pub(super) op: Cheap,
    pub(super) first: Instr,
    pub(super) strides: [i32; 3],
    pub(super) count: usize,
}

impl Strided {
    /// The instructions one after another.
    #[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap)] // registers are numbered in 32 bits
    pub(super) fn instrs(&self) -> impl Iterator<Item = Instr> {
        let (first, [out, a, b]) = (self.first, self.strides);
        (0..self.count as i32).map(move |k| Instr {
            op: first.op,
            out: first.out.wrapping_add_signed(out * k),
            a: first.a.wrapping_add_signed(a * k),
            b: first.b.wrapping_add_signed(b * k),
        })
    }
}

/// Runs a batch, made by `Tape::new`, over the registers it laid out.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(super) fn execute_strided<R: Real>(batch: &Strided, registers: &mut [R]) {
    match batch.op {
        Cheap::Assign => walk(batch, registers, |x, _| x),
        Cheap::Add => walk(batch, registers, |x, y| x + y),
        Cheap::Sub => walk(batch, registers, |x, y| x - y),
        Cheap::Mul => walk(batch, registers, |x, y| x * y),
        Cheap::Div => walk(batch, registers, |x, y| x / y),
        Cheap::Neg => walk(batch, registers, |x, _| -x),
        Cheap::Sq => walk(batch, registers, |x, _| x * x),
        Cheap::Twice => walk(batch, registers, |x, _| x + x),
        Cheap::Inv => walk(batch, registers, |x, _| R::splat(1.0) / x),
    }
}

/// For single numbers all but the last are loops that the compiler turns into vector operations; an operation of lanes is
/// a vector already, and one loop is enough.
#[allow(clippy::inline_always)]
#[inline(always)]
#[allow(unsafe_code)]
#[allow(clippy::cast_possible_wrap)] // registers are numbered in 32 bits
fn walk<R: Real>(batch: &Strided, registers: &mut [R], f: impl Fn(R, R) -> R) {
    let (start, first) = (registers.as_mut_ptr(), batch.first);
    // SAFETY: as in `execute`, since a batch is made of instructions, and holds at least one.
    unsafe {
        let out = start.add(first.out as usize);
        let (a, b) = (start.add(first.a as usize), start.add(first.b as usize));
        match (batch.strides, R::IS_SINGLE) {
            ([1, 1, 1], true) => {
                for i in 0..batch.count {
                    *out.add(i) = f(*a.add(i), *b.add(i));
                }
            }
            ([1, 0, 1], true) => {
                let x = *a;
                for i in 0..batch.count {
                    *out.add(i) = f(x, *b.add(i));
                }
            }
            ([1, 1, 0], true) => {
                let y = *b;
                for i in 0..batch.count {
                    *out.add(i) = f(*a.add(i), y);
                }
            }
            ([1, 2, 2], true) => {
                for i in 0..batch.count {
                    *out.add(i) = f(*a.add(2 * i), *b.add(2 * i));
                }
            }
            ([2, 2, 1], true) => {
                for i in 0..batch.count {
                    *out.add(2 * i) = f(*a.add(2 * i), *b.add(i));
                }
            }
            ([2, 1, 0], true) => {
                let y = *b;
                for i in 0..batch.count {
                    *out.add(2 * i) = f(*a.add(i), y);
                }
            }
            (strides, _) => {
                let [to, from, and] = strides.map(|stride| stride as isize);
                for i in 0..batch.count as isize {
                    *out.offset(to * i) = f(*a.offset(from * i), *b.offset(and * i));
                }
            }
        }
    }
}

/// A call that is not inlined: its registers are not the loop's.
#[cold]
#[inline(never)]
fn apart(f: fn(f64) -> f64, x: f64) -> f64 {
    f(x)
}

crate::compiled!(R in [f64] { run_alone::<R> as fn(_, _, _) });
crate::compiled!(R in [Lanes, Lanes<BATCH>] { run_wide::<R> as fn(_, _, _), execute_points::<R> as fn(_, _, _, _) });
