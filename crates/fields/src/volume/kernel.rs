//! The flows of pieces as one kernel.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::State;
use super::affine::{AffineChange, Changes};
use super::code::{Code, Variables, evaluate};
use super::flow::{Levels, PieceFlow, Shear};
use super::functions::{FunctionScratch, Functions, SetFunctions};
use super::rows::{PolynomialRows, RowRun};
use super::stages::{RungeKutta, Substitution};
use liouville_base::composition::Flow;
use liouville_base::error::StepError;
use liouville_base::simd::{ForEach, Kernel, Number, SimdView, SimdViews, Stored};

/// Memory of flows beside the state.
#[derive(Clone, Debug)]
pub(super) struct FlowScratch<S> {
    /// The change of each variable.
    pub(super) change: Vec<S>,
    /// Z_r of each stage, and its K_r.
    pub(super) stages: Vec<[Vec<S>; 2]>,
    pub(super) functions: FunctionScratch,
}

/// Flows to be made one after another.
pub(super) struct FlowKernel<'a, S> {
    pub(super) piece_flows: &'a [PieceFlow],
    pub(super) functions: &'a Functions,
    /// The place of a variable that is the same in all trajectories.
    pub(super) clock: Option<u32>,
    pub(super) changes: &'a Changes,
    pub(super) flows: &'a [Flow],
    /// An addition to the length of the first.
    pub(super) before: f64,
    pub(super) t: f64,
    pub(super) h: f64,
    pub(super) state: &'a mut State<S>,
    pub(super) scratch: &'a mut FlowScratch<S>,
}

impl<S: Stored> Kernel<S> for FlowKernel<'_, S> {
    type Output = Result<(), StepError>;

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) -> Result<(), StepError> {
        let Self { state, scratch, .. } = self;
        scratch.functions.forget();
        let mut before = self.before;
        for flow in self.flows {
            let h = before + flow.weight * self.h;
            before = 0.0;
            let piece = &self.piece_flows[flow.part];
            if self.functions.wants(flow.part, &scratch.functions) {
                let done = views.call(SetFunctions {
                    functions: self.functions,
                    piece: flow.part,
                    clock: self.clock,
                    x: &mut state.x,
                    scratch: &mut scratch.functions,
                });
                done.map_err(|(function, member)| StepError::Function {
                    piece: flow.part,
                    function,
                    member,
                    t: self.t + flow.offset * self.h,
                })?;
            }
            self.functions.outdate(flow.part, &mut scratch.functions);
            if let Some(levels) = piece.levels(flow.is_adjoint) {
                views.call(flow_of(levels, h, state, scratch));
                continue;
            }
            match piece {
                PieceFlow::Natural { .. } | PieceFlow::Scaling { .. } => {
                    unreachable!("flows of levels are made above")
                }
                PieceFlow::Shear(piece) => views.call(flow_of(piece, h, state, scratch)),
                PieceFlow::Exponential(piece) => {
                    let done = views.call(flow_of(piece, h, state, scratch));
                    done.map_err(|member| StepError::Singular {
                        piece: flow.part,
                        member,
                        t: self.t + flow.offset * self.h,
                    })?;
                }
                PieceFlow::Triangular(piece) if flow.is_adjoint => {
                    views.call(flow_of(Substitution(piece), h, state, scratch));
                }
                PieceFlow::Triangular(piece) => {
                    views.call(flow_of(RungeKutta(piece), h, state, scratch));
                }
                PieceFlow::Turn(piece) => views.call(flow_of(piece, h, state, scratch)),
                PieceFlow::Plane(_) => unreachable!("made one member after another"),
                PieceFlow::Affine(_) => {
                    let change = AffineChange(self.changes.find(flow.part, h));
                    views.call(flow_of(change, h, state, scratch));
                }
            }
        }
        Ok(())
    }
}

/// The flow of one piece, of length `h`.
pub(super) struct FlowOf<'a, S, P> {
    pub(super) piece: P,
    pub(super) h: f64,
    pub(super) state: &'a mut State<S>,
    pub(super) scratch: &'a mut FlowScratch<S>,
}

#[inline(always)]
fn flow_of<'a, S, P>(
    piece: P,
    h: f64,
    state: &'a mut State<S>,
    scratch: &'a mut FlowScratch<S>,
) -> FlowOf<'a, S, P> {
    FlowOf {
        piece,
        h,
        state,
        scratch,
    }
}

impl<S> Kernel<S> for FlowOf<'_, S, Levels<'_>> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) {
        let Self {
            piece, h, state, ..
        } = self;
        for rows in piece.iter() {
            for run in rows.iter() {
                change_run(views, piece.change, run, h, state);
            }
        }
    }
}

