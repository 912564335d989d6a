#pragma once
// The parts of one log that is being written: which one is open, when the next one starts, how old ones are closed.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "schema/store/lock.hpp"
#include "schema/store/part_head.hpp"
#include "schema/store/part_writer.hpp"
#include "schema/store/repack.hpp"

namespace tacho::store {

class PartSequence {
 public:
  /// Writes what every part carries: robots, the open session and its streams.
  using Fill = std::function<void(Connection&)>;

  /// Locks the folder, finds the newest part, ends sessions in it that were killed, and closes older parts that a kill
  /// left open. Throws Error.
  PartSequence(const std::filesystem::path& folder, bool durable);

  /// The newest part that could be read, as it was found; empty in a new log.
  [[nodiscard]] const std::optional<PartHead>& found() const { return found_; }
  /// True when found() is the part that is written on. False: next() must be called first.
  [[nodiscard]] bool has_current() const { return current_ != nullptr; }
  PartWriter& current() { return *current_; }

  /// Starts the next part; `hot` are the rows of the one before that have not been moved yet. When this throws, the
  /// current part goes on.
  void next(const Fill& fill, const HotLedger& hot);
  /// The current part is no longer written.
  void close(const HotLedger& hot);
  /// Moves what is hot in parts that are no longer written, for some time or to the end, and closes those that no
  /// reader holds open.
  void tidy(Repacker& repacker, Deadline until);

 private:
  std::filesystem::path folder_;
  bool durable_;
  FolderLock lock_;
  std::string log_;
  std::uint32_t number_ = 0;
  std::optional<PartHead> found_;
  std::unique_ptr<PartWriter> current_;
  /// No longer written, not yet closed.
  struct Left {
    std::filesystem::path path;
    std::optional<HotLedger> hot;  ///< empty: not known yet
    bool counted = false;
    std::chrono::steady_clock::time_point not_before{};  ///< a reader held it open at the last try
  };
  std::vector<Left> left_;

  bool finish(Left& left, Repacker& repacker, Deadline until);
  void find_newest(const std::vector<PartFile>& files);
};

}  // namespace tacho::store
