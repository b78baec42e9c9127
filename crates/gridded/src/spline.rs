//! A spline of two coordinates and of frozen ones, as the Hamiltonian of the two.

use crate::basis::Basis;
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

    /// The axis of a coordinate: of the frozen ones, v and w.
    pub(crate) fn axis(&self, k: usize) -> &Basis {
        match k.checked_sub(self.frozen.len()) {
            Some(k) => &self.axes[k],
            None => &self.frozen[k],
        }
    }

    /// How many numbers the polynomial of a cell has by each frozen coordinate; one where there is none.
    pub(crate) fn powers(&self) -> [usize; 2] {
        [0, 1].map(|k| self.frozen.get(k).map_or(1, |axis| axis.degree() + 1))
    }
}
