//! Processors of steps that are stable for long, but conjugate to steps of their order only.
//!
//! A step K = P⁻¹ R P has the cosine of a good rotation R, and P K^N P⁻¹ is R^N: a run begins with P⁻¹, and P
//! is applied to each recorded state. On an eigenvector of H, x = h·eigenvalue,
//!
//!     P = ((cosh η, sinh η), (sinh η, cosh η)),    tanh 2η = (K₁₁ − K₂₂)/(K₁₂ − K₂₁),
//!
//! η odd in x. Both functions are sums of Chebyshev polynomials on [−X, X], and applied by their recursion.
//! X has to stay below the limit of stability, where η is infinite. Source: lopezmarcos1996, blanes2006.

use super::{Move, Sink, Sweeper, Wave};
use crate::problem::Update;
use liouville_base::error::StepError;
use liouville_base::simd::Stored;
use liouville_base::tableau::Stable;
use std::f64::consts::PI;

const LARGEST_DEGREE: usize = 512;

/// cosh η and sinh η as sums of Chebyshev polynomials of x / X.
#[derive(Clone, Debug, PartialEq)]
pub struct Processor {
    largest: f64,
    /// Of cosh η the even ones, of sinh η the odd ones.
    coefficients: Vec<f64>,
}

impl Processor {
    /// The processor of a method for |x| ≤ `largest`, to `tolerance`; none if that takes too high a degree.
    pub fn new(method: &Stable, largest: f64, tolerance: f64) -> Option<Self> {
        if largest >= method.limit {
            return None;
        }
        let mut nodes = 32;
        while nodes <= 2 * LARGEST_DEGREE {
            let coefficients =
                interpolated(nodes, |u| 0.5 * method.reflection(largest * u).atanh());
            let mut rest = 0.0;
            let kept = coefficients.iter().rposition(|c| {
                rest += c.abs();
                rest > tolerance
            });
            let kept = kept.map_or(1, |last| last + 1);
            // the error of interpolation is that of the omitted coefficients, once they fall
            if 4 * kept <= 3 * nodes && kept <= LARGEST_DEGREE {
                let coefficients = coefficients[..kept].to_vec();
                return Some(Self {
                    largest,
                    coefficients,
                });
            }
            nodes *= 2;
        }
        None
    }

    /// Products of H and ψ, two real ones each.
    pub fn degree(&self) -> usize {
        self.coefficients.len() - 1
    }

    /// ψ ← P ψ, or P⁻¹ ψ, for steps `h` of H − `shift`.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled; ψ is unchanged then.
    pub fn apply<S: Stored>(
        &self,
        sweeper: &mut Sweeper<S>,
        (shift, h): (f64, f64),
        wave: &mut Wave<S>,
        is_inverse: bool,
    ) -> Result<(), StepError> {
        let moves = self.moves(shift, h, is_inverse);
        let first = self.coefficients[0];
        let (mut q, mut p) = (scaled(&wave.q, first), scaled(&wave.p, first));
        let mut last = wave.q.clone();
        let mut this = scaled(&wave.q, 0.0);
        let sums = Sink::Sums(&mut q, &mut p);
        sweeper.run(&moves, &mut last, &mut this, sums)?;
        last.copy_from_slice(&wave.p);
        this.fill(S::splat(0.0));
        let sums = Sink::Sums(&mut p, &mut q);
        sweeper.run(&moves, &mut last, &mut this, sums)?;
        (wave.q, wave.p) = (q, p);
        Ok(())
    }

    /// T₁ = y T₀, then T_{k+1} = 2 y T_k − T_{k−1} in place of T_{k−1}, with y = h (H − σ)/X.
    fn moves(&self, shift: f64, h: f64, is_inverse: bool) -> Vec<Move> {
        let sign = if is_inverse { -1.0 } else { 1.0 };
        let moves = self.coefficients.iter().enumerate().skip(1);
        moves
            .map(|(k, c)| {
                let (keep, factor) = if k == 1 { (0.0, 1.0) } else { (-1.0, 2.0) };
                let factor = factor * h / self.largest;
                let diagonal = -factor * shift;
                let is_odd = k % 2 == 1;
                Move {
                    into_second: is_odd,
                    update: Update {
                        keep,
                        factor,
                        diagonal,
                    },
                    weight: if is_odd { sign * c } else { *c },
                    copy: 0,
                }
            })
            .collect()
    }
}

fn scaled<S: Stored>(x: &[S], factor: f64) -> Vec<S> {
    let mut scaled = x.to_vec();
    for x in &mut scaled {
        for member in 0..S::MEMBERS {
            x.set_member(member, factor * x.member(member));
        }
    }
    scaled
}

