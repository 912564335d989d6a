#!/usr/bin/env bash
# Measures: `tests/bench/run.sh [FILTER]` prints one JSON object per figure. FILTER: store, sql, odometry, battery, alarms, blockage.
set -euo pipefail
cd "$(dirname "$0")/../.."
case "${1:-}" in
  "" | store | sql | odometry | battery | alarms | blockage) ;;
  *) echo "usage: tests/bench/run.sh [store|sql|odometry|battery|alarms|blockage]" >&2; exit 2 ;;
esac
cmake --preset release >/dev/null
cmake --build --preset release --target store_bench analysis_bench sql_bench >/dev/null
bench=build/release/tests/bench
[ -n "${1:-}" ] && [ "$1" != store ] || "$bench/store_bench"
[ -n "${1:-}" ] && [ "$1" != sql ] || "$bench/sql_bench"
case "${1:-}" in store | sql) ;; *) "$bench/analysis_bench" "${1:-}" ;; esac
