#pragma once
// Writes a log: a folder of numbered SQLite parts. Exactly one LogWriter may have a log open; a lock file says whose.
// One connection does all writes and all checkpoints (SQLite 3.40.1 has the WAL-reset bug).
//
// Thread rule: one thread. Everything appended since the last commit() is lost by a kill, and becomes a gap row with
// cause recorder_killed when the log is opened again. Answers wait in memory for the commit(), some megabytes of them:
// where there are more, they are written ahead of it.
//
// When the disk fails, the call throws Error and everything since the last commit() is lost; the writer can be used on.
// The polls that were lost become gap rows with cause disk in the next transaction that works, and events and clock
// points (the first 20 000 of each) are written with them: callers do not report either again.

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "schema/records.hpp"
#include "schema/row_source.hpp"
#include "schema/sample.hpp"
#include "schema/store/decode.hpp"
#include "schema/store/keeper.hpp"

namespace tacho::store {

struct WriterOptions {
  std::uint64_t part_bytes = 256u << 20;  ///< a part is closed when it is larger; smaller parts confine damage better
  bool part_per_day = true;               ///< ... or when the UTC day of the newest row changes
  int keyframe_every = 120;               ///< answers that depend on one row; smaller = larger log, faster seek
  int zstd_level = 3;                     ///< of blocks
  std::uint64_t wal_bytes =
      128u << 20;                ///< a WAL is checkpointed when larger; pages that change again are written once
  bool blocks = true;            ///< false: rows stay hot, as in a part that a kill left; only tests want that
  std::uint32_t first_part = 1;  ///< number of the first part of a new log; higher for a copy of a later one
  bool durable = true;           ///< synchronous FULL; false only for generated logs that can be made again
  Decode decode = {};            ///< needed for one-minute rollups; empty: none are made (schema/log.hpp has one)
  Retention retention = {};      ///< by default nothing is removed
};

class LogWriter {
 public:
  /// Creates `folder` when it does not exist. Throws Error when it cannot be written, belongs to a newer schema, or is
  /// being recorded by another process. Ends sessions that were killed: closes their holes with gap rows.
  explicit LogWriter(const std::filesystem::path& folder, WriterOptions options = {});
  ~LogWriter();
  LogWriter(const LogWriter&) = delete;
  LogWriter& operator=(const LogWriter&) = delete;

  /// `id`, `t_end_us` and `clean` of the argument are ignored.
  SessionId begin_session(const Session& session);
  /// Writes planned counts and the end time, and commits.
  void end_session(Micros t_end_us, bool clean);

  /// Finds the robot by name or adds it; a changed address is updated.
  RobotId robot(const std::string& name, const std::string& address);
  void identify(RobotId robot, const Robot& identity);
  /// Declares a stream of this session. When an earlier session recorded the same stream, a recorder_off gap covers the
  /// time from its last row to this session's start.
  void declare(const Stream& stream);
  /// Polls the schedule has asked for so far; kept in memory, written by end_session(). Without it: the number after
  /// the last stored or missed poll.
  void planned(RobotId robot, Source source, std::uint64_t count);
  void set_word_order(RobotId robot, Source source, WordOrder order);

  // Copying a log: rows as they were, with their numbers.
  /// What follows goes into the part of this number, which is higher than those before.
  void restore_part(std::uint32_t number);
  void restore(const Robot& robot);
  /// Begins the session. Ids grow.
  void restore(const Session& session);
  /// Declares a stream without a recorder_off gap: the copied gaps have it. Polls begin with `first_poll`.
  void restore(const Stream& stream, std::uint64_t first_poll);

  /// Answers of a stream come with growing seq.
  void append(const Answer& answer);
  /// Fields of one answer that were not absent, and its unknown keys and decodability; feeds Coverage and UnknownKey.
  void note(const Sample& sample);
  void add(const Gap& gap);
  void add(const Event& event);
  void add(const ClockPoint& point);

  /// Makes everything so far durable; switches to the next part when one is due; removes a part when the rules of
  /// retention say so. When the disk is full, the oldest part makes room where the rules allow that; what was lost
  /// meanwhile is in gap rows then.
  void commit();

  struct Stats {
    std::uint64_t rows = 0;
    std::uint64_t body_bytes = 0;
    std::uint64_t stored_bytes = 0;  ///< of body_bytes, once committed, with numbers and times
    std::uint64_t lost = 0;          ///< polls that failed transactions cost
    std::uint64_t commits = 0;
    std::uint64_t parts = 0;
    std::chrono::microseconds last_commit{0};  ///< inserting the packed answers, and making all durable
  };
  [[nodiscard]] const Stats& stats() const;
  /// How long the disk will do; reads the head of every part. Throws Error.
  [[nodiscard]] Forecast forecast() const;

  /// What the session's rows of one stream say: stored + sum(missed) is every poll that left a trace.
  struct Tally {
    std::uint64_t stored = 0;
    std::uint64_t partial = 0;
    std::array<std::uint64_t, kCauseCount> missed{};
  };
  /// As committed; of the last session until the next one begins. Zeros for a stream it did not have.
  [[nodiscard]] Tally tally(RobotId robot, Source source) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho::store
