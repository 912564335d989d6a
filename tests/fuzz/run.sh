#!/usr/bin/env bash
# Runs each fuzzer for a bounded time: `tests/fuzz/run.sh [SECONDS]` (default 60 each). Needs clang. New inputs stay in
# build/fuzz/corpus; a failing one is left in build/fuzz/found and belongs into tests/fuzz/corpus with its fix.
set -euo pipefail
cd "$(dirname "$0")/../.."
seconds=${1:-60}
if [ $# -gt 1 ] || ! [[ "$seconds" =~ ^[1-9][0-9]*$ ]]; then
  echo "usage: tests/fuzz/run.sh [SECONDS]" >&2
  exit 2
fi
if ! command -v clang++ >/dev/null; then
  echo "fuzz: error: clang++ not found; install the package clang" >&2
  exit 1
fi

targets=(frame status_json registers block mbap register_plan config learned)
cmake --preset fuzz >/dev/null
cmake --build --preset fuzz --target "${targets[@]/#/fuzz_}"
mkdir -p build/fuzz/found
for target in "${targets[@]}"; do
  mkdir -p "build/fuzz/corpus/$target"
  echo "fuzz: $target for $seconds s"
  build/fuzz/tests/fuzz/"fuzz_$target" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 -print_final_stats=1 \
    -artifact_prefix="build/fuzz/found/$target-" "build/fuzz/corpus/$target" "tests/fuzz/corpus/$target"
done
