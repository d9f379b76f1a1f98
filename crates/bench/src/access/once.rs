//! The one-time key: how the first person gets in where a token is demanded and there is none.

use std::fs;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::secret::{Digest, Secret};

/// A key that is used once, and then dead; it dies by itself after a while, too.
#[derive(Debug, Default)]
pub struct OnceKey(Mutex<Option<Key>>);

#[derive(Debug)]
struct Key {
    digest: Digest,
    until: Instant,
    /// Where it can be read until then.
    file: Option<PathBuf>,
}

impl Drop for Key {
    fn drop(&mut self) {
        if let Some(file) = &self.file {
            let _ = fs::remove_file(file);
        }
    }
}

impl OnceKey {
    fn key(&self) -> MutexGuard<'_, Option<Key>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Has a key open the door once, within the time it lasts. A file that holds it goes when it does.
    pub fn set(&self, secret: &Secret, lasts: Duration, file: Option<PathBuf>) {
        *self.key() = Some(Key { digest: secret.digest(), until: Instant::now() + lasts, file });
    }

    /// Whether this is the key; it is dead afterwards.
    #[must_use]
    pub fn take(&self, presented: &Digest) -> bool {
        self.expire();
        let mut key = self.key();
        let is_it = key.as_ref().is_some_and(|key| key.digest.matches(presented));
        if is_it {
            *key = None;
        }
        is_it
    }

    /// Forgets a key whose time is up.
    pub fn expire(&self) {
        let mut key = self.key();
        if key.as_ref().is_some_and(|key| Instant::now() >= key.until) {
            *key = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_works_once_and_its_file_goes_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("key");
        fs::write(&file, "key").unwrap();
        let (once, secret) = (OnceKey::default(), Secret::random("").unwrap());
        assert!(!once.take(&secret.digest()));
        once.set(&secret, Duration::from_secs(60), Some(file.clone()));
        assert!(!once.take(&Digest::of("guess")) && file.exists());
        assert!(once.take(&secret.digest()) && !file.exists());
        assert!(!once.take(&secret.digest()));
    }

    #[test]
    fn a_key_dies_by_itself() {
        let (once, secret) = (OnceKey::default(), Secret::random("").unwrap());
        once.set(&secret, Duration::ZERO, None);
        assert!(!once.take(&secret.digest()));
    }
}
