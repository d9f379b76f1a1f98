#!/usr/bin/env bash
# Runs docs/curl.md as it stands: its commands, in order, in one shell, on the daemon; and compares what each prints with
# what the page says that it prints.
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

[[ -n ${NO_BUILD:-} ]] || build_daemon
folder=$(mktemp -d)
walk=
finish() {
  # The walk's daemon is in the walk's own group.
  [[ -z $walk ]] || kill -KILL -- "-$walk" 2>/dev/null || true
  rm -rf "$folder"
}
trap finish EXIT

# Each block into a file of its own, numbered in order: NN.sh, and NN.text for what it prints.
mkdir "$folder/blocks" "$folder/walk"
awk -v into="$folder/blocks" '
  /^```/ {
    if (file != "") { close(file); file = ""; next }
    kind = substr($0, 4)
    if (kind == "sh") { number++ }
    if (kind != "sh" && (kind != "text" || number == 0)) { print "curl.md:" NR ": a block of kind " kind; exit 1 }
    file = sprintf("%s/%02d.%s", into, number, kind)
    printf "" > file
    next
  }
  file != "" { print > file }
  END { if (file != "") { print "curl.md: a block has no end"; exit 1 } }
' ../../docs/curl.md

# All in one shell, whose output is parted by lines that no command prints.
for block in "$folder"/blocks/*.sh; do
  number=$(basename "$block" .sh)
  [[ -e $folder/blocks/$number.text ]] || : >"$folder/blocks/$number.text"
  echo "exec >'$folder/blocks/$number.said'"
  cat "$block"
done >"$folder/walk.sh"

port=$((20000 + RANDOM % 10000))
set -m
(
  cd "$folder/walk"
  export PATH="$root/target/debug:$PATH" PLENALIGN_STATE_DIR="$folder/state" LISTEN=127.0.0.1:$port
  unset PLENALIGN_TOKEN
  exec timeout 400 bash -euo pipefail "$folder/walk.sh"
) &
walk=$!
set +m
status=0
wait "$walk" || status=$?

blocks=0
failed=0
for text in "$folder"/blocks/*.text; do
  number=$(basename "$text" .text)
  said=$folder/blocks/$number.said
  [[ -e $said ]] || said=/dev/null
  mapfile -t wanted <"$text"
  mapfile -t got <"$said"
  same=$((${#wanted[@]} == ${#got[@]}))
  for line in "${!wanted[@]}"; do
    # Only the dots stand for something else.
    pattern=$(printf '%s' "${wanted[line]}" | sed 's/[][*?\\]/\\&/g; s/…/*/g')
    # shellcheck disable=SC2053
    [[ ${got[line]-} == $pattern ]] || same=0
  done
  if ((!same)); then
    echo "curl-walk: block $number should print"
    sed 's/^/    /' "$text"
    echo "  and printed"
    sed 's/^/    /' "$said"
    failed=1
    break
  fi
  blocks=$((blocks + 1))
done
if ((status != 0 || failed)); then
  echo "curl-walk: the walk ended with $status" >&2
  tail -n 20 "$folder/walk/serve.log" >&2 || true
  exit 1
fi

# What the dots stood for.
cd "$folder/walk"
jq -e '
  .simulated and .job.state == "converged" and (.job.report |
    (.delta_v_mm - .delta_v_target_mm | fabs) < 0.05 and
    .e_mm > .e_tolerance.low_mm and .e_mm < .e_tolerance.high_mm and
    (.spacing_px - .spacing_target_px | fabs) < 0.05 and .spacing_sigma_px < 0.05) and
  (.operator_steps | length) == 4 and all(.operator_steps[]; .confirmed_at)
' export.json >/dev/null || { echo "curl-walk: the report is not that of an aligned camera" >&2; jq .job.report export.json >&2; exit 1; }
grep -q SIMULATED report.html
grep -qi '^.*iteration\|stage' export.csv
[[ $(head -c 2 frame.jpg | od -An -tx1 | tr -d ' ') == ffd8 ]] || { echo "curl-walk: frame.jpg is no JPEG" >&2; exit 1; }
echo "curl-walk: $blocks blocks of docs/curl.md ran, and printed what it says"
