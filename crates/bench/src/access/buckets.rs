//! How often one may ask: a bucket for each asker, which fills at a steady rate.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Askers remembered at most: beyond it, those whose bucket is fullest are forgotten.
const MOST: usize = 4096;

#[derive(Debug, Clone, Copy)]
struct Bucket {
    left: f64,
    at: Instant,
}

/// Buckets by asker.
#[derive(Debug)]
pub struct Buckets<K> {
    per_second: f64,
    burst: f64,
    buckets: Mutex<HashMap<K, Bucket>>,
}

impl<K: Eq + Hash + Clone> Buckets<K> {
    /// Buckets that let `burst` through at once and `per_second` in the long run.
    #[must_use]
    pub fn new(per_second: f64, burst: f64) -> Self {
        Self { per_second, burst, buckets: Mutex::default() }
    }

    fn buckets(&self) -> MutexGuard<'_, HashMap<K, Bucket>> {
        self.buckets.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn level(&self, bucket: Bucket, now: Instant) -> f64 {
        let filled = now.saturating_duration_since(bucket.at).as_secs_f64() * self.per_second;
        (bucket.left + filled).min(self.burst)
    }

    /// Takes one from an asker's bucket.
    ///
    /// # Errors
    /// How long until there is one, where there is none.
    pub fn take(&self, asker: &K) -> Result<(), Duration> {
        self.take_at(asker, Instant::now())
    }

    /// Whether there is one in an asker's bucket, without taking it.
    ///
    /// # Errors
    /// As [`Buckets::take`].
    pub fn look(&self, asker: &K) -> Result<(), Duration> {
        let now = Instant::now();
        self.buckets().get(asker).map_or(Ok(()), |bucket| self.wait(self.level(*bucket, now)))
    }

    fn wait(&self, level: f64) -> Result<(), Duration> {
        if level >= 1.0 { Ok(()) } else { Err(Duration::from_secs_f64((1.0 - level) / self.per_second)) }
    }

    fn take_at(&self, asker: &K, now: Instant) -> Result<(), Duration> {
        let mut buckets = self.buckets();
        if buckets.len() >= MOST && !buckets.contains_key(asker) {
            self.forget(&mut buckets, now);
        }
        let bucket = buckets.entry(asker.clone()).or_insert(Bucket { left: self.burst, at: now });
        let level = self.level(*bucket, now);
        self.wait(level)?;
        *bucket = Bucket { left: level - 1.0, at: now };
        Ok(())
    }

    /// Makes room: away with the full buckets, which say nothing, and if that is not enough with the fullest half.
    fn forget(&self, buckets: &mut HashMap<K, Bucket>, now: Instant) {
        buckets.retain(|_, bucket| self.level(*bucket, now) < self.burst);
        if buckets.len() >= MOST {
            let mut levels: Vec<f64> = buckets.values().map(|bucket| self.level(*bucket, now)).collect();
            levels.sort_by(f64::total_cmp);
            let middle = levels[levels.len() / 2];
            buckets.retain(|_, bucket| self.level(*bucket, now) < middle);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_burst_goes_through_then_a_steady_rate_each_asker_for_itself() {
        let buckets = Buckets::new(2.0, 3.0);
        let from = Instant::now();
        for _ in 0..3 {
            buckets.take_at(&"a", from).unwrap();
        }
        assert_eq!(buckets.take_at(&"a", from), Err(Duration::from_millis(500)));
        buckets.take_at(&"b", from).unwrap();
        let later = from + Duration::from_millis(500);
        buckets.take_at(&"a", later).unwrap();
        assert!(buckets.take_at(&"a", later).is_err());
        // It never holds more than a burst.
        let much_later = from + Duration::from_secs(1000);
        for _ in 0..3 {
            buckets.take_at(&"a", much_later).unwrap();
        }
        assert!(buckets.take_at(&"a", much_later).is_err());
    }

    #[test]
    fn however_many_ask_the_room_they_take_is_bounded() {
        let buckets = Buckets::new(0.001, 10.0);
        let now = Instant::now();
        for _ in 0..10 {
            buckets.take_at(&u32::MAX, now).unwrap();
        }
        for asker in 0..20_000 {
            buckets.take_at(&asker, now).unwrap();
        }
        assert!(buckets.buckets().len() <= MOST);
        // Who has asked most is not forgotten for it.
        assert!(buckets.take_at(&u32::MAX, now).is_err());
    }
}
