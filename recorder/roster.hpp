#pragma once
// Which robot of the log is recorded for each configured one. A log knows robots by their configured names; when
// another robot answers at an address, it is the row of the log with that identity, or a new one. Pure; one thread at a
// time.

#include <map>
#include <string>
#include <vector>

#include "recorder/fleet.hpp"

namespace tacho::recorder {

class Roster {
 public:
  using Row = Fleet::Row;

  /// A row of the log. Later ones with the same id replace it.
  void know(Row row);
  /// The row that is recorded for a configured robot from now on.
  void assign(const std::string& configured, const Row& row);
  /// The row is no longer recorded for it, and may be for another; find() still gives it.
  void leave(const std::string& configured);
  /// It is no longer configured.
  void release(const std::string& configured) { assigned_.erase(configured); }
  /// What has been told of a row since.
  void learn(RobotId row, const Identity& told);

  /// The last row that was assigned; null when there was none.
  [[nodiscard]] const Row* find(const std::string& configured) const;
  /// For whom a row is recorded; empty: for nobody.
  [[nodiscard]] std::string recorded_for(RobotId row) const;

  struct Place {
    std::string name;    ///< of the row
    Identity identity;   ///< as far as it is known
    bool taken = false;  ///< the row is recorded for another configured robot
  };
  /// Where a robot that answers for a configured one belongs.
  [[nodiscard]] Place place(const std::string& configured, const Identity& other) const;
  /// A row of its own for it, under a name that the log does not have yet: "amr-1 (2)".
  [[nodiscard]] Place new_place(const std::string& configured, const Identity& other) const;
  /// Where a configured robot belongs that was not recorded yet: the row of its name, unless that is taken.
  [[nodiscard]] Place first_place(const std::string& configured) const;

 private:
  struct Assigned {
    RobotId row;
    bool left;
  };
  [[nodiscard]] const Row* named(const std::string& name) const;
  std::map<RobotId, Row> rows_;
  std::map<std::string, Assigned> assigned_;
};

}  // namespace tacho::recorder
