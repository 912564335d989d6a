// One libFuzzer binary per target; TACHO_FUZZ_TARGET names the function.

#include <cstddef>
#include <cstdint>

#include "tests/fuzz/targets.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  // libFuzzer hands out bytes, the wire works on characters.
  tacho::fuzz::TACHO_FUZZ_TARGET({reinterpret_cast<const char*>(data), size});
  return 0;
}
