//! Whether the bench is real, and who has it.

use crate::cli::doctor::facts::{Facts, PortState};
use crate::cli::doctor::finding::Finding;
use crate::config::BenchDriver;

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    let Some(config) = facts.configuration.config() else {
        let why = "what is configured of it is not known: ports and cameras are listed, and not judged";
        return vec![Finding::note("bench.driver", "bench", why)];
    };
    let mut found = vec![match config.bench.driver {
        BenchDriver::Simulated => {
            Finding::note("bench.driver", "bench", "SIMULATED: no real device is driven, and none is needed")
        }
        BenchDriver::Hardware => Finding::ok("bench.driver", "bench", "hardware"),
    }];
    found.push(match (&facts.holder, &facts.server.port) {
        (None, _) => Finding::ok("bench.lock", "bench", "no process has it"),
        (Some(holder), PortState::Taken { url, daemon: Ok(_) }) => {
            Finding::ok("bench.lock", "bench", format!("{} has it, and a daemon answers at {url}", holder.said()))
        }
        (Some(holder), _) => Finding::problem(
            "bench.lock",
            "bench",
            format!(
                "{} has it, and at {} no daemon answers: no other process can drive it",
                holder.said(),
                facts.server.listen
            ),
            format!("kill {}    # or, where it serves elsewhere: plenalign doctor --listen ADDRESS:PORT", holder.pid),
        ),
    });
    found
}
