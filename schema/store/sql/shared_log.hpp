#pragma once
// The log behind the virtual tables of one connection: opened when it is first read, shared by all tables of the same
// files.

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "schema/row_source.hpp"

namespace tacho::store::sql {

/// How a log is opened; tacho::open_log (schema/log.hpp), handed in so that the store does not know the decoders.
using OpenLog = std::function<std::unique_ptr<RowSource>(std::span<const std::filesystem::path>)>;

/// Thread rule: that of the connection.
class SharedLog {
 public:
  SharedLog(OpenLog open, std::vector<std::filesystem::path> paths)
      : open_(std::move(open)), paths_(std::move(paths)) {}
  /// A log that is open already and outlives this.
  explicit SharedLog(RowSource& log) : log_(&log) {}

  /// Throws Error when it cannot be opened.
  RowSource& get();

  /// A statement uses the log as long as it holds this. When nobody does, a log that has grown is opened again, so that
  /// every statement sees what was committed before it began.
  std::shared_ptr<void> use();

 private:
  OpenLog open_;
  std::vector<std::filesystem::path> paths_;
  std::unique_ptr<RowSource> owned_;
  RowSource* log_ = nullptr;
  std::weak_ptr<void> used_;
  std::string state_;  ///< names, sizes and times of the files when it was opened
};

/// All logs of a connection.
class LogShelf {
 public:
  /// `standard` is what a table without arguments reads; may be null.
  LogShelf(OpenLog open, std::shared_ptr<SharedLog> standard)
      : open_(std::move(open)), standard_(std::move(standard)) {}
  /// The log of these files. Throws Error when one does not exist, or there are none and no standard.
  std::shared_ptr<SharedLog> at(const std::vector<std::string>& paths);

 private:
  OpenLog open_;
  std::shared_ptr<SharedLog> standard_;
  std::map<std::vector<std::string>, std::weak_ptr<SharedLog>> logs_;
};

}  // namespace tacho::store::sql
