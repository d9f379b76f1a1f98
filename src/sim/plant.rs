//! The mechanics that a stage twin's motors turn: what a controller's firmware can act on and sense.

/// Motors and switches of one controller's axes, numbered from 0 as the controller numbers them.
pub trait Plant: Send + Sync {
    /// The motor of `axis` now stands `position_mm` from where it stood at power-up, by the firmware's own count of
    /// steps. Called in order, at least every 10 ms of motion and at every reversal.
    fn motor_moved(&self, axis: usize, position_mm: f64);

    /// Whether the home switch of `axis` is closed.
    fn home_switch_closed(&self, axis: usize) -> bool;

    /// Whether the axis stands against a hard limit switch (either end).
    fn limit_switch_closed(&self, axis: usize) -> bool;
}
