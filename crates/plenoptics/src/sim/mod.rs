//! Raw frames of a camera that is known exactly: what lies before it, its parts as they truly sit, the exposure.

pub mod exposure;
pub mod flaws;
pub mod renderer;
pub mod scene;
pub mod shutter;
pub mod texture;
