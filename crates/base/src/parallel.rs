//! Threads within a step, for states so large that rows of one polynomial field are work for several.

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::Arc;

/// Some threads that work together; clones are the same threads.
#[derive(Clone, Debug)]
pub struct Workers(Arc<ThreadPool>);

impl Workers {
    /// Starts `threads` threads, or none if one is enough or no more can be started.
    pub fn new(threads: usize) -> Option<Self> {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.ok().filter(|pool| pool.current_num_threads() > 1);
        pool.map(|pool| Self(Arc::new(pool)))
    }

    /// Works on pieces of `size` of two arrays, of which the second may be empty; `work` is given the place where
    /// a piece begins.
    pub fn each<T: Send, F>(&self, size: usize, a: &mut [T], b: &mut [T], work: F)
    where
        F: Fn(usize, &mut [T], &mut [T]) + Sync,
    {
        self.0.install(|| {
            let pieces = a.par_chunks_mut(size).enumerate();
            if b.is_empty() {
                pieces.for_each(|(k, a)| work(k * size, a, &mut []));
            } else {
                let pieces = pieces.zip(b.par_chunks_mut(size));
                pieces.for_each(|((k, a), b)| work(k * size, a, b));
            }
        });
    }

    /// How many they are.
    pub fn threads(&self) -> usize {
        self.0.current_num_threads()
    }

    /// Works on all parts.
    pub fn all<T: Send, F>(&self, parts: &mut [T], work: F)
    where
        F: Fn(&mut T) + Sync,
    {
        self.0
            .install(|| parts.par_iter_mut().with_max_len(1).for_each(&work));
    }
}
