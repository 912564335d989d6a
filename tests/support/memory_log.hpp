#pragma once
// A RowSource in memory, for tests of analyses: rows are decoded samples put in by hand or by a simulated robot.

#include <initializer_list>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "schema/row_source.hpp"

namespace tacho::test {

class MemoryLog : public RowSource {
 public:
  /// Adds a robot; ids count from 1.
  RobotId add_robot(const std::string& name);
  /// Starts the next row of a source; cells are then set through the returned sample. `t_s`: seconds since 2026-01-01
  /// UTC. Rows of one source must be added in order; seq counts up by itself unless given.
  Sample& row(RobotId robot, Source source, double t_s, double rtt_s = 0.004);
  static void set(Sample& sample, std::string_view field, double value);        ///< real
  static void set_int(Sample& sample, std::string_view field, std::int64_t v);  ///< integer, flag, code
  static void set_text(Sample& sample, std::string_view field, std::string_view v);
  static void set_state(Sample& sample, std::string_view field, State state);
  /// Marks all four alarm arrays as present and adds one alarm.
  static void no_alarms(Sample& sample);
  static void alarm(Sample& sample, AlarmLevel level, std::int64_t code, std::int64_t stamp_s, std::int64_t times = 1);
  void gap(const Gap& gap);
  void event(const Event& event);
  void period(RobotId robot, Source source, double period_s);
  /// Rows per slice when read; tests vary it to show that chunking does not matter. 0 = one slice.
  void slice_rows(std::size_t rows) { slice_rows_ = rows; }

  static Micros micros(double t_s);  ///< the time scale of row()

  [[nodiscard]] std::vector<Robot> robots() const override;
  [[nodiscard]] std::vector<Session> sessions() const override;
  [[nodiscard]] std::vector<Stream> streams() const override;
  [[nodiscard]] std::vector<Coverage> coverage() const override;
  [[nodiscard]] std::vector<UnknownKey> unknown_keys() const override { return {}; }
  [[nodiscard]] std::vector<ReadProblem> problems() const override { return {}; }
  void read(RobotId robot, Window window, const Selection& selection,
            const std::function<void(const Slice&)>& yield) override;
  void read_raw(RobotId, Source, Window, const std::function<void(const Answer&)>&) override {}

 private:
  std::vector<Robot> robots_;
  std::vector<Sample> rows_;  // in arrival order
  std::vector<Gap> gaps_;
  std::vector<Event> events_;
  std::map<std::pair<RobotId, Source>, Micros> periods_;
  std::map<std::pair<RobotId, Source>, std::uint64_t> next_seq_;
  std::size_t slice_rows_ = 0;
};

}  // namespace tacho::test
