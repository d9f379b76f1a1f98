#!/usr/bin/env bash
# The long counts: the daemon killed at many random moments, its stop timed under load, jobs among faults, random sequences
# of requests against a model of what may be true, every kind of job ended at each of its points and after every other, the
# contract tried with many examples, cameras drawn at random and aligned, a study on a Slurm cluster whose tasks and nodes end
# in its middle, a network camera that loses packets, a large one aligned over the network, the reference bench aligned for
# many seeds, then benches of which nothing is as configured; each result is kept, so that a broken run goes on where it ended.
#
#   tests/long.sh            kills and cameras 1 to 200, faults and sequences of seeds 1 to 300, every job, 200 examples,
#                            benches 1 to 500, seeds 1 to 20
#   CAMERAS=201-400 JOBS="homing air_only" KILLS=201-400 SOAK=301-600 MODEL=301-600 EXAMPLES=1000 RENDERED=501-600 \
#     SEEDS=21-40 tests/long.sh
set -euo pipefail
cd "$(dirname "$0")/.."

kills=${KILLS:-1-200}
[[ $kills =~ ^[0-9]+-[0-9]+$ ]] || { echo "long: KILLS=$kills is not a range such as 1-200" >&2; exit 2; }
range=${SEEDS:-1-20}
[[ $range =~ ^([0-9]+)-([0-9]+)$ ]] || { echo "long: SEEDS=$range is not a range such as 1-20" >&2; exit 2; }
first=${BASH_REMATCH[1]} last=${BASH_REMATCH[2]}
soak=${SOAK:-1-300}
[[ $soak =~ ^([0-9]+)-([0-9]+)$ ]] || { echo "long: SOAK=$soak is not a range such as 1-300" >&2; exit 2; }
soak_first=${BASH_REMATCH[1]} soak_last=${BASH_REMATCH[2]}
model=${MODEL:-1-300}
[[ $model =~ ^([0-9]+)-([0-9]+)$ ]] || { echo "long: MODEL=$model is not a range such as 1-300" >&2; exit 2; }
model_first=${BASH_REMATCH[1]} model_last=${BASH_REMATCH[2]}
cameras=${CAMERAS:-1-200}
[[ $cameras =~ ^([0-9]+)-([0-9]+)$ ]] || { echo "long: CAMERAS=$cameras is not a range such as 1-200" >&2; exit 2; }
cameras_first=${BASH_REMATCH[1]} cameras_last=${BASH_REMATCH[2]}

deploy/setup.sh test
cargo build --release --quiet
results=target/long
mkdir -p "$results"
KILLS=$kills KILL_RESULTS=$PWD/$results \
  cargo test --release --quiet --test integration many_kills -- --ignored --nocapture
cargo test --release --quiet --test integration many_stops_reach -- --ignored --nocapture
SEEDS=$range cargo test --release --quiet --test integration many_frames_are_smeared -- --ignored --nocapture
SEEDS=$range cargo test --release --quiet --test integration two_boards::many -- --ignored --nocapture
cargo test --release --quiet --test integration what_many_budgets_say -- --ignored --nocapture
cargo test --release --quiet --test integration a_slurm_study_comes_through -- --ignored
cargo test --release --quiet --test integration every_kind_of_job_follows -- --ignored
# Runs a test over a range of seeds, ten at a time; the parts that are there already are not run again.
tens() {
  local what=$1 test=$2 first=$3 last=$4 from to result
  for ((from = first; from <= last; from += 10)); do
    to=$((from + 9 < last ? from + 9 : last))
    result=$results/${what,,}-$from-$to.log
    if [[ ! -s $result ]]; then
      env "$what=$from-$to" cargo test --release --quiet --test integration "$test" -- --ignored --nocapture >"$result.part" 2>&1 || {
        tail -n 60 "$result.part" >&2
        exit 1
      }
      mv "$result.part" "$result"
    fi
  done
}
tens SOAK many_jobs_among "$soak_first" "$soak_last"
grep -h '^[0-9]* jobs, ' "$results"/soak-*.log | awk '{ jobs += $1; converged += $3; faults += $5; during += $7 }
  END { print jobs " jobs among " faults " faults (" during " while a job ran), " converged " converged, nothing violated" }'
tens MODEL many_sequences "$model_first" "$model_last"
grep -h '^[0-9]* sequences, ' "$results"/model-*.log | awk '{ sequences += $1; steps += $3; requests += $5 }
  END { print sequences " sequences of " steps " steps with " requests " requests, every promise kept" }'
