#include "schema/store/sql/shared_log.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <system_error>

#include "schema/error.hpp"

namespace tacho::store::sql {

namespace {

namespace fs = std::filesystem;

/// What changes when something is written to a log. Sizes alone would miss a WAL that starts over.
std::string state_of(const std::vector<fs::path>& paths) {
  std::vector<fs::path> files;
  std::error_code ignored;
  for (const fs::path& path : paths) {
    if (fs::is_directory(path, ignored)) {
      for (const auto& entry : fs::directory_iterator(path, ignored)) {
        files.push_back(entry.path());
      }
    } else {
      files.push_back(path);
      files.push_back(path.string() + "-wal");
    }
  }
  std::sort(files.begin(), files.end());
  std::string state;
  for (const fs::path& file : files) {
    const std::string name = file.filename().string();
    if (name.ends_with(".db") || name.ends_with("-wal")) {
      std::error_code missing;
      const auto size = fs::file_size(file, missing);
      const auto time = fs::last_write_time(file, missing).time_since_epoch().count();
      fmt::format_to(std::back_inserter(state), "{}:{}:{} ", name, missing ? 0 : size, missing ? 0 : time);
    }
  }
  return state;
}

}  // namespace

RowSource& SharedLog::get() {
  if (log_ == nullptr) {
    state_ = state_of(paths_);  // before opening: what is written meanwhile counts as new
    owned_ = open_(paths_);
    log_ = owned_.get();
  }
  return *log_;
}

std::shared_ptr<void> SharedLog::use() {
  std::shared_ptr<void> user = used_.lock();
  if (user) {
    return user;
  }
  if (owned_ && state_ != state_of(paths_)) {
    log_ = nullptr;
    owned_.reset();
  }
  user = std::make_shared<char>();
  used_ = user;
  return user;
}

std::shared_ptr<SharedLog> LogShelf::at(const std::vector<std::string>& paths) {
  if (paths.empty()) {
    if (!standard_) {
      throw Error("virtual table", "which log should it read?",
                  "name its folder or parts: CREATE VIRTUAL TABLE temp.status USING tacho_status('/path/of/log')");
    }
    return standard_;
  }
  for (const std::string& path : paths) {
    std::error_code ignored;
    if (!fs::exists(path, ignored)) {  // said now, not when the table is first read
      throw Error(path, "does not exist", "give the folder of a log, or a part of one");
    }
  }
  std::weak_ptr<SharedLog>& known = logs_[paths];
  std::shared_ptr<SharedLog> log = known.lock();
  if (!log) {
    log = std::make_shared<SharedLog>(open_, std::vector<fs::path>(paths.begin(), paths.end()));
    known = log;
  }
  return log;
}

}  // namespace tacho::store::sql
