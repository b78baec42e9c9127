//! Hamiltonians of two levels, by which the terms of a series in Bessel functions are counted before any product.

use super::fit::Sampler;
use super::polynomials::NODES;
use crate::method::bessel::{END, ROUNDING, bessel_to_the_last};
use crate::method::term_bounds::{Interval, range};

impl Sampler {
    /// How levels might change with time: energies by the ends of the first group with those of the others, where the
    /// potential changes most, and a pair of levels at the ends of the spectrum that all changes couple.
    pub(super) fn levels(&self, fit: &[f64], (low, high): Interval) -> Vec<TwoLevels> {
        let (groups, middle) = (self.groups(), f64::midpoint(low, high));
        let row_width = self.samples.len() / NODES;
        let width = 0.5 * (high - low);
        let changes = |place: usize| -> f64 {
            let rows = fit.chunks(row_width).skip(1);
            rows.map(|row| row[place].abs()).sum()
        };
        let most = (groups..row_width).max_by(|a, b| changes(*a).total_cmp(&changes(*b)));
        let end = |(low, high): Interval, is_high: bool| if is_high { high } else { low };
        let mut found = Vec::new();
        for is_high in [true, false] {
            for others in [true, false] {
                let of_power = |(l, row): (usize, &[f64])| {
                    let parts = row.iter().zip(&self.bounds().parts).enumerate();
                    let sum: f64 = parts
                        .map(|(k, (weight, bounds))| {
                            weight * end(*bounds, if k == 0 { is_high } else { others })
                        })
                        .sum();
                    let potential = most.map_or(0.0, |place| row[place]);
                    match l {
                        // closer bounds than those of the parts are those of H at the start, too
                        0 => (sum + potential - middle).clamp(-width, width),
                        _ => sum + potential,
                    }
                };
                let diagonal: Vec<f64> = fit.chunks(row_width).enumerate().map(of_power).collect();
                found.push(TwoLevels {
                    beside: vec![0.0; diagonal.len()],
                    diagonal,
                    start: [1.0, 0.0, 0.0, 0.0],
                });
            }
        }
        let changing = fit.chunks(row_width).skip(1).map(|row| {
            let parts = row.iter().zip(&self.bounds().parts);
            let sum: f64 = parts.map(|(w, (low, high))| w * 0.5 * (high - low)).sum();
            let (least, largest) = range(&row[groups..]);
            sum + 0.5 * (largest - least)
        });
        let beside: Vec<f64> = std::iter::once(0.0).chain(changing).collect();
        let mut diagonal = vec![0.0; beside.len()];
        diagonal[0] = width;
        for start in [[1.0, 0.0, 0.0, 0.0], [0.6, 0.0, 0.0, 0.8]] {
            found.push(TwoLevels {
                diagonal: diagonal.clone(),
                beside: beside.clone(),
                start,
            });
        }
        found
    }
}

/// A Hamiltonian of two levels, of polynomials of time: ± those of the diagonal, and what is beside it.
#[derive(Clone, Debug, Default)]
pub(super) struct TwoLevels {
    pub(super) diagonal: Vec<f64>,
    pub(super) beside: Vec<f64>,
    /// Real and imaginary part of each level.
    pub(super) start: [f64; 4],
}

impl TwoLevels {
    /// `out += factor * H_l x`
    pub(super) fn add_product(&self, l: usize, factor: f64, x: &[f64; 4], out: &mut [f64; 4]) {
        let (a, b) = (factor * self.diagonal[l], factor * self.beside[l]);
        for part in 0..2 {
            out[part] += a * x[part] + b * x[part + 2];
            out[part + 2] += b * x[part] - a * x[part + 2];
        }
    }
}

/// A state of two levels, by the real and imaginary part of each.
type Levels = [f64; 4];

/// `out += factor * x` for each part.
fn add(out: &mut Levels, factor: f64, x: &Levels) {
    for (out, x) in out.iter_mut().zip(x) {
        *out += factor * x;
    }
}

/// The last term that a series in Bessel functions takes for two levels, whose H has polynomials of time on its diagonal,
/// of both signs, and beside it; none where terms are so large that their rounding errors are not below the tolerance, or
/// where large ones follow small ones: what H changes by s^l is seen l terms later.
pub(super) fn bessel_terms(
    levels: &TwoLevels,
    theta: f64,
    beta: f64,
    tolerance: f64,
) -> Option<usize> {
    let bessel = bessel_to_the_last(theta.abs());
    let degree = levels.diagonal.len() - 1;
    let mut c: [Levels; 2] = [[0.0; 4], levels.start];
    let mut w = vec![[[0.0; 4]; 2]; degree];
    let (mut small, mut found) = (0, None);
    for (n, factor) in bessel.iter().enumerate() {
        let [before, now] = c;
        let size = now.iter().map(|x| x * x).sum::<f64>().sqrt() * factor.abs();
        if size * ROUNDING > tolerance {
            return None;
        }
        let is_small = n as f64 > theta.abs() && size <= END * tolerance;
        small = if is_small { small + 1 } else { 0 };
        if small == 0 && found.is_some() {
            return None;
        }
        if small == 2 {
            found = Some(n);
        }
        if small == degree + 2 {
            return found;
        }
        let newer = 2.0 * n as f64 / theta;
        let (this, last) = (n % 2, (n + 1) % 2);
        let mut sum = [0.0; 4];
        levels.add_product(0, 1.0, &now, &mut sum);
        for (l, w) in w.iter().enumerate() {
            levels.add_product(l + 1, newer, &w[last], &mut sum);
        }
        for l in (1..degree).rev() {
            let mut next = w[l][this].map(|x| -x);
            add(&mut next, newer, &w[l - 1][last]);
            w[l][this] = next;
        }
        if let Some(lowest) = w.first_mut() {
            let mut next = lowest[this].map(|x| -x);
            add(&mut next, 1.0, &now);
            lowest[this] = next;
        }
        let keep = if n == 1 { 2.0 } else { 1.0 };
        let factor = 2.0 / beta;
        let mut next = before.map(|x| keep * x);
        add(&mut next, factor, &[sum[1], -sum[0], sum[3], -sum[2]]);
        c = [now, next];
    }
    found
}
