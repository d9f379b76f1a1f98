//! Commands given before and after a stop told apart.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;
use tokio::time::Instant;

/// The generations of a controller's commands: a stop outdates every one given before it, connected or not.
#[derive(Debug)]
pub struct Orders {
    generation: Arc<AtomicU64>,
    /// The newest generation that a stop has made.
    stops: watch::Sender<u64>,
    under_way: watch::Sender<u32>,
    /// When the last byte of the newest stop was handed to the operating system.
    sent: Mutex<Option<Instant>>,
}

impl Default for Orders {
    fn default() -> Self {
        Self {
            generation: Arc::default(),
            stops: watch::Sender::new(0),
            under_way: watch::Sender::new(0),
            sent: Mutex::default(),
        }
    }
}

/// A stop under way while it lives.
#[derive(Debug)]
pub struct UnderWay(Arc<Orders>);

impl Drop for UnderWay {
    fn drop(&mut self) {
        self.0.under_way.send_modify(|count| *count -= 1);
    }
}

impl Orders {
    /// What a command that is admitted now carries.
    #[must_use]
    pub fn generation(&self) -> u64 {
        self.generation.load(Ordering::SeqCst)
    }

    /// The number itself, for a port to compare with.
    #[must_use]
    pub fn shared(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.generation)
    }

    /// Makes every command given before outdated: it no longer begins.
    pub fn outdate(&self) {
        let generation = self.generation.fetch_add(1, Ordering::SeqCst) + 1;
        self.stops.send_modify(|newest| *newest = (*newest).max(generation));
    }

    /// Outdates what was commanded before, and makes what is commanded from now on wait until this is dropped.
    #[must_use]
    pub fn stop(self: &Arc<Self>) -> UnderWay {
        self.under_way.send_modify(|count| {
            if *count == 0 {
                *self.sent() = None;
            }
            *count += 1;
        });
        let under_way = UnderWay(Arc::clone(self));
        self.outdate();
        under_way
    }

    fn sent(&self) -> MutexGuard<'_, Option<Instant>> {
        self.sent.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A stop's last byte has been handed to the operating system. Where several stops are under way, the first of them
    /// is what stops the controller.
    pub fn stop_sent(&self) {
        self.sent().get_or_insert_with(Instant::now);
    }

    /// When the last byte of the newest stop was handed to the operating system.
    #[must_use]
    pub fn newest_stop_sent(&self) -> Option<Instant> {
        *self.sent()
    }

    /// Returns once a stop has outdated a generation.
    pub async fn outdated(&self, generation: u64) {
        if self.stops.subscribe().wait_for(|&newest| newest > generation).await.is_err() {
            std::future::pending::<()>().await;
        }
    }

    /// Waits until no stop is under way.
    pub async fn no_stop_under_way(&self) {
        // The sender lives as long as this.
        let _ = self.under_way.subscribe().wait_for(|&count| count == 0).await;
    }
}
