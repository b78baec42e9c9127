//! How many terms of a window derivatives take, by bounds of the terms alone.
//!
//! With |H(t0) − σ| ≤ β, G_l = |h| |H_l| of the powers from the first on, and a change of H whose powers have the sizes
//! |h| |dH_l| = d_l in units of the largest that it has in the run, terms and their changes are no longer than e_n and e'_n:
//!
//!     powers:  e_{n+1} = Σ_l G_l e_{n−l} / (n + 1),  G_0 = β|h|,   e'_{n+1} = Σ_l (G_l e'_{n−l} + d_l e_{n−l}) / (n + 1)
//!     Bessel:  e_n = 2 − δ_n0 + Σ_{m<n} (n − m) f_m,               f_m = (2/βh) Σ_{l>0} G_l y^l_m
//!              e'_n = Σ_{m<n} (n − m) f'_m,                        f'_m = (2/βh) (Σ_{l>0} G_l y'^l_m + Σ_l d_l y^l_m)
//!
//! with y^l of e, and y'^l of e', as in `driven::terms` with a plus for each minus. The second follows from
//! |U_k| ≤ k + 1 on [−1, 1]: a change of c_{m+1} is one of c_n by U_{n−m−1}(G).

use super::super::bessel::bessel_to_the_last;
use crate::method::driven::choice::END;

/// Most terms, beyond four times the length of the window in units of 1/β.
const MOST: usize = 1000;

/// A window, and changes of H in it.
#[derive(Clone)]
pub(super) struct Majorant {
    /// β|h|
    pub(super) theta: f64,
    /// G_l from the first power on.
    pub(super) sizes: Vec<f64>,
    /// d_l, empty without a change.
    pub(super) changes: Vec<f64>,
    /// Tolerances of the terms that are left out, and of their derivatives.
    pub(super) tolerances: (f64, f64),
}

/// How many terms a window takes, and the largest of them, which roundings are in proportion to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Length {
    pub(super) count: usize,
    pub(super) largest: f64,
}

/// Small terms in a row by which a series ends; as they fall by halves, the last is left out with all behind it.
const SMALL: usize = 2;

/// Watches terms until some in a row are small and fall by halves.
struct Watch {
    most: (f64, f64),
    largest: f64,
    before: f64,
    small: usize,
}

impl Watch {
    fn new((of_terms, of_changes): (f64, f64)) -> Self {
        let most = |tolerance: f64| END * tolerance.max(f64::EPSILON / 8.0);
        Self {
            most: (most(of_terms), most(of_changes)),
            largest: 0.0,
            before: f64::INFINITY,
            small: 0,
        }
    }

    /// Whether a term and its change may be left out.
    fn are_small(&self, (term, change): (f64, f64)) -> bool {
        term <= self.most.0 && change <= self.most.1
    }

    /// Whether a term and its change are the last ones, where such terms fall from here on.
    fn is_last(&mut self, (term, change): (f64, f64), is_falling: bool) -> bool {
        let size = term.max(change);
        let is_small = is_falling && self.are_small((term, change)) && 2.0 * size <= self.before;
        self.small = if is_small { self.small + 1 } else { 0 };
        self.largest = self.largest.max(size);
        self.before = size.max(f64::MIN_POSITIVE);
        self.small == SMALL
    }
}

impl Majorant {
    /// Makes the majorant of an H that does not depend on time, whose bounds are for the terms of all states.
    pub(super) fn of_constant(theta: f64, tolerance: f64) -> Self {
        Self {
            theta,
            sizes: Vec::new(),
            changes: vec![1.0],
            tolerances: (f64::INFINITY, tolerance),
        }
    }

    fn most(&self) -> usize {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // finite and positive
        let length = (4.0 * self.theta) as usize;
        MOST + length
    }

