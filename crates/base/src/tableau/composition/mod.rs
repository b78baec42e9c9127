//! Compositions of a step with itself: with Φ a basic step and Φ* its adjoint,
//!
//!     Φ_{α_s h} ∘ Φ*_{α_{s−1} h} ∘ … ∘ Φ_{α_2 h} ∘ Φ*_{α_1 h},    Σ α_k = 1
//!
//! (or beginning with Φ), the first map on the right. Two kinds of numbers define the α:
//!
//!     symmetric   γ_1 .. γ_m .. γ_1 of a symmetric S_h = Φ_{h/2} ∘ Φ*_{h/2}:  each stage is α = γ/2, γ/2
//!     adjoint     a_1 b_1 a_2 b_2 .. a_2 b_1 a_1 (those of a two-part splitting), its middle given by
//!                 Σ a = Σ b = 1:  α_1 = a_1,  α_{k+1} = (coefficient k+1) − α_k,  Φ first
//!
//! Both lists are palindromes and given by one half. They are evaluated in double-double arithmetic and
//! rounded once. Source: hairer2006, II.4, II.5 and V.3; mclachlan1995; the numbers' own sources stand by them.

mod schemes;

use schemes::SCHEMES;
use twofloat::TwoFloat;

/// The numbers that define a scheme, as decimal digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weights {
    /// The basic step itself.
    Basic,
    /// Stages of a symmetric step, up to the middle one.
    Symmetric {
        /// γ_1 .. γ_m
        gammas: &'static [&'static str],
    },
    /// Coefficients of a two-part splitting, without the middle one.
    Adjoint {
        /// a_1, a_2 ..
        a: &'static [&'static str],
        /// b_1, b_2 ..
        b: &'static [&'static str],
    },
}

/// A composition of a step with itself; see the module for the letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scheme {
    /// Its name.
    pub name: &'static str,
    /// Its order, whatever is composed.
    pub order: usize,
    /// Key of the reference.
    pub source: &'static str,
    /// Its numbers.
    pub weights: Weights,
}

impl Scheme {
    /// All schemes, orders ascending.
    pub fn all() -> &'static [Self] {
        &SCHEMES
    }

    /// The scheme of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        SCHEMES.iter().find(|scheme| scheme.name == name)
    }

    /// The maps of a step, first to last: whether it is Φ*, and its fraction α of the step.
    pub fn flows(&self) -> Vec<(bool, f64)> {
        let (begins_adjoint, alphas) = match self.weights {
            Weights::Basic => (false, vec![1.0]),
            Weights::Symmetric { gammas } => {
                let half = gammas.iter().map(|digits| parse(digits) / 2.0);
                let half: Vec<TwoFloat> = half.flat_map(|alpha| [alpha, alpha]).collect();
                // the middle stage is two maps, each on its side of the middle
                (true, mirrored(&half[..half.len() - 1]))
            }
            Weights::Adjoint { a, b } => (false, mirrored(&half_of_alphas(a, b))),
        };
        alphas
            .iter()
            .enumerate()
            .map(|(k, alpha)| (k.is_multiple_of(2) == begins_adjoint, *alpha))
            .collect()
    }

    /// The stages γ of a symmetric step, first to last; none where the scheme needs an adjoint.
    pub fn stages(&self) -> Option<Vec<f64>> {
        match self.weights {
            Weights::Basic => Some(vec![1.0]),
            Weights::Symmetric { gammas } => {
                let half = gammas.iter().map(|digits| f64::from(parse(digits)));
                let half: Vec<f64> = half.collect();
                let back = half.iter().rev().skip(1).copied();
                Some(half.iter().copied().chain(back).collect())
            }
            Weights::Adjoint { .. } => None,
        }
    }
}

/// The first half of the α of a splitting's coefficients, its middle coefficient left out.
fn half_of_alphas(a: &[&str], b: &[&str]) -> Vec<TwoFloat> {
    let coefficients = a.iter().enumerate().flat_map(|(k, x)| {
        let pair = [Some(x), b.get(k)];
        pair.into_iter().flatten().map(|digits| parse(digits))
    });
    coefficients
        .scan(TwoFloat::from(0.0), |last, coefficient| {
            *last = coefficient - *last;
            Some(*last)
        })
        .collect()
}

/// The list and its mirror image, rounded.
fn mirrored(half: &[TwoFloat]) -> Vec<f64> {
    let half: Vec<f64> = half.iter().map(|x| f64::from(*x)).collect();
    half.iter().chain(half.iter().rev()).copied().collect()
}

/// The value of decimal digits, to some 31 of them.
pub(super) fn parse(digits: &str) -> TwoFloat {
    let (sign, digits) = match digits.strip_prefix('-') {
        Some(rest) => (-1.0, rest),
        None => (1.0, digits),
    };
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let number = |digits: &str| {
        digits
            .bytes()
            .fold(0.0, |sum, digit| 10.0 * sum + f64::from(digit - b'0'))
    };
    // division by an f64 is good to double-double; by a TwoFloat, in this version of the crate, it is not
    let chunks = fraction.as_bytes().chunks(11).rev();
    let fraction = chunks.fold(TwoFloat::from(0.0), |sum, chunk| {
        let text: String = chunk.iter().map(|byte| char::from(*byte)).collect();
        (sum + number(&format!("{text:0<11}"))) / 1e11
    });
    (fraction + number(whole)) * sign
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alphas_add_up_to_one_and_read_the_same_backwards() {
        for scheme in Scheme::all() {
            let flows = scheme.flows();
            let sum: f64 = flows.iter().map(|(_, alpha)| alpha).sum();
            assert!(
                (sum - 1.0).abs() < 4.0 * f64::EPSILON,
                "{}: {sum}",
                scheme.name
            );
            for (flow, back) in flows.iter().zip(flows.iter().rev()) {
                assert_eq!(flow.1.to_bits(), back.1.to_bits(), "{}", scheme.name);
                assert!(scheme.name == "Lie" || flow.0 != back.0);
            }
            assert!(flows.windows(2).all(|pair| pair[0].0 != pair[1].0));
        }
    }

    #[test]
    fn stages_of_a_symmetric_step_are_pairs_of_maps() {
        for scheme in Scheme::all() {
            let Some(stages) = scheme.stages() else {
                assert!(matches!(scheme.weights, Weights::Adjoint { .. }));
                continue;
            };
            let flows = scheme.flows();
            if scheme.name == "Lie" {
                assert_eq!((stages, flows.len()), (vec![1.0], 1));
                continue;
            }
            assert_eq!(2 * stages.len(), flows.len());
            for (gamma, pair) in stages.iter().zip(flows.chunks(2)) {
                assert!(pair[0].0 && !pair[1].0);
                let bits = (gamma / 2.0).to_bits();
                assert!(pair.iter().all(|flow| flow.1.to_bits() == bits));
            }
        }
    }

    #[test]
    fn digits_are_read_to_double_double() {
        // 2^(1/3), by its cube
        let root = parse("1.259921049894873164767210607278228350570251464701507980081975");
        let error = root * root * root - 2.0;
        assert!(f64::from(error).abs() < 1e-30, "{error:?}");
        assert_eq!(f64::from(parse("-0.4")).to_bits(), (-0.4_f64).to_bits());
        assert_eq!(f64::from(parse("1")).to_bits(), 1.0_f64.to_bits());
    }
}
