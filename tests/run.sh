#!/usr/bin/env bash
# Builds and runs all tests: `tests/run.sh`. With --long also TSan, the fuzzers and the long tests.
set -euo pipefail
cd "$(dirname "$0")/.."
long=0
for arg in "$@"; do
  case "$arg" in
    --long) long=1 ;;
    *) echo "usage: tests/run.sh [--long]" >&2; exit 2 ;;
  esac
done

samples/install-packages.sh
cmake --preset dev >/dev/null
cmake --build --preset dev
if [ "$long" = 1 ]; then
  cmake --preset tsan >/dev/null
  cmake --build --preset tsan
  ctest --preset tsan
  tests/fuzz/run.sh
  # Every byte of two parts takes hours with sanitizers, which look at a sample below; and they keep memory, so that
  # thirty days say nothing about it.
  cmake --preset release >/dev/null
  cmake --build --preset release --target store_flip_tests soak_tests
  TZ=UTC TACHO_SOAK=1 build/release/tests/recorder/soak_tests
  TZ=UTC TACHO_EVERY_BYTE=1 build/release/tests/schema/store_flip_tests
  export TACHO_LONG=1
fi
ctest --preset dev -j2
