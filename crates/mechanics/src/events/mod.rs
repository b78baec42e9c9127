//! Events of a mechanical system, and its states at given times.

mod event;
mod partial;
mod search;

pub use event::Event;

use crate::problem::{Carried, Path, Point};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch};
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::observe::Observe;
use liouville_base::run::Recorder;
use liouville_base::run::{EventDetector, Seen};
use partial::PartialStep;
use search::{Node, Scene, Trust, Zero};

/// Samples of an event's function in a step.
const SAMPLES: usize = 8;
/// Relative changes of a state that may be nothing but roundoff.
const NOISE: f64 = 256.0 * f64::EPSILON;
/// A start on an event is left for this part of the first step, as a power of 2, or more.
const LEAVING: i32 = -24;

/// Finds events, and records at given times, on the interpolated trajectory.
pub struct DenseDetector<S: Stepper> {
    path: Path,
    partial: PartialStep<S>,
    events: Vec<Event>,
    nodes: Vec<Node>,
    zeros: Vec<Zero>,
    /// Zeros of all events in a step: where, and which.
    found: Vec<(f64, usize)>,
    seen: Seen,
    times: Option<Vec<f64>>,
    next: usize,
}

/// An event's function in a step that is over.
struct Looking<'a, S: Stepper> {
    path: &'a mut Path,
    partial: &'a mut PartialStep<S>,
    event: &'a mut Event,
    end: &'a S::State,
}

impl<S: Stepper> Scene for Looking<'_, S>
where
    S::State: Carried + Clone,
{
    fn rough(&mut self, x: f64) -> Result<f64, StepError> {
        rough(self.path, self.event, self.partial.t + x * self.partial.h)
    }

    fn exact(&mut self, x: f64) -> Result<f64, StepError> {
        let t = self.partial.go(x, self.end)?;
        at(self.path, self.event, t, &self.partial.state)
    }
}

/// An event's function on the interpolated trajectory.
fn rough(path: &mut Path, event: &mut Event, t: f64) -> Result<f64, StepError> {
    path.move_to(t);
    if event.needs_lam {
        path.solve_there()?;
    }
    let Point { y, z, .. } = path.point();
    event.at(t, (y, z), path.lam())
}

/// An event's function at a state.
fn at(path: &mut Path, event: &mut Event, t: f64, state: &impl Carried) -> Result<f64, StepError> {
    if event.needs_lam {
        path.solve(t, state)?;
    }
    event.at(t, (state.y(), state.z()), path.lam())
}

