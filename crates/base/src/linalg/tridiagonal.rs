//! Eigenvalues and eigenvectors of small symmetric tridiagonal matrices, by the implicit QL algorithm.
//! Source: Bowdler, Martin, Reinsch and Wilkinson, Numerische Mathematik 11 (1968), 293–306.

/// T = U Λ Uᵀ, with memory for the largest T.
#[derive(Clone, Debug)]
pub struct Tridiagonal {
    values: Vec<f64>,
    /// The eigenvectors, one after another.
    vectors: Vec<f64>,
    /// The entries beside the diagonal while they are driven to zero.
    beside: Vec<f64>,
}

/// Sweeps that an eigenvalue may take; two are usual.
const MOST_SWEEPS: usize = 60;

impl Tridiagonal {
    /// Memory for matrices up to this order.
    pub fn new(most: usize) -> Self {
        Self {
            values: Vec::with_capacity(most),
            vectors: Vec::with_capacity(most * most),
            beside: Vec::with_capacity(most),
        }
    }

    /// Decomposes the matrix with this diagonal, and with the entries beside it at the head of `beside`.
    ///
    /// # Panics
    /// When a number is not finite, or there are not enough of them.
    pub fn solve(&mut self, diagonal: &[f64], beside: &[f64]) {
        let n = diagonal.len();
        let beside = &beside[..n.saturating_sub(1)];
        let mut numbers = diagonal.iter().chain(beside);
        assert!(numbers.all(|x| x.is_finite()), "numbers of a matrix");
        // in units of the largest, so that no square overflows
        let numbers = diagonal.iter().chain(beside);
        let largest = numbers.fold(0.0, |most: f64, x| most.max(x.abs()));
        let unit = if largest > 0.0 { largest } else { 1.0 };
        self.values.clear();
        self.values.extend(diagonal.iter().map(|x| x / unit));
        self.beside.clear();
        self.beside.extend(beside.iter().map(|x| x / unit));
        self.beside.resize(n, 0.0);
        self.vectors.clear();
        self.vectors.resize(n * n, 0.0);
        for k in 0..n {
            self.vectors[k * n + k] = 1.0;
        }
        for first in 0..n {
            let mut sweeps = 0;
            while let Some(last) = self.end_of_block(first) {
                sweeps += 1;
                assert!(sweeps <= MOST_SWEEPS, "eigenvalues of a finite matrix");
                self.sweep(first, last);
            }
        }
        self.values.iter_mut().for_each(|value| *value *= unit);
        self.sort();
    }

    /// The last row coupled to row `first` by entries above roundoff, if any is.
    fn end_of_block(&self, first: usize) -> Option<usize> {
        let is_coupled = |k: &usize| {
            let size = self.values[*k].abs() + self.values[k + 1].abs();
            self.beside[*k].abs() > f64::EPSILON * size
        };
        let coupled = (first..self.values.len() - 1).take_while(is_coupled);
        coupled.last().map(|k| k + 1)
    }

    /// One QL step with Wilkinson's shift on rows `first` to `last`.
    fn sweep(&mut self, first: usize, last: usize) {
        let n = self.values.len();
        let (d, e) = (&mut self.values, &mut self.beside);
        let slope = (d[first + 1] - d[first]) / (2.0 * e[first]);
        let shift = e[first] / (slope + slope.hypot(1.0).copysign(slope));
        let mut g = d[last] - d[first] + shift;
        let (mut sin, mut cos, mut moved) = (1.0, 1.0, 0.0);
        for i in (first..last).rev() {
            let (f, b) = (sin * e[i], cos * e[i]);
            let length = (f * f + g * g).sqrt();
            e[i + 1] = length;
            if length == 0.0 {
                // the matrix falls apart here
                d[i + 1] -= moved;
                e[last] = 0.0;
                return;
            }
            let inverse = 1.0 / length;
            (sin, cos) = (f * inverse, g * inverse);
            g = d[i + 1] - moved;
            let twist = (d[i] - g) * sin + 2.0 * cos * b;
            moved = sin * twist;
            d[i + 1] = g + moved;
            g = cos * twist - b;
            let (low, high) = self.vectors[i * n..(i + 2) * n].split_at_mut(n);
            for (low, high) in low.iter_mut().zip(high) {
                let (x, y) = (*low, *high);
                *low = cos * x - sin * y;
                *high = sin * x + cos * y;
            }
        }
        d[first] -= moved;
        e[first] = g;
        e[last] = 0.0;
    }

    /// Brings the smallest eigenvalue to the front, and each vector with its value.
    fn sort(&mut self) {
        let n = self.values.len();
        for k in 0..n {
            let smaller = |a: &usize, b: &usize| self.values[*a].total_cmp(&self.values[*b]);
            let Some(least) = (k..n).min_by(smaller) else {
                return;
            };
            if least != k {
                self.values.swap(k, least);
                let (head, tail) = self.vectors.split_at_mut(least * n);
                head[k * n..(k + 1) * n].swap_with_slice(&mut tail[..n]);
            }
        }
    }

    /// The eigenvalues, the smallest first.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The eigenvector of eigenvalue k.
    pub fn vector(&self, k: usize) -> &[f64] {
        let n = self.values.len();
        &self.vectors[k * n..(k + 1) * n]
    }
}
