#include "schema/store/part_sequence.hpp"

#include <algorithm>
#include <cassert>
#include <utility>

#include "schema/store/part_reader.hpp"
#include "schema/store/recovery.hpp"
#include "schema/store/schema_sql.hpp"
#include "schema/store/seal.hpp"

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
  const std::int64_t last = add_hot_rows(connection, vocabulary, counted_to, counts);
  for (const auto& [key, count] : counts) {
    part.put(key, count);
  }
  part.set_counted_to(last);
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

PartSequence::PartSequence(const fs::path& folder, bool durable, int zstd_level, Decode decode)
    : folder_(made(folder)), durable_(durable), zstd_level_(zstd_level), decode_(std::move(decode)), lock_(folder) {
  remove_unfinished_parts(folder_);
  const std::vector<PartFile> files = list_parts(folder_);
  find_newest(files);
  number_ = files.empty() ? 0 : files.back().number;
  if (log_.empty()) {
    log_ = found_ ? found_->row.log : random_log_id();
  }
  knows_ids_ = files.empty() || (found_ && found_->damage.empty() && found_->path == files.back().path);
  continues_ = knows_ids_ && found_ && found_->version == kSchemaVersion;
  for (const PartFile& file : files) {
    std::error_code unknown;
    if (continues_ && file.path == found_->path) {
      continue;
    }
    // The last connection to a part takes its WAL away, so what was being finished when a kill came may have none.
    std::optional<KeptPart> part = read_kept_part(file, log_);
    // A file of another log or program is not ours to finish.
    if (part && (!part->closed || fs::exists(file.path.string() + "-wal", unknown))) {
      left_.push_back({file, std::nullopt, false, nullptr, {}, {}});
    } else {
      keep(std::move(part));
    }
  }
}

PartSequence::~PartSequence() {
  std::error_code ignored;  // the next start removes it, too
  if (prepared()) {
    fs::remove(prepared_, ignored);
  }
}

void PartSequence::open() {
  if (continues_) {
    auto part = std::make_unique<PartWriter>(found_->path, durable_);
    reopen_part(part->connection());
    end_killed_sessions(*part, *found_);
    current_ = std::move(part);
    current_number_ = number_;
  }
}

/// Nothing is left to be done for this part.
void PartSequence::keep(std::optional<KeptPart> part) {
  if (part) {
    part->closed = true;
    const auto place = std::find_if(closed_.begin(), closed_.end(),
                                    [&](const KeptPart& other) { return other.number > part->number; });
    closed_.insert(place, std::move(*part));
  }
}

std::vector<KeptPart> PartSequence::parts() {
  std::vector<KeptPart> all = closed_;
  const auto add = [&](std::uint32_t number, const fs::path& path, KeptPart part = {}) {
    part.number = number;
    part.path = path;
    part.bytes = part_file_bytes(path);
    all.push_back(std::move(part));
  };
  for (const Left& left : left_) {
    // What cannot be finished must not keep the log from giving up parts: who reads it reads on without its name.
    add(left.file.number, left.file.path, left.stuck.value_or(KeptPart{}));
  }
  if (current_) {
    add(current_number_, current_->connection().path());
  } else if (continues_) {
    add(number_, found_->path);
  }
  std::sort(all.begin(), all.end(), [](const KeptPart& a, const KeptPart& b) { return a.number < b.number; });
  return all;
}

void PartSequence::remove_oldest() {
  assert(!closed_.empty() || !left_.empty());
  if (left_.empty() || (!closed_.empty() && closed_.front().number < left_.front().file.number)) {
    remove_part(closed_.front().path);
    closed_.erase(closed_.begin());
  } else {
    remove_part(left_.front().file.path);
    left_.erase(left_.begin());
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

PartRow PartSequence::next_row() const { return {log_, number_ + 1, "tachograph " TACHO_VERSION, false, 0, {}}; }

void PartSequence::prepare() {
  if (!prepared()) {
    prepared_ = prepare_part(folder_, next_row());
  }
}

/// Opens a new part. One that cannot be opened (no room for its WAL) goes again: nobody would write it, and nobody
/// remove it.
std::unique_ptr<PartWriter> PartSequence::opened(const fs::path& path) {
  try {
    return std::make_unique<PartWriter>(path, durable_);
  } catch (const Error&) {
    try {
      remove_part(path);
    } catch (const Error&) {
      ++number_;  // its number is taken
    }
    throw;
  }
}

void PartSequence::next(const Fill& fill, const HotLedger& hot) {
  fs::path path;
  try {
    prepare();
    path = finish_part(prepared_, fill);
  } catch (const Error&) {
    // Whatever became of the prepared one, a fresh one may do.
    prepared_.clear();
    prepare();
    path = finish_part(prepared_, fill);
  }
  prepared_.clear();
  auto part = opened(path);
  ++number_;
  close(hot);
  current_ = std::move(part);
  current_number_ = number_;
}

void PartSequence::close(const HotLedger& hot) {
  if (current_) {
    left_.push_back({{current_number_, current_->connection().path()}, hot, false, nullptr, {}, {}});
    current_.reset();
  }
}

bool PartSequence::tidy(Deadline until, std::optional<Micros> now_us) {
  disk_full_ = false;
  for (auto left = left_.begin(); left != left_.end();) {
    if (finish(*left, until, now_us)) {
      keep(read_kept_part(left->file, log_));
      left = left_.erase(left);
    } else {
      ++left;
    }
  }
  return !disk_full_;
}

/// True when all rows of the part are in blocks.
bool PartSequence::move_all(PartWriter& part, Left& left, Deadline until) const {
  if (!left.hot) {
    left.hot = all_hot_rows(part.connection());
  }
  if (!left.repacker) {
    left.repacker = std::make_unique<Repacker>(zstd_level_, decode_);
    left.repacker->begin(*left.hot, left.hot->all());
  }
  while (left.repacker->busy()) {
    if (!left.repacker->pack(part.connection(), until)) {
      return false;
    }
    part.begin();
    left.repacker->store(part);
    part.commit();
    left.repacker->stored(*left.hot);
  }
  return true;
}

/// True when nothing is left to do for the part.
bool PartSequence::finish(Left& left, Deadline until, std::optional<Micros> now_us) {
  const auto now = std::chrono::steady_clock::now();
  if (now >= until || (until != kNoDeadline && now < left.not_before)) {
    return false;
  }
  left.stuck.reset();
  bool full = false;
  try {
    PartWriter part(left.file.path, durable_);
    part.connection().set_busy_timeout(0);  // recording never waits for a reader
    if (!left.counted) {
      if (!check_seal(part.connection(), false, true).damage.empty()) {
        return true;  // what is damaged must not be sealed as if it were whole
      }
      count_hot_rows(part);
      left.counted = true;
    }
    if (!move_all(part, left, until)) {
      return false;
    }
    if (close_part(part.connection(), now_us)) {
      return true;
    }
  } catch (const SqliteError& error) {
    left.repacker.reset();
    if (error.damaged()) {
      return true;  // a damaged part stays as it is
    }
    full = error.full();
  }
  disk_full_ = disk_full_ || full;
  left.not_before = full ? now : now + kClosingPause;
  left.stuck = read_kept_part(left.file, log_);
  if (left.stuck) {
    left.stuck->closed = true;  // as far as it can be: it may be removed
  }
  return false;
}

}  // namespace tacho::store