/// Coefficients of the polynomials that equal cosh η and sinh η at Chebyshev's nodes, in turn.
#[expect(clippy::cast_precision_loss)] // small integers
fn interpolated(nodes: usize, eta: impl Fn(f64) -> f64) -> Vec<f64> {
    let angle = |node: usize| PI * (node as f64 + 0.5) / nodes as f64;
    // half of the nodes are enough, and none is 0
    let exponentials: Vec<f64> = (0..nodes / 2).map(|k| eta(angle(k).cos()).exp()).collect();
    (0..nodes)
        .map(|k| {
            let terms = exponentials.iter().enumerate().map(|(node, e)| {
                let value = if k % 2 == 0 { e + 1.0 / e } else { e - 1.0 / e };
                value / 2.0 * (k as f64 * angle(node)).cos()
            });
            let count = if k == 0 { 2.0 } else { 4.0 };
            count / nodes as f64 * terms.sum::<f64>()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::method::Shears;
    use crate::problem::{Diagonals, Hamiltonian, Operator};
    use liouville_base::composition::Parts;
    use liouville_base::tableau::Purpose;
    use std::sync::Arc;

    /// Every level x of a diagonal Hamiltonian is a rotation of its own; returns what a run makes of
    /// q = 1, p = 0, as angles and lengths.
    fn run(method: &Stable, levels: &[f64], steps: usize) -> (Vec<f64>, Vec<f64>) {
        let n = levels.len();
        let largest = levels[n - 1];
        let processor = Processor::new(method, largest, 1e-13).expect("a processor");
        let (shift, h) = (3.0, 0.5);
        let entries = levels.iter().map(|x| x / h + shift).collect();
        let diagonal = Diagonals::new(n, &[(0, entries)]);
        let operator = Operator::Diagonals(Arc::new(diagonal));
        let mut sweeper = Sweeper::new(Arc::new(Hamiltonian::new(vec![operator])));
        let mut wave = Wave::new(vec![1.0; n], vec![0.0; n]);
        let at = (shift, h);
        processor
            .apply(&mut sweeper, at, &mut wave, true)
            .expect("products");
        let mut shears = Shears::new(sweeper.clone(), shift, 1.0);
        for _ in 0..steps {
            for (k, c) in method.coefficients.iter().enumerate() {
                shears
                    .flow(k % 2, false, 0.0, c * h, &mut wave)
                    .expect("a product");
            }
        }
        processor
            .apply(&mut sweeper, at, &mut wave, false)
            .expect("products");
        let ends = wave.q.iter().zip(&wave.p);
        ends.map(|(q, p)| ((-p).atan2(*q), q.hypot(*p))).unzip()
    }

    #[test]
    fn processed_steps_are_rotations_by_the_angle_of_the_stability_polynomial() {
        let method = Stable::find(Purpose::Stability, 6, 8).expect("in the table");
        let levels: Vec<f64> = (1..=40)
            .map(|k| f64::from(k) / 40.0 * 0.8 * method.limit)
            .collect();
        let (angles, lengths) = run(method, &levels, 1);
        for ((x, angle), length) in levels.iter().zip(angles).zip(lengths) {
            assert!((length - 1.0).abs() < 1e-11, "at {x}: {length}");
            let k = method
                .coefficients
                .chunks(2)
                .fold([1.0, 0.0, 0.0, 1.0], |k, c| {
                    let (up, down) = (c[0] * x, c[1] * x);
                    let (q0, q1) = (k[0] + up * k[2], k[1] + up * k[3]);
                    [q0, q1, k[2] - down * q0, k[3] - down * q1]
                });
            let cosine = f64::midpoint(k[0], k[3]);
            assert!((angle.cos() - cosine).abs() < 1e-11, "at {x}: {angle}");
        }
    }

    #[test]
    fn processed_steps_have_the_order_of_the_polynomial() {
        let method = Stable::find(Purpose::Stability, 4, 6).expect("in the table");
        let error = |x: f64| {
            let (angles, _) = run(method, &[x / 2.0, x], 1);
            (angles[1] - x).abs()
        };
        // the angle's error is of one power more
        let slope = (error(1.0) / error(0.5)).log2();
        assert!((slope - 5.0).abs() < 0.2, "{slope}");
    }

    #[test]
    fn there_is_none_at_the_limit_of_stability() {
        let method = Stable::find(Purpose::Stability, 6, 6).expect("in the table");
        assert!(Processor::new(method, method.limit, 1e-6).is_none());
        let degree = |tolerance| {
            let processor = Processor::new(method, 0.8 * method.limit, tolerance);
            processor.expect("a processor").degree()
        };
        assert!(degree(1e-4) < degree(1e-10));
    }
}
