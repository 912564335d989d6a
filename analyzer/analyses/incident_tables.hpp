#pragma once
// The tables of an incident, without rows: names, units and meanings of their columns.

#include "analyzer/report/section.hpp"

namespace tacho {

DataTable timeline_table();
DataTable signals_table();
DataTable state_table();
DataTable quality_table();

}  // namespace tacho
