#!/usr/bin/env bash
# Every benchmark and the comparison with others' tools; ends with one table of ratios, in target/bench/benchmarks.md and
# on standard output.
#
#   BENCH_PAGE=docs/benchmarks.md make bench   puts it into that page, too
#   BENCH_MACHINE=name make bench              says by that name which machine it was
set -euo pipefail
cd "$(dirname "$0")/.."

folder=target/bench
mkdir -p "$folder"
# A page without a place for the table is to be known before an hour of timing.
[[ -z ${BENCH_PAGE:-} ]] || grep -q 'The table of `make bench` begins' "$BENCH_PAGE" || {
  echo "bench: $BENCH_PAGE has no place for the table; docs/benchmarks.md has" >&2
  exit 1
}
# Before anything is built, which is load itself.
cut -d' ' -f1-3 /proc/loadavg >"$folder/started"
cargo bench --bench grid --bench spacing --bench live --bench views --bench jpeg --bench render
cargo bench --bench accuracy
benches/compare/run.sh
cargo bench --bench pace -- --out "$PWD/$folder/pace.json"
echo
python3 benches/table.py --since "$folder/started" --comparison target/compare/comparison.json --pace "$folder/pace.json" \
  ${BENCH_PAGE:+--page "$BENCH_PAGE"} "$folder/benchmarks.md"
