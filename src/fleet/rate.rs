//! At most so many a second, and the newest of them.

use std::time::Duration;

use tokio::time::Instant;

/// Lets the newest of what it is offered through, at most so often.
pub(super) struct Rated<T> {
    /// `None` where nothing is let through.
    interval: Option<Duration>,
    next_at: Instant,
    newest: Option<T>,
}

impl<T> Rated<T> {
    /// At most `per_s` a second; none at 0.
    pub(super) fn new(per_s: f64) -> Self {
        let interval = (per_s > 0.0).then(|| Duration::from_secs_f64(1.0 / per_s));
        Self { interval, next_at: Instant::now(), newest: None }
    }

    /// Takes the place of what has not been let through yet.
    pub(super) fn offer(&mut self, newest: T) {
        if self.interval.is_some() {
            self.newest = Some(newest);
        }
    }

    /// The newest once it may go; never where there is none. Nothing is lost when this is dropped half-way.
    pub(super) async fn next(&mut self) -> T {
        let Some(interval) = self.interval.filter(|_| self.newest.is_some()) else {
            return std::future::pending().await;
        };
        tokio::time::sleep_until(self.next_at).await;
        match self.newest.take() {
            Some(newest) => {
                self.next_at = Instant::now() + interval;
                newest
            }
            None => std::future::pending().await,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn the_newest_comes_at_the_rate() {
        let (mut rated, begun) = (Rated::new(2.0), Instant::now());
        for n in 0..3 {
            rated.offer(n);
        }
        assert_eq!((rated.next().await, begun.elapsed()), (2, Duration::ZERO));
        rated.offer(3);
        assert!(tokio::time::timeout(Duration::from_millis(499), rated.next()).await.is_err());
        rated.offer(4);
        assert_eq!((rated.next().await, begun.elapsed()), (4, Duration::from_millis(500)));
        let mut none = Rated::new(0.0);
        none.offer(1);
        assert!(tokio::time::timeout(Duration::from_hours(1), none.next()).await.is_err());
    }
}
