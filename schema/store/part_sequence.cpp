#include "schema/store/part_sequence.hpp"

#include <algorithm>
#include <utility>

#include "schema/store/part_reader.hpp"
#include "schema/store/recovery.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

namespace fs = std::filesystem;

constexpr auto kClosingPause = std::chrono::seconds(30);

/// Counts the rows that the coverage rows do not count yet: they must be counted before they move.
void count_hot_rows(PartWriter& part) {
  Connection& connection = part.connection();
  const Vocabulary vocabulary = read_vocabulary(connection);
  const std::int64_t counted_to = read_part_row(connection).counted_to;
  part.begin();
  StreamCounts counts = read_coverage_rows(connection, vocabulary);
  add_hot_rows(connection, vocabulary, counted_to, counts);
  for (const auto& [key, count] : counts) {
    part.put(key, count);
  }
  part.set_counted_to(std::max(counted_to, connection.integer("SELECT ifnull(max(id), 0) FROM hot")));
  part.commit();
}

HotLedger all_hot_rows(Connection& connection) {
  HotLedger ledger;
  ledger.load(connection, read_vocabulary(connection));
  return ledger;
}

/// The folder exists afterwards, also after a power cut.
const fs::path& made(const fs::path& folder) {
  std::error_code error;
  if (folder.empty() || fs::exists(folder, error)) {
    return folder;
  }
  const fs::path parent = made(folder.parent_path());
  fs::create_directory(folder, error);
  if (error) {
    throw Error(folder.string(), error.message(), "choose a folder that this user may write to");
  }
  sync_folder(parent.empty() ? "." : parent);
  return folder;
}

}  // namespace

PartSequence::PartSequence(const fs::path& folder, bool durable)
    : folder_(made(folder)), durable_(durable), lock_(folder) {
  remove_unfinished_parts(folder_);
  const std::vector<PartFile> files = list_parts(folder_);
  find_newest(files);
  number_ = files.empty() ? 0 : files.back().number;
  if (log_.empty()) {
    log_ = found_ ? found_->row.log : random_log_id();
  }
  if (found_ && found_->version == kSchemaVersion && found_->damage.empty() && found_->path == files.back().path) {
    current_ = std::make_unique<PartWriter>(found_->path, durable_);
    reopen_part(current_->connection());
    end_killed_sessions(*current_, *found_);
  }
  for (const PartFile& file : files) {
    std::error_code unknown;
    if (!(current_ && file.path == found_->path) && fs::exists(file.path.string() + "-wal", unknown)) {
      left_.push_back({file.path, std::nullopt, false, {}});
    }
  }
}

void PartSequence::find_newest(const std::vector<PartFile>& files) {
  for (auto file = files.rbegin(); file != files.rend() && log_.empty(); ++file) {
    try {
      PartHead head = read_part(file->path);
      if (head.damage.empty()) {
        log_ = head.row.log;  // a damaged part may have forgotten it
      }
      if (!found_) {
        found_ = std::move(head);
      }
    } catch (const NewerPart&) {
      throw;
    } catch (const Error&) {
      // A foreign or broken file keeps its number; readers name it.
    }
  }
}

void PartSequence::next(const Fill& fill, const HotLedger& hot) {
  const PartRow row{log_, number_ + 1, "tachograph " TACHO_VERSION, false, 0};
  auto part = std::make_unique<PartWriter>(create_part(folder_, row, fill), durable_);
  ++number_;
  close(hot);
  current_ = std::move(part);
}

void PartSequence::close(const HotLedger& hot) {
  if (current_) {
    left_.push_back({current_->connection().path(), hot, false, {}});
    current_.reset();
  }
}

void PartSequence::tidy(Repacker& repacker, Deadline until) {
  std::erase_if(left_, [&](Left& left) { return finish(left, repacker, until); });
}

/// True when nothing is left to do for the part.
bool PartSequence::finish(Left& left, Repacker& repacker, Deadline until) {
  const auto now = std::chrono::steady_clock::now();
  if (now >= until || (until != kNoDeadline && now < left.not_before)) {
    return false;
  }
  try {
    PartWriter part(left.path, durable_);
    part.connection().set_busy_timeout(0);  // recording never waits for a reader
    if (!left.counted) {
      count_hot_rows(part);
      left.counted = true;
    }
    if (!left.hot) {
      left.hot = all_hot_rows(part.connection());
    }
    if (!move_all(part, *left.hot, repacker, until)) {
      return false;
    }
    if (close_part(part.connection())) {
      return true;
    }
  } catch (const SqliteError& error) {
    if (error.damaged()) {
      return true;  // a damaged part stays as it is
    }
  }
  left.not_before = now + kClosingPause;
  return false;
}

}  // namespace tacho::store
