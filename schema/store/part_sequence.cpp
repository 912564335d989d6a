#include "schema/store/part_sequence.hpp"

#include <utility>

#include "schema/store/recovery.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

namespace fs = std::filesystem;

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
      open_.push_back(file.path);
    }
  }
  retry_closing();
}

void PartSequence::find_newest(const std::vector<PartFile>& files) {
  for (auto file = files.rbegin(); file != files.rend() && log_.empty(); ++file) {
    try {
      PartHead head = read_head(file->path);
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

void PartSequence::next(const Fill& fill) {
  const PartRow row{log_, number_ + 1, "tachograph " TACHO_VERSION, false, 0};
  auto part = std::make_unique<PartWriter>(create_part(folder_, row, fill), durable_);
  ++number_;
  close();
  current_ = std::move(part);
}

void PartSequence::close() {
  if (!current_) {
    return;
  }
  const fs::path path = current_->connection().path();
  current_.reset();
  open_.push_back(path);
  retry_closing();
}

void PartSequence::retry_closing() {
  std::vector<fs::path> still_open;
  for (const fs::path& path : open_) {
    try {
      Connection connection = open_part_for_writing(path, durable_);
      connection.set_busy_timeout(0);  // recording never waits for a reader
      if (close_part(connection)) {
        continue;
      }
    } catch (const SqliteError& error) {
      if (error.damaged()) {
        continue;  // a damaged part stays as it is
      }
    }
    still_open.push_back(path);
  }
  open_ = std::move(still_open);
}

}  // namespace tacho::store
