// Every analysis, in the order of the report: one row each.

#include <vector>

#include "analyzer/analyses/analyses.hpp"

namespace tacho {

std::span<const AnalysisSpec> analyses() {
  static const std::vector<AnalysisSpec> rows{
      kOdometry,
      kBattery,
      kAlarms,
      kBlockage,
  };
  return rows;
}

}  // namespace tacho
