//! Cotangents of the states at given times, a row for each time.

use liouville_base::linalg::Matrix;

/// Cotangents of (y, z, λ) at given times.
#[derive(Debug)]
pub(super) struct GivenTimes {
    times: Vec<f64>,
    rows: Matrix,
}

impl GivenTimes {
    /// No cotangents yet at these times, of so many numbers of y, z and λ.
    pub(super) fn new(times: Vec<f64>, [n, l, m]: [usize; 3]) -> Self {
        let rows = Matrix::zeros(times.len(), n + l + m);
        Self { times, rows }
    }

    /// Sets the cotangents; returns whether their number fits.
    pub(super) fn give(&mut self, rows: Matrix) -> bool {
        let fits = (rows.rows(), rows.cols()) == (self.rows.rows(), self.rows.cols());
        if fits {
            self.rows = rows;
        }
        fits
    }

    /// Returns the row of one of the times.
    pub(super) fn row(&self, t: f64) -> &[f64] {
        let is_forward = self.times.first() <= self.times.last();
        let is_before = |own: &f64| if is_forward { *own < t } else { *own > t };
        self.rows.row(self.times.partition_point(is_before))
    }
}
