#pragma once
// The result of the battery analysis as a Section: tables and series (battery_tables.cpp), verdicts
// (battery_findings.cpp).

#include <memory>
#include <string>
#include <vector>

#include "analyzer/analyses/battery_fold.hpp"

namespace tacho::battery {

using Robots = std::vector<std::unique_ptr<RobotFold>>;

void add_tables(Section& section, const Robots& robots);
void add_series(Section& section, const RobotFold& fold);
void add_findings(Section& section, const RobotFold& fold);
void add_notes(Section& section, const RobotFold& fold);

// Parts of add_tables.
void add_usage_tables(Section& section, const Robots& robots);   // battery_usage_tables.cpp
void add_detail_tables(Section& section, const Robots& robots);  // battery_detail_tables.cpp

inline const std::string kNominalMissing = "configure battery.nominal_capacity_ah";
inline const ColumnSpec kRobot{"robot", "", "Robot", false};
inline const ColumnSpec kPack = integer_column("pack", "Battery pack, counted from 1 by falls of battery_cycle");

DataTable make_table(std::string name, std::string title, std::vector<ColumnSpec> columns, bool detail = false);
/// NaN as a missing value.
Value cell(double value, std::string why = "not in the log");
/// A share as percent.
Value percent(double share);

/// Calls fill(fold, pack, number from 1).
template <class Fill>
void each_pack(const Robots& robots, Fill&& fill) {
  for (const std::unique_ptr<RobotFold>& fold : robots) {
    for (std::size_t i = 0; i < fold->packs.size(); ++i) {
      fill(*fold, *fold->packs[i], static_cast<std::int64_t>(i + 1));
    }
  }
}

/// Why this quantity is not known, in words that name the field; empty when it is supplied.
std::string missing(const RobotFold& fold, Item item);

Quantity known(double value, std::string unit);
Quantity within(double value, double lo, double hi, std::string unit);
Quantity unknown(std::string reason, std::string unit = {});

/// Charge moved in a pack, bridged parts not included. `charging`: into the battery.
Quantity moved_ah(const RobotFold& fold, const Pack& pack, bool charging);
/// Ah per unit of SoC that the record itself shows: throughput over variation of SoC. No capacity measurement: it
/// follows the battery's own idea of its capacity. NaN with less than one full cycle.
double apparent_capacity_ah(const Pack& pack);
/// Failed charges: sessions without current and idle contacts, by time.
std::vector<ChargeSession> failed_charges(const RobotFold& fold);
/// What battery_cycle counts in this pack.
CounterResult counter_result(const RobotFold& fold, const Pack& pack);

}  // namespace tacho::battery
