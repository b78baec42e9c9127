//! Whether an energy that is kept, or can only fall, changes as only steps that are too large change it.
//!
//! The size of an energy that is E₀ at the start is |E₀| and the mean kinetic energy so far. A change is one by more than
//! that size, or of an energy that can only fall a rise by a fifth of it. A jump parts all energies before from all
//! after it by a thousandth of the size, and by a thousand times the typical change, so that a change that others are
//! like is no jump. Errors that come and go, as those of symplectic methods, part no energies. What roundings of the states change the energy by is none of these.

use liouville_base::checkpoint;
use liouville_base::observe::Finding;

/// The part of the size that is a change, of an energy that is kept and of one that can only fall.
const CHANGE: [f64; 2] = [1.0, 0.2];
/// No change counts below this part of the present kinetic energy.
const PART: f64 = 0.1;
/// The part of the size that is a jump, if it is so many times the typical change.
const JUMP: f64 = 1e-3;
const CONSPICUOUS: f64 = 1e3;
/// A typical change follows a further one by this factor, up or down: it stays about the median of late.
const PULL: f64 = 4.0;
/// Forces take from the energy if their power is at most this part of the largest that they take.
const NOISE: f64 = 1e-12;

/// Follows the energy of one motion, in memory of fixed size.
#[derive(Clone, Debug, Default)]
pub struct EnergyWatch {
    /// Whether the energy can only fall, as of methods that damp or of friction: only a rise counts.
    falls: bool,
    looks: usize,
    start: (f64, f64),
    last: (f64, f64),
    lowest: (f64, f64),
    /// The sum of kinetic energies.
    kinetic: f64,
    /// About the median of the changes from look to look, of late.
    typical: f64,
    /// The change of the energy by resets.
    by_resets: f64,
    /// The most that roundings were found to change the energy by.
    noise: f64,
    /// The least and the largest power of forces.
    power: [f64; 2],
    change: Option<[(f64, f64); 2]>,
    /// Rises and falls that part the energies.
    sides: [Climb; 2],
}

/// The highest energy, or the highest of −E, and a jump that parts all energies before it from all after it.
#[derive(Clone, Debug, Default)]
struct Climb {
    highest: f64,
    jump: Option<Parting>,
}

/// The highest energy before, the lowest after it, and the times around.
#[derive(Clone, Copy, Debug, Default)]
struct Parting {
    below: f64,
    above: f64,
    between: (f64, f64),
}

impl Parting {
    fn width(&self) -> f64 {
        self.above - self.below
    }
}

impl EnergyWatch {
    /// A watch that has seen nothing yet.
    pub fn new(falls: bool) -> Self {
        Self {
            falls,
            ..Self::default()
        }
    }

    /// Looks at the energy, the kinetic energy and powers of forces at `t`; `roundings` finds by how much roundings of
    /// the state there change the energy.
    pub fn look(
        &mut self,
        t: f64,
        [energy, kinetic]: [f64; 2],
        powers: &[f64],
        roundings: impl FnMut() -> f64,
    ) {
        let energy = energy - self.by_resets;
        let has_overflown = !self.last.1.is_finite();
        self.looks += 1;
        self.kinetic += kinetic.abs();
        for power in powers {
            self.power = [self.power[0].min(*power), self.power[1].max(*power)];
        }
        if self.looks == 1 {
            self.start = (t, energy);
            self.lowest = self.start;
            self.sides[0].highest = energy;
            self.sides[1].highest = -energy;
        } else if !has_overflown {
            self.compare(t, energy, kinetic.abs(), roundings);
        }
        self.last = (t, energy);
    }

    fn compare(&mut self, t: f64, energy: f64, kinetic: f64, mut roundings: impl FnMut() -> f64) {
        let noise = &mut self.noise;
        let mut counts = |change: f64, least: f64| {
            if change > least.max(*noise) {
                *noise = noise.max(roundings());
            }
            change > least.max(*noise)
        };
        let (first, mean) = (self.start.1.abs(), self.kinetic / self.looks as f64);
        let size = first + mean;
        let step = (energy - self.last.1).abs();
        self.typical = match self.looks {
            2 => step,
            _ if step > self.typical => self.typical * PULL,
            _ => self.typical * (1.0 / PULL),
        };
        self.typical = self.typical.max(f64::EPSILON * size);
        let from = if self.falls { self.lowest } else { self.start };
        let change = energy - from.1;
        let change = if self.falls { change } else { change.abs() };
        let least = (CHANGE[usize::from(self.falls)] * size).max(PART * kinetic);
        // the first change, and the largest rise
        let largest = match self.change {
            Some([low, high]) if self.falls => high.1 - low.1,
            Some(_) => f64::INFINITY,
            None => 0.0,
        };
        if counts(change, least.max(largest)) {
            self.change = Some([from, (t, energy)]);
        }
        if energy < self.lowest.1 {
            self.lowest = (t, energy);
        }
        let least = (JUMP * first.max(mean)).max(CONSPICUOUS * self.typical);
        let sides = if self.falls { 1 } else { 2 };
        for (side, energy) in self.sides[..sides].iter_mut().zip([energy, -energy]) {
            side.jump = side.jump.and_then(|jump| {
                let above = jump.above.min(energy);
                let jump = Parting { above, ..jump };
                (jump.width() > least).then_some(jump)
            });
            if side.jump.is_none() && counts(energy - side.highest, least) {
                side.jump = Some(Parting {
                    below: side.highest,
                    above: energy,
                    between: (self.last.0, t),
                });
            }
            side.highest = side.highest.max(energy);
        }
    }

    /// Goes on from the energy after a reset, whose change is none of the steps.
    pub fn restart(&mut self, energy: f64) {
        if self.looks > 0 {
            self.by_resets = energy - self.last.1;
        }
    }

    /// Returns the finding: for a "change" or a "rise" two times and the energies there, for a "jump" the times around
    /// it and its part of the energy's size. Where forces may add to an energy, nothing is found.
    pub fn found(&self) -> Option<Finding> {
        let [least, most] = self.power;
        if most > -NOISE * least {
            return None;
        }
        let mean = self.kinetic / self.looks as f64;
        let first = self.start.1.abs();
        // the size of an energy that rises is that of the whole run
        let least = if self.falls {
            CHANGE[1] * (first + mean)
        } else {
            0.0
        };
        let change = self
            .change
            .filter(|[from, to]| (to.1 - from.1).abs() > least);
        let change = change.map(|[from, to]| vec![from.0, to.0, from.1, to.1]);
        let jumps = self.sides.iter().filter_map(|side| side.jump);
        let widest = jumps.max_by(|a, b| a.width().total_cmp(&b.width()));
        match (change, widest.filter(|_| self.last.1.is_finite())) {
            (Some(numbers), _) if !self.falls => Some(("change", numbers)),
            (_, Some(jump)) => {
                let ((from, to), size) = (jump.between, first.max(mean));
                Some(("jump", vec![from, to, jump.width() / size]))
            }
            (change, None) => change.map(|numbers| ("rise", numbers)),
        }
    }
}

checkpoint!(Parting {
    below,
    above,
    between
});
checkpoint!(Climb { highest, jump });
checkpoint!(EnergyWatch {
    looks,
    start,
    last,
    lowest,
    kinetic,
    typical,
    by_resets,
    noise,
    power,
    change,
    sides
});
