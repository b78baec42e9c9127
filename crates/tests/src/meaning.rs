//! What the operations of a tape mean.

use liouville_base::elementary;
use liouville_base::tape::Op;

/// The operations of numbers alone: those of a column are the last two.
pub fn of_numbers() -> &'static [Op] {
    &Op::ALL[..Op::ALL.len() - 2]
}

/// What C's `math.h` and operators say; the standard library's own inverse hyperbolic functions do not. Sines and
/// cosines are ours.
pub fn meaning(op: Op, a: f64, b: f64) -> f64 {
    let truth = |condition| if condition { 1.0 } else { 0.0 };
    match op {
        Op::Add => a + b,
        Op::Sub => a - b,
        Op::Mul => a * b,
        Op::Div => a / b,
        Op::Neg => -a,
        Op::Exp => a.exp(),
        Op::Log => a.ln(),
        Op::Pow | Op::Constpow => a.powf(b),
        Op::Sqrt => a.sqrt(),
        Op::Sq => a * a,
        Op::Twice => 2.0 * a,
        Op::Sin => elementary::sin(a),
        Op::Cos => elementary::cos(a),
        Op::Tan => a.tan(),
        Op::Asin => a.asin(),
        Op::Acos => a.acos(),
        Op::Atan => a.atan(),
        Op::Lt => truth(a < b),
        Op::Le => truth(a <= b),
        #[allow(clippy::float_cmp)] // C's ==
        Op::Eq => truth(a == b),
        #[allow(clippy::float_cmp)] // C's !=
        Op::Ne => truth(a != b),
        Op::Not => truth(a == 0.0),
        Op::And => truth(a != 0.0 && b != 0.0),
        Op::Or => truth(a != 0.0 || b != 0.0),
        Op::Floor => a.floor(),
        Op::Ceil => a.ceil(),
        Op::Fmod => a % b,
        Op::Fabs => a.abs(),
        Op::Sign if a > 0.0 => 1.0,
        Op::Sign if a < 0.0 => -1.0,
        Op::Assign | Op::Sign => a,
        Op::Copysign => a.copysign(b),
        Op::IfElseZero if a == 0.0 => 0.0,
        Op::IfElseZero => b,
        Op::Fmin => a.min(b),
        Op::Fmax => a.max(b),
        Op::Inv => 1.0 / a,
        Op::Sinh => a.sinh(),
        Op::Cosh => a.cosh(),
        Op::Tanh => a.tanh(),
        Op::Asinh => libm::asinh(a),
        Op::Acosh => libm::acosh(a),
        Op::Atanh => libm::atanh(a),
        Op::Atan2 => a.atan2(b),
        Op::Log1p => a.ln_1p(),
        Op::Expm1 => a.exp_m1(),
        Op::Hypot => a.hypot(b),
        Op::Search | Op::Entry => panic!("an operation of a column"),
    }
}