impl<S: Stepper> DenseDetector<S>
where
    S::State: Carried + Clone,
{
    /// Someone who looks for events along a path, and records at `times` where there are any.
    ///
    /// `stepper` makes the same steps as the run, whose state is one like `state`.
    pub fn new(
        path: Path,
        stepper: S,
        state: &S::State,
        events: Vec<Event>,
        times: Option<Vec<f64>>,
    ) -> Self {
        let seen = Seen {
            events: vec![(Vec::new(), Vec::new()); events.len()],
            end: None,
        };
        Self {
            path,
            partial: PartialStep {
                stepper,
                t: 0.0,
                h: 0.0,
                end: 0.0,
                start: state.clone(),
                state: state.clone(),
            },
            events,
            nodes: Vec::new(),
            zeros: Vec::new(),
            found: Vec::new(),
            seen,
            times,
            next: 0,
        }
    }

    /// All events' functions at the samples of a step, the last of them beyond its end.
    fn sample(&mut self, end: &S::State) -> Result<(), StepError> {
        let needs_lam = self.events.iter().any(|event| event.needs_lam);
        for event in &mut self.events {
            event.samples.clear();
        }
        for k in 1..=SAMPLES + 1 {
            let t = self.partial.t + k as f64 / SAMPLES as f64 * self.partial.h;
            let is_beyond = k > SAMPLES;
            if k == SAMPLES {
                self.path.move_near(self.partial.end, end, [0.0, 0.0]);
            } else {
                self.path.move_to(t);
            }
            let solved = if needs_lam {
                self.path.solve_there()
            } else {
                Ok(())
            };
            let is_solved = solved.is_ok();
            if !is_beyond {
                solved?;
            }
            for event in &mut self.events {
                let Point { y, z, .. } = self.path.point();
                let value = match event.at(t, (y, z), self.path.lam()) {
                    Ok(value) if is_solved || !event.needs_lam => value,
                    // what is beyond the step only tells whether the function has turned
                    _ if is_beyond => f64::NAN,
                    other => other?,
                };
                event.samples.push(value);
            }
        }
        Ok(())
    }

    /// The zeros of one event in a step, appended to `found`.
    fn search(&mut self, index: usize, end: &S::State) -> Result<(), StepError> {
        let Self {
            path,
            partial,
            events,
            nodes,
            zeros,
            ..
        } = self;
        let event = &mut events[index];
        nodes.clear();
        zeros.clear();
        let mut first = Node {
            x: 0.0,
            value: event.last,
            is_exact: true,
        };
        let mut before = Node {
            x: -1.0 / SAMPLES as f64,
            value: f64::NAN,
            is_exact: false,
        };
        if let Some((earlier, value)) = event.earlier {
            (before.x, before.value) = (-earlier / partial.h.abs(), value);
        } else {
            let t = partial.t + before.x * partial.h;
            // nothing need be there before the start
            before.value = rough(path, event, t).unwrap_or(f64::NAN);
            first = leaving(path, partial, event, first)?;
        }
        nodes.extend([before, first]);
        nodes.extend(event.samples.iter().zip(1_usize..).map(|(value, k)| Node {
            x: k as f64 / SAMPLES as f64,
            value: *value,
            is_exact: k == SAMPLES,
        }));
        event.earlier = Some((partial.h.abs() / SAMPLES as f64, event.samples[SAMPLES - 2]));
        event.last = event.samples[SAMPLES - 1];
        let resolution = f64::EPSILON / 2.0 * (partial.t / partial.h).abs().max(1.0);
        let trust = if path.is_rough() {
            Trust::LOOSE
        } else {
            Trust::FIRM
        };
        let mut sign = event.sign;
        let mut looking = Looking {
            path,
            partial,
            event,
            end,
        };
        search::zeros(&mut looking, nodes, &mut sign, (trust, resolution), zeros)?;
        event.sign = sign;
        let wanted = zeros.iter().filter(|zero| event.wants(zero.sign));
        self.found.extend(wanted.map(|zero| (zero.x, index)));
        Ok(())
    }

    /// Keeps the events of a step in the order of time, up to one that ends the run.
    fn keep(&mut self, end: &S::State) -> Result<Option<f64>, StepError> {
        self.found.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (part, index) in self.found.drain(..) {
            let t = self.partial.go(part, end)?;
            let state = &self.partial.state;
            self.path.solve(t, state)?;
            let (times, rows) = &mut self.seen.events[index];
            times.push(t);
            rows.extend_from_slice(state.y());
            rows.extend_from_slice(state.z());
            rows.extend_from_slice(self.path.lam());
            let event = &mut self.events[index];
            event.count += 1;
            if event.count == event.terminal {
                self.seen.end = Some((index, t));
                return Ok(Some(t));
            }
        }
        Ok(None)
    }

    /// Records at the wanted times up to `t`.
    fn emit<O: Observe<Point>>(&mut self, t: f64, out: &mut Recorder<O>) -> Result<(), StepError> {
        let Some(times) = &self.times else {
            return Ok(());
        };
        while let Some(wanted) = times.get(self.next) {
            if (wanted - t) * self.partial.h > 0.0 {
                break;
            }
            self.path.move_to(*wanted);
            out.record(*wanted, self.path.point())?;
            self.next += 1;
        }
        Ok(())
    }
}

