//! Doing within bounded time what a camera's description may have last for ever: working it out, and looking up
//! features by it.

use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

use tokio::runtime::Handle;

use super::allowance::left;

/// How long a camera may take to be opened and set up; or to be read.
pub(super) const OPEN_WITHIN: Duration = Duration::from_secs(30);
/// So much work that was given up may go on: each takes a processor's time until it ends.
const MOST_GIVEN_UP: usize = 4;
/// How long nothing is said to a camera whose opening was given up: it lets go of who is silent for longer than its
/// heartbeat, of 3 s where nobody has set another.
const SILENT_FOR: Duration = Duration::from_secs(10);

/// What was given up and has not ended.
static GIVEN_UP: Mutex<Vec<Weak<()>>> = Mutex::new(Vec::new());

/// Whether what is done in a thread of its own is waited for still.
#[derive(Debug, Clone)]
pub(super) struct Wanted {
    state: Arc<Mutex<State>>,
    allowed: Duration,
    until: Instant,
}

#[derive(Debug, Default)]
struct State {
    given_up: bool,
    /// What speaks to a camera that was taken meanwhile.
    speaker: Option<Handle>,
}

impl Wanted {
    /// What begins now and is waited for so long.
    pub(super) fn beginning(allowed: Duration) -> Self {
        Self { state: Arc::default(), allowed, until: Instant::now() + allowed }
    }

    /// How much longer it is waited for.
    pub(super) fn left(&self) -> Duration {
        left(self.until)
    }

    /// Does a part of it in a thread of its own, which is given up when the whole is: what the part does not own, a
    /// camera above all, is then let go of although the part goes on.
    ///
    /// # Errors
    /// As [`within`].
    pub(super) fn part<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> Result<T, String> + Send + 'static,
    ) -> Result<T, String> {
        self.check()?;
        begun(&Self { state: Arc::default(), ..*self }, |_| work())
    }

    /// To be asked before a camera is made to do what it would go on with.
    ///
    /// # Errors
    /// That it is not waited for any more, in words.
    pub(super) fn check(&self) -> Result<(), String> {
        match self.state().given_up {
            true => Err("it was given up meanwhile".to_owned()),
            false => Ok(()),
        }
    }

    /// This runtime of one worker speaks to a camera that was taken, and keeps it for this program: it is to fall
    /// silent when the work is given up, which itself may not come to that for ever.
    pub(super) fn speaks(&self, runtime: &Handle) {
        let mut state = self.state();
        state.speaker = Some(runtime.clone());
        if state.given_up {
            state.fall_silent();
        }
    }

    fn give_up(&self) {
        let mut state = self.state();
        state.given_up = true;
        state.fall_silent();
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn fall_silent(&mut self) {
        if let Some(runtime) = self.speaker.take() {
            // Its one worker does nothing else meanwhile: no heartbeat leaves, and no answer is taken.
            runtime.spawn(async { std::thread::sleep(SILENT_FOR) });
        }
    }
}

/// Does something in a thread of its own, which is given up when it takes too long: what it comes to is dropped when it
/// ends.
///
/// # Errors
/// That it takes too long, or why it cannot be done, in words.
pub(super) fn within<T: Send + 'static>(
    allowed: Duration,
    work: impl FnOnce(&Wanted) -> Result<T, String> + Send + 'static,
) -> Result<T, String> {
    begun(&Wanted::beginning(allowed), work)
}

fn begun<T: Send + 'static>(
    wanted: &Wanted,
    work: impl FnOnce(&Wanted) -> Result<T, String> + Send + 'static,
) -> Result<T, String> {
    if given_up() >= MOST_GIVEN_UP {
        return Err(format!(
            "{MOST_GIVEN_UP} cameras that were opened or read took too long, were given up, and are worked at still: none is \
             begun besides; disconnect those cameras, and start this program again"
        ));
    }
    let lives = Arc::new(());
    let life = Arc::downgrade(&lives);
    let (done, end) = sync_channel(1);
    let work = {
        let wanted = wanted.clone();
        move || {
            let _lives = lives;
            // Nobody may wait for it any more.
            let _ = done.send(work(&wanted));
        }
    };
    let thread = std::thread::Builder::new().name("camera-open".to_owned()).spawn(work);
    thread.map_err(|error| format!("there is no thread to open it in: {error}"))?;
    match end.recv_timeout(wanted.left()) {
        Ok(done) => done,
        Err(RecvTimeoutError::Disconnected) => Err("the camera's library answered something unexpected".to_owned()),
        Err(RecvTimeoutError::Timeout) => {
            wanted.give_up();
            // It may have ended just now.
            if let Ok(done) = end.try_recv() {
                return done;
            }
            GIVEN_UP.lock().unwrap_or_else(PoisonError::into_inner).push(life);
            Err(format!(
                "it was given up after {} s: it answers too slowly, or what its description says takes too long to work out",
                wanted.allowed.as_millis() as f64 / 1e3
            ))
        }
    }
}

