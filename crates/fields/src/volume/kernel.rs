//! The flows, over whatever the state is stored in.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::State;
use super::affine::{Changes, move_along};
use super::code::{Code, Source, evaluate};
use super::exponential::grow;
use super::motion::Motion;
use super::rows::{Rows, Run};
use super::stages::{runge_kutta, substitute};
use liouville_base::composition::Flow;
use liouville_base::error::StepError;
use liouville_base::real::Scalar;
use liouville_base::simd::{ForEach, Kernel, Number, SimdView, SimdViews};

/// What flows work in beside the state.
#[derive(Clone, Debug)]
pub(super) struct Scratch<S> {
    /// What is about to be added.
    pub(super) change: Vec<S>,
    /// Z_r of each stage, and its K_r.
    pub(super) stages: Vec<[Vec<S>; 2]>,
}

/// Flows to be made one after another.
pub(super) struct Moves<'a, S> {
    pub(super) motions: &'a [Motion],
    pub(super) changes: &'a Changes,
    pub(super) flows: &'a [Flow],
    /// How much longer the first is than it says.
    pub(super) before: f64,
    pub(super) t: f64,
    pub(super) h: f64,
    pub(super) state: &'a mut State<S>,
    pub(super) scratch: &'a mut Scratch<S>,
}

impl<S: Scalar> Kernel<S> for Moves<'_, S> {
    type Output = Result<(), StepError>;

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, windows: W) -> Result<(), StepError> {
        let Self { state, scratch, .. } = self;
        let mut before = self.before;
        for flow in self.flows {
            let h = before + flow.weight * self.h;
            before = 0.0;
            match &self.motions[flow.part] {
                Motion::Natural { rows, waves } => {
                    set_waves(windows, waves, state);
                    change_rows(windows, Change::Add, rows, h, state);
                }
                Motion::Shear {
                    change,
                    waves,
                    places,
                } => {
                    set_waves(windows, waves, state);
                    shear(windows, change, places, h, state);
                }
                Motion::Scaling { rows } => change_rows(windows, Change::Scale, rows, h, state),
                Motion::Exponential(piece) => {
                    grow(windows, piece, h, state).map_err(|member| StepError::Singular {
                        piece: flow.part,
                        member,
                        t: self.t + flow.offset * self.h,
                    })?;
                }
                Motion::Triangular(piece) if piece.is_euler() => {
                    if flow.is_adjoint {
                        for level in &piece.levels {
                            change_rows(windows, Change::Add, level, h, state);
                        }
                    } else {
                        for level in piece.levels.iter().rev() {
                            change_rows(windows, Change::Add, level, h, state);
                        }
                    }
                }
                Motion::Triangular(piece) => {
                    if flow.is_adjoint {
                        substitute(windows, piece, h, state, scratch);
                    } else {
                        runge_kutta(windows, piece, h, state, scratch);
                    }
                }
                Motion::Affine(_) => {
                    let change = self.changes.find(flow.part, h);
                    move_along(windows, change, state, scratch);
                }
            }
        }
        Ok(())
    }
}

/// Adds to what a window sees, with what was lost to rounding before where that is kept.
#[inline(always)]
pub(super) fn add<W: SimdView>(
    window: W,
    (x, low): (&mut [W::Stored], &mut [W::Stored]),
    place: usize,
    change: W::Number,
) {
    let now = window.load(x, place);
    if low.is_empty() {
        window.store(x, place, now + change);
        return;
    }
    let change = change + window.load(low, place);
    let sum = now + change;
    let back = sum - now;
    let lost = (now - (sum - back)) + (change - back);
    window.store(x, place, sum);
    window.store(low, place, lost);
}

/// Multiplies what a window sees by e^exponent.
#[inline(always)]
pub(super) fn multiply<W: SimdView>(
    window: W,
    (x, low): (&mut [W::Stored], &mut [W::Stored]),
    place: usize,
    exponent: W::Number,
) {
    let now = window.load(x, place);
    if low.is_empty() {
        window.store(x, place, now * exponent.exp());
    } else {
        add(window, (x, low), place, now * exponent.exp_m1());
    }
}

