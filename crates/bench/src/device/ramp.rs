//! How far an axis comes that speeds up and slows down at one acceleration.

/// Greatest speed and acceleration of a motion; both may be infinite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ramp {
    /// Greatest speed, mm/s.
    pub speed_mm_per_s: f64,
    /// Acceleration and deceleration, mm/s².
    pub acceleration_mm_per_s2: f64,
}

impl Ramp {
    /// Without a bound.
    pub const RIGID: Self = Self { speed_mm_per_s: f64::INFINITY, acceleration_mm_per_s2: f64::INFINITY };

    /// The same at another speed, where that is less.
    #[must_use]
    pub fn at_most(self, speed_mm_per_s: f64) -> Self {
        Self { speed_mm_per_s: self.speed_mm_per_s.min(speed_mm_per_s), ..self }
    }

    /// The way (mm) at whose end an axis that goes at `now` mm/s rests again after `seconds`, having gone as fast as it
    /// can meanwhile; its braking distance where that takes longer.
    #[must_use]
    pub fn reach(&self, now: f64, seconds: f64) -> f64 {
        let Self { speed_mm_per_s: speed, acceleration_mm_per_s2: acceleration } = *self;
        let now = now.clamp(0.0, speed);
        let peak = 0.5 * (acceleration * seconds + now);
        if peak <= now {
            now * now / (2.0 * acceleration)
        } else if peak <= speed {
            (2.0 * peak * peak - now * now) / (2.0 * acceleration)
        } else {
            let ramps = (2.0 * speed - now) / acceleration;
            (2.0 * speed * speed - now * now) / (2.0 * acceleration) + speed * (seconds - ramps)
        }
    }

    /// The speed (mm/s) at which an axis can go on without slowing down that is told `seconds` of its way at most, and
    /// hears of more within `pause` seconds.
    #[must_use]
    pub fn steady(&self, seconds: f64, pause: f64) -> f64 {
        self.speed_mm_per_s.min(self.acceleration_mm_per_s2 * (seconds - pause))
    }

    /// The same of an axis that is told `way` mm at most.
    #[must_use]
    pub fn steady_within(&self, way: f64, pause: f64) -> f64 {
        let acceleration = self.acceleration_mm_per_s2;
        // way = v pause + v²/2a, written so that a may be infinite.
        let speed = 2.0 * way / (pause + (pause * pause + 2.0 * way / acceleration).sqrt());
        self.speed_mm_per_s.min(speed)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// How long an axis takes for a way, by small steps.
    fn takes(ramp: Ramp, now: f64, way: f64) -> f64 {
        let (dt, mut speed, mut left, mut time) = (1e-5, now, way, 0.0);
        while left > 1e-6 && time < 10.0 {
            let brake = (2.0 * ramp.acceleration_mm_per_s2 * left).sqrt();
            let next = (speed + ramp.acceleration_mm_per_s2 * dt).min(ramp.speed_mm_per_s).min(brake);
            left -= 0.5 * (speed + next) * dt;
            speed = next;
            time += dt;
        }
        time
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn a_reach_takes_its_time(speed in 0.1f64..50.0, acceleration in 1.0f64..1000.0, part in 0.0f64..1.0) {
            let ramp = Ramp { speed_mm_per_s: speed, acceleration_mm_per_s2: acceleration };
            let now = part * speed.min(0.3 * acceleration);
            let time = takes(ramp, now, ramp.reach(now, 0.3));
            // The last micrometre takes up to its root's time.
            prop_assert!((time - 0.3).abs() < 0.002, "{}", time);
        }
    }

    #[test]
    fn speeds_that_can_be_kept_leave_the_braking_distance_after_the_pause() {
        let ramp = Ramp { speed_mm_per_s: 50.0, acceleration_mm_per_s2: 20.0 };
        let steady = ramp.steady(0.3, 0.1);
        assert!((steady - 4.0).abs() < 1e-12);
        let left = ramp.at_most(steady).reach(steady, 0.3) - 0.1 * steady;
        assert!((left - steady * steady / 40.0).abs() < 1e-12);
        let near = ramp.steady_within(0.2, 0.1);
        assert!((0.1 * near + near * near / 40.0 - 0.2).abs() < 1e-12 && near < 2.0, "{near}");
        assert_eq!(Ramp::RIGID.steady_within(0.2, 0.1), 2.0);
        assert_eq!(Ramp::RIGID.at_most(5.0).reach(0.0, 0.3), 1.5);
        assert_eq!(ramp.reach(50.0, 0.3), 62.5, "it cannot stop sooner");
    }
}
