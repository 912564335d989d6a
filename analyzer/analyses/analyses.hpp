#pragma once
// The analyses by name. Each `kName` is defined in analyses/NAME.cpp together with its needs, its settings and its
// `make`, and has one row in registry.cpp; nothing else mentions it.

#include "analyzer/analysis.hpp"

namespace tacho {

extern const AnalysisSpec kOdometry;
extern const AnalysisSpec kBattery;
extern const AnalysisSpec kAlarms;
extern const AnalysisSpec kBlockage;

}  // namespace tacho
