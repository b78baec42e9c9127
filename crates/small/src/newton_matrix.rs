//! Full Newton's matrix in registers, for the stage equations of the crate above.

use super::Fixed;
use super::layout::Layout;
use liouville_base::linalg::Matrix;
use liouville_base::real::{Lanes, Scalar};
use liouville_base::simd::dispatch_simd;

/// Values of one coordinate in a row for each point; the lanes left repeat the last one.
fn lanes(values: &Matrix, col: usize) -> Lanes {
    Lanes(std::array::from_fn(|i| {
        values[(i.min(values.rows() - 1), col)]
    }))
}

impl<const N: usize, const M: usize> Fixed<f64, N, M> {
    /// Makes the matrix at these Y and Z, Ŷ and λ, a row a stage or node.
    pub fn linearize_at(
        &mut self,
        (t, h): (f64, f64),
        [y, z]: [&Matrix; 2],
        [node_y, lam]: [&Matrix; 2],
    ) {
        let n = self.problem.n;
        self.stage.argument(0)[0] = Lanes::splat(t) + self.tables.c * h;
        self.node.argument(0)[0] = Lanes::splat(t) + self.tables.c_hat * h;
        for q in 0..n {
            self.stage.argument(1 + q)[0] = lanes(y, q);
            self.stage.argument(1 + n + q)[0] = lanes(z, q);
            self.node.argument(1 + q)[0] = lanes(node_y, q);
        }
        for c in 0..self.problem.m {
            self.node.argument(1 + n + c)[0] = lanes(lam, c);
        }
        dispatch_simd::<Lanes, _>(
            #[inline(always)]
            || self.linearize(h),
        );
    }

    /// Corrects Z and λ for residuals of momenta and for g; returns the largest correction of Z.
    pub fn correct_at(
        &mut self,
        h: f64,
        [momentum, g]: [&Matrix; 2],
        [z, lam]: [&mut Matrix; 2],
    ) -> f64 {
        let (n, m) = (self.problem.n, self.problem.m);
        let Some(full) = self.full.as_mut().filter(|_| Self::TAKES_NEWTON) else {
            return f64::NAN;
        };
        for q in 0..n {
            self.work.residual[q] = [lanes(momentum, q)];
        }
        for c in 0..m {
            self.node.value_mut(c)[0] = lanes(g, c);
        }
        let residual = &self.work.residual[..n];
        dispatch_simd::<Lanes, _>(
            #[inline(always)]
            || full.solve(self.tables, residual, &self.node, (m, h)),
        );
        let (d_z, d_lam) = full.corrections.split_at(n);
        let mut size = 0.0_f64;
        for (q, d_z) in d_z.iter().enumerate() {
            for i in 0..z.rows() {
                let d_z = f64::at(d_z, i);
                z[(i, q)] += d_z;
                size = if d_z.abs() <= size { size } else { d_z.abs() };
            }
        }
        for (c, d_lam) in d_lam.iter().enumerate().take(m) {
            for j in 0..self.tables.intervals {
                lam[(j, c)] += f64::at(d_lam, j) * (1.0 / h);
            }
        }
        size
    }
}
