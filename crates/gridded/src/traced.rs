//! A Hamiltonian of two coordinates and of frozen ones that is given by programs.

use crate::equation::{Fault, MOST_CORRECTIONS, Near};
use crate::{Malformed, finite, size};
use liouville_base::real::Real;
use liouville_base::tape::{Registers, Tape};
use std::sync::Arc;

/// A Hamiltonian F(c, v, w; params) with frozen coordinates c, and its derivatives.
#[derive(Clone, Debug)]
pub struct Traced {
    frozen: usize,
    /// F
    value: Arc<Tape>,
    /// F_v, F_w and F_vw
    slopes: Arc<Tape>,
    /// F_v, F_w, F_vv, F_vw and F_ww, then F_v and F_w by each frozen coordinate, and by each parameter.
    jet: Arc<Tape>,
    params: Vec<f64>,
    /// Whether F_vw is zero.
    is_separable: bool,
}

/// The registers of the programs.
pub(crate) type Programs<R> = [Registers<R>; 3];

/// 1 − σ F_eu is above this: the equation has one solution near its start.
const LEAST: f64 = 0.05;
/// Corrections below this part of a coordinate, in roundoffs, are none, ...
const ROUNDOFFS: f64 = 4.0;
/// ... and the last of all may be this much larger: F is made of numbers that cancel.
const STALLED: f64 = 1e-13;

impl Traced {
    /// The Hamiltonian by its programs, whose arguments are all coordinates, and the parameters.
    ///
    /// # Errors
    /// Sizes that do not fit, or parameters that are not finite.
    pub fn new(
        frozen: usize,
        value: Arc<Tape>,
        slopes: Arc<Tape>,
        jet: Arc<Tape>,
        params: Vec<f64>,
        is_separable: bool,
    ) -> Result<Self, Malformed> {
        if frozen > 2 {
            return Err(Malformed::Size {
                name: "frozen coordinates",
                found: frozen,
                wanted: 2,
            });
        }
        let of_jet = 5 + 2 * (frozen + params.len());
        for (tape, outputs) in [(&value, 1), (&slopes, 3), (&jet, of_jet)] {
            size("arguments", tape.inputs().len(), 2)?;
            size("coordinates", tape.inputs()[0], frozen + 2)?;
            size("parameters", tape.inputs()[1], params.len())?;
            size("values", tape.outputs(), outputs)?;
        }
        finite("parameter", &params)?;
        Ok(Self {
            frozen,
            value,
            slopes,
            jet,
            params,
            is_separable,
        })
    }

    pub(crate) fn frozen(&self) -> usize {
        self.frozen
    }

    pub(crate) fn params(&self) -> &[f64] {
        &self.params
    }

    pub(crate) fn programs<R: Real>(&self) -> Programs<R> {
        let params: Vec<R> = self.params.iter().map(|p| R::splat(*p)).collect();
        [&self.value, &self.slopes, &self.jet].map(|tape| tape.bind(&params))
    }

    /// F, v' and w'.
    pub(crate) fn sample(
        &self,
        x: [f64; 4],
        [value, slopes, _]: &mut Programs<f64>,
    ) -> Result<[f64; 3], Fault> {
        let x = &x[..self.frozen + 2];
        let value = self.value.eval(value, [x])[0];
        let slopes = self.slopes.eval(slopes, [x]);
        let found = [value, slopes[1], -slopes[0]];
        let is_finite = found.iter().all(|x| x.is_finite());
        is_finite.then_some(found).ok_or(Fault::NotFinite)
    }

    /// The values of the program of all derivatives.
    pub(crate) fn jet<'a>(&self, x: [f64; 4], [_, _, jet]: &'a mut Programs<f64>) -> &'a [f64] {
        self.jet.eval(jet, [&x[..self.frozen + 2]])
    }

    pub(crate) fn near<'a, R: Real>(
        &'a self,
        x: &[R; 4],
        is_adjoint: bool,
        h: f64,
        [_, registers, _]: &'a mut Programs<R>,
    ) -> Starts<'a, R> {
        let (e, u) = (usize::from(is_adjoint), usize::from(!is_adjoint));
        Starts {
            tape: &self.slopes,
            registers,
            x: *x,
            width: self.frozen + 2,
            place: self.frozen + u,
            start: x[self.frozen + u],
            e,
            u,
            sigma: if is_adjoint { h } else { -h },
            is_separable: self.is_separable,
            made: 0,
            last: R::splat(f64::INFINITY),
            slope: R::splat(0.0),
        }
    }
}

/// Programs at starts, as functions of the implicit coordinate.
pub(crate) struct Starts<'a, R> {
    tape: &'a Tape,
    registers: &'a mut Registers<R>,
    x: [R; 4],
    width: usize,
    /// The place of the implicit coordinate, and that at the start.
    place: usize,
    start: R,
    e: usize,
    u: usize,
    sigma: f64,
    is_separable: bool,
    /// How many corrections there were, and the last one.
    made: usize,
    last: R,
    /// F_eu at the last iterate but one.
    slope: R,
}

impl<R: Real> Near<R> for Starts<'_, R> {
    fn implicit(&mut self) -> [R; 3] {
        let e = self.e;
        let slopes = self.tape.eval(self.registers, [&self.x[..self.width]]);
        self.slope = slopes[2];
        [slopes[e], slopes[2], R::splat(0.0)]
    }

    fn explicit(&mut self) -> R {
        let u = self.u;
        self.tape.eval(self.registers, [&self.x[..self.width]])[u]
    }

    fn go(&mut self, u: R) {
        self.x[self.place] = u;
    }

    /// Corrections shrink quadratically: the next one is about this one times the square of its part of the last.
    fn unsolved(&mut self, now: R, correction: R) -> R {
        self.made += 1;
        let is_last = self.made == MOST_CORRECTIONS;
        let [v, w] = [self.x[self.width - 2], self.x[self.width - 1]];
        let last = std::mem::replace(&mut self.last, correction.map(f64::abs));
        R::each(
            [correction, last, self.slope, now, self.start, v, w],
            |[correction, last, slope, now, start, v, w]| {
                let size = correction.abs();
                let roundoff = f64::EPSILON * now.abs().max(start.abs());
                let part = size / last;
                let has_stalled = || is_last && size <= STALLED * v.abs().max(w.abs());
                let is_solved = size.is_finite()
                    && 1.0 - slope * self.sigma > LEAST
                    && (self.is_separable
                        || size <= ROUNDOFFS * roundoff
                        || (last.is_finite() && size * part * part <= roundoff)
                        || has_stalled());
                f64::from(u8::from(!is_solved))
            },
        )
    }

    fn fault(&self, member: usize, now: f64) -> Fault {
        if now.is_finite() {
            Fault::NotConverged(self.last.member(member))
        } else {
            Fault::NotFinite
        }
    }
}
