//! Operations, and the loop that runs them.
//!
//! Functions are those of the standard library, which are the C library's; only its inverse
//! hyperbolic functions are formulas of its own that lose digits, and come from `libm` instead.

use crate::real::Real;
use crate::vector::wide;

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

/// One instruction over registers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instr {
    pub(super) op: Op,
    pub(super) out: u32,
    pub(super) a: u32,
    pub(super) b: u32,
}

/// Runs a program that [`Tape::new`] made, over the registers it laid out.
#[inline]
pub(super) fn execute<R: Real>(program: &[Instr], registers: &mut [R]) {
    if R::MEMBERS == 1 {
        run(program, registers);
    } else {
        run_wide(program, registers);
    }
}

#[inline(never)]
fn run_wide<R: Real>(program: &[Instr], registers: &mut [R]) {
    wide::<R, _>(
        #[inline(always)]
        || run(program, registers),
    );
}

#[allow(clippy::inline_always)] // what is not inlined is compiled without the instructions it is for
#[allow(unsafe_code)]
#[inline(always)]
fn run<R: Real>(program: &[Instr], registers: &mut [R]) {
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
            #[allow(clippy::float_cmp)] // it is what the program asks for
            Op::Eq => two!(|x, y| x.zip(y, |a, b| truth(a == b))),
            #[allow(clippy::float_cmp)]
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
            Op::Asinh => one(|x| apart(libm::asinh, x)),
            Op::Acosh => one(|x| apart(libm::acosh, x)),
            Op::Atanh => one(|x| apart(libm::atanh, x)),
            Op::Atan2 => two!(|x, y| x.zip(y, f64::atan2)),
            Op::Log1p => one(f64::ln_1p),
            Op::Expm1 => one(f64::exp_m1),
            Op::Hypot => two!(|x, y| x.zip(y, f64::hypot)),
        }
    }
}

/// A call that is not inlined: its registers are not the loop's.
#[cold]
#[inline(never)]
fn apart(f: fn(f64) -> f64, x: f64) -> f64 {
    f(x)
}
