#pragma once
// A snapshot as Prometheus text (exposition format 0.0.4). One table says what there is: name, type, help, values.

#include <span>
#include <string>
#include <string_view>

#include "recorder/snapshot.hpp"

namespace tacho::recorder {

inline constexpr std::string_view kMetricsContentType = "text/plain; version=0.0.4; charset=utf-8";

std::string metrics_text(const Snapshot& snapshot);

/// For documentation and tests.
struct MetricName {
  std::string_view name;
  std::string_view type;
  std::string_view help;
};
std::span<const MetricName> metric_names();

}  // namespace tacho::recorder
