//! A Hamiltonian of two coordinates and of frozen ones that is given by programs.

use crate::equation::{Fault, MOST_CORRECTIONS, Near};
use crate::{Malformed, finite, size};
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

/// Memory for the programs of a plane; a spline needs none.
#[derive(Clone, Debug, Default)]
pub struct Memory(Option<[Registers<f64>; 3]>);

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

    pub(crate) fn memory(&self) -> Memory {
        Memory(Some(self.bound()))
    }

    fn bound(&self) -> [Registers<f64>; 3] {
        [&self.value, &self.slopes, &self.jet].map(|tape| tape.bind(&self.params))
    }

    /// F, v' and w'.
    pub(crate) fn sample(&self, x: [f64; 4], memory: &mut Memory) -> Result<[f64; 3], Fault> {
        let [value, slopes, _] = memory.of(self);
        let x = &x[..self.frozen + 2];
        let value = self.value.eval(value, [x])[0];
        let slopes = self.slopes.eval(slopes, [x]);
        let found = [value, slopes[1], -slopes[0]];
        let is_finite = found.iter().all(|x| x.is_finite());
        is_finite.then_some(found).ok_or(Fault::NotFinite)
    }

    /// The values of the program of all derivatives.
    pub(crate) fn jet<'a>(&self, x: [f64; 4], memory: &'a mut Memory) -> &'a [f64] {
        let [_, _, jet] = memory.of(self);
        self.jet.eval(jet, [&x[..self.frozen + 2]])
    }

    pub(crate) fn near<'a>(
        &'a self,
        x: &[f64; 4],
        is_adjoint: bool,
        h: f64,
        memory: &'a mut Memory,
    ) -> Programs<'a> {
        let [_, registers, _] = memory.of(self);
        let (e, u) = (usize::from(is_adjoint), usize::from(!is_adjoint));
        Programs {
            tape: &self.slopes,
            registers,
            x: *x,
            width: self.frozen + 2,
            place: self.frozen + u,
            start: x[self.frozen + u].abs(),
            e,
            u,
            sigma: if is_adjoint { h } else { -h },
            is_separable: self.is_separable,
            made: 0,
            last: f64::INFINITY,
            slope: 0.0,
        }
    }
}

impl Memory {
    fn of(&mut self, traced: &Traced) -> &mut [Registers<f64>; 3] {
        self.0.get_or_insert_with(|| traced.bound())
    }
}

/// Programs at a start, as functions of the implicit coordinate.
pub(crate) struct Programs<'a> {
    tape: &'a Tape,
    registers: &'a mut Registers<f64>,
    x: [f64; 4],
    width: usize,
    /// The place of the implicit coordinate.
    place: usize,
    /// The size of it at the start.
    start: f64,
    e: usize,
    u: usize,
    sigma: f64,
    is_separable: bool,
    /// How many corrections there were, and the last one.
    made: usize,
    last: f64,
    /// F_eu at the last iterate but one.
    slope: f64,
}

impl Programs<'_> {
    fn slopes(&mut self) -> &[f64] {
        self.tape.eval(self.registers, [&self.x[..self.width]])
    }
}

impl Near for Programs<'_> {
    fn implicit(&mut self) -> (f64, f64) {
        let e = self.e;
        let slopes = self.slopes();
        let found = (slopes[e], slopes[2]);
        self.slope = found.1;
        found
    }

    fn explicit(&mut self) -> f64 {
        let u = self.u;
        self.slopes()[u]
    }

    fn go(&mut self, u: f64) {
        self.x[self.place] = u;
    }

    /// Corrections shrink quadratically: the next one is about this one times the square of its part of the last.
    fn is_solved(&mut self, now: f64, correction: f64) -> bool {
        let (size, last) = (correction.abs(), self.last);
        (self.last, self.made) = (size, self.made + 1);
        if !(size.is_finite() && 1.0 - self.slope * self.sigma > LEAST) {
            return false;
        }
        let (roundoff, part) = (f64::EPSILON * now.abs().max(self.start), size / last);
        let has_stalled = || {
            let [v, w] = [0, 1].map(|k| self.x[self.width - 2 + k].abs());
            self.made == MOST_CORRECTIONS && size <= STALLED * v.max(w)
        };
        self.is_separable
            || size <= ROUNDOFFS * roundoff
            || (last.is_finite() && size * part * part <= roundoff)
            || has_stalled()
    }

    fn fault(&self, now: f64) -> Fault {
        if now.is_finite() {
            Fault::NotConverged(self.last)
        } else {
            Fault::NotFinite
        }
    }
}
