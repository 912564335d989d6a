#pragma once
// Reads a log (a folder of parts, or single parts) as a RowSource, also while it is being recorded.
//
// Foreign files in the folder are skipped and named in problems(); a damaged part yields what can be read and is named.
// Decoded on reading, by decoders that the caller hands in: blocks as columns, hot rows and what is no column one by
// one.

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "schema/row_source.hpp"
#include "schema/store/decode.hpp"
#include "schema/store/manifest.hpp"
#include "schema/store/part_head.hpp"

namespace tacho::store {

/// The end of what problems() says of a file that cannot be opened.
inline constexpr std::string_view kSkipped = "; skipped";

class LogReader final : public RowSource {
 public:
  /// Throws Error when nothing at all can be read: no such folder, no part in it, newer schema, parts of different
  /// logs. `access`: of opening and read(); everything else is careful, because it is used where damage is.
  LogReader(std::span<const std::filesystem::path> logs, Decoders decoders, Access access = Access::careful);
  ~LogReader() override;

  [[nodiscard]] std::vector<Robot> robots() const override;
  [[nodiscard]] std::vector<Session> sessions() const override;
  [[nodiscard]] std::vector<Stream> streams() const override;
  [[nodiscard]] std::vector<Coverage> coverage() const override;
  [[nodiscard]] std::vector<UnknownKey> unknown_keys() const override;
  [[nodiscard]] std::vector<ReadProblem> problems() const override;
  void read(RobotId robot, Window window, const Selection& selection,
            const std::function<void(const Slice&)>& yield) override;
  void read_raw(RobotId robot, Source source, Window window, const std::function<void(const Answer&)>& yield) override;
  /// A portion is a part.
  [[nodiscard]] std::size_t rollup_portions() const override;
  [[nodiscard]] std::vector<Rollup> rollups(RobotId robot, std::size_t portion) override;

  /// Every file of these logs that may be a part, each once.
  static std::vector<std::filesystem::path> files(std::span<const std::filesystem::path> logs);

  struct PartInfo {
    std::filesystem::path path;
    std::uint32_t number = 0;
    std::uint64_t bytes = 0;
    bool closed = false;
    Micros first_us = 0;
    Micros last_us = 0;
  };
  [[nodiscard]] std::vector<PartInfo> parts() const;

  /// Parts of this log that are not among those given. Only a folder can say so.
  struct Absent {
    std::uint32_t before = 0;            ///< so many at the beginning
    std::vector<std::uint32_t> between;  ///< numbers; the first thousand
    /// The newest part is closed, but this session has not ended in it: it goes on in a part that is not here, or the
    /// recorder had to stop.
    std::optional<SessionId> cut_off;
  };
  [[nodiscard]] Absent absent() const;
  /// What the log tells last of a part that retention removed. Reads events, newest part first. Throws nothing.
  [[nodiscard]] std::optional<Event> last_removal() const;

  // Part by part, for whoever checks or copies a log. Nothing is put in order or left out, but for what is damaged.
  struct Records {
    std::vector<Gap> gaps;
    std::vector<Event> events;
    std::vector<ClockPoint> clock;
  };
  /// Lets SQLite check the pages of a part. Nothing else tells that a page has forgotten the newest rows of a table
  /// without a seal, or leads some who look for a row to the wrong page. `part` counts in parts().
  void check_pages(std::size_t part);
  /// Of one robot, or (0) of none.
  Records part_records(std::size_t part, RobotId robot);
  /// Sessions that have answers in it, and perhaps some that have none.
  [[nodiscard]] std::set<SessionId> part_sessions(std::size_t part) const;
  /// All sources in order of arrival, of all sessions or one.
  void part_answers(std::size_t part, RobotId robot, std::optional<SessionId> session,
                    const std::function<void(const Answer&)>& yield);
  /// What was written into a part, hour by hour, as far as it is in blocks; empty when that is not on record.
  Manifest part_manifest(std::size_t part);
  /// The first poll of a stream that the parts given here can hold: earlier ones were in parts that are gone.
  [[nodiscard]] std::uint64_t first_poll(const Stream& stream) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho::store
