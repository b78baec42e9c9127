//! Windows: the outputs that one series makes, and where a run is among them.

use liouville_base::checkpoint::CheckpointMismatch;

/// The times of all outputs, and how many of them each series makes.
///
/// Without times, each step is a window of its own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Windows {
    times: Vec<f64>,
    counts: Vec<usize>,
}

impl Windows {
    /// Windows of so many outputs each.
    pub fn new(counts: Vec<usize>) -> Self {
        let times = Vec::new();
        Self { times, counts }
    }

    /// The same with the times of all outputs; none where they are not as many.
    pub fn of(self, times: Vec<f64>) -> Option<Self> {
        let Self { counts, .. } = self;
        let is_fitting = counts.iter().sum::<usize>() == times.len() && !counts.contains(&0);
        is_fitting.then_some(Self { times, counts })
    }

    /// The most outputs of a window.
    pub fn most(&self) -> usize {
        self.counts.iter().copied().max().unwrap_or(1)
    }
}

/// The next output: of which window, and which in it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Place {
    window: usize,
    /// The first output of the window, of all.
    first: usize,
    pub(super) output: usize,
    /// Where the window begins.
    pub(super) start: f64,
}

impl Place {
    /// Lengths of time from the start of the window to its outputs, the next of which is a step of h away from t.
    pub(super) fn lengths(&self, windows: &Windows, (t, h): (f64, f64), out: &mut Vec<f64>) {
        out.clear();
        let Some(count) = windows.counts.get(self.window) else {
            out.push(h);
            return;
        };
        let times = &windows.times[self.first..self.first + count];
        // a window of one output is a step as any other
        if let [_] = times {
            out.push(h);
        } else {
            let start = if self.output == 0 { t } else { self.start };
            out.extend(times.iter().map(|time| time - start));
        }
    }

    /// Goes on to the next output.
    pub(super) fn advance(&mut self, windows: &Windows) {
        let Some(count) = windows.counts.get(self.window) else {
            return;
        };
        self.output += 1;
        if self.output == *count {
            self.first += count;
            self.window += 1;
            self.output = 0;
        }
    }

    /// Refuses a place that is not in the windows.
    pub(super) fn check(&self, windows: &Windows) -> Result<(), CheckpointMismatch> {
        let before: usize = windows.counts.iter().take(self.window).sum();
        let count = windows.counts.get(self.window).copied().unwrap_or(1);
        if self.window <= windows.counts.len() && self.first == before && self.output < count {
            Ok(())
        } else {
            Err(CheckpointMismatch)
        }
    }
}

liouville_base::checkpoint!(Place {
    window,
    first,
    output,
    start
});
