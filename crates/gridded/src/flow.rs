//! The flow of a plane, compiled for each degree of a spline and each instruction set.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use crate::cells::Cells;
use crate::equation::{Fault, Near, solved};
use crate::plane::{Kept, Memory, Plane};
use crate::spline::Spline;
use liouville_base::real::{Lanes, Real};
use liouville_base::simd::{InstructionSet, Kernel, SimdViews, Stored};

/// A flow of one trajectory, or of several in lock-step: coordinates are the frozen ones, v and w.
#[derive(Debug)]
pub struct PlaneFlow<'a, R> {
    /// The Hamiltonian.
    pub plane: &'a Plane,
    /// Its memory.
    pub memory: &'a mut Memory<R>,
    /// The coordinates.
    pub x: &'a mut [R; 4],
    /// Whether v is implicit.
    pub is_adjoint: bool,
    /// The length of the flow.
    pub h: f64,
}

impl<R: Real + Stored> PlaneFlow<'_, R> {
    /// Moves v and w.
    ///
    /// # Errors
    /// A coordinate is outside its axis, the equation was not solved, or the Hamiltonian is not finite; and the number of
    /// the first trajectory with this fault.
    ///
    /// # Panics
    /// When the memory is that of another plane.
    #[inline(never)]
    pub fn run(&mut self, machine: InstructionSet) -> Result<(), (Fault, usize)> {
        let (x, is_adjoint, h) = (&mut *self.x, self.is_adjoint, self.h);
        match (self.plane, &mut self.memory.0) {
            (Plane::Spline(spline), Kept::Cells(cells)) => R::run(
                machine,
                OnGrid {
                    spline,
                    cells,
                    x,
                    is_adjoint,
                    h,
                },
            ),
            (Plane::Traced(traced), Kept::Programs(programs)) => {
                let near = traced.near(x, is_adjoint, h, programs);
                solved(
                    near,
                    traced.frozen(),
                    [R::splat(0.0); 2],
                    (x, is_adjoint, h),
                )
            }
            _ => panic!("memory of another plane"),
        }
    }
}

liouville_base::compiled!(R in [f64, Lanes] { PlaneFlow::<R>::run as fn(_, _) -> _ });

/// A flow on a grid.
struct OnGrid<'a, R> {
    spline: &'a Spline,
    cells: &'a mut Cells<R>,
    x: &'a mut [R; 4],
    is_adjoint: bool,
    h: f64,
}

impl<R: Real + Stored> Kernel<R> for OnGrid<'_, R> {
    type Output = Result<(), (Fault, usize)>;

    #[inline(always)]
    fn run<W: SimdViews<Stored = R>>(self, views: W) -> Self::Output {
        if self.spline.axes[0].degree() == 3 {
            views.call(OfDegree::<_, 4>(self))
        } else {
            views.call(OfDegree::<_, 6>(self))
        }
    }
}

/// A flow with the size that it is compiled for: `N` functions on a cell.
struct OfDegree<'a, R, const N: usize>(OnGrid<'a, R>);

impl<R: Real + Stored, const N: usize> Kernel<R> for OfDegree<'_, R, N> {
    type Output = Result<(), (Fault, usize)>;

    #[inline(always)]
    fn run<W: SimdViews<Stored = R>>(self, views: W) -> Self::Output {
        let OnGrid {
            spline,
            cells,
            x,
            is_adjoint,
            h,
        } = self.0;
        let frozen = spline.frozen();
        if !cells.hold(x, 0..frozen + 2) {
            let (cells, x) = (&mut *cells, &mut *x);
            views.call(Enter::<_, N> { spline, cells, x })?;
        }
        let (e, u) = (usize::from(is_adjoint), usize::from(!is_adjoint));
        let last = frozen.saturating_sub(1);
        let mean = cells.mean(cells.places[last].s(x[last]));
        let local = Local::<_, _, N>::new(views, spline, cells, x, [e, u]);
        solved(local, frozen, mean, (x, is_adjoint, h))
    }
}

/// Finds the cells of starts.
struct Enter<'a, R, const N: usize> {
    spline: &'a Spline,
    cells: &'a mut Cells<R>,
    x: &'a mut [R; 4],
}

impl<R: Real + Stored, const N: usize> Kernel<R> for Enter<'_, R, N> {
    type Output = Result<(), (Fault, usize)>;

    #[inline(always)]
    fn run<W: SimdViews<Stored = R>>(self, _: W) -> Self::Output {
        self.cells.enter::<N>(self.spline, self.x)
    }
}

/// Finds the cells of iterates.
struct Follow<'a, R, const N: usize> {
    spline: &'a Spline,
    cells: &'a mut Cells<R>,
    x: R,
    axis: usize,
}

