#pragma once
// `tacho-recorder tail LOG`: follows a log that is being recorded: new answers, gaps and events, one line each. Read
// only; each look is a short read transaction, so the recorder does not notice.

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "schema/row_source.hpp"

namespace tacho::recorder {

struct TailOptions {
  std::filesystem::path log;
  std::vector<std::string> robots;  ///< empty: all
  std::vector<Source> sources;      ///< answers of these; empty: of all
  std::vector<FieldIndex> fields;   ///< empty: a few that say what the robot does
  bool answers = true;              ///< false: gaps and events alone
  bool json = false;                ///< an object per line
};

/// What --robot, --source and --fields name. Throws UsageError with the nearest name.
std::vector<Source> parse_sources(const std::vector<std::string>& names);
std::vector<FieldIndex> parse_fields(const std::vector<std::string>& names);

class Tail {
 public:
  /// Everything committed after `from_us` (wall clock) is new. Throws Error when there is no log, UsageError when a
  /// robot is not in it.
  Tail(TailOptions options, Micros from_us);
  /// Lines for what has been committed since the last call, by time. Nothing is lost between two calls however far
  /// they are apart, and nothing comes twice.
  std::vector<std::string> poll();
  /// Prints until a signal comes, `for_us` is over (empty: never), or nobody reads standard output any more.
  void follow(std::optional<Micros> for_us);

 private:
  struct Line {
    Micros t_us = 0;
    std::string text;
  };
  using Poll = std::pair<SessionId, std::uint64_t>;

  void read(RowSource& log, const Robot& robot, std::vector<Line>& lines);
  void rows(const Robot& robot, const Slice& slice, std::vector<Line>& lines);
  void records(const Robot& robot, const Slice& slice, std::vector<Line>& lines);
  [[nodiscard]] std::string answer_line(const Robot& robot, SessionId session, const Batch& batch,
                                        std::size_t row) const;
  [[nodiscard]] std::string gap_line(const Robot& robot, const Gap& gap) const;
  [[nodiscard]] std::string event_line(const Robot& robot, const Event& event) const;

  TailOptions options_;
  Selection selection_;
  Micros from_us_ = 0;
  Micros newest_us_ = 0;  // of all that was told
  bool first_ = true;
  std::map<std::pair<RobotId, Source>, Poll> told_;
  std::map<std::uint64_t, Micros> told_records_;  // by hash, of gaps and events: when
};

}  // namespace tacho::recorder
