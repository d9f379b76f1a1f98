//! What the loops decide: from what was measured to the next move, and to how an axis really goes. Pure functions, which
//! hold no device.

pub mod air;
pub(crate) mod at_pose;
pub mod axis_model;
pub mod calibrated;
pub(crate) mod mistake;
pub mod room;
pub mod shell;
pub(crate) mod swept_way;
pub mod through_focus;
