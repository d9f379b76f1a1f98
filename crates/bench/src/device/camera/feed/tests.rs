//! What of a camera's frames comes through.

use super::*;
use crate::device::AxisPose;

fn black() -> Arc<RawImage> {
    Arc::new(RawImage::from_u8(1, 1, vec![0]))
}

/// Both ends for a camera of 10 frames a second that may take 3 s.
fn slow_feed() -> (Feed, Outlet) {
    let config = CameraConfig { timeout_ms: 3000, frame_rate_hz: 10.0, ..CameraConfig::default() };
    let unknown = AxisPose { position: None, settled: false };
    let state = CameraState::not_yet("genicam", "not opened yet");
    feed(&config, (1, 1), Arc::new(move |_, _| (unknown, unknown)), state)
}

impl Outlet {
    fn publish_aged(&self, seq: u64, age_ms: u64) {
        let window = Window { from_age: Duration::from_millis(age_ms), to_age: Duration::ZERO, assumed: false };
        self.publish(black(), seq, (window, Instant::now()));
    }

    fn tell_good(&self) {
        self.tell(News { good: true, identity: "", white: 255, notes: Vec::new(), count: Count::default() });
    }
}

#[tokio::test(start_paused = true)]
async fn a_camera_that_is_back_is_waited_for_anew() {
    let (feed, outlet) = slow_feed();
    outlet.tell_good();
    outlet.publish_aged(1, 300);
    outlet.go_offline("restarted".to_owned());
    let asked = Instant::now();
    let camera = async {
        // It is back just before the wait would end, and its first frame is not dated yet.
        tokio::time::sleep(Duration::from_millis(3200)).await;
        outlet.tell_good();
        tokio::time::sleep(Duration::from_millis(600)).await;
        outlet.publish_aged(2, 300);
    };
    let (frame, ()) = tokio::join!(feed.next(asked), camera);
    assert_eq!(frame.unwrap().seq, 2);
    // One that is back and sends nothing is given up all the same.
    outlet.go_offline("restarted".to_owned());
    outlet.tell_good();
    let asked = Instant::now();
    let why = feed.next(asked).await.unwrap_err();
    assert!(matches!(why, DeviceError::Timeout { .. }) && asked.elapsed() < Duration::from_secs(10), "{why}");
}

#[tokio::test(start_paused = true)]
async fn one_that_falls_silent_is_waited_for_while_its_driver_finds_out_and_then_as_any_that_is_lost() {
    let (feed, outlet) = slow_feed();
    outlet.tell_good();
    outlet.publish_aged(1, 300);
    let asked = Instant::now();
    let camera = async {
        tokio::time::sleep(Duration::from_secs(8)).await;
        outlet.go_offline("it does not answer".to_owned());
        tokio::time::sleep(Duration::from_secs(15)).await;
        outlet.tell_good();
        outlet.publish_aged(2, 300);
    };
    let (frame, ()) = tokio::join!(feed.next(asked), camera);
    assert_eq!(frame.unwrap().seq, 2);
}

#[tokio::test(start_paused = true)]
async fn one_that_comes_and_goes_without_a_frame_is_not_waited_for_for_ever() {
    let (feed, outlet) = slow_feed();
    outlet.tell_good();
    outlet.publish_aged(1, 300);
    let asked = Instant::now();
    let camera = async {
        loop {
            outlet.go_offline("restarted".to_owned());
            tokio::time::sleep(Duration::from_secs(1)).await;
            outlet.tell_good();
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
    };
    tokio::select! {
        frame = feed.next(asked) => assert!(frame.is_err()),
        () = camera => {}
    }
    assert!(asked.elapsed() < RETURN_ALLOWED + Duration::from_secs(10), "{:?}", asked.elapsed());
}

#[tokio::test(start_paused = true)]
async fn one_that_nobody_takes_frames_of_any_more_is_not_waited_for() {
    for offline in [false, true] {
        let (feed, outlet) = slow_feed();
        outlet.tell_good();
        outlet.publish_aged(1, 300);
        if offline {
            outlet.go_offline("restarted".to_owned());
        }
        drop(outlet);
        let asked = Instant::now();
        assert!(feed.next(asked).await.is_err() && asked.elapsed() < Duration::from_secs(1));
    }
}

#[tokio::test(start_paused = true)]
async fn frames_that_come_to_count_as_older_are_waited_for() {
    let (feed, outlet) = slow_feed();
    outlet.tell_good();
    outlet.publish_aged(1, 300);
    let asked = Instant::now();
    let camera = async {
        // One that took long: frames may have been exposed for as long from now on.
        for seq in 2..8 {
            tokio::time::sleep(Duration::from_millis(900)).await;
            outlet.publish_aged(seq, 4000);
        }
    };
    let (frame, ()) = tokio::join!(feed.next(asked), camera);
    assert_eq!(frame.unwrap().seq, 6);
}

#[tokio::test(start_paused = true)]
async fn a_frame_that_is_published_late_is_no_younger_for_that() {
    let unknown = AxisPose { position: None, settled: false };
    let state = CameraState::not_yet("v4l2", "not opened yet");
    let (feed, outlet) = feed(&CameraConfig::default(), (1, 1), Arc::new(move |_, _| (unknown, unknown)), state);
    let age = Duration::from_millis(30);
    let dated_at = Instant::now();
    tokio::time::advance(Duration::from_millis(14)).await;
    outlet.publish(black(), 1, (Window { from_age: age, to_age: Duration::ZERO, assumed: false }, dated_at));
    let frame = feed.live.borrow().clone().unwrap();
    assert_eq!((frame.exposed_from, frame.exposed_to), (dated_at - age, dated_at));
}

#[tokio::test(start_paused = true)]
async fn a_frame_is_waited_for_as_long_as_frames_count_as_old() {
    let config = CameraConfig { timeout_ms: 100, frame_rate_hz: 100.0, ..CameraConfig::default() };
    let unknown = AxisPose { position: None, settled: false };
    let state = CameraState::not_yet("v4l2", "not opened yet");
    let (feed, outlet) = feed(&config, (1, 1), Arc::new(move |_, _| (unknown, unknown)), state);
    // By their arrival, of a buffer that holds many.
    let window = Window { from_age: Duration::from_secs(3), to_age: Duration::ZERO, assumed: true };
    let publish = |seq| outlet.publish(black(), seq, (window, Instant::now()));
    publish(1);
    let frame = feed.next(Instant::now());
    tokio::pin!(frame);
    for seq in 2..=30 {
        tokio::time::advance(Duration::from_millis(100)).await;
        publish(seq);
        tokio::select! {
            biased;
            early = &mut frame => panic!("{seq} counts as exposed before it was asked for: {early:?}"),
            () = std::future::ready(()) => {}
        }
    }
    tokio::time::advance(Duration::from_millis(100)).await;
    publish(31);
    assert_eq!(frame.await.unwrap().seq, 31);
}
