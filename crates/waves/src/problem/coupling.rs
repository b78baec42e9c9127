//! A constant matrix between the components of a wave function on a grid, C ⊗ 1.

use super::Update;
use liouville_base::simd::Stored;
use liouville_fourier::Complex;

/// A real symmetric matrix C = U Λ Uᵀ between components, each of so many points.
#[derive(Clone, Debug)]
pub struct Coupling {
    points: usize,
    /// C by rows.
    matrix: Vec<f64>,
    levels: Vec<f64>,
    /// U by rows.
    vectors: Vec<f64>,
}

impl Coupling {
    /// The matrix with these eigenvalues, and eigenvectors as columns; none where sizes do not fit.
    pub fn new(points: usize, levels: &[f64], vectors: &[f64]) -> Option<Self> {
        let count = levels.len();
        let fits = points > 0 && count > 0 && vectors.len() == count * count;
        let entry = |a: usize, b: usize| {
            let parts = levels.iter().enumerate();
            let part =
                |(j, level): (usize, &f64)| level * vectors[a * count + j] * vectors[b * count + j];
            parts.map(part).sum::<f64>()
        };
        fits.then(|| Self {
            matrix: (0..count * count)
                .map(|place| entry(place / count, place % count))
                .collect(),
            levels: levels.to_vec(),
            vectors: vectors.to_vec(),
            points,
        })
    }

    /// Number of rows.
    pub fn size(&self) -> usize {
        self.points * self.levels.len()
    }

    /// e^{−iCs} by rows.
    pub(crate) fn phases(&self, s: f64) -> Vec<Complex> {
        let count = self.levels.len();
        let turns: Vec<Complex> = self
            .levels
            .iter()
            .map(|x| Complex::from_polar(1.0, -x * s))
            .collect();
        let entry = |place: usize| {
            let (a, b) = (place / count * count, place % count * count);
            let parts = turns.iter().enumerate();
            parts
                .map(|(j, turn)| turn * self.vectors[a + j] * self.vectors[b + j])
                .sum()
        };
        (0..count * count).map(entry).collect()
    }

    /// Updates all rows.
    pub(super) fn update<S: Stored>(&self, update: Update, x: &[S], out: &mut [S]) {
        let (count, points) = (self.levels.len(), self.points);
        for (place, out) in out.iter_mut().enumerate() {
            let (row, point) = (place / points * count, place % points);
            for member in 0..S::MEMBERS {
                let parts = self.matrix[row..][..count].iter().enumerate();
                let part = |(b, c): (usize, &f64)| c * x[b * points + point].member(member);
                let product: f64 = parts.map(part).sum();
                let change = update.factor * product + update.diagonal * x[place].member(member);
                out.set_member(member, update.keep * out.member(member) + change);
            }
        }
    }
}
