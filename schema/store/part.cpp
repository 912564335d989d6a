#include "schema/store/part.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <random>

#include "schema/store/schema_sql.hpp"
#include "schema/store/seal.hpp"
#include "schema/store/summary.hpp"
#include "schema/store/vocabulary.hpp"

namespace tacho::store {

namespace {

namespace fs = std::filesystem;

constexpr std::string_view kPrefix = "part-";
constexpr std::string_view kSuffix = ".db";
constexpr std::string_view kUnfinished = ".unfinished-";

// A commit a second writes few hot rows, and each page it touches anew: 1024 writes 0.92 GB per robot-day, 2048 1.12,
// 4096 1.45. Whole blocks are read 27 % slower from 1024 than from 4096 (mapped; 44 % without mmap), and one file must
// hold both so that moving rows into blocks is one transaction.
constexpr const char* kPageSize = "1024";

/// Runs `work`; what the file system refuses becomes an Error.
template <class Work>
void in_folder(const fs::path& folder, Work work) {
  try {
    work();
  } catch (const fs::filesystem_error& error) {
    throw Error(folder.string(), error.what(), "check the disk, its free space and the rights of this user");
  }
}

}  // namespace

void sync_folder(const fs::path& folder) {
  const int file = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const bool good = file >= 0 && fsync(file) == 0;
  const int error = errno;
  if (file >= 0) {
    close(file);
  }
  if (!good) {
    throw Error(folder.string(), std::strerror(error), "check the disk");
  }
}

PartRow read_part_row(Connection& connection) {
  Statement row(connection, select_sql("part"));
  if (!row.step()) {
    return {};
  }
  return {row.text(0),    static_cast<std::uint32_t>(row.integer(1)),
          row.text(2),    row.integer(3) != 0,
          row.integer(4), row.null(5) ? std::nullopt : std::optional<Micros>(row.integer(5))};
}

std::string random_log_id() {
  std::random_device random;
  std::string id;
  for (int i = 0; i < 4; ++i) {
    id += fmt::format("{:08x}", random());
  }
  return id;
}

std::vector<PartFile> list_parts(const fs::path& folder) {
  std::vector<PartFile> parts;
  const auto take = [&](const fs::path& path) {
    const std::string name = path.filename().string();
    if (name.size() <= kPrefix.size() + kSuffix.size() || name.rfind(kPrefix, 0) != 0 || path.extension() != kSuffix) {
      return;
    }
    PartFile part{0, path};
    const char* end = name.data() + name.size() - kSuffix.size();
    const auto [stop, error] = std::from_chars(name.data() + kPrefix.size(), end, part.number);
    if (error == std::errc() && stop == end) {
      parts.push_back(part);
    }
  };
  in_folder(folder, [&] {
    for (const auto& entry : fs::directory_iterator(folder)) {
      take(entry.path());
    }
  });
  std::sort(parts.begin(), parts.end(), [](const PartFile& a, const PartFile& b) { return a.number < b.number; });
  return parts;
}

fs::path part_path(const fs::path& folder, std::uint32_t number) {
  return folder / fmt::format("{}{:06}{}", kPrefix, number, kSuffix);
}

fs::path prepare_part(const fs::path& folder, const PartRow& row) {
  const fs::path prepared = folder / (std::string(kUnfinished) + part_path(folder, row.number).filename().string());
  in_folder(folder, [&] { fs::remove(prepared); });
  Connection connection(prepared, OpenMode::create);
  connection.set_pragma("page_size", kPageSize);
  connection.set_pragma("synchronous", "2");
  Transaction transaction(connection);
  connection.exec(schema_sql());
  write_vocabulary(connection);
  Statement insert(connection, insert_sql("part"));
  insert.run(row.log, row.number, row.software, row.closed, row.counted_to, row.ended_us);
  seal_vocabulary(connection);
  transaction.commit();
  return prepared;
}

fs::path finish_part(const fs::path& prepared, const std::function<void(Connection&)>& fill) {
  const fs::path folder = prepared.parent_path();
  const fs::path path = folder / prepared.filename().string().substr(kUnfinished.size());
  {
    Connection connection(prepared, OpenMode::write);
    // Nobody needs a journal to take this back: what is not finished is removed.
    connection.set_pragma("journal_mode", "memory");
    connection.set_pragma("synchronous", "2");
    Transaction transaction(connection);
    fill(connection);
    seal_head(connection);
    transaction.commit();
  }
  in_folder(folder, [&] { fs::rename(prepared, path); });
  try {
    sync_folder(folder);
  } catch (const Error&) {
    std::error_code ignored;  // a part that nobody writes would say that its session ended there
    fs::remove(path, ignored);
    throw;
  }
  return path;
}

void remove_unfinished_parts(const fs::path& folder) {
  in_folder(folder, [&] {
    std::vector<fs::path> left;
    for (const auto& entry : fs::directory_iterator(folder)) {
      const std::string name = entry.path().filename().string();
      const std::size_t end = name.find(".db-");
      const bool beside = name.rfind(kPrefix, 0) == 0 && end != std::string::npos;
      if (name.rfind(kUnfinished, 0) == 0 || (beside && !fs::exists(folder / name.substr(0, end + kSuffix.size())))) {
        left.push_back(entry.path());
      }
    }
    for (const fs::path& path : left) {
      fs::remove(path);
    }
  });
}

Connection open_part_for_writing(const fs::path& path, bool durable) {
  Connection connection(path, OpenMode::write);
  connection.set_pragma("journal_mode", "wal");
  connection.set_pragma("synchronous", durable ? "2" : "0");
  connection.set_pragma("secure_delete", "0");  // Debian builds SQLite with it on
  connection.set_pragma("foreign_keys", "0");
  connection.set_pragma("cache_size", "-4096");
  connection.set_pragma("temp_store", "2");  // a few rows while others move
  connection.own_checkpoints();
  return connection;
}

void reopen_part(Connection& connection) {
  Transaction transaction(connection);
  delete_summary(connection);
  connection.exec("UPDATE part SET closed = 0, ended_us = NULL");
  break_seal(connection);
  transaction.commit();
}

bool close_part(Connection& connection, std::optional<Micros> now_us) {
  {
    Transaction transaction(connection);
    Statement(connection, "UPDATE part SET closed = 1, ended_us = ?1").run(now_us);
    write_summary(connection, write_seal(connection));
    transaction.commit();
  }
  if (!connection.checkpoint_truncate()) {
    return false;
  }
  try {
    connection.set_pragma("journal_mode", "delete");
  } catch (const SqliteError& error) {
    if (error.busy()) {
      return false;
    }
    throw;
  }
  return true;
}

}  // namespace tacho::store
