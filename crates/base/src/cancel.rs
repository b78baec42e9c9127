//! Cooperative cancellation: long steps poll a flag at least every 40 ms.

use std::sync::Arc;
use std::time::{Duration, Instant};

/// The time between two polls.
const INTERVAL: Duration = Duration::from_millis(40);

/// A flag that asks for a step to stop; clones share it.
#[derive(Clone)]
pub struct CancelToken {
    poll: Arc<dyn Fn() -> bool + Send + Sync>,
    polled: Instant,
}

impl CancelToken {
    /// A token that is cancelled when `poll` returns true.
    pub fn new(poll: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self {
            poll: Arc::new(poll),
            polled: Instant::now(),
        }
    }

    /// Whether the step is to stop.
    pub fn is_cancelled(&mut self) -> bool {
        if self.polled.elapsed() < INTERVAL {
            return false;
        }
        self.polled = Instant::now();
        (self.poll)()
    }
}

impl Default for CancelToken {
    /// A token that is never cancelled.
    fn default() -> Self {
        Self::new(|| false)
    }
}
