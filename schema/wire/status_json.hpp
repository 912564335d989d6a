#pragma once
// 11100, 11013 and 19301 bodies -> Sample. Survives anything: missing keys, null, integers for floats, boolean DI
// arrays, the four alarm shapes, unknown keys (collected), bodies that are no JSON (decodable = false).

#include <memory>
#include <string_view>

#include "schema/sample.hpp"

namespace tacho::wire {

/// Holds the parser's memory. One per thread.
class JsonDecoder {
 public:
  JsonDecoder();
  ~JsonDecoder();
  JsonDecoder(JsonDecoder&&) noexcept;
  JsonDecoder& operator=(JsonDecoder&&) noexcept;

  /// Clears `out` but for `out.meta`, then fills the fields in `wanted` (alarm and point lists, when one of their
  /// fields is wanted, whole). A condition flag of a wanted field is decoded too. Unknown keys are collected only when
  /// `collect_unknown`.
  void decode(std::string_view body, const FieldSet& wanted, bool collect_unknown, Sample& out);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho::wire
