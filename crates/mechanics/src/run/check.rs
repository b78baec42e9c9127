//! Refusal of a method that does not step its system, and of a job that fits neither.

use super::{Control, Detection, Job, Method, Problem, SparkMethod, System};
use crate::events::Law;
use liouville_base::composition::NeedsAdjoint;
use liouville_base::run::StartError;
use liouville_base::tape::Tape;
use liouville_problem::{Turning, Watched};
use std::sync::Arc;

impl System {
    /// The system as the method steps it.
    pub(super) fn new(problem: Problem, method: Method) -> Result<Self, StartError> {
        match (problem, method) {
            (Problem::General(problem, pools), Method::Spark(spark)) => {
                let stages = spark.composition()?;
                Ok(Self::Spark((problem, pools), spark, stages))
            }
            (Problem::Separable(problem), Method::Spark(spark)) => {
                if (spark.tableau.stages, spark.tableau.intervals) != (2, 1) {
                    return invalid("RATTLE is the Lobatto pair of two stages");
                }
                Ok(Self::Rattle(problem, spark.composition()?))
            }
            (Problem::SemiExplicit(problem), Method::Spark(spark)) => {
                let stages = spark.composition()?;
                if spark.tableau.stages != spark.tableau.intervals {
                    return invalid("a semi-explicit system is stepped on Gauss or Radau points");
                }
                Ok(Self::Index2(problem, spark, stages))
            }
            (Problem::SecondOrder(problem), Method::Alpha(weights, reactions, newton_tol)) => {
                check_newton_tol(newton_tol)?;
                Ok(Self::Alpha(problem, weights, reactions, newton_tol))
            }
            _ => invalid("the method does not step such a system"),
        }
    }

    /// Sizes of y and z, and of the parameters.
    pub(super) fn sizes(&self) -> ([usize; 2], usize) {
        if let Self::Index2(problem, ..) = self {
            let params = problem.field.inputs().last();
            return ([problem.n, problem.l], params.copied().unwrap_or(0));
        }
        let mechanical = self.mechanical();
        ([mechanical.n; 2], mechanical.stage.inputs()[3])
    }

    /// The number of multipliers beside y and z.
    pub(super) fn multipliers(&self) -> usize {
        match self {
            Self::Index2(..) => 0,
            _ => self.mechanical().recorded_multipliers(),
        }
    }

    /// The controls that the method has, by the names of their kinds.
    fn has(&self, control: &Control) -> bool {
        match control {
            Control::Fixed | Control::Held(_) => true,
            Control::Adaptive { .. } => {
                matches!(
                    self,
                    Self::Spark(_, _, None) | Self::Alpha(..) | Self::Index2(_, _, None)
                )
            }
            Control::Reversible { monitor, .. } => match self {
                Self::Spark(..) | Self::Rattle(..) => true,
                Self::Index2(_, spark, _) => monitor.is_some() && spark.tableau.is_symmetric(),
                Self::Alpha(..) => false,
            },
        }
    }
}

fn check_newton_tol(tolerance: Option<f64>) -> Result<(), StartError> {
    if tolerance.is_some_and(|x| !(x > 0.0 && x < 1.0)) {
        return invalid("newton_tol is between 0 and 1");
    }
    Ok(())
}

impl SparkMethod {
    /// The stages of the composition, if there is one.
    fn composition(&self) -> Result<Option<Vec<f64>>, StartError> {
        check_newton_tol(self.newton_tol)?;
        let Some(scheme) = self.scheme else {
            return Ok(None);
        };
        if !self.tableau.is_symmetric() {
            return invalid("only a symmetric method is composed");
        }
        match scheme.stages() {
            None => invalid(NeedsAdjoint(scheme.name).to_string()),
            stages => Ok(stages),
        }
    }
}

impl Job {
    /// Refuses a job that does not fit the system.
    pub(super) fn check(&self, system: &System) -> Result<(), StartError> {
        self.check_sizes(system)?;
        self.check_control(system)?;
        self.check_tangents(system)?;
        self.check_watched(system)?;
        self.check_turning(system)?;
        match &self.detection {
            Some(detection) => detection.check(system),
            None => Ok(()),
        }
    }

    fn check_sizes(&self, system: &System) -> Result<(), StartError> {
        let ([n, l], params) = system.sizes();
        let members = self.members.unwrap_or(1);
        let most = if matches!(system, System::Alpha(..)) {
            3
        } else {
            2
        };
        let times = (self.detection.iter()).flat_map(|detection| &detection.times);
        let times: usize = times.map(Vec::len).sum();
        let has_parts = self.parts.is_empty()
            || self.parts.len() == members
                && self.parts.iter().map(|(.., count)| count).sum::<usize>() == times;
        let fits = members > 0
            && has_parts
            && self.span.steps > 0
            && self.span.every > 0
            && (2..=most).contains(&self.start.len())
            && (self.start.iter().zip([n, l, n])).all(|(x, size)| x.len() == members * size)
            && [params, members * params].contains(&self.params.len())
            && match self.recorded.tape.inputs() {
                [1, y, z, p] => [y, z, p] == [&n, &l, &params],
                [1, y, z, m, p] => [y, z, m, p] == [&n, &l, &system.multipliers(), &params],
                _ => false,
            };
        if fits {
            return Ok(());
        }
        let rows = if self.members.is_some() {
            "a row for each member of "
        } else {
            ""
        };
        let z = if most == 2 { "z" } else { "z and perhaps a" };
        let sizes = if n == l {
            format!("y, {z} of size {n}")
        } else {
            format!("y of size {n} and z of size {l}")
        };
        invalid(format!(
            "a run starts from {rows}{sizes}, with params of size {params}, and has a step; its observer takes \
             [1, {n}, {l}, {params}], or multipliers before the last"
        ))
    }

