//! Says when the crate has to be built again because of the page: `rust-embed` cannot see a folder appear.
//!
//! Both embed `web/dist` as it is then. A release build notices when it changes; others would be made anew with every
//! change of the page: touch `src/api/page.rs` to have it embedded again. Nothing is built or fetched here.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if std::env::var("PROFILE").as_deref() == Ok("release") {
        println!("cargo::rerun-if-changed=web/dist");
    }
}
