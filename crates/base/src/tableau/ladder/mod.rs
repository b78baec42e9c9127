//! The ladder: sequences of shears
//!
//!     q ← q + c₁ h H p,   p ← p − c₂ h H q,   q ← q + c₃ h H p,   …,   p ← p − cₙ h H q
//!
//! whose step h is as long as possible for the error it may make. On an eigenvector of H a step is a matrix
//! K(x) of determinant 1, x = h·eigenvalue, and the exact one a rotation R(x). Its part that rotates is
//! (K + J K Jᵀ)/2 with the cosine p(x) = cos φ, β the rest. The error of N steps with |x| ≤ f·theta is at most
//!
//!     (1 + err)ᴺ − 1,   and   N·dphi + κ + κ²/2
//!
//! by err = max |K − R|, dphi = max |φ − x| and κ = max |β / sin φ|, which a table lists by fractions f. The
//! methods are not those of any paper: `tools/ladder.py` makes them, after gray1996, blanes2008 and blanes2015.

use std::sync::OnceLock;

/// One method of the ladder; see the module for the letters.
#[derive(Clone, Debug, PartialEq)]
pub struct Ladder {
    /// Its name.
    pub id: &'static str,
    /// Whether |p| ≤ 1 up to theta, so that no number of steps makes the error grow but linearly.
    pub is_stable: bool,
    /// How many times larger β is than the error of the angle, by design.
    pub ratio: f64,
    /// Largest |x| it is made for.
    pub theta: f64,
    /// How many independent roundings a step is worth: N steps leave about gain·√N·2⁻⁵³.
    pub gain: f64,
    /// c₁ .. cₙ
    pub coefficients: Vec<f64>,
    /// Largest |K − R| up to each fraction of theta.
    pub err: Vec<f64>,
    /// Largest |φ − x|, infinite where |p| > 1.
    pub dphi: Vec<f64>,
    /// Largest |β / sin φ|, infinite where |p| > 1.
    pub kappa: Vec<f64>,
}

struct Table {
    fractions: Vec<f64>,
    methods: Vec<Ladder>,
}

impl Ladder {
    /// All methods, by their number of shears, then by theta.
    pub fn all() -> &'static [Self] {
        &table().methods
    }

    /// The method of this name.
    pub fn named(id: &str) -> Option<&'static Self> {
        Self::all().iter().find(|method| method.id == id)
    }

    /// Fractions of theta, ascending, the last one 1.
    pub fn fractions() -> &'static [f64] {
        &table().fractions
    }
}

fn table() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(|| parse(include_str!("table.txt")))
}

/// Reads the output of `tools/ladder.py`.
fn parse(text: &'static str) -> Table {
    let mut table = Table {
        fractions: Vec::new(),
        methods: Vec::new(),
    };
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let (key, rest) = line.split_once(' ').unwrap_or((line, ""));
        if key == "method" {
            table.methods.push(headed(rest));
            continue;
        }
        let values = rest.split_whitespace().map(number);
        match (key, table.methods.last_mut()) {
            ("fractions", None) => table.fractions.extend(values),
            ("c", Some(method)) => method.coefficients.extend(values),
            ("err", Some(method)) => method.err.extend(values),
            ("dphi", Some(method)) => method.dphi.extend(values),
            ("kappa", Some(method)) => method.kappa.extend(values),
            _ => assert!(line.is_empty(), "a line of the ladder: {line}"),
        }
    }
    table
}

fn headed(line: &'static str) -> Ladder {
    let words: Vec<&str> = line.split_whitespace().collect();
    Ladder {
        id: words[0],
        is_stable: words[1] == "stable",
        ratio: number(words[2]),
        theta: number(words[3]),
        gain: number(words[4]),
        coefficients: Vec::new(),
        err: Vec::new(),
        dphi: Vec::new(),
        kappa: Vec::new(),
    }
}

fn number(word: &str) -> f64 {
    word.parse()
        .unwrap_or_else(|_| panic!("a number of the ladder: {word}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// K(x), by rows.
    fn matrix(coefficients: &[f64], x: f64) -> [f64; 4] {
        let mut k = [1.0, 0.0, 0.0, 1.0];
        for (shear, c) in coefficients.iter().enumerate() {
            let (to, from, c) = if shear % 2 == 0 {
                (0, 2, c * x)
            } else {
                (2, 0, -c * x)
            };
            k[to] += c * k[from];
            k[to + 1] += c * k[from + 1];
        }
        k
    }

    fn angles_of(k: [f64; 4]) -> (f64, f64, f64) {
        let beta = (k[0] - k[3]).hypot(k[1] + k[2]) / 2.0;
        (f64::midpoint(k[0], k[3]), (k[1] - k[2]) / 2.0, beta)
    }

    #[test]
    fn names_are_different_and_steps_grow() {
        let all = Ladder::all();
        assert!(all.len() >= 60);
        for (k, method) in all.iter().enumerate() {
            assert_eq!(Ladder::named(method.id), Some(&all[k]));
            let lengths = [&method.err, &method.dphi, &method.kappa].map(Vec::len);
            assert_eq!(lengths, [Ladder::fractions().len(); 3], "{}", method.id);
        }
        assert!(Ladder::named("L5s_1.0").is_none());
    }

    #[test]
    fn determinants_are_one_and_coefficients_add_up() {
        for method in Ladder::all() {
            for part in 0..2 {
                let mine = method.coefficients.iter().skip(part).step_by(2);
                let off = (mine.sum::<f64>() - 1.0).abs();
                // the derivative of the error at 0
                assert!(
                    off <= 30.0 * method.err[0] / (0.05 * method.theta) + 1e-13,
                    "{}: {off:e}",
                    method.id
                );
            }
            let k = matrix(&method.coefficients, method.theta);
            let off = (k[0] * k[3] - k[1] * k[2] - 1.0).abs();
            assert!(off < 1e-15 * method.gain, "{}: {off:e}", method.id);
        }
    }

    #[test]
    fn errors_are_below_the_tables_and_reach_them() {
        for method in Ladder::all() {
            let floor = 4e-16 * method.gain;
            for (fraction, largest) in Ladder::fractions().iter().zip(&method.err) {
                let end = fraction * method.theta;
                let points = (1..=400).map(|k| f64::from(k) / 400.0 * end);
                let found = points
                    .map(|x| {
                        let (p, s, beta) = angles_of(matrix(&method.coefficients, x));
                        (p - x.cos()).hypot(s - x.sin()) + beta
                    })
                    .fold(0.0, f64::max);
                assert!(found <= largest + floor, "{}: {found:e}", method.id);
                assert!(found >= 0.95 * largest - floor, "{}: {found:e}", method.id);
            }
        }
    }

    #[test]
    fn stable_methods_are_stable() {
        for method in Ladder::all().iter().filter(|method| method.is_stable) {
            assert!(method.kappa.iter().all(|kappa| kappa.is_finite()));
            for k in 1..=4000 {
                let x = f64::from(k) / 4000.0 * method.theta;
                let (p, _, beta) = angles_of(matrix(&method.coefficients, x));
                let floor = 1e-15 * method.gain;
                assert!(p.abs() <= 1.0 + floor, "{} at {x}: {p}", method.id);
                let bound = method.kappa[Ladder::fractions().len() - 1];
                let sine = (1.0 - p * p).max(0.0).sqrt();
                assert!(
                    beta <= bound * (sine + 1e-7) + floor,
                    "{} at {x}",
                    method.id
                );
            }
        }
    }
}
