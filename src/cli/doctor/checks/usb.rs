//! USB between the configured camera and this machine: whether it may be opened, and whether frames come through.

use super::stages;
use crate::cli::doctor::facts::{DeviceFile, Facts};
use crate::cli::doctor::finding::Finding;
use crate::config::Config;
use crate::device::camera::genicam::found::{FoundCamera, Way};
use crate::device::camera::genicam::usb::STREAM_BYTES;

const WHAT: &str = "camera's USB";
/// What a kernel gives all programs that was not told otherwise, MiB.
const USUAL_MIB: u32 = 16;
/// Of what USB carries, what is used at most without frames being lost.
const SHARE: f64 = 0.9;

/// What keeps this user, or the service, from opening the camera.
pub(super) fn permission(file: &DeviceFile, facts: &Facts) -> Option<Finding> {
    const ID: &str = "camera.permission";
    // What belongs to root's group is not given to others by becoming one of it.
    if file.gid != 0 {
        return super::permission::check(ID, "camera", file, facts);
    }
    let service = facts.service.as_ref().filter(|service| !file.may_be_opened_by(service));
    let who = if file.ours { &service?.name } else { &facts.user.name };
    Some(Finding::problem(
        ID,
        "camera",
        format!("{} may not be opened by {who}: no udev rule gives the camera to the group video", file.path.display()),
        "sudo cp deploy/udev/70-plenalign.rules /etc/udev/rules.d/ && sudo udevadm control --reload && sudo udevadm \
         trigger --subsystem-match=usb --action=add",
    ))
}

/// What on the way would lose frames of so many bytes.
pub(super) fn check(
    config: &Config,
    camera: &FoundCamera,
    file: Option<&DeviceFile>,
    memory_mib: Option<u32>,
    frame_bytes: usize,
) -> Vec<Finding> {
    let mut all = Vec::new();
    if let Way::Usb { carried_mbit_per_s: Some(carried), .. } = camera.way {
        all.extend(link(config.bench.camera.frame_rate_hz, f64::from(carried), frame_bytes));
    }
    all.extend(memory_mib.and_then(memory));
    all.extend(file.and_then(|file| stages::autosuspend("camera.autosuspend", "camera", file)));
    all
}

fn link(rate_hz: f64, carried: f64, frame_bytes: usize) -> Option<Finding> {
    let needed = frame_bytes as f64 * rate_hz * 8e-6;
    if needed <= carried * SHARE {
        return None;
    }
    let rate = (rate_hz * carried * SHARE / needed * 10.0).floor() / 10.0;
    let slow = if carried < 1000.0 { "    # or plug it into a USB 3 port, by a USB 3 cable" } else { "" };
    Some(Finding::problem(
        "camera.link",
        WHAT,
        format!("frames need {needed:.0} Mbit/s, and its connection carries {carried:.0} Mbit/s of them"),
        format!("[bench.camera] frame_rate_hz = {rate:.1}{slow}"),
    ))
}

/// What is under way on USB has to be kept somewhere.
fn memory(mib: u32) -> Option<Finding> {
    // What the kernel keeps of each transfer comes on top.
    let needed = u32::try_from(STREAM_BYTES >> 20).unwrap_or(u32::MAX).saturating_add(1);
    let most = needed.max(USUAL_MIB);
    (mib != 0 && mib < needed).then(|| {
        Finding::problem(
            "camera.usb_memory",
            WHAT,
            format!("the kernel keeps {mib} MiB of what is under way for all programs, and a camera's stream needs {needed} MiB"),
            format!(
                "echo {most} | sudo tee /sys/module/usbcore/parameters/usbfs_memory_mb    # {needed} more for each further \
                 camera; for good: usbcore.usbfs_memory_mb={most} on the kernel's command line"
            ),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::super::genicam::tests::{camera, config};
    use super::*;

    fn ids(config: &Config, carried_mbit_per_s: Option<u32>, memory_mib: Option<u32>) -> Vec<&'static str> {
        let way = Way::Usb { file: "/dev/bus/usb/002/005".into(), product: "2676:ba02".to_owned(), carried_mbit_per_s };
        let found = check(config, &camera(way), None, memory_mib, 4096 * 3072);
        found.iter().map(|finding| finding.id).collect()
    }

    #[test]
    fn what_would_lose_frames_is_told_before_it_does() {
        // 2.5 Gbit/s.
        assert_eq!(ids(&config(), Some(3200), Some(16)), [""; 0]);
        assert_eq!(ids(&config(), Some(320), Some(4)), ["camera.link", "camera.usb_memory"]);
        assert_eq!(ids(&config(), None, Some(0)), [""; 0], "as much as is wanted");
        let mend = link(25.0, 320.0, 4096 * 3072).unwrap().mend.unwrap();
        assert!(mend.contains("frame_rate_hz = 2.8 ") && mend.contains("USB 3 port"), "{mend}");
        assert!(link(2.8, 320.0, 4096 * 3072).is_none());
    }

    #[test]
    fn a_camera_that_only_root_may_open_is_given_away_by_a_rule() {
        let facts = super::super::tests::well();
        let file = DeviceFile {
            path: "/dev/bus/usb/002/005".into(),
            gid: 0,
            group: "root".to_owned(),
            mode: 0o664,
            ours: false,
            ..facts.cameras[0].file.clone()
        };
        let told = permission(&file, &facts).unwrap();
        assert!(told.mend.as_ref().unwrap().contains("70-plenalign.rules"), "{told:?}");
    }
}