/// What a window sees of the variables.
struct Seen<'a, W: SimdView> {
    window: W,
    x: &'a [W::Stored],
}

impl<W: SimdView> Source for Seen<'_, W> {
    type Number = W::Number;

    #[inline(always)]
    fn load(&self, place: u32) -> W::Number {
        self.window.load(self.x, place as usize)
    }
}

/// The value of a row for what a window sees.
#[inline(always)]
pub(super) fn value<W: SimdView>(window: W, program: &[Code], x: &[W::Stored]) -> W::Number {
    evaluate(program, window.constant(0.0), &Seen { window, x })
}

/// What is done with the value of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// x += h R
    Add,
    /// x *= exp(h p)
    Scale,
}

struct ChangeRow<'a, S> {
    program: &'a [Code],
    change: Change,
    place: usize,
    h: f64,
    state: &'a mut State<S>,
}

impl<S> ForEach<S> for ChangeRow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let value = value(window, self.program, &self.state.x).scaled(self.h);
        match self.change {
            Change::Add => add(window, self.state.parts(), self.place, value),
            Change::Scale => multiply(window, self.state.parts(), self.place, value),
        }
        true
    }
}

/// Changes a run of rows.
#[inline(always)]
pub(super) fn change_run<W: SimdViews>(
    windows: W,
    change: Change,
    (run, program): (&Run, &[Code]),
    h: f64,
    state: &mut State<W::Stored>,
) {
    let place = run.place;
    let mut row = ChangeRow {
        program,
        change,
        place,
        h,
        state,
    };
    windows.each(run.count, &mut row);
}

#[inline(always)]
fn change_rows<W: SimdViews>(
    windows: W,
    change: Change,
    rows: &Rows,
    h: f64,
    state: &mut State<W::Stored>,
) {
    for run in rows.iter() {
        change_run(windows, change, run, h, state);
    }
}

/// A wave behind the variables.
struct SetWave<'a, S> {
    program: &'a [Code],
    place: usize,
    x: &'a mut [S],
}

impl<S> ForEach<S> for SetWave<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let argument = value(window, self.program, self.x);
        window.store(self.x, self.place, argument.cos());
        true
    }
}

#[inline(always)]
fn set_waves<W: SimdViews>(windows: W, waves: &Rows, state: &mut State<W::Stored>) {
    for (run, program) in waves.iter() {
        let mut wave = SetWave {
            program,
            place: run.place,
            x: &mut state.x,
        };
        windows.each(run.count, &mut wave);
    }
}

struct ShearBy<'a, S> {
    program: &'a [Code],
    places: &'a [(u32, f64)],
    h: f64,
    state: &'a mut State<S>,
}

impl<S> ForEach<S> for ShearBy<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let change = value(window, self.program, &self.state.x).scaled(self.h);
        for &(place, direction) in self.places {
            let change = change.scaled(direction);
            add(window, self.state.parts(), place as usize, change);
        }
        true
    }
}

#[inline(always)]
fn shear<W: SimdViews>(
    windows: W,
    change: &Rows,
    places: &[(u32, f64)],
    h: f64,
    state: &mut State<W::Stored>,
) {
    for (_, program) in change.iter() {
        let mut shear = ShearBy {
            program,
            places,
            h,
            state: &mut *state,
        };
        windows.each(1, &mut shear);
    }
}

/// out = row, or the change of the state where there is none.
struct SetRow<'a, S> {
    program: &'a [Code],
    place: usize,
    x: &'a [S],
    out: &'a mut [S],
}

impl<S> ForEach<S> for SetRow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let value = value(window, self.program, self.x);
        window.store(self.out, self.place, value);
        true
    }
}

#[inline(always)]
pub(super) fn set_rows<W: SimdViews>(
    windows: W,
    rows: &Rows,
    x: &[W::Stored],
    out: &mut [W::Stored],
) {
    for (run, program) in rows.iter() {
        let mut row = SetRow {
            program,
            place: run.place,
            x,
            out: &mut *out,
        };
        windows.each(run.count, &mut row);
    }
}
