#pragma once
// Loops over many numbers, with instructions for four at a time where the processor has them. What comes out is the
// same: no sum of reals is reordered, and no multiplication is joined with an addition.

namespace tacho::store {

#if defined(__x86_64__)
inline const bool kHasWideInstructions = __builtin_cpu_supports("avx2") != 0;

template <class Loop>
__attribute__((target("avx2"))) void run_wide(const Loop& loop) {
  loop();
}
#else
inline constexpr bool kHasWideInstructions = false;
template <class Loop>
void run_wide(const Loop& loop) {
  loop();
}
#endif

/// Runs `loop`: a lambda with the attribute always_inline, so that its body is compiled for the processor at hand.
template <class Loop>
void run_loop(const Loop& loop) {
  if (kHasWideInstructions) {
    run_wide(loop);
  } else {
    loop();
  }
}

}  // namespace tacho::store
