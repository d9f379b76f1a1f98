//! Admission against the stop on two real threads: between two lines without an await, too, there is room for a stop.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use plenalign::config::Side;
use plenalign::device::AxisName;
use plenalign::units::Millimetres;
use tokio::time::Instant;

use super::super::until::until;
use super::commands::{Rig, is_idle};
use super::controller::Told;

/// How often a command and a stop are let loose on each other.
const TRIES: u32 = 200;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stop_and_an_admission_at_the_same_moment_leave_nothing_to_go_out() {
    let rig = Rig::new().await;
    let (mut amid, mut refused) = (0, 0);
    for attempt in 0..TRIES {
        rig.far.put_home();
        rig.far.told().clear();
        let (service, permit) = (Arc::clone(&rig.service), rig.permit.clone());
        let ready = Arc::new(AtomicBool::new(false));
        let set = Arc::clone(&ready);
        let asked = tokio::spawn(async move {
            set.store(true, Ordering::SeqCst);
            match attempt % 3 {
                0 => service.move_axis(&permit, AxisName::E, Millimetres(21.0)).await.map(drop),
                1 => service.home_axis(&permit, AxisName::Focus).await.map(drop),
                _ => service.jog(&permit, AxisName::Focus, Side::High, Some(1.0), None).await.map(drop),
            }
        });
        while !ready.load(Ordering::SeqCst) {
            std::hint::spin_loop();
        }
        // A little later each time, from before the latch is looked at to after the first order.
        for _ in 0..(attempt * 37 % 4000) * 20 {
            std::hint::spin_loop();
        }
        rig.service.stop(Instant::now(), "ada").await;
        rig.far.told().push(Told::Ended);
        refused += u32::from(asked.await.unwrap().is_err());
        until("nothing has the axes", async || is_idle(&rig.service)).await;
        {
            let told = rig.far.told();
            let ended = told.iter().position(|told| *told == Told::Ended).unwrap();
            let orders = |told: &[Told]| told.iter().filter(|told| matches!(told, Told::Order(..))).count();
            assert_eq!(orders(&told[ended..]), 0, "attempt {attempt}, after the stop was answered: {told:?}");
            // What went out just before has the stop behind it.
            let last = told.iter().rev().find(|told| **told != Told::Ended);
            assert_eq!(last, Some(&Told::Stop), "attempt {attempt}: {told:?}");
            amid += u32::from(orders(&told) > 0);
        }
        rig.service.reset_stop("ada", "the next attempt").await.unwrap();
    }
    println!("{TRIES} stops against admissions: {refused} refused at once, {amid} after an order went out");
    rig.service.shut_down().await;
}
