//! Cooperative cancellation: long steps poll a flag.

use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long a step goes on without asking.
const BETWEEN: Duration = Duration::from_millis(40);

/// Asks whether to stop, but not too often; clones ask the same.
#[derive(Clone)]
pub struct CancelToken {
    is_cancelled: Arc<dyn Fn() -> bool + Send + Sync>,
    asked: Instant,
}

impl CancelToken {
    /// CancelToken that lasts until `is_cancelled` says otherwise.
    pub fn new(is_cancelled: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self {
            is_cancelled: Arc::new(is_cancelled),
            asked: Instant::now(),
        }
    }

    /// Whether to stop.
    pub fn is_cancelled(&mut self) -> bool {
        if self.asked.elapsed() < BETWEEN {
            return false;
        }
        self.asked = Instant::now();
        (self.is_cancelled)()
    }
}

impl Default for CancelToken {
    /// It lasts for ever.
    fn default() -> Self {
        Self::new(|| false)
    }
}
