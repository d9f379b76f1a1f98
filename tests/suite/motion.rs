//! The motion rules over the simulated bench.

use std::sync::Arc;
use std::time::Duration;

use plenalign::config::Side;
use plenalign::control::motion::Motion;
use plenalign::control::open_bench;
use plenalign::device::AxisName;
use plenalign::device::jog::deadman;
use tokio::time::sleep;

use super::bench::small_config;

#[tokio::test(start_paused = true)]
async fn a_jog_ends_at_the_wall_at_the_deadman_and_at_a_stop() {
    let config = Arc::new(small_config(1));
    let motion = Arc::new(Motion::new(Arc::clone(&config), open_bench(&config).await.unwrap()));
    let (_grip, dead) = deadman(Duration::from_secs(60));
    assert!(motion.jog(AxisName::E, Side::Low, 5.0, dead).await.is_err(), "not homed");
    motion.home(AxisName::E).await.unwrap();

    // Nobody holds it any more: it ends on its way.
    let (_grip, dead) = deadman(Duration::from_millis(400));
    let reached = motion.jog(AxisName::E, Side::Low, 5.0, dead).await.unwrap().value();
    assert!(reached < 29.0 && reached > 26.0, "{reached}");

    // Held to the end: the wall, and not a hair further.
    let (_grip, dead) = deadman(Duration::from_secs(60));
    let reached = motion.jog(AxisName::E, Side::Low, 5.0, dead).await.unwrap().value();
    assert!((reached - motion.e_wall_mm()).abs() < 0.003, "{reached} at a wall of {}", motion.e_wall_mm());
    let (_grip, dead) = deadman(Duration::from_secs(60));
    let again = motion.jog(AxisName::E, Side::Low, 5.0, dead).await.unwrap().value();
    assert!((again - reached).abs() < 0.003, "{reached} to {again}");

    // A stop ends it whoever holds it, and keeps another from beginning.
    let jogging = tokio::spawn({
        let motion = Arc::clone(&motion);
        let (grip, dead) = deadman(Duration::from_secs(60));
        async move {
            let _grip = grip;
            motion.jog(AxisName::E, Side::High, 2.0, dead).await
        }
    });
    sleep(Duration::from_secs(2)).await;
    motion.stop().await;
    assert!(jogging.await.unwrap().is_err());
    let (_grip, dead) = deadman(Duration::from_secs(60));
    assert!(motion.jog(AxisName::E, Side::High, 2.0, dead).await.is_err(), "the stop is latched");
}