    fn check_tangents(&self, system: &System) -> Result<(), StartError> {
        let Some(tangents) = &self.tangents else {
            return Ok(());
        };
        let fits = tangents.fit(system, self.members.unwrap_or(1));
        if fits && self.recorded.states && self.has_slopes() {
            return Ok(());
        }
        invalid(
            "tangents are those of a SPARK method or an index-2 method without newton_tol, or of the α family, with the \
             derivatives of all events, of the system it steps, with states",
        )
    }

    /// Whether all events have derivatives, of the sizes that they are to have.
    pub(super) fn has_slopes(&self) -> bool {
        let events = (self.detection.iter()).flat_map(|detection| &detection.events);
        let mut slopes = events.map(|event| (event, event.slopes.as_ref()));
        slopes.all(|(event, slopes)| {
            let point = event.tape.inputs();
            let Some(slopes) = slopes.filter(|_| point.len() == 5) else {
                return false;
            };
            let [n, l, lam, params] = [point[1], point[2], point[3], point[4]];
            let law = event.reset.as_ref().map(|(law, _)| law);
            slopes.fit(law, [n, l, lam, params], 1 + n + l + lam + params)
        })
    }

    fn check_turning(&self, system: &System) -> Result<(), StartError> {
        let ([n, l], params) = system.sizes();
        let fits = |own: &Turning| {
            own.tape.inputs() == [1, n, l, params] && own.tape.outputs() == 2 * own.count()
        };
        if self.recorded.turning.as_ref().is_none_or(fits) {
            return Ok(());
        }
        invalid("angles are continued by a tape of (t, y, z, params) of the angles and their rates")
    }

    fn check_watched(&self, system: &System) -> Result<(), StartError> {
        let ([n, l], params) = system.sizes();
        let point = [1, n, l, params];
        let Watched { energy, left_out } = &self.watched;
        let has_energy = |(tape, _): &(Arc<Tape>, bool)| {
            tape.inputs() == point && matches!(tape.outputs(), 2 | 4)
        };
        let members = self.members.unwrap_or(1);
        let has_sizes = |(tape, which, sizes): &(Arc<Tape>, Vec<usize>, Vec<f64>)| {
            let count = which.len();
            tape.inputs() == point && tape.outputs() == count && sizes.len() == members * count
        };
        if energy.as_ref().is_none_or(has_energy) && left_out.as_ref().is_none_or(has_sizes) {
            return Ok(());
        }
        invalid(
            "what is watched are tapes of (t, y, z, params), of two or four values for an energy, and of constraints \
             left out with a size for each and each member",
        )
    }

    fn check_control(&self, system: &System) -> Result<(), StartError> {
        let ([n, l], params) = system.sizes();
        if !system.has(&self.control) {
            let name = self.control.name();
            return invalid(format!("this method has no control {name:?}"));
        }
        if self.members.is_some() && !matches!(self.control, Control::Fixed) {
            return invalid("an ensemble has equal steps");
        }
        match &self.control {
            Control::Adaptive { tolerance, .. } if tolerance.atol.len() != n => {
                invalid(format!("atol has size {n}"))
            }
            Control::Reversible {
                monitor: Some((tape, _)),
                ..
            } if tape.inputs() != [1, n, l, l, params] || tape.outputs() != 2 => {
                invalid("a monitor is a tape of (t, y, z, z', params) with two values")
            }
            Control::Held(ends) if ends.len() < 2 => invalid("steps lie between two times or more"),
            _ => Ok(()),
        }
    }
}

impl Detection {
    fn check(&self, system: &System) -> Result<(), StartError> {
        let ([n, l], params) = system.sizes();
        let mut tapes = self.events.iter().map(|event| &event.tape);
        let point = [1, n, l, system.multipliers(), params];
        let is_event = |inputs: &[usize]| inputs == point;
        if !tapes.all(|tape| is_event(tape.inputs()) && tape.outputs() == 1) {
            return invalid("an event is a tape of (t, y, z, lam, params) with one value");
        }
        let takes_impacts = !matches!(system, System::Index2(..));
        let mut resets = self.events.iter().filter_map(|event| event.reset.as_ref());
        let fits = resets.all(|(law, rate)| {
            let of_rate = [1, n, l, params];
            let has_rate =
                (rate.as_ref()).map(|rate| rate.inputs() == of_rate && rate.outputs() == 1);
            match law {
                Law::State(tape) => {
                    is_event(tape.inputs()) && tape.outputs() == n + l && has_rate != Some(false)
                }
                Law::Impact(tape) => {
                    let is_impact = is_event(tape.inputs()) && tape.outputs() == 1 + n;
                    is_impact && takes_impacts && has_rate == Some(true)
                }
            }
        });
        if fits {
            return Ok(());
        }
        invalid(
            "a reset is a tape of (t, y, z, lam, params) of the state after it, or of an impact with the rate of its \
             event",
        )
    }
}

fn invalid<T>(sentence: impl Into<String>) -> Result<T, StartError> {
    Err(StartError::Invalid(sentence.into()))
}
