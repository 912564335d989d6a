#pragma once
// One-minute rollups of one robot in one closed part, made again from its answers and compared with those stored.

#include <array>
#include <map>
#include <string>
#include <vector>

#include "schema/store/rollup.hpp"

namespace tacho {

class RollupCheck {
 public:
  /// Answers in order of arrival.
  void add(const Sample& sample);
  /// Differences in words; the check begins anew. Where nothing is stored nothing is compared: none were made.
  std::vector<std::string> compare(const std::vector<Rollup>& stored);

 private:
  std::array<store::RollupRows, kSourceCount> made_;
  /// Other sources are rolled up for what status has not given so far: from when on it did is not on record.
  FieldSet status_gave_;

  [[nodiscard]] std::string difference(const Rollup& stored) const;
};

}  // namespace tacho
