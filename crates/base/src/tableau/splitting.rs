//! Splittings of T + V: kicks e^{−i b h V} and drifts e^{−i a h T} in turn, kicks at both ends,
//!
//!     b_1 a_1 b_2 a_2 .. a_2 b_2 a_1 b_1,    Σ a = Σ b = 1
//!
//! A kick takes V at the time Σ a of the drifts before it, so that a splitting keeps its order where V depends
//! on time. Any composition is one; those of Runge–Kutta–Nyström type have fewer conditions to satisfy because
//! T is quadratic in the momenta, [V, [V, [V, T]]] = 0. Source: blanes2002.
//!
//! Their conditions are those on ln Π e^{bB} e^{aA}, a series of commutators in which those that contain
//! [B, [B, [B, A]]] are left out. Its coefficients of the words
//!
//!     AAB, ABB (order 4)    AAAAB, AAABB, AABAB, 3 AABBB + ABABB (order 6)
//!
//! vanish. The numbers in print, 15 digits, leave residuals up to 1e-16; the last ones here, of 40 digits, were
//! refined by Newton's method while the free ones stay as they are in print.

use super::Scheme;
use super::composition::parse;
use twofloat::TwoFloat;

/// A flow of a splitting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Whether it is a kick, by V.
    pub is_kick: bool,
    /// How much of the step it takes.
    pub weight: f64,
    /// How much of the step the drifts before it have taken.
    pub offset: f64,
}

/// A splitting of Runge–Kutta–Nyström type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Nystrom {
    /// What it is called.
    pub name: &'static str,
    /// Its order.
    pub order: usize,
    /// Key of the reference.
    pub source: &'static str,
    /// b_1, b_2 .. up to the middle, without the last one, which the sum gives.
    pub kicks: &'static [&'static str],
    /// a_1, a_2 .., likewise.
    pub drifts: &'static [&'static str],
}

static NYSTROM: [Nystrom; 2] = [
    Nystrom {
        name: "RKN4s6",
        order: 4,
        source: "blanes2002",
        kicks: &[
            "0.0829844064174052",
            "0.396309801498368",
            "-0.03905630492234584477961967727001231562165",
        ],
        drifts: &[
            "0.245298957184271",
            "0.604872665711094423109328512782106074715",
        ],
    },
    Nystrom {
        name: "RKN6s11",
        order: 6,
        source: "blanes2002",
        kicks: &[
            "0.0414649985182624",
            "0.198128671918067",
            "-0.04000619210415606662552682415961207725314",
            "0.07525398430157888074055150762794006467377",
            "-0.01151138742068577749105479620161825679187",
        ],
        drifts: &[
            "0.123229775946271",
            "0.290553797799558",
            "-0.127049212625416245041320623715583393208",
            "-0.2463317610620912798276586187719322095401",
            "0.3572088727959466753967943714348619007237",
        ],
    },
];

impl Nystrom {
    /// All of them, orders ascending.
    pub fn all() -> &'static [Self] {
        &NYSTROM
    }

    /// Kicks and drifts in turn, first to last.
    fn weights(&self) -> Vec<f64> {
        let one = TwoFloat::from(1.0);
        let [kicks, drifts] = [self.kicks, self.drifts].map(|digits| {
            let given: Vec<TwoFloat> = digits.iter().map(|digits| parse(digits)).collect();
            let sum = given.iter().fold(TwoFloat::from(0.0), |sum, x| sum + *x);
            (given, one - sum * 2.0)
        });
        // of the two that the sums give one is in the middle, the other stands beside it twice
        let is_middle_kick = kicks.0.len() > drifts.0.len();
        let mut half = Vec::new();
        for (k, kick) in kicks.0.iter().enumerate() {
            half.push(*kick);
            half.extend(drifts.0.get(k));
        }
        let (beside, middle) = if is_middle_kick {
            (drifts.1, kicks.1)
        } else {
            (kicks.1, drifts.1)
        };
        half.push(beside / 2.0);
        let half: Vec<f64> = half.iter().map(|x| f64::from(*x)).collect();
        let back = half.iter().rev().copied();
        let middle = std::iter::once(f64::from(middle));
        half.iter().copied().chain(middle).chain(back).collect()
    }
}

/// The flows of a step of the splitting of this name, or of the composition, kicks at both ends but for "Lie".
pub fn split_program(name: &str) -> Option<Vec<Turn>> {
    let weights = match Nystrom::all()
        .iter()
        .find(|splitting| splitting.name == name)
    {
        Some(splitting) => splitting.weights(),
        None => composed(Scheme::named(name)?),
    };
    let mut offset = 0.0;
    let turns = weights.iter().enumerate().map(|(k, &weight)| {
        let is_kick = k.is_multiple_of(2);
        let turn = Turn {
            is_kick,
            weight,
            offset,
        };
        offset += if is_kick { 0.0 } else { weight };
        turn
    });
    Some(turns.collect())
}

/// Kicks and drifts in turn: where a map and an adjoint meet, they meet in the same flow.
fn composed(scheme: &Scheme) -> Vec<f64> {
    let flows = scheme.flows();
    let mut weights = vec![0.0; flows.len() + 1];
    for (k, (_, alpha)) in flows.iter().enumerate() {
        weights[k] += alpha;
        weights[k + 1] += alpha;
    }
    weights
}
