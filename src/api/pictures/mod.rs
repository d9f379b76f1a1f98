//! What a viewer is shown of a frame: which picture, which part of it, and as what it is sent.

pub(in crate::api) mod frame;
pub(in crate::api) mod picture;
pub(in crate::api) mod placeholder;
pub(in crate::api) mod scene;
pub mod view;
pub(in crate::api) mod viewed;
pub(in crate::api) mod viewport;
