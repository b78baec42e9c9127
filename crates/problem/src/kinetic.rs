//! Steps that follow the kinetic energy: s = (c + T)^(−p) with T = |z · p_z z|/2 where v = z.
//!
//! T is even under reversal of the velocities, smooth, and of the state alone. Its rate is the central difference
//! along the tangent (1, v, z'), odd to the last bit when velocities are reversed.

use super::monitor::{Metric, MonitoredPoint, PART};
use super::{Acceleration, Carried, Model};
use liouville_base::error::StepError;
use liouville_base::linalg::{copy, max_norm};
use liouville_base::observe::{Fitted, Monitor};

/// The monitor of the kinetic energy.
#[derive(Clone, Debug)]
pub struct Kinetic {
    model: Model,
    acceleration: Acceleration,
    here: MonitoredPoint,
    side: MonitoredPoint,
    metric: Metric,
    /// c and p.
    offset: f64,
    power: f64,
}

impl Kinetic {
    /// The monitor, whose steps are equal until it is fitted.
    pub fn new(model: Model) -> Self {
        let zeros = vec![0.0; model.problem.n];
        Self {
            acceleration: Acceleration::new(&model),
            here: MonitoredPoint::new(0.0, &zeros, &zeros),
            side: MonitoredPoint::new(0.0, &zeros, &zeros),
            metric: Metric::new(zeros.len()),
            offset: 0.0,
            power: 0.0,
            model,
        }
    }

    /// T at a time and a state.
    fn energy(&mut self, t: f64, state: &impl Carried) -> f64 {
        self.here.t = t;
        copy(&mut self.here.y, state.y());
        copy(&mut self.here.z, state.z());
        kinetic(&mut self.metric, &mut self.model, &self.here)
    }

    /// T a little ahead less T a little behind.
    fn difference(&mut self, step: f64) -> f64 {
        let [ahead, behind] = [step, -step].map(|step| {
            self.side.shift_from(&self.here, step);
            kinetic(&mut self.metric, &mut self.model, &self.side)
        });
        ahead - behind
    }

    /// A small part of the time in which the state changes by its own size.
    fn difference_step(&self) -> f64 {
        let MonitoredPoint { y, z, v, z_dot, .. } = &self.here;
        let times = [(z, z_dot), (y, v)].map(|(x, rate)| max_norm(x) / max_norm(rate));
        PART * times[0].min(times[1])
    }
}

fn kinetic(metric: &mut Metric, model: &mut Model, at: &MonitoredPoint) -> f64 {
    metric.squares(model, at, [&at.z])[0] / 2.0
}

impl<S: Carried> Monitor<S> for Kinetic {
    fn rate(&mut self, t: f64, state: &S) -> Result<f64, StepError> {
        if self.power == 0.0 {
            return Ok(0.0);
        }
        let energy = self.energy(t, state);
        self.here.solve(&mut self.model, &mut self.acceleration)?;
        let step = self.difference_step();
        let rate = self.difference(step) / (2.0 * step) / (self.offset + energy);
        // at rest T has no rate
        Ok(if rate.is_finite() {
            -self.power * rate
        } else {
            0.0
        })
    }
}

impl<S: Carried> Fitted<S> for Kinetic {
    fn quantity(&mut self, t: f64, state: &S) -> f64 {
        self.energy(t, state)
    }

    fn fit(&mut self, offset: f64, power: f64) {
        (self.offset, self.power) = (offset, power);
    }
}

liouville_base::checkpoint!(Kinetic {
    acceleration,
    offset,
    power
});
