//! Taking turns at a camera on USB, which can be opened only once at a time: this program lists cameras and opens one
//! side by side, and neither is to find the camera taken by the other.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::bounded::Wanted;
use super::target::Site;

/// The cameras whose turns are taken.
static TAKEN: Mutex<Vec<Site>> = Mutex::new(Vec::new());
/// One of those has ended.
static ENDED: Condvar = Condvar::new();

/// It is given up so much earlier than the whole: else that says only that it took too long.
const SAY_SO: Duration = Duration::from_millis(200);

fn taken() -> MutexGuard<'static, Vec<Site>> {
    TAKEN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The turn of one part of this program at a camera, for as long as this lives: while the camera is opened and asked.
#[derive(Debug)]
pub(super) struct Turn(Site);

impl Turn {
    /// Waits until no other part of this program opens the camera there, for as long as that is `wanted`.
    ///
    /// # Errors
    /// That one still does, in words.
    pub(super) fn at(site: Site, wanted: &Wanted) -> Result<Self, String> {
        let (mut taken, waited) = ENDED
            .wait_timeout_while(taken(), wanted.left().saturating_sub(SAY_SO), |taken| taken.contains(&site))
            .unwrap_or_else(PoisonError::into_inner);
        if waited.timed_out() && taken.contains(&site) {
            return Err("this program is still opening it for something else".to_owned());
        }
        taken.push(site.clone());
        Ok(Self(site))
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        taken().retain(|site| *site != self.0);
        ENDED.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    fn at(address: u8, allowed: Duration) -> Result<Turn, String> {
        Turn::at(Site::Usb { bus: "turns".to_owned(), address }, &Wanted::beginning(allowed))
    }

    #[test]
    fn one_part_waits_for_another_at_the_same_camera_and_at_no_other() {
        let patience = Duration::from_secs(20);
        let first = at(1, patience).unwrap();
        let _other = at(2, patience).unwrap();
        let (got, turn) = mpsc::channel();
        let waits = std::thread::spawn(move || got.send(at(1, patience)).is_ok());
        assert!(turn.recv_timeout(Duration::from_millis(50)).is_err(), "two have the same turn");
        drop(first);
        let second = turn.recv_timeout(patience).unwrap().unwrap();
        assert!(waits.join().unwrap());
        // Who waits is not kept longer than it is waited for.
        let late = at(1, Duration::from_millis(1));
        assert!(late.as_ref().is_err_and(|why| why.contains("still opening it")), "{late:?}");
        drop(second);
        at(1, patience).unwrap();
    }
}
