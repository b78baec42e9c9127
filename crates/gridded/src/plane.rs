//! The flow of two coordinates by a Hamiltonian, the others frozen: symplectic Euler with Newton's method.
//!
//!     v' = F_w + U,   w' = −F_v + V
//!     w1 = w0 − h F_v(v0, w1) + h V,   v1 = v0 + h F_w(v0, w1) + h U
//!
//! and its adjoint, in which v is implicit. U and V are a mean flow, which has no periodic potential. The determinant of the
//! derivative is (1 + h F_vw)^−1 (1 + h F_vw) = 1 where the scalar equation is solved. With u the implicit and e the
//! explicit coordinate, both are u1 = u0 + σ h F_e(e0, u1), e1 = e0 − σ h F_u(e0, u1).
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use crate::basis::{Basis, Place};
use crate::window::{Frozen, Window};
use crate::{Malformed, finite, size};
use liouville_base::simd::{InstructionSet, Kernel, SimdViews, Stored};

/// Newton's corrections, of which there are two to five up to the largest steps.
pub const MOST_CORRECTIONS: usize = 12;
/// The last correction, as a part of a cell: what it leaves is its square.
const CORRECTION: f64 = 1e-10;

/// A spline of two coordinates and of frozen ones, as the Hamiltonian of the two.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    pub(crate) frozen: Vec<Basis>,
    /// The axes of v and w.
    pub(crate) axes: [Basis; 2],
    /// Coefficients, those of the frozen coordinates first, then v, then w.
    pub(crate) coefficients: Vec<f64>,
    /// Coefficients of U and V by the functions of the last frozen axis; one number where they are constant.
    pub(crate) mean: [Vec<f64>; 2],
}

/// Why a flow could not be made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// A coordinate is outside its axis, by its number among frozen ones, v and w.
    Outside(usize),
    /// Newton's method did not converge; the last correction in parts of a cell.
    NotConverged(f64),
}

/// A flow of one trajectory: coordinates are the frozen ones, v and w.
#[derive(Clone, Copy, Debug)]
pub struct PlaneFlow<'a> {
    /// The Hamiltonian.
    pub plane: &'a Plane,
    /// The coordinates.
    pub x: [f64; 4],
    /// Whether v is implicit.
    pub is_adjoint: bool,
    /// The length of the flow.
    pub h: f64,
}

impl Plane {
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
struct Local<'a, const N: usize, const M: usize, const K: usize> {
    frozen: Frozen<'a, K>,
    /// The cell of the explicit coordinate, and its functions there.
    cell: usize,
    values: [f64; N],
    slopes: [f64; N],
    window: Window<M>,
    /// The implicit coordinate.
    place: Place,
    mean: [f64; 2],
    is_inner: bool,
}

impl<'a, const N: usize, const M: usize, const K: usize> Local<'a, N, M, K> {
    #[inline(always)]
    fn new(plane: &'a Plane, x: &[f64; 4], is_adjoint: bool) -> Result<Self, Fault> {
        let mut places = [Place::none(); K];
        for k in 0..K {
            places[k] = plane.frozen[k].locate(x[k]).ok_or(Fault::Outside(k))?;
        }
        let (e, u) = (usize::from(is_adjoint), usize::from(!is_adjoint));
        let fixed = plane.axes[e].locate(x[K + e]);
        let fixed = fixed.ok_or(Fault::Outside(K + e))?;
        let place = plane.axes[u].locate(x[K + u]);
        let place = place.ok_or(Fault::Outside(K + u))?;
        let (values, slopes) = plane.axes[e].values_and_slopes::<N>(fixed);
        let frozen = Frozen::new(plane, &plane.frozen, places);
        let is_inner = !is_adjoint;
        let explicit = (fixed.cell, &values, &slopes);
        Ok(Self {
            window: Window::new(&frozen, explicit, place.cell, is_inner),
            mean: plane.mean(places.last().copied()),
            cell: fixed.cell,
            frozen,
            values,
            slopes,
            place,
            is_inner,
        })
    }

