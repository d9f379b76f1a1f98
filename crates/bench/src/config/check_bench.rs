//! Physical sense of `[bench]`.

use super::check::Faults;
use super::{AxisConfig, BenchConfig, BenchDriver, CameraDriver};

impl BenchConfig {
    pub(super) fn check(&self, faults: &mut Faults) {
        for (name, axis) in [("focus", &self.focus), ("e", &self.e)] {
            axis.check(&format!("bench.{name}"), faults);
        }
        for (name, controller) in &self.controllers {
            let key = format!("bench.controllers.{name}");
            faults.require(!controller.port.as_os_str().is_empty(), format!("{key}.port"), || {
                "is empty: give the serial port, best by its /dev/serial/by-id name".to_owned()
            });
            faults.require(controller.port.as_os_str() != "usb:", format!("{key}.port"), || {
                "names no USB serial number: usb:A50285BI, for one".to_owned()
            });
            faults.require(controller.baud() > 0, format!("{key}.baud"), || "must be at least 1".to_owned());
        }
        self.camera.check(faults);
        if self.driver == BenchDriver::Hardware || self.camera.driver == CameraDriver::Files {
            self.camera.check_source(faults);
        }
        self.simulation.check(faults);
        if self.driver == BenchDriver::Hardware {
            self.check_wiring(faults);
        }
    }

    /// On hardware every axis needs a controller, and one of its own axes there.
    fn check_wiring(&self, faults: &mut Faults) {
        for (name, axis) in [("focus", &self.focus), ("e", &self.e)] {
            match self.controllers.get(&axis.controller) {
                None => {
                    let known: Vec<&str> = self.controllers.keys().map(String::as_str).collect();
                    let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
                    faults.add(
                        format!("bench.{name}.controller"),
                        format!(
                            "driver = \"hardware\" needs a section [bench.controllers.{}]; there is {known}",
                            axis.controller
                        ),
                    );
                }
                Some(controller) => {
                    if let Err(names) = controller.driver.check_axis(&axis.axis) {
                        faults.add(format!("bench.{name}.axis"), format!("{:?} is no axis: {names}", axis.axis));
                    }
                }
            }
        }
        faults.require(
            (&self.focus.controller, &self.focus.axis) != (&self.e.controller, &self.e.axis),
            "bench.e.axis",
            || format!("is the focus axis's: both are {} of controller {}", self.e.axis, self.e.controller),
        );
    }
}

impl AxisConfig {
    fn check(&self, path: &str, faults: &mut Faults) {
        let key = |name: &str| format!("{path}.{name}");
        let (low, high) = (self.low_limit_mm, self.high_limit_mm);
        faults.require(low < high, key("low_limit_mm"), || format!("{low} is not less than high_limit_mm, {high}"));
        faults.require(low >= high || (low..=high).contains(&self.home_position_mm), key("home_position_mm"), || {
            format!("{} is outside the limits of {low} to {high}", self.home_position_mm)
        });
        faults.positive(key("steps_per_mm"), self.steps_per_mm);
        faults.positive(key("speed_mm_per_s"), self.speed_mm_per_s);
        faults.positive(key("acceleration_mm_per_s2"), self.acceleration_mm_per_s2);
        faults.positive(key("max_step_mm"), self.max_step_mm);
        faults.not_negative(key("backlash_mm"), self.backlash_mm);
        faults.require(low >= high || self.backlash_mm < high - low, key("backlash_mm"), || {
            format!("{} is more than the whole travel", self.backlash_mm)
        });
        faults.not_negative(key("zero_uncertainty_mm"), self.zero_uncertainty_mm);
        faults.require((0.0..1.0).contains(&self.scale_uncertainty), key("scale_uncertainty"), || {
            format!("{} is not a relative uncertainty from 0 to below 1", self.scale_uncertainty)
        });
    }
}
