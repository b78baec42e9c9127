//! The coefficients of a method between points, and those of the extrapolated start.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::layout::Weights;
use super::{LAM, Z};
use liouville_base::linalg::{Matrix, inverse};
use liouville_base::newton;
use liouville_base::real::{Lanes, Real};
use liouville_base::tableau::{self, Known};

static TABLES: Known<Option<Tables>> = Known::new();

/// The coefficients of a SPARK method with s stages and k + 1 nodes. Values beyond the last stage or node repeat it.
#[derive(Clone, Debug)]
pub(super) struct Tables {
    pub(super) stages: usize,
    pub(super) intervals: usize,
    pub(super) c: Lanes,
    pub(super) c_hat: Lanes,
    b: Lanes,
    b_hat: Lanes,
    /// aᵛ, aᶠ, μᵛ, μᶠ (s by s), μ̄ and ā ((k+1) by s), μ̂ and â (s by k).
    pub(super) a_v: Weights,
    pub(super) a_f: Weights,
    pub(super) mu_v: Weights,
    pub(super) mu_f: Weights,
    pub(super) mu_bar: Weights,
    pub(super) a_bar: Weights,
    pub(super) mu_hat: Weights,
    pub(super) a_hat: Weights,
    /// Columns of P = ā â, below the first node.
    pub(super) product: Vec<Lanes>,
    /// P⁻¹, to the nodes 0..k−1 from all nodes; the first column is zero.
    pub(super) inverse_product: Weights,
}

impl Tables {
    /// The tables of a method, made once a process; `None` where P is singular.
    pub(super) fn of(tableau: &tableau::Spark) -> Option<&'static Self> {
        TABLES.once(tableau.key, || Self::new(tableau)).as_ref()
    }

    fn new(tableau: &tableau::Spark) -> Option<Self> {
        let (s, k) = (tableau.stages, tableau.intervals);
        let lanes = |x: &[f64]| Lanes(std::array::from_fn(|i| x[i.min(x.len() - 1)]));
        let matrix = |of: &Matrix, cols| Weights::new(cols, |i, j| of[(i.min(of.rows() - 1), j)]);
        let product = Matrix::from_fn(k, k, |i, l| {
            let terms = (0..s).map(|j| tableau.a_bar[(i + 1, j)] * tableau.a_hat[(j, l)]);
            terms.sum()
        });
        let inverse = inverse(&product)?;
        let below = |l: usize| {
            Lanes(std::array::from_fn(|i| match i {
                0 => 0.0,
                i if i <= k => product[(i - 1, l)],
                _ => 0.0,
            }))
        };
        Some(Self {
            stages: s,
            intervals: k,
            c: lanes(&tableau.c),
            c_hat: lanes(&tableau.c_hat),
            b: lanes(&tableau.b),
            b_hat: lanes(&tableau.b_hat),
            a_v: matrix(&tableau.a_v, s),
            a_f: matrix(&tableau.a_f, s),
            mu_v: matrix(&tableau.mu_v, s),
            mu_f: matrix(&tableau.mu_f, s),
            mu_bar: matrix(&tableau.mu_bar, s),
            a_bar: matrix(&tableau.a_bar, s),
            mu_hat: matrix(&tableau.mu_hat, k),
            a_hat: matrix(&tableau.a_hat, k),
            product: (0..k).map(below).collect(),
            inverse_product: Weights::new(k + 1, |i, j| match (i, j) {
                (i, j) if i < k && j > 0 => inverse[(i, j - 1)],
                _ => 0.0,
            }),
        })
    }

    /// h b and h b̂.
    pub(super) fn weights(&self, h: f64) -> [Lanes; 2] {
        [self.b * h, self.b_hat * h]
    }
}

/// The weights that extrapolate the step before, and the step sizes that they are for.
#[derive(Clone, Debug)]
pub(super) struct StartWeights {
    place: [u64; 2],
    pub(super) z: Weights,
    pub(super) lam: Weights,
    pub(super) end: Vec<f64>,
}

impl StartWeights {
    pub(super) fn new(tableau: &tableau::Spark) -> Self {
        let (s, k) = (tableau.stages, tableau.intervals);
        Self {
            place: [f64::NAN.to_bits(); 2],
            z: Weights::new(s + 2, |_, _| 0.0),
            lam: Weights::new(k + 1, |_, _| 0.0),
            end: vec![0.0; s + 2],
        }
    }

    /// Takes the weights there are.
    pub(super) fn update<R: Real>(&mut self, held: &newton::Predictor<R>) {
        let place = held.weights_key().map(f64::to_bits);
        if place == self.place {
            return;
        }
        self.place = place;
        for (weights, curve) in [(&mut self.z, Z), (&mut self.lam, LAM)] {
            let [of, end] = held.curves[curve].weights();
            weights.set(|i, j| of[(i.min(of.rows() - 1), j)]);
            if curve == Z {
                self.end.copy_from_slice(end.row(0));
            }
        }
    }
}
