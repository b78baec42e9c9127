//! A spline of two coordinates and of frozen ones, as the Hamiltonian of the two, and what of it is near a start.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use crate::basis::{Basis, Place};
use crate::flow::{Fault, Near};
use crate::window::{Frozen, Window};
use crate::{Malformed, finite, size};

/// The last correction, as a part of a cell: what it leaves is its square.
const CORRECTION: f64 = 1e-10;

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
    fn mean(&self, last: Option<Place>) -> [f64; 2] {
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

    /// F, v' and w' at frozen coordinates, v and w.
    ///
    /// # Errors
    /// The number of a coordinate that is outside its axis.
    pub fn sample(&self, x: [f64; 4]) -> Result<[f64; 3], Fault> {
        match (self.axes[0].degree(), self.frozen()) {
            (3, 0) => self.sampled::<4, 6, 0>(x),
            (3, 1) => self.sampled::<4, 6, 1>(x),
            (3, _) => self.sampled::<4, 6, 2>(x),
            (_, 0) => self.sampled::<6, 8, 0>(x),
            (_, 1) => self.sampled::<6, 8, 1>(x),
            _ => self.sampled::<6, 8, 2>(x),
        }
    }

    fn sampled<const N: usize, const M: usize, const K: usize>(
        &self,
        x: [f64; 4],
    ) -> Result<[f64; 3], Fault> {
        let local = Local::<N, M, K>::new(self, &x, false)?;
        let (values, slopes) = self.axes[1].values_and_slopes::<N>(local.place);
        let cell = local.place.cell;
        let (by_v, _) = local.window.implicit(cell, (&values, &slopes));
        let (value, by_w) = (
            local.window.explicit(cell, &values),
            local.window.explicit(cell, &slopes),
        );
        Ok([value, local.mean[0] + by_w, local.mean[1] - by_v])
    }
}

/// The potential near a start: all but the frozen coordinates and the explicit one contracted.
pub(crate) struct Local<'a, const N: usize, const M: usize, const K: usize> {
    /// The axis of the implicit coordinate.
    axis: &'a Basis,
    frozen: Frozen<'a, K>,
    /// The cell of the explicit coordinate, and its functions there.
    cell: usize,
    values: [f64; N],
    slopes: [f64; N],
    window: Window<M>,
    /// The implicit coordinate.
    place: Place,
    pub(crate) mean: [f64; 2],
    is_inner: bool,
    /// The last correction, as a part of a cell.
    last: f64,
}

impl<'a, const N: usize, const M: usize, const K: usize> Local<'a, N, M, K> {
    #[inline(always)]
    pub(crate) fn new(spline: &'a Spline, x: &[f64; 4], is_adjoint: bool) -> Result<Self, Fault> {
        let mut places = [Place::none(); K];
        for k in 0..K {
            places[k] = spline.frozen[k].locate(x[k]).ok_or(Fault::Outside(k))?;
        }
        let (e, u) = (usize::from(is_adjoint), usize::from(!is_adjoint));
        let fixed = spline.axes[e].locate(x[K + e]);
        let fixed = fixed.ok_or(Fault::Outside(K + e))?;
        let place = spline.axes[u].locate(x[K + u]);
        let place = place.ok_or(Fault::Outside(K + u))?;
        let (values, slopes) = spline.axes[e].values_and_slopes::<N>(fixed);
        let frozen = Frozen::new(spline, &spline.frozen, places);
        let is_inner = !is_adjoint;
        let explicit = (fixed.cell, &values, &slopes);
        Ok(Self {
            window: Window::new(&frozen, explicit, place.cell, is_inner),
            mean: spline.mean(places.last().copied()),
            cell: fixed.cell,
            frozen,
            values,
            slopes,
            place,
            is_inner,
            axis: &spline.axes[u],
            last: 0.0,
        })
    }
}

impl<const N: usize, const M: usize, const K: usize> Near for Local<'_, N, M, K> {
    #[inline(always)]
    fn implicit(&mut self) -> (f64, f64) {
        let (values, slopes) = self.axis.values_and_slopes::<N>(self.place);
        self.window.implicit(self.place.cell, (&values, &slopes))
    }

    #[inline(always)]
    fn explicit(&mut self) -> f64 {
        let (_, slopes) = self.axis.values_and_slopes::<N>(self.place);
        self.window.explicit(self.place.cell, &slopes)
    }

    #[inline(always)]
    fn go(&mut self, u: f64) {
        self.axis.go(&mut self.place, u);
        if !self.window.holds(self.place.cell) {
            let explicit = (self.cell, &self.values, &self.slopes);
            self.window = Window::new(&self.frozen, explicit, self.place.cell, self.is_inner);
        }
    }

    #[inline(always)]
    fn is_solved(&mut self, now: f64, correction: f64) -> bool {
        let inverse = self.axis.inverse(self.place.cell);
        self.last = correction.abs() * inverse;
        let rounding = f64::EPSILON * now.abs() * inverse;
        self.last <= CORRECTION + 8.0 * rounding
    }

    #[cold]
    fn fault(&self, now: f64) -> Fault {
        // an iterate that has left the grid goes on along the polynomials of its last cell
        if self.axis.locate(now).is_none() {
            return Fault::Outside(K + usize::from(self.is_inner));
        }
        Fault::NotConverged(self.last)
    }
}
