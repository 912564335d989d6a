#!/usr/bin/env bash
# Try it: installs what is missing (Debian 12), builds, records three simulated robots for a minute, writes a 30-day log of
# a fourth, and reports on both. Takes under 5 minutes after the build.
#   samples/demo.sh [OUTPUT_FOLDER]
set -euo pipefail

usage() { echo "usage: samples/demo.sh [OUTPUT_FOLDER]   (new or empty; default: a new folder in ${TMPDIR:-/tmp})"; }
case "${1:-}" in
  -h | --help) usage; exit 0 ;;
  -*) usage >&2; exit 2 ;;
esac
[ $# -le 1 ] || { usage >&2; exit 2; }

if [ $# = 1 ]; then
  mkdir -p "$1"
  out="$(cd "$1" && pwd)"
  [ -z "$(ls -A "$out")" ] || { echo "demo: error: $out is not empty; name a new folder" >&2; exit 1; }
else
  out="$(mktemp -d "${TMPDIR:-/tmp}/tachograph-demo-XXXXXX")"
fi
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# Everything runs in the background and is waited for, so that an interrupt is acted on at once and nothing is left running.
declare -A running=()
finish() {
  local code=$?
  trap - EXIT INT TERM
  for pid in "${!running[@]}"; do
    kill -TERM "$pid" 2>/dev/null || true
  done
  for pid in "${!running[@]}"; do
    wait "$pid" 2>/dev/null || true
  done
  exit "$code"
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

run() {
  "$@" &
  local pid=$! code=0
  running[$pid]=1
  wait "$pid" || code=$?
  unset "running[$pid]"
  return "$code"
}
say() { printf '\n== %s\n' "$*"; }

say "build"
run samples/install-packages.sh
run cmake --preset release >"$out/build.txt"
run cmake --build --preset release --target tacho-sim tacho-recorder tacho-analyzer >>"$out/build.txt" ||
  { tail -n 30 "$out/build.txt" >&2; exit 1; }
sim=$PWD/build/release/samples/simulator/tacho-sim
recorder=$PWD/build/release/recorder/tacho-recorder
analyzer=$PWD/build/release/analyzer/tacho-analyzer
started=$SECONDS

say "three simulated robots"
"$sim" serve --scenario samples/scenarios/demo.json --truth "$out/live-truth.json" >"$out/robots.txt" &
sim_pid=$!
running[$sim_pid]=1
for _ in $(seq 100); do
  grep -q '^run ' "$out/robots.txt" && break
  kill -0 "$sim_pid" 2>/dev/null || { echo "demo: error: the simulator did not start" >&2; exit 1; }
  sleep 0.1
done
grep '^robot ' "$out/robots.txt"
robots=()
while read -r _ name address; do
  robots+=(--robot "$name=$address")
done < <(grep '^robot ' "$out/robots.txt")

say "recording them for 60 s: status 1 Hz, io 2 Hz, registers 5 Hz, inputs 5 Hz"
moment="$(date -u -d '30 seconds' +%Y-%m-%dT%H:%M:%SZ)"
run "$recorder" run "${robots[@]}" --log "$out/live" --for 60s \
  --period status=1Hz,io=2Hz,registers=5Hz,inputs=5Hz
kill -TERM "$sim_pid"
wait "$sim_pid" || true
unset "running[$sim_pid]"

say "writing 30 days of one more robot at 0.1 Hz"
run "$sim" write --scenario samples/scenarios/busy_day.json --log "$out/month" --days 30 --rate 0.1

say "reports"
run "$analyzer" info "$out/live"
run "$analyzer" report "$out/live" -o "$out/live-report" >"$out/live-report.txt"
run "$analyzer" report "$out/month" -o "$out/month-report" >"$out/month-report.txt"

say "done in $((SECONDS - started)) s after the build; look at"
cat <<END
  $out/live-report.txt      findings of the recorded minute
  $out/month-report.txt     findings of the 30 days
  $out/live-report/         every table (JSON, CSV) and picture (PNG) of the minute
  $out/month-report/        and of the month
  $out/live-truth.json      what was true of the three robots
  $out/month/truth.json     what was true of the fourth
and ask the logs yourself, for example
  $analyzer battery $out/month
  $analyzer alarms $out/month
  $analyzer incident $out/live --at $moment
END
