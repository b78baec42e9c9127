//! Cooperative cancellation: long steps poll a flag, their own or that of the thread.

use rayon::ThreadPool;
use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Sender};
use std::time::{Duration, Instant};

/// How long a step goes on without asking.
const BETWEEN: Duration = Duration::from_millis(40);

/// Asks whether to stop, but not too often; clones ask the same, and stop together.
#[derive(Clone)]
pub struct CancelToken {
    asks: Asks,
    asked: Instant,
    was_cancelled: Arc<AtomicBool>,
}

/// Where a token gets its answer.
#[derive(Clone)]
enum Asks {
    Function(Arc<dyn Fn() -> bool + Send + Sync>),
    /// The token of the thread that polls.
    Thread,
    /// Nowhere.
    Nothing,
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
    let known = OF_THREAD.with_borrow_mut(CancelToken::known);
    known.unwrap_or_else(Question::put)
}

/// Works on all threads of a pool, and asks the token of this one for them until they are over: a signal reaches the main
/// thread alone.
pub fn on_threads(pool: &ThreadPool, work: impl Fn() + Sync) {
    let (sender, over) = mpsc::channel();
    let token = OF_THREAD.with_borrow(CancelToken::follower);
    pool.in_place_scope(|scope| {
        scope.spawn_broadcast(|_, _| {
            let _over = Over(&sender);
            within(token.clone(), &work);
        });
        let mut left = pool.current_num_threads();
        while left > 0 {
            match over.recv_timeout(BETWEEN) {
                Ok(()) => left -= 1,
                Err(_) => _ = is_cancelled(),
            }
        }
    });
}

/// Says that a thread is over when it is dropped, after a panic too.
struct Over<'a>(&'a Sender<()>);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        let _ = self.0.send(());
    }
}

impl CancelToken {
    /// CancelToken that lasts until `is_cancelled` says otherwise.
    pub fn new(is_cancelled: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self::of(Asks::Function(Arc::new(is_cancelled)))
    }

    /// CancelToken that is that of the thread which polls it.
    pub fn of_thread() -> Self {
        Self::of(Asks::Thread)
    }

    /// CancelToken that asks nobody, and is cancelled with this one.
    fn follower(&self) -> Self {
        Self {
            asks: Asks::Nothing,
            ..self.clone()
        }
    }

    fn of(asks: Asks) -> Self {
        Self {
            asks,
            asked: Instant::now(),
            was_cancelled: Arc::default(),
        }
    }

    /// Whether to stop, from then on for ever.
    pub fn is_cancelled(&mut self) -> bool {
        self.known().unwrap_or_else(Question::put)
    }

    /// The answer, or what is to be asked where that is due.
    fn known(&mut self) -> Result<bool, Question> {
        if self.was_cancelled.load(Ordering::Relaxed) {
            return Ok(true);
        }
        match &self.asks {
            Asks::Thread => Ok(is_cancelled()),
            Asks::Function(function) if self.asked.elapsed() >= BETWEEN => {
                self.asked = Instant::now();
                Err(Question {
                    function: function.clone(),
                    was_cancelled: self.was_cancelled.clone(),
                })
            }
            Asks::Function(_) | Asks::Nothing => Ok(false),
        }
    }
}

/// A question that is put while no token is borrowed: the handler of a signal may begin a run of its own.
struct Question {
    function: Arc<dyn Fn() -> bool + Send + Sync>,
    was_cancelled: Arc<AtomicBool>,
}

impl Question {
    fn put(self) -> bool {
        let is_cancelled = (self.function)();
        self.was_cancelled.fetch_or(is_cancelled, Ordering::Relaxed);
        is_cancelled
    }
}

impl Default for CancelToken {
    /// It lasts for ever.
    fn default() -> Self {
        Self::of(Asks::Nothing)
    }
}