/// The start of a run for an event: where its function is nothing but roundoff, shortly after it.
fn leaving<S: Stepper>(
    path: &mut Path,
    partial: &PartialStep<S>,
    event: &mut Event,
    start: Node,
) -> Result<Node, StepError>
where
    S::State: Carried + Clone,
{
    let slope = (event.samples[0] - start.value).abs() * SAMPLES as f64;
    let mut noise = NOISE * slope * (partial.t / partial.h).abs().max(1.0);
    for parts in [[NOISE, NOISE], [NOISE, -NOISE]] {
        path.move_near(partial.t, &partial.start, parts);
        if event.needs_lam {
            path.solve_there()?;
        }
        let Point { y, z, .. } = path.point();
        let value = event.at(partial.t, (y, z), path.lam())?;
        noise = noise.max((value - start.value).abs());
    }
    if start.value.abs() > noise {
        return Ok(start);
    }
    for power in LEAVING..0 {
        let x = f64::from(power).exp2() / SAMPLES as f64;
        let value = rough(path, event, partial.t + x * partial.h)?;
        if value.abs() > 2.0 * noise {
            return Ok(Node {
                x,
                value,
                is_exact: false,
            });
        }
    }
    Ok(Node {
        value: 0.0,
        ..start
    })
}

impl<S, O> EventDetector<S, O> for DenseDetector<S>
where
    S: Stepper,
    S::State: Carried + Clone + Send,
    O: Observe<Point>,
{
    fn is_recording(&self) -> bool {
        self.times.is_some()
    }

    fn start(&mut self, t: f64, state: &S::State, _: &mut Recorder<O>) -> Result<(), StepError> {
        self.path.push(t, state)?;
        self.partial.t = t;
        for event in &mut self.events {
            event.last = at(&mut self.path, event, t, state)?;
        }
        Ok(())
    }

    fn before(&mut self, t: f64, state: &S::State) {
        self.partial.t = t;
        self.partial.start.clone_from(state);
    }

    fn after(
        &mut self,
        t: f64,
        state: &mut S::State,
        out: &mut Recorder<O>,
    ) -> Result<Option<f64>, StepError> {
        (self.partial.end, self.partial.h) = (t, t - self.partial.t);
        self.path.push(t, state)?;
        let mut end = None;
        if !self.events.is_empty() {
            self.found.clear();
            self.sample(state)?;
            for index in 0..self.events.len() {
                self.search(index, state)?;
            }
            end = self.keep(state)?;
            if end.is_some() {
                state.clone_from(&self.partial.state);
            }
        }
        // earlier the polynomials would not be those of the whole run
        if self.path.is_full() || end.is_some() {
            self.emit(end.unwrap_or(t), out)?;
        }
        Ok(end)
    }

    fn finish(&mut self, out: &mut Recorder<O>) {
        let last = self.path.end();
        if self.seen.end.is_none() && !self.path.is_full() {
            // where one cannot be recorded, the records end before it
            let _ = self.emit(last, out);
        }
    }

    fn take(&mut self) -> Seen {
        Seen {
            events: self.seen.events.iter_mut().map(std::mem::take).collect(),
            end: self.seen.end,
        }
    }
}

/// What was seen is with whoever has split_front it.
impl<S: Stepper> Checkpoint for DenseDetector<S> {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.path.save(member, out);
        self.partial.stepper.save(member, out);
        self.partial.h.save(member, out);
        for event in &self.events {
            event.save(member, out);
        }
        self.seen.end.save(member, out);
        self.next.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.path.restore(member, saved)?;
        self.partial.stepper.restore(member, saved)?;
        self.partial.h.restore(member, saved)?;
        for event in &mut self.events {
            event.restore(member, saved)?;
        }
        for (times, rows) in &mut self.seen.events {
            times.clear();
            rows.clear();
        }
        self.seen.end.restore(member, saved)?;
        self.next.restore(member, saved)
    }
}
