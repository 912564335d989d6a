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
cmake --build --preset release --target store_bench write_bench block_bench scan_bench sql_bench analysis_bench program_bench >/dev/null
bench=build/release/tests/bench
for each in ${filter:-$filters}; do
  case "$each" in
    store | write | scan | sql) "$bench/${each}_bench" ;;
    blocks) "$bench/block_bench" ;;
    recorder | report) "$bench/program_bench" "$each" ;;
    *) "$bench/analysis_bench" "$each" ;;
  esac
done