tens SMALL_CAMERAS many_small_cameras "$cameras_first" "$cameras_last"
tens CAMERAS many_cameras_align "$cameras_first" "$cameras_last"
for of in small_cameras cameras; do
  grep -h '^[0-9]* cameras, ' "$results/$of"-*.log | awk -v of="$of" '{ cameras += $1; converged += $3 }
    END { print of ": " converged " of " cameras " converged, the others were refused before anything moved"
          if (converged < 0.85 * cameras) exit 1 }'
done
# What judges the estimator is proven itself, and renders what is kept of it.
tests/second-renderer/run.sh
# Every kind of job ended at each of its points; the kinds that are there already are not run again.
jobs=${JOBS:-homing joint_alignment air_only shell_only clarity_only l_bound_measurement focus_sweep spacing_watch calibration release commands}
for job in $jobs; do
  result=$results/points-$job.log test=all_points_of_a_job
  [[ $job != release ]] || test=all_polls_of_a_release
  [[ $job != commands ]] || test=no_order_of_the_other_jobs_goes_out
  if [[ ! -s $result ]]; then
    JOB=$job cargo test --release --quiet --test integration "$test" -- --ignored --nocapture >"$result.part" 2>&1 || {
      tail -n 60 "$result.part" >&2
      exit 1
    }
    mv "$result.part" "$result"
  fi
done
grep -hE '^([a-z_]+|[0-9]+ commands)[ (:].* ends' "$results"/points-*.log
EXAMPLES=${EXAMPLES:-200} tests/schemathesis/run.sh
# Minutes of a network camera whose packets are lost; those that are there already are not run again.
result=$results/network-losses.log
if [[ ! -s $result ]]; then
  FRAMES=3000 tests/genicam/run.sh >"$result.part" 2>&1 || {
    tail -n 60 "$result.part" >&2
    exit 1
  }
  mv "$result.part" "$result"
fi
grep -h '^- with packets lost' "$result"
# An alignment over the network with a camera of twelve million pixels; one that is there already is not run again.
result=$results/network-camera.log
if [[ ! -s $result ]]; then
  NO_BUILD=1 SENSOR=4096x3072 PROGRAM=$PWD/target/release/plenalign tests/genicam/twin.sh >"$result.part" 2>&1 || {
    tail -n 60 "$result.part" >&2
    exit 1
  }
  mv "$result.part" "$result"
fi
grep -h '^- aligned' "$result"
for seed in $(seq "$first" "$last"); do
  result=$results/align-$seed.json
  if [[ ! -s $result ]]; then
    PLENALIGN_STATE_DIR=$results target/release/plenalign align --seed "$seed" --json >"$result.part" 2>"$results/align-$seed.log" || true
    mv "$result.part" "$result"
  fi
done

python3 - "$results" "$first" "$last" <<'PYTHON'
import json, sys
folder, first, last = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
bad = 0
print("seed outcome        Δv error air µm  focus error air µm  spacing error px  ± px    e truth mm  least e mm  moves")
for seed in range(first, last + 1):
    r = json.load(open(f"{folder}/align-{seed}.json"))
    truth, air = r["truth"], r["truth"].get("air", {})
    delta_v = 1000 * (air.get("delta_v_mm", float("nan")) - r["delta_v_air_target_mm"])
    focus = 1000 * (air.get("focus_error_mm") or float("nan"))
    spacing = (r["spacing_px"] or float("nan")) - r["spacing_target_px"]
    good = (r["outcome"] == "converged" and abs(focus) < 10 and abs(spacing) < 0.03
            and r["moves_air"] <= 4 and r["moves_shell"] <= 5 and not truth["touched_shell"])
    bad += not good
    print(f"{seed:4d} {r['outcome']:14s} {delta_v:15.2f} {focus:19.2f} {spacing:17.4f} {r['spacing_sigma_px'] or 0:7.4f}"
          f" {truth['e_mm']:11.3f} {truth['least_e_with_shell_mm'] or float('nan'):11.3f}  {r['moves_air']}+{r['moves_shell']}"
          f"{'' if good else '   NOT AS WANTED: ' + r['reason']}")
total = last - first + 1
print(f"{total - bad} passed, {bad} failed")
sys.exit(1 if bad else 0)
PYTHON
RENDERED=${RENDERED:-1-500} RENDERED_RESULTS=$PWD/$results \
  cargo test --release --quiet --test integration many_rendered_benches -- --ignored --nocapture
