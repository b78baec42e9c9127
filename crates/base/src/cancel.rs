//! Cooperative cancellation: long steps poll a flag, their own or that of the thread.

use std::cell::RefCell;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long a step goes on without asking.
const BETWEEN: Duration = Duration::from_millis(40);

/// Asks whether to stop, but not too often; clones ask the same.
#[derive(Clone)]
pub struct CancelToken {
    is_cancelled: Arc<dyn Fn() -> bool + Send + Sync>,
    asked: Instant,
    was_cancelled: bool,
}

thread_local! {
    /// The token of what this thread computes.
    static OF_THREAD: RefCell<CancelToken> = RefCell::default();
}

/// Does something whose steps may ask this token.
pub fn within<T>(token: CancelToken, work: impl FnOnce() -> T) -> T {
    let before = OF_THREAD.replace(token);
    let found = work();
    OF_THREAD.set(before);
    found
}

/// Whether what this thread computes is to stop.
pub fn is_cancelled() -> bool {
    OF_THREAD.with_borrow_mut(CancelToken::is_cancelled)
}

impl CancelToken {
    /// CancelToken that lasts until `is_cancelled` says otherwise.
    pub fn new(is_cancelled: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self {
            is_cancelled: Arc::new(is_cancelled),
            asked: Instant::now(),
            was_cancelled: false,
        }
    }

    /// Whether to stop, from then on for ever.
    pub fn is_cancelled(&mut self) -> bool {
        if !self.was_cancelled && self.asked.elapsed() >= BETWEEN {
            self.asked = Instant::now();
            self.was_cancelled = (self.is_cancelled)();
        }
        self.was_cancelled
    }
}

impl Default for CancelToken {
    /// It lasts for ever.
    fn default() -> Self {
        Self::new(|| false)
    }
}
