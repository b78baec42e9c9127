//! A spline near the start of a flow.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use crate::basis::{Basis, Place};
use crate::equation::{Fault, Near};
use crate::spline::Spline;
use crate::window::{Frozen, Window};

/// The last correction, as a part of a cell: what it leaves is its square.
const CORRECTION: f64 = 1e-10;

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

impl Spline {
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
