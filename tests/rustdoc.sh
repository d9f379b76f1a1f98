#!/usr/bin/env bash
# The rustdoc of `cargo test --doc`: documents the crate, private items among it, instead of running the examples in its
# documentation, of which there are none. `cargo doc` would check each dependency once more.
set -euo pipefail

arguments=()
while (($# > 0)); do
  case $1 in
  --test) ;;
  --test-run-directory | --test-builder | --test-args | --test-runtool) shift ;;
  --test-*=*) ;;
  *) arguments+=("$1") ;;
  esac
  shift
done
exec rustdoc "${arguments[@]}" --document-private-items --out-dir "$(dirname "$0")/../target/doc" -D warnings
