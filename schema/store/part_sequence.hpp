#pragma once
// The parts of one log that is being written: which one is open, when the next one starts, how old ones are closed.

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "schema/store/kept_parts.hpp"
#include "schema/store/lock.hpp"
#include "schema/store/part_head.hpp"
#include "schema/store/part_writer.hpp"
#include "schema/store/repack.hpp"

namespace tacho::store {

class PartSequence {
 public:
  /// Writes what every part carries: robots, the open session and its streams.
  using Fill = std::function<void(Connection&)>;

  /// Locks the folder, finds the newest part, and what is left to be done for older ones. Writes into no part. Throws
  /// Error.
  PartSequence(const std::filesystem::path& folder, bool durable, int zstd_level, Decode decode);
  ~PartSequence();
  PartSequence(const PartSequence&) = delete;
  PartSequence& operator=(const PartSequence&) = delete;

  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  /// The newest part that could be read, as it was found; empty in a new log.
  [[nodiscard]] const std::optional<PartHead>& found() const { return found_; }

  /// False: there are sessions and robots that found() does not know: a newer part cannot be read, or it is damaged.
  [[nodiscard]] bool knows_ids() const { return knows_ids_; }

  /// Opens found() to be written on, when it is the last one and whole, and ends sessions in it that were killed.
  void open();
  /// False: next() must be called first.
  [[nodiscard]] bool has_current() const { return current_ != nullptr; }
  PartWriter& current() { return *current_; }

  /// The next part gets this number, or a higher one where it is taken. False: the current part has it. Before
  /// prepare().
  bool skip_to(std::uint32_t number) {
    number_ = std::max(number_, number - 1);
    return current_number_ < number;
  }

  /// Makes the next part ready as far as can be done ahead, so that next() has little to do; once.
  void prepare();
  [[nodiscard]] bool prepared() const { return !prepared_.empty(); }
  /// Starts the next part; `hot` are the rows of the one before that have not been moved yet. When this throws, the
  /// current part goes on.
  void next(const Fill& fill, const HotLedger& hot);
  /// The current part is no longer written.
  void close(const HotLedger& hot);
  /// Moves what is hot in parts that are no longer written, for some time or to the end, and closes those that no
  /// reader holds open. `now_us`: the wall clock when it is known to be right. False when the disk has no room for
  /// that.
  bool tidy(Deadline until, std::optional<Micros> now_us);

  /// All parts of the log, by number.
  [[nodiscard]] std::vector<KeptPart> parts();
  /// Removes the first of parts(), which is not the current one. Throws Error when it stays.
  void remove_oldest();

 private:
  std::filesystem::path folder_;
  bool durable_;
  int zstd_level_;
  Decode decode_;
  FolderLock lock_;
  std::string log_;
  std::uint32_t number_ = 0;
  std::optional<PartHead> found_;
  bool continues_ = false;  ///< found_ is to be written on
  bool knows_ids_ = true;
  std::unique_ptr<PartWriter> current_;
  std::uint32_t current_number_ = 0;
  std::filesystem::path prepared_;
  std::vector<KeptPart> closed_;  ///< nothing is left to be done for them
  /// No longer written, not yet closed.
  struct Left {
    PartFile file;
    std::optional<HotLedger> hot;  ///< empty: not known yet
    bool counted = false;
    std::unique_ptr<Repacker> repacker;                  ///< empty: not begun yet
    std::chrono::steady_clock::time_point not_before{};  ///< of the next try
    std::optional<KeptPart> stuck;  ///< the last try ended at a reader, at damage, at rights or at a full disk
  };
  std::vector<Left> left_;
  bool disk_full_ = false;  ///< met by tidy()

  std::unique_ptr<PartWriter> opened(const std::filesystem::path& path);
  bool finish(Left& left, Deadline until, std::optional<Micros> now_us);
  bool move_all(PartWriter& part, Left& left, Deadline until) const;
  void keep(std::optional<KeptPart> part);
  void find_newest(const std::vector<PartFile>& files);
  [[nodiscard]] PartRow next_row() const;
};

}  // namespace tacho::store