    /// Returns the length of a series in powers; none where its terms are beyond all numbers.
    pub(super) fn powers(&self) -> Option<Length> {
        let all: f64 = self.theta + self.sizes.iter().sum::<f64>();
        let (mut terms, mut moved) = (vec![1.0], vec![0.0]);
        let mut watch = Watch::new(self.tolerances);
        // terms vanish before those that high powers of H make: as many have to be small as reach the next
        let reach = self.sizes.len().max(self.changes.len().saturating_sub(1));
        let mut last: Option<Length> = None;
        while terms.len() < self.most() {
            let n = terms.len() - 1;
            let next = (n + 1) as f64;
            let sum = |sizes: &[f64], of: &[f64]| -> f64 {
                let pairs = sizes.iter().zip(of.iter().rev());
                pairs.map(|(size, x)| size * x).sum()
            };
            let product = |of: &[f64]| self.theta * of[n] + sum(&self.sizes, &of[..n]);
            let term = product(&terms) / next;
            let change = (product(&moved) + sum(&self.changes, &terms)) / next;
            terms.push(term);
            moved.push(change);
            if !term.max(change).is_finite() {
                return None;
            }
            let is_falling = n >= self.changes.len() && 2.0 * all < next + 1.0;
            if watch.is_last((term, change), is_falling) && last.is_none() {
                last = Some(Length {
                    count: terms.len() - 1,
                    largest: watch.largest,
                });
            }
            match last {
                Some(_) if !watch.are_small((term, change)) => last = None,
                Some(found) if terms.len() > found.count + reach => return last,
                _ => {}
            }
        }
        None
    }

    /// Returns the length of a series in Bessel functions; none where its terms are beyond all numbers.
    pub(super) fn bessel(&self) -> Option<Length> {
        let bessel = bessel_to_the_last(self.theta);
        let degree = self.sizes.len().max(self.changes.len().saturating_sub(1));
        let mut of = [Neumann::new(degree), Neumann::new(degree)];
        let mut sums = [[0.0; 2]; 2];
        let mut watch = Watch::new(self.tolerances);
        let factor = 2.0 / self.theta;
        for (n, value) in bessel.iter().enumerate().take(self.most()) {
            let start = if n == 0 { 1.0 } else { 2.0 };
            let (term, change): (f64, f64) = (start + sums[0][1], sums[1][1]);
            let sizes = (term * value.abs(), change * value.abs());
            if !sizes.0.max(sizes.1).is_finite() {
                return None;
            }
            if watch.is_last(sizes, n as f64 > self.theta) {
                return Some(Length {
                    count: n.max(1),
                    largest: watch.largest,
                });
            }
            of[0].advance(n, factor, term);
            of[1].advance(n, factor, change);
            let changing = |own: &Neumann| own.sum(&self.sizes, 1);
            let forces = [
                changing(&of[0]),
                changing(&of[1]) + of[0].sum(&self.changes, 0),
            ];
            for (sums, force) in sums.iter_mut().zip(forces) {
                sums[0] += factor * force;
                sums[1] += sums[0];
            }
        }
        None
    }
}

/// Coefficients of a series in Bessel functions times powers of the time.
struct Neumann {
    /// y^l of the newest n.
    powers: Vec<f64>,
    /// w^l, of even n and of odd n.
    sums: Vec<[f64; 2]>,
}

impl Neumann {
    fn new(degree: usize) -> Self {
        Self {
            powers: vec![0.0; degree + 1],
            sums: vec![[0.0; 2]; degree + 1],
        }
    }

    /// Goes on to a term, `factor` being 2/βh.
    fn advance(&mut self, n: usize, factor: f64, term: f64) {
        let (now, before) = (n % 2, (n + 1) % 2);
        for l in (0..self.powers.len()).rev() {
            self.powers[l] = match l {
                0 => term,
                l => n as f64 * factor * self.sums[l - 1][before],
            };
            self.sums[l][now] += self.powers[l];
        }
    }

    /// Σ_l size_l y^l, of powers from one on.
    fn sum(&self, sizes: &[f64], from: usize) -> f64 {
        let pairs = sizes
            .iter()
            .zip(&self.powers[from.min(self.powers.len())..]);
        pairs.map(|(size, power)| size * power).sum()
    }
}
