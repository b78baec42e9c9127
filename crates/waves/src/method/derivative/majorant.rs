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

use crate::method::bessel::{END, bessel_to_the_last};
use crate::method::driven::choice::{Form, LARGEST, Window};
use crate::method::driven::factors::Factors;
use crate::method::driven::polynomials::{NodeMap, by_nodes};
use crate::method::driven::whole::Fit;

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

/// A state within a window: where, and the factors of the terms.
pub(in crate::method) struct Output {
    pub(in crate::method) s: f64,
    pub(in crate::method) factors: Vec<f64>,
}

/// A window as it was made.
pub(in crate::method) struct SeriesPiece {
    /// e^{i phase} ψ at its start.
    pub(in crate::method) start: Vec<f64>,
    pub(in crate::method) phase: f64,
    pub(in crate::method) window: Window,
    pub(in crate::method) fit: Fit,
    /// |h| times the norm of each power of the fit from the first on.
    pub(in crate::method) sizes: Vec<f64>,
    /// A bound of the terms that are left out, relative to the state.
    pub(in crate::method) tail: f64,
    /// Times, and the coefficients of the fit by the weights of H there.
    pub(in crate::method) nodes: Vec<f64>,
    pub(in crate::method) map: NodeMap,
    /// The ends of steps, and at last the end of the window.
    pub(in crate::method) outputs: Vec<Output>,
    pub(in crate::method) steps: usize,
    /// The part of a planned window that it is, as one in so many.
    pub(in crate::method) parts: f64,
    /// Whether the fit has a weight for each term, not for each group of terms.
    pub(in crate::method) is_by_terms: bool,
}

impl SeriesPiece {
    pub(super) fn count(&self) -> usize {
        let counts = self.outputs.iter().map(|output| output.factors.len());
        counts.max().unwrap_or(0)
    }

    /// See [`super::Recorder::raise`].
    pub(super) fn raise(&mut self, degree: usize) {
        let powers = self.fit.degree + 1;
        if degree < powers {
            return;
        }
        for values in [&mut self.fit.weights, &mut self.fit.potential] {
            values.resize(values.len() / powers * (degree + 1), 0.0);
        }
        self.fit.degree = degree;
        self.map = by_nodes(degree);
    }

    /// See [`super::Recorder::lengthen`].
    pub(super) fn lengthen(&mut self, changes: &[f64], tolerance: f64) -> bool {
        let degree = self.fit.degree;
        let width = changes.len() / self.nodes.len();
        if width == 0 && degree == 0 && self.window.form == Form::Bessel {
            return true; // bounds of the spectrum are for all states
        }
        let found = match (width, degree) {
            (0, _) => Vec::new(),
            (_, 0) => vec![1.0],
            _ => self.map.apply(changes, width, degree),
        };
        let sizes = found.chunks(width.max(1));
        let sizes = sizes.map(|row| row.iter().fold(0.0, |most: f64, x| most.max(x.abs())));
        let Some((form, length)) = self.series(sizes.collect(), tolerance) else {
            return false;
        };
        if form == self.window.form && length.count <= self.count() {
            return true;
        }
        self.window.form = form;
        for output in &mut self.outputs {
            let factors = Factors::new(&self.window, output.s);
            output.factors = (0..length.count)
                .map(|n| factors.of(&self.window, n))
                .collect();
        }
        true
    }

    /// Whether bounds of the terms, for all states and for changes of H by any of its powers, show a series that ends.
    pub(in crate::method) fn ends(&self) -> bool {
        let changes = vec![1.0; self.fit.degree + 1];
        self.series(changes, f64::INFINITY).is_some()
    }

    /// The form of the series with the sizes of changes, and how many terms it takes.
    fn series(&self, changes: Vec<f64>, tolerance: f64) -> Option<(Form, Length)> {
        let (degree, form) = (self.fit.degree, self.window.form);
        let majorant = Majorant {
            theta: self.window.beta * self.window.h.abs(),
            sizes: self.sizes.clone(),
            changes,
            tolerances: (self.tail, tolerance),
        };
        let powers = || Some((Form::Powers, majorant.powers()?));
        let own = match form {
            Form::Powers => powers(),
            // bounds of the spectrum are for the terms of all states
            Form::Bessel if degree == 0 => Majorant {
                tolerances: (f64::INFINITY, tolerance),
                ..majorant.clone()
            }
            .bessel()
            .map(|length| (form, length)),
            Form::Bessel => majorant.bessel().map(|length| (form, length)),
        };
        let best = match own {
            Some((Form::Bessel, length)) if length.largest > LARGEST => {
                powers().filter(|(_, other)| other.largest < length.largest)
            }
            Some(_) => None,
            None => powers(),
        };
        best.or(own)
    }
}
