//! A spline of two coordinates and of frozen ones, as the Hamiltonian of the two.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use crate::basis::{Basis, Place};
use crate::{Malformed, finite, size};

/// A spline of two coordinates and of frozen ones, as the Hamiltonian of the two.
#[derive(Clone, Debug, PartialEq)]
pub struct Spline {
    pub(crate) frozen: Vec<Basis>,
    /// The axes of v and w.
    pub(crate) axes: [Basis; 2],
    /// Coefficients, those of the frozen coordinates first, then v, then w.
    pub(crate) coefficients: Vec<f64>,
    /// Coefficients of U and V by the functions of the last frozen axis; one number where they are constant.
    pub(crate) mean: [Vec<f64>; 2],
}

impl Spline {
    /// The Hamiltonian with these axes and coefficients, and the mean flow beside it.
    ///
    /// # Errors
    /// Sizes that do not fit, or numbers that are not finite.
    pub fn new(
        frozen: Vec<Basis>,
        axes: [Basis; 2],
        coefficients: Vec<f64>,
        mean: [Vec<f64>; 2],
    ) -> Result<Self, Malformed> {
        let degree = axes[0].degree();
        if axes[1].degree() != degree || !(degree == 3 || degree == 5) {
            let wanted = "3 or 5 in both coordinates of a plane";
            return Err(Malformed::Degree { degree, wanted });
        }
        if frozen.len() > 2 {
            return Err(Malformed::Size {
                name: "frozen coordinates",
                found: frozen.len(),
                wanted: 2,
            });
        }
        let shape = frozen.iter().chain(&axes).map(Basis::functions);
        size("coefficients", coefficients.len(), shape.product())?;
        finite("coefficient", &coefficients)?;
        for mean in &mean {
            finite("mean flow", mean)?;
            if mean.len() != 1 {
                let last = frozen.last().map_or(1, Basis::functions);
                size("mean flow", mean.len(), last)?;
            }
        }
        Ok(Self {
            frozen,
            axes,
            coefficients,
            mean,
        })
    }

    /// How many coordinates are frozen.
    pub fn frozen(&self) -> usize {
        self.frozen.len()
    }

    /// Adds the coefficients of a patch, times a weight.
    #[inline(always)]
    pub(crate) fn gather<const C: usize, const R: usize>(
        &self,
        patch: &mut [[f64; C]; R],
        weight: Option<f64>,
        corner: usize,
        stride: usize,
    ) {
        for (r, row) in patch.iter_mut().enumerate() {
            let own = &self.coefficients[corner + r * stride..][..C];
            for k in 0..C {
                row[k] = match weight {
                    Some(weight) => row[k] + weight * own[k],
                    None => own[k],
                };
            }
        }
    }

    /// U and V, given the last frozen coordinate.
    #[inline(always)]
    pub(crate) fn mean(&self, last: Option<Place>) -> [f64; 2] {
        let mean = |mean: &Vec<f64>| match (last, self.frozen.last()) {
            (Some(place), Some(basis)) if mean.len() > 1 => {
                let values = basis.values(place);
                let own = &mean[place.cell..=place.cell + basis.degree()];
                own.iter()
                    .zip(values)
                    .fold(0.0, |sum, (c, value)| sum + value * c)
            }
            _ => mean[0],
        };
        [mean(&self.mean[0]), mean(&self.mean[1])]
    }
}