/// Adds to the variable at a place, with its rounding error where that is kept.
#[inline(always)]
pub(super) fn add<W: SimdView>(
    view: W,
    (x, low): (&mut [W::Stored], &mut [W::Stored]),
    place: usize,
    change: W::Number,
) {
    let now = view.load(x, place);
    if low.is_empty() {
        view.store(x, place, now + change);
        return;
    }
    let change = change + view.load(low, place);
    let sum = now + change;
    let back = sum - now;
    let lost = (now - (sum - back)) + (change - back);
    view.store(x, place, sum);
    view.store(low, place, lost);
}

/// Multiplies the variable at a place by e^exponent.
#[inline(always)]
pub(super) fn multiply<W: SimdView>(
    view: W,
    (x, low): (&mut [W::Stored], &mut [W::Stored]),
    place: usize,
    exponent: W::Number,
) {
    let now = view.load(x, place);
    if low.is_empty() {
        view.store(x, place, now * exponent.exp());
    } else {
        add(view, (x, low), place, now * exponent.exp_m1());
    }
}

/// The variables of a state in a view.
pub(super) struct StateVariables<'a, W: SimdView> {
    pub(super) view: W,
    pub(super) x: &'a [W::Stored],
}

impl<W: SimdView> Variables for StateVariables<'_, W> {
    type Number = W::Number;

    #[inline(always)]
    fn load(&self, place: u32) -> W::Number {
        self.view.load(self.x, place as usize)
    }
}

/// The value of a row in a view.
#[inline(always)]
pub(super) fn value<W: SimdView>(view: W, program: &[Code], x: &[W::Stored]) -> W::Number {
    evaluate(program, view.constant(0.0), &StateVariables { view, x })
}

/// The use of the value of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// x += h R
    Add,
    /// x *= exp(h p)
    Scale,
}

struct ChangeRow<'a, S> {
    program: &'a [Code],
    place: usize,
    h: f64,
    state: &'a mut State<S>,
}

impl<S> ForEach<S> for ChangeRow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let value = value(view, self.program, &self.state.x).scaled(self.h);
        add(view, self.state.parts(), self.place, value);
        true
    }
}

struct ScaleRow<'a, S>(ChangeRow<'a, S>);

impl<S> ForEach<S> for ScaleRow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let row = &mut self.0;
        let value = value(view, row.program, &row.state.x).scaled(row.h);
        let x = view.load(&row.state.x, row.place);
        view.store(&mut row.state.x, row.place, x * value.exp());
        true
    }
}

/// The same with compensated sums, whose formula is long.
struct ScaleLowRow<'a, S>(ChangeRow<'a, S>);

impl<S> ForEach<S> for ScaleLowRow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let row = &mut self.0;
        let value = value(view, row.program, &row.state.x).scaled(row.h);
        multiply(view, row.state.parts(), row.place, value);
        true
    }
}

/// Changes a run of rows.
#[inline(always)]
fn change_run<W: SimdViews>(
    views: W,
    change: Change,
    (run, program): (&RowRun, &[Code]),
    h: f64,
    state: &mut State<W::Stored>,
) {
    let place = run.place;
    let is_plain = state.low.is_empty();
    if let (Change::Add, true, Some(short)) = (change, is_plain, &run.short) {
        return short.change(views, (place, run.count), h, state);
    }
    let mut row = ChangeRow {
        program,
        place,
        h,
        state,
    };
    match change {
        Change::Add => views.each(run.count, &mut row),
        Change::Scale if is_plain => views.each(run.count, &mut ScaleRow(row)),
        Change::Scale => views.each_narrow(run.count, &mut ScaleLowRow(row)),
    };
}

struct ShearBy<'a, S> {
    program: &'a [Code],
    places: &'a [(u32, f64)],
    h: f64,
    state: &'a mut State<S>,
}

impl<S> ForEach<S> for ShearBy<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let change = value(view, self.program, &self.state.x).scaled(self.h);
        for &(place, direction) in self.places {
            let change = change.scaled(direction);
            add(view, self.state.parts(), place as usize, change);
        }
        true
    }
}

impl<S> Kernel<S> for FlowOf<'_, S, &Shear> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) {
        let Self {
            piece, h, state, ..
        } = self;
        for (_, program) in piece.change.iter() {
            let mut shear = ShearBy {
                program,
                places: &piece.places,
                h,
                state: &mut *state,
            };
            views.one(&mut shear);
        }
    }
}

/// out = row
struct SetRow<'a, S> {
    program: &'a [Code],
    place: usize,
    x: &'a [S],
    out: &'a mut [S],
}

impl<S> ForEach<S> for SetRow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let value = value(view, self.program, self.x);
        view.store(self.out, self.place, value);
        true
    }
}

#[inline(always)]
pub(super) fn set_rows<W: SimdViews>(
    views: W,
    rows: &PolynomialRows,
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
        views.each(run.count, &mut row);
    }
}
