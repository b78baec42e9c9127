//! Shears for the Schrödinger equation that are stable for long steps, and shears of high order.
//!
//! A step of 2m shears, q and p in turn as in the ladder, has the coefficients a₁ b₁ a₂ b₂ .. aₘ bₘ with
//! aᵢ = bₘ₊₁₋ᵢ. On an eigenvector of H it has the cosine p(x), a polynomial of degree m in x².
//!
//!     stability          p agrees with cos x to x^order and |p| ≤ 1 on [0, x*] with the largest x* there is;
//!                        a step is conjugate to one of that order
//!     Gray–Manolopoulos  the step itself has that order
//!
//! Source: mclachlan1997 and lopezmarcos1996 for the former, gray1996 for the latter; the numbers are by
//! `tools/stability.py`.

use super::composition::parse as number;
use std::sync::OnceLock;
use twofloat::TwoFloat;

/// The purpose of a method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// The longest stable step.
    Stability,
    /// Its order.
    Order,
}

/// One method; see the module for the letters.
#[derive(Clone, Debug, PartialEq)]
pub struct Stable {
    /// Its purpose.
    pub purpose: Purpose,
    /// Order of the step, or of a step that it is conjugate to.
    pub order: usize,
    /// m, half the number of shears.
    pub stages: usize,
    /// x*, up to which steps are stable.
    pub limit: f64,
    /// How many independent roundings a step is worth.
    pub gain: f64,
    /// a₁, b₁ .. aₘ, bₘ
    pub coefficients: Vec<f64>,
    exact: Vec<TwoFloat>,
}

impl Stable {
    /// All methods: those made for stability by order, then stages; then those made for their order.
    pub fn all() -> &'static [Self] {
        static TABLE: OnceLock<Vec<Stable>> = OnceLock::new();
        TABLE.get_or_init(|| parse(include_str!("table.txt")))
    }

    /// The method of this purpose, order and number of stages.
    pub fn find(purpose: Purpose, order: usize, stages: usize) -> Option<&'static Self> {
        let key = (purpose, order, stages);
        let mut all = Self::all().iter();
        all.find(|method| (method.purpose, method.order, method.stages) == key)
    }

    /// tanh 2η = (K₁₁ − K₂₂)/(K₁₂ − K₂₁) at x ≠ 0: a step is P⁻¹ R(φ) P with a rotation by φ and
    /// P = ((cosh η, sinh η), (sinh η, cosh η)).
    ///
    /// Where a step is ±1 both vanish, so that they are computed from more digits than a double has.
    pub fn reflection(&self, x: f64) -> f64 {
        let [zero, one] = [0.0, 1.0].map(TwoFloat::from);
        let start = [one, zero, zero, one];
        let k = self.exact.chunks(2).fold(start, |k, c| {
            let (up, down) = (c[0] * x, c[1] * x);
            let (q0, q1) = (k[0] + up * k[2], k[1] + up * k[3]);
            [q0, q1, k[2] - down * q0, k[3] - down * q1]
        });
        f64::from(k[0] - k[3]) / f64::from(k[1] - k[2])
    }
}

/// Reads the output of `tools/stability.py`.
fn parse(text: &str) -> Vec<Stable> {
    let mut methods: Vec<Stable> = Vec::new();
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let words: Vec<&str> = line.split_whitespace().collect();
        match (words[0], methods.last_mut()) {
            ("method", _) => methods.push(Stable {
                purpose: if words[1] == "stability" {
                    Purpose::Stability
                } else {
                    Purpose::Order
                },
                order: read(words[2]),
                stages: read(words[3]),
                limit: read(words[4]),
                gain: read(words[5]),
                coefficients: Vec::new(),
                exact: Vec::new(),
            }),
            ("c", Some(method)) => {
                let exact = words[1..].iter().map(|word| number(word));
                method.exact.extend(exact);
                let rounded = method.exact.iter().copied().map(f64::from);
                method.coefficients = rounded.collect();
            }
            _ => panic!("a line of the stable methods: {line}"),
        }
    }
    methods
}

fn read<T: std::str::FromStr>(word: &str) -> T {
    let Ok(number) = word.parse() else {
        panic!("a number of the stable methods: {word}")
    };
    number
}

#[cfg(test)]
mod tests {
    use super::*;

    /// K(x), by rows.
    fn matrix(coefficients: &[f64], x: f64) -> [f64; 4] {
        coefficients.chunks(2).fold([1.0, 0.0, 0.0, 1.0], |k, c| {
            let (up, down) = (c[0] * x, c[1] * x);
            let (q0, q1) = (k[0] + up * k[2], k[1] + up * k[3]);
            [q0, q1, k[2] - down * q0, k[3] - down * q1]
        })
    }

    #[test]
    fn coefficients_read_the_same_backwards_with_parts_exchanged() {
        for method in Stable::all() {
            assert_eq!(method.coefficients.len(), 2 * method.stages);
            let forwards = method.coefficients.iter();
            for (a, b) in forwards.zip(method.coefficients.iter().rev()) {
                assert_eq!(a.to_bits(), b.to_bits());
            }
        }
    }

    #[test]
    fn steps_are_stable_up_to_their_limit_and_not_beyond() {
        for method in Stable::all() {
            let cosine = |x: f64| {
                let k = matrix(&method.coefficients, x);
                f64::midpoint(k[0], k[3])
            };
            let points = (0..=2000).map(|k| f64::from(k) / 2000.0 * method.limit);
            let largest = points.map(|x| cosine(x).abs()).fold(0.0, f64::max);
            assert!(largest < 1.0 + 1e-12 * method.gain, "{method:?}: {largest}");
            let beyond = cosine(1.001 * method.limit).abs();
            assert!(beyond > 1.0 + 1e-6, "{method:?}: {beyond}");
        }
    }

    #[test]
    fn orders_are_those_claimed() {
        for method in Stable::all() {
            let error = |x: f64| {
                let k = matrix(&method.coefficients, x);
                match method.purpose {
                    Purpose::Stability => (f64::midpoint(k[0], k[3]) - x.cos()).abs(),
                    Purpose::Order => (k[0] - x.cos()).hypot(k[1] - x.sin()),
                }
            };
            // the cosine's error begins with one power more, and is even
            let (power, part) = match method.purpose {
                Purpose::Stability => (method.order + 2, 0.25),
                Purpose::Order => (method.order + 1, 0.1),
            };
            let x = part * method.limit.min(4.8);
            let slope = (error(x) / error(x / 2.0)).log2();
            #[expect(clippy::cast_precision_loss)]
            let off = slope - power as f64;
            assert!(off.abs() < 0.4, "{method:?}: {slope}");
        }
    }
}
