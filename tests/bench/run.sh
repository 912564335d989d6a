#!/usr/bin/env bash
# Measures: `tests/bench/run.sh [FILTER]` prints one JSON object per figure. FILTER: store, blocks, sql, odometry, battery,
# alarms, blockage.
set -euo pipefail
cd "$(dirname "$0")/../.."
filter="${1:-}"
case "$filter" in
  "" | store | blocks | sql | odometry | battery | alarms | blockage) ;;
  *) echo "usage: tests/bench/run.sh [store|blocks|sql|odometry|battery|alarms|blockage]" >&2; exit 2 ;;
esac
cmake --preset release >/dev/null
cmake --build --preset release --target store_bench block_bench sql_bench analysis_bench >/dev/null
bench=build/release/tests/bench
for group in store block sql; do
  case "$filter" in "" | "$group" | "${group}s") "$bench/${group}_bench" ;; esac
done
case "$filter" in store | blocks | sql) ;; *) "$bench/analysis_bench" "$filter" ;; esac
