# Has every build that follows lint what it compiles, with warnings as errors: sourced by the scripts that build what
# tests run, so that all of them share one build. Clippy by itself would check each dependency once more, which takes
# longer than all of its lints.
export RUSTC_WORKSPACE_WRAPPER=clippy-driver
# As `cargo clippy -- -D warnings` passes it on.
export CLIPPY_ARGS=-D__CLIPPY_HACKERY__warnings__CLIPPY_HACKERY__
