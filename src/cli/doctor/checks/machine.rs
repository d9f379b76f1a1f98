//! Program, user, clock, libraries.

use crate::cli::doctor::facts::{Facts, SystemFacts};
use crate::cli::doctor::finding::Finding;

/// Before this year the clock has never been set: this program did not exist.
const FIRST_YEAR: i16 = 2025;
/// After this year it is set to something else than the time.
const LAST_YEAR: i16 = 2100;

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    let system = &facts.system;
    let mut found = vec![Finding::ok(
        "program.version",
        format!("plenalign {}", system.version),
        format!("on {}, Linux {}, {}", system.system, system.kernel, system.architecture),
    )];
    let (what, name) = ("user", &facts.user.name);
    found.push(match &facts.service {
        Some(service) if facts.user.is_root() => Finding::note(
            "program.user",
            what,
            format!(
                "{name}, who may open everything: whether user {} may, who runs the service, is said below",
                service.name
            ),
        ),
        None if facts.user.is_root() => Finding::note("program.user", what, format!("{name}, who may open everything")),
        _ => Finding::ok("program.user", what, name),
    });
    found.extend([year(system), synchronised(system), turbo(system)]);
    found
}

fn year(system: &SystemFacts) -> Finding {
    let at = system.now.strftime("%Y-%m-%d %H:%M:%S UTC").to_string();
    let year = system.now.to_zoned(jiff::tz::TimeZone::UTC).year();
    if (FIRST_YEAR..LAST_YEAR).contains(&year) {
        return Finding::ok("clock.year", "clock", at);
    }
    Finding::problem(
        "clock.year",
        "clock",
        format!("{at} cannot be the time: certificates and tokens count as not valid, and the history's order is lost"),
        "sudo timedatectl set-ntp true    # or: sudo date --set '2026-01-31 12:00'",
    )
}

fn synchronised(system: &SystemFacts) -> Finding {
    const ID: &str = "clock.synchronised";
    match system.synchronised {
        Some(true) => Finding::ok(ID, "clock", "is kept right by the network"),
        Some(false) => Finding::warning(
            ID,
            "clock",
            "is not synchronised: the times of history, frames and recordings drift",
            "sudo apt install systemd-timesyncd && sudo timedatectl set-ntp true",
        ),
        None => Finding::note(ID, "clock", "whether it is synchronised cannot be found out here (no systemd)"),
    }
}

fn turbo(system: &SystemFacts) -> Finding {
    const ID: &str = "library.turbojpeg";
    match &system.turbo_fault {
        None => Finding::ok(ID, "libturbojpeg.so.0", "encodes the pictures for viewers"),
        Some(why) => Finding::note(
            ID,
            "libturbojpeg.so.0",
            format!("is not used ({why}): pictures for viewers are encoded by the slower encoder in this program"),
        )
        .mend("sudo apt install libturbojpeg0"),
    }
}
