//! Says when the crate has to be built again because of the page: `rust-embed` cannot see a folder appear.
//!
//! A release build embeds `web/dist`; a debug build reads it when asked. Nothing is built or fetched here.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if std::env::var("PROFILE").as_deref() == Ok("release") {
        println!("cargo::rerun-if-changed=web/dist");
    }
}