    /// Moves the implicit coordinate to where an iterate is.
    #[inline(always)]
    fn go(&mut self, axis: &Basis, u: f64) {
        axis.go(&mut self.place, u);
        if !self.window.holds(self.place.cell) {
            let explicit = (self.cell, &self.values, &self.slopes);
            self.window = Window::new(&self.frozen, explicit, self.place.cell, self.is_inner);
        }
    }
}

impl PlaneFlow<'_> {
    /// Makes the flow: the new v and w.
    ///
    /// # Errors
    /// A coordinate is outside its axis, or the equation was not solved.
    pub fn run(self, machine: InstructionSet) -> Result<[f64; 2], Fault> {
        f64::run(machine, self)
    }

    /// The flow with `N` functions on a cell, `M` in a window and `K` frozen coordinates.
    #[inline(always)]
    fn solved<const N: usize, const M: usize, const K: usize>(&self) -> Result<[f64; 2], Fault> {
        let Self {
            plane,
            x,
            is_adjoint,
            h,
        } = *self;
        let mut local = Local::<N, M, K>::new(plane, &x, is_adjoint)?;
        let (e, u) = (usize::from(is_adjoint), usize::from(!is_adjoint));
        let sigma = if is_adjoint { h } else { -h };
        let (axis, start, mean) = (&plane.axes[u], x[K + u], local.mean);
        let target = start + mean[u] * h;
        let (mut now, mut is_solved, mut last) = (start, false, 0.0);
        for _ in 0..MOST_CORRECTIONS {
            let (values, slopes) = axis.values_and_slopes::<N>(local.place);
            let functions = (&values, &slopes);
            let (change, slope) = local.window.implicit(local.place.cell, functions);
            let residual = now - target - change * sigma;
            let correction = residual / (1.0 - slope * sigma);
            now -= correction;
            local.go(axis, now);
            let inverse = axis.inverse(local.place.cell);
            last = correction.abs() * inverse;
            let rounding = f64::EPSILON * now.abs() * inverse;
            if last <= CORRECTION + 8.0 * rounding {
                is_solved = true;
                break;
            }
        }
        if !is_solved {
            // an iterate that has left the grid goes on along the polynomials of its last cell
            let is_outside = axis.locate(now).is_none();
            return Err(if is_outside {
                Fault::Outside(K + u)
            } else {
                Fault::NotConverged(last)
            });
        }
        let (_, slopes) = axis.values_and_slopes::<N>(local.place);
        let other = local.window.explicit(local.place.cell, &slopes);
        let moved = x[K + e] + mean[e] * h - other * sigma;
        Ok(if is_adjoint {
            [now, moved]
        } else {
            [moved, now]
        })
    }
}

impl Kernel<f64> for PlaneFlow<'_> {
    type Output = Result<[f64; 2], Fault>;

    #[inline(always)]
    fn run<W: SimdViews<Stored = f64>>(self, views: W) -> Self::Output {
        match (self.plane.axes[0].degree(), self.plane.frozen()) {
            (3, 0) => views.call(Sized::<4, 6, 0>(self)),
            (3, 1) => views.call(Sized::<4, 6, 1>(self)),
            (3, _) => views.call(Sized::<4, 6, 2>(self)),
            (_, 0) => views.call(Sized::<6, 8, 0>(self)),
            (_, 1) => views.call(Sized::<6, 8, 1>(self)),
            _ => views.call(Sized::<6, 8, 2>(self)),
        }
    }
}

/// A flow with the sizes that it is compiled for.
struct Sized<'a, const N: usize, const M: usize, const K: usize>(PlaneFlow<'a>);

impl<const N: usize, const M: usize, const K: usize> Kernel<f64> for Sized<'_, N, M, K> {
    type Output = Result<[f64; 2], Fault>;

    #[inline(always)]
    fn run<W: SimdViews<Stored = f64>>(self, _: W) -> Self::Output {
        self.0.solved::<N, M, K>()
    }
}