/// Runs what may be run in no thread of an asynchronous runtime.
///
/// # Errors
/// Where it ends unexpectedly, in words.
pub(super) fn apart<T: Send>(work: impl FnOnce() -> T + Send) -> Result<T, String> {
    let joined = std::thread::scope(|scope| scope.spawn(work).join());
    joined.map_err(|_| "the camera's library answered something unexpected".to_owned())
}

fn given_up() -> usize {
    let mut given_up = GIVEN_UP.lock().unwrap_or_else(PoisonError::into_inner);
    given_up.retain(|life| life.strong_count() > 0);
    given_up.len()
}

/// Held by each test that opens something or has something given up, which counts for the whole program.
#[cfg(test)]
pub(super) static ALONE: Mutex<()> = Mutex::new(());

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    #[test]
    fn what_takes_too_long_is_given_up_and_not_begun_without_end() {
        let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let soon = Duration::from_secs(20);
        assert_eq!(within(soon, |_| Ok(7)), Ok(7));
        assert_eq!(within::<()>(soon, |_| Err("gone".to_owned())), Err("gone".to_owned()));
        let panicked = within::<()>(soon, |_| panic!("as a library may")).unwrap_err();
        assert!(panicked.contains("unexpected"), "{panicked}");
        let late = Duration::from_millis(1);
        let ends: Vec<mpsc::Sender<()>> = (0..MOST_GIVEN_UP)
            .map(|_| {
                let (to, end) = mpsc::channel::<()>();
                let why = within(late, move |_| Ok(end.recv().is_err())).unwrap_err();
                assert!(why.contains("given up after 0.001 s"), "{why}");
                to
            })
            .collect();
        let why = within(soon, |_| Ok(())).unwrap_err();
        assert!(why.contains("none is begun besides"), "{why}");
        drop(ends);
        // They end, each in its own time.
        while given_up() > 0 {
            std::thread::yield_now();
        }
        assert_eq!(within(soon, |_| Ok(())), Ok(()));
    }

    #[test]
    fn what_is_given_up_does_not_go_on_and_keeps_no_camera() {
        let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        let (beat, beats) = mpsc::channel();
        runtime.spawn(async move {
            // As the library's heartbeat, until nobody listens.
            while beat.send(()).is_ok() {
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
        });
        let speaker = runtime.handle().clone();
        let (to, go_on) = mpsc::channel::<()>();
        let (say, said) = mpsc::channel();
        let work = move |wanted: &Wanted| {
            wanted.speaks(&speaker);
            // A description that takes for ever.
            let _ = go_on.recv();
            say.send(wanted.check()).unwrap();
            Ok(())
        };
        within(Duration::from_millis(50), work).unwrap_err();
        // What was under way when it fell silent, and nothing after that: a beat would come within a millisecond.
        let beats_on = |_: &()| beats.recv_timeout(Duration::from_millis(500)).is_ok();
        assert!(std::iter::repeat_n((), 1000).take_while(beats_on).count() < 1000, "its heart beats on");
        drop(to);
        assert!(said.recv().unwrap().is_err_and(|why| why.contains("given up")));
        assert_eq!(Wanted::beginning(OPEN_WITHIN).check(), Ok(()));
        while given_up() > 0 {
            std::thread::yield_now();
        }
        runtime.shutdown_background();
    }

    #[test]
    fn what_a_part_that_takes_for_ever_does_not_own_is_let_go_of_with_the_whole() {
        let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let (camera, let_go) = mpsc::channel::<()>();
        let (to, end) = mpsc::channel::<()>();
        let work = move |wanted: &Wanted| {
            let _camera = camera;
            // A description that takes for ever, and nothing else.
            wanted.part(move || Ok(end.recv().is_err()))
        };
        let why = within(Duration::from_secs(1), work).unwrap_err();
        assert!(why.contains("given up after 1 s"), "{why}");
        let dropped = let_go.recv_timeout(Duration::from_secs(20));
        assert_eq!(dropped, Err(RecvTimeoutError::Disconnected), "the camera is kept");
        assert!(given_up() > 0, "the part goes on, and counts");
        drop(to);
        while given_up() > 0 {
            std::thread::yield_now();
        }
        let late = Wanted::beginning(OPEN_WITHIN);
        assert_eq!(late.part(|| Ok(7)), Ok(7));
        late.give_up();
        assert!(late.part(|| Ok(7)).is_err_and(|why| why.contains("given up")), "it is begun all the same");
    }
}
