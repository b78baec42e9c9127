//! Long steps ask now and then whether somebody has lost patience.

use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long a step goes on without asking.
const BETWEEN: Duration = Duration::from_millis(40);

/// Asks whether to stop, but not too often; clones ask the same.
#[derive(Clone)]
pub struct Patience {
    is_lost: Arc<dyn Fn() -> bool + Send + Sync>,
    asked: Instant,
}

impl Patience {
    /// Patience that lasts until `is_lost` says otherwise.
    pub fn new(is_lost: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self {
            is_lost: Arc::new(is_lost),
            asked: Instant::now(),
        }
    }

    /// Whether to stop.
    pub fn is_lost(&mut self) -> bool {
        if self.asked.elapsed() < BETWEEN {
            return false;
        }
        self.asked = Instant::now();
        (self.is_lost)()
    }
}

impl Default for Patience {
    /// It lasts for ever.
    fn default() -> Self {
        Self::new(|| false)
    }
}
