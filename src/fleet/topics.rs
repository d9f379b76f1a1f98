//! The topics of a bench, in the manner of Sparkplug: `PREFIX/GROUP/KIND/BENCH[/PART]`.

use crate::device::AxisName;

/// Topics of one bench.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topics {
    /// Prefix and group, with a slash between.
    base: String,
    bench: String,
}

impl Topics {
    /// The topics of a bench in a group, below a prefix.
    #[must_use]
    pub fn new(prefix: &str, group: &str, bench: &str) -> Self {
        Self { base: format!("{prefix}/{group}"), bench: bench.to_owned() }
    }

    /// That the bench is there, with what it is; retained.
    #[must_use]
    pub fn birth(&self) -> String {
        format!("{}/NBIRTH/{}", self.base, self.bench)
    }

    /// That it is gone; retained, and the last will.
    #[must_use]
    pub fn death(&self) -> String {
        format!("{}/NDEATH/{}", self.base, self.bench)
    }

    /// How the bench is; retained.
    #[must_use]
    pub fn state(&self) -> String {
        self.data("state")
    }

    /// The newest measurement.
    #[must_use]
    pub fn measurement(&self) -> String {
        self.data("measurement")
    }

    /// Where an axis is.
    #[must_use]
    pub fn axis(&self, axis: AxisName) -> String {
        self.data(axis.name())
    }

    /// What happens to jobs, in order.
    #[must_use]
    pub fn job(&self) -> String {
        format!("{}/JOB/{}", self.base, self.bench)
    }

    /// Whether an alert is on; retained.
    #[must_use]
    pub fn alert(&self, alert: &str) -> String {
        format!("{}/ALERT/{}/{alert}", self.base, self.bench)
    }

    fn data(&self, part: &str) -> String {
        format!("{}/DDATA/{}/{part}", self.base, self.bench)
    }
}

/// Every form of a topic, as the contract writes them.
#[must_use]
pub fn forms() -> Vec<String> {
    let topics = Topics::new("{prefix}", "{group}", "{bench}");
    let axes = AxisName::ALL.map(|axis| topics.axis(axis));
    let others =
        [topics.birth(), topics.death(), topics.state(), topics.measurement(), topics.job(), topics.alert("{alert}")];
    others.into_iter().chain(axes).collect()
}

/// A machine's name as one part of a topic: what cannot be there becomes an underscore.
pub(super) fn level(name: &str) -> String {
    name.chars().map(|c| if matches!(c, '/' | '+' | '#') || c.is_control() { '_' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_have_prefix_group_kind_bench_and_part() {
        let topics = Topics::new("lab/plenalign", "wet", "bench 3");
        assert_eq!(topics.birth(), "lab/plenalign/wet/NBIRTH/bench 3");
        assert_eq!(topics.axis(AxisName::E), "lab/plenalign/wet/DDATA/bench 3/e");
        assert_eq!(topics.alert("stop_latched"), "lab/plenalign/wet/ALERT/bench 3/stop_latched");
        assert_eq!(level("a/b+c#d\n"), "a_b_c_d_");
        assert_eq!(forms().len(), 8);
    }
}
