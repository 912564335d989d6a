#!/usr/bin/env bash
# Measures: `tests/bench/run.sh [FILTER]` prints one JSON object per figure.
set -euo pipefail
cd "$(dirname "$0")/../.."
filters="store write blocks scan sql recorder odometry battery alarms blockage report"
filter="${1:-}"
if [ $# -gt 1 ] || { [ -n "$filter" ] && [[ " $filters " != *" $filter "* ]]; }; then
  echo "usage: tests/bench/run.sh [${filters// /|}]" >&2
  exit 2
fi
cmake --preset release >/dev/null
cmake --build --preset release --target write_bench block_bench scan_bench sql_bench analysis_bench program_bench >/dev/null
bench=build/release/tests/bench
run() {
  case "$1" in
    store) for part in write blocks scan sql; do run "$part"; done ;;
    write | scan | sql) "$bench/$1_bench" ;;
    blocks) "$bench/block_bench" ;;
    recorder) "$bench/program_bench" recorder && "$bench/program_bench" dead ;;
    report) "$bench/program_bench" report ;;
    *) "$bench/analysis_bench" "$1" ;;
  esac
}
# Without a filter all of them: store is write, blocks, scan and sql.
for each in ${filter:-store recorder odometry battery alarms blockage report}; do
  run "$each"
done
