//! Who may open a device file.

use crate::cli::doctor::facts::{DeviceFile, Facts};
use crate::cli::doctor::finding::Finding;

/// What keeps this user, or the service, from opening a device file.
pub(super) fn check(id: &'static str, what: &str, file: &DeviceFile, facts: &Facts) -> Option<Finding> {
    let (user, group) = (&facts.user, &file.group);
    let path = file.path.display();
    if !file.ours {
        // The kernel's word counts: an access list may say otherwise than the bits.
        if file.mode & 0o060 != 0o060 {
            return Some(Finding::problem(
                id,
                what,
                format!(
                    "{path} may not be opened by {}, nor by its group {group} (mode {:03o})",
                    user.name,
                    file.mode & 0o777
                ),
                format!("ls -l {path}    # a udev rule has changed its mode: see /etc/udev/rules.d"),
            ));
        }
        if file.could_be_opened_by(user) {
            return Some(Finding::problem(
                id,
                what,
                format!(
                    "{path} may not be opened by {}: the group {group} is theirs from the next login on",
                    user.name
                ),
                format!("newgrp {group}    # or log out, and in again"),
            ));
        }
        return Some(Finding::problem(
            id,
            what,
            format!("{path} may not be opened by {}, who is not in the group {group}", user.name),
            format!("sudo usermod -aG {group} {}    # then log out, and in again", user.name),
        ));
    }
    let service = facts.service.as_ref().filter(|service| !file.may_be_opened_by(service))?;
    Some(Finding::warning(
        id,
        what,
        format!("{path} may not be opened by user {}, who runs the service: the group {group} may", service.name),
        format!("sudo usermod -aG {group} {} && sudo systemctl restart plenalign", service.name),
    ))
}