impl<R: Real + Stored, const N: usize> Kernel<R> for Follow<'_, R, N> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = R>>(self, _: W) {
        self.cells.follow::<N>(self.spline, self.axis, self.x);
    }
}

/// A spline near the starts of flows, as a function of the implicit coordinate u, whose powers within the cell it has.
struct Local<'a, W, R, const N: usize> {
    views: W,
    spline: &'a Spline,
    cells: &'a mut Cells<R>,
    /// The frozen coordinates and e in their cells.
    frozen: [R; 2],
    explicit: (R, bool),
    /// F, and its derivative by e in its cell, by powers of u.
    values: [R; N],
    slopes: [R; N],
    u: R,
    /// The numbers of the axes of e and u.
    axes: [usize; 2],
    /// The last correction, as a part of a cell.
    last: R,
}

/// The last correction, as a part of a cell: what it leaves is its cube.
const CORRECTION: f64 = 2e-6;

impl<'a, W, R: Real, const N: usize> Local<'a, W, R, N> {
    #[inline(always)]
    fn new(
        views: W,
        spline: &'a Spline,
        cells: &'a mut Cells<R>,
        x: &[R; 4],
        [e, u]: [usize; 2],
    ) -> Self {
        let count = spline.frozen();
        let zero = R::splat(0.0);
        let mut frozen = [zero; 2];
        for k in 0..count {
            frozen[k] = cells.places[k].s(x[k]);
        }
        let axes = [count + e, count + u];
        let explicit = (cells.places[axes[0]].s(x[axes[0]]), e == 1);
        let (values, slopes) = cells.along(spline.powers(), frozen, explicit);
        Self {
            u: cells.places[axes[1]].s(x[axes[1]]),
            views,
            spline,
            cells,
            frozen,
            explicit,
            values,
            slopes,
            axes,
            last: zero,
        }
    }

    /// Cells of e and u to a unit.
    #[inline(always)]
    fn inverses(&self) -> [R; 2] {
        let [e, u] = self.axes;
        [self.cells.places[e].inverse, self.cells.places[u].inverse]
    }
}

impl<W: SimdViews<Stored = R>, R: Real + Stored, const N: usize> Near<R> for Local<'_, W, R, N> {
    #[inline(always)]
    fn implicit(&mut self) -> [R; 3] {
        let [by_e, by_u] = self.inverses();
        let [value, slope, curve] = jet(&self.slopes, self.u);
        let of_slope = by_e * by_u;
        [value * by_e, slope * of_slope, curve * (of_slope * by_u)]
    }

    #[inline(always)]
    fn explicit(&mut self) -> R {
        let [_, slope, _] = jet(&self.values, self.u);
        slope * self.cells.places[self.axes[1]].inverse
    }

    #[inline(always)]
    fn go(&mut self, u: R) {
        let axis = self.axes[1];
        if !self.cells.hold(&[u; 4], axis..axis + 1) {
            let (spline, cells) = (self.spline, &mut *self.cells);
            let x = u;
            self.views.call(Follow::<_, N> {
                spline,
                cells,
                x,
                axis,
            });
            let powers = self.spline.powers();
            let along = self.cells.along(powers, self.frozen, self.explicit);
            (self.values, self.slopes) = along;
        }
        self.u = self.cells.places[axis].s(u);
    }

    #[inline(always)]
    fn unsolved(&mut self, now: R, correction: R) -> R {
        let inverse = self.cells.places[self.axes[1]].inverse;
        self.last = abs(correction) * inverse;
        let rounding = abs(now) * inverse * (8.0 * f64::EPSILON);
        let (zero, one) = (R::splat(0.0), R::splat(1.0));
        self.last
            .if_less(rounding + R::splat(CORRECTION), zero, one)
    }

    #[cold]
    fn fault(&self, member: usize, now: f64) -> Fault {
        // an iterate that has left the grid goes on along the polynomials of its last cell
        if self.spline.axis(self.axes[1]).locate(now).is_none() {
            return Fault::Outside(self.axes[1]);
        }
        Fault::NotConverged(self.last.member(member))
    }
}

#[inline(always)]
fn abs<R: Real>(x: R) -> R {
    let zero = R::splat(0.0);
    x.if_less(zero, zero - x, x)
}

/// p, p' and p''/2 of a polynomial.
#[inline(always)]
fn jet<R: Real, const N: usize>(c: &[R; N], s: R) -> [R; 3] {
    let mut value = c[N - 1] * s + c[N - 2];
    let mut slope = c[N - 1];
    let mut curve = R::splat(0.0);
    for k in (0..N - 2).rev() {
        curve = if k == N - 3 { slope } else { curve * s + slope };
        slope = slope * s + value;
        value = value * s + c[k];
    }
    [value, slope, curve]
}
