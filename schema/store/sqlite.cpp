#include "schema/store/sqlite.hpp"

#include <fmt/format.h>
#include <sqlite3.h>

#include <limits>
#include <utility>

#include "schema/store/record_format.hpp"

namespace tacho::store {

namespace {

constexpr int kBusyMs = 5000;
constexpr int kHeaderBytes = 100;

const char* remedy_for(int code) {
  switch (code & 0xFF) {
    case SQLITE_FULL:
      return "free space on this disk";
    case SQLITE_IOERR:
      return "check the disk, its free space and its cables";
    case SQLITE_READONLY:
    case SQLITE_PERM:
    case SQLITE_CANTOPEN:
      return "check that the folder exists and that this user may read and write it";
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return "close the other program that holds this file open";
    case SQLITE_NOTADB:
      return "this is no part of a log: move it out of the folder";
    case SQLITE_CORRUPT:
      return "keep the file as it is; what can be read of it is still read";
    default:
      return "";
  }
}

int flags_of(OpenMode mode) {
  constexpr int kCommon = SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE;
  switch (mode) {
    case OpenMode::create:
      return kCommon | SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE;
    case OpenMode::write:
      return kCommon | SQLITE_OPEN_READWRITE;
    case OpenMode::read:
      return kCommon | SQLITE_OPEN_READONLY;
    case OpenMode::immutable:
      return kCommon | SQLITE_OPEN_READONLY | SQLITE_OPEN_URI;
  }
  return kCommon;
}

/// A file: URI in which nothing of the path can be taken for a query.
std::string immutable_uri(const std::filesystem::path& path) {
  constexpr std::string_view kHex = "0123456789ABCDEF";
  std::string uri = "file:";
  for (const char c : std::filesystem::absolute(path).string()) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '%' || c == '?' || c == '#') {
      uri += {'%', kHex[byte >> 4U], kHex[byte & 15U]};
    } else {
      uri += c;
    }
  }
  return uri + "?immutable=1";
}

int remember_wal_pages(void* target, sqlite3*, const char*, int pages) {
  *static_cast<int*>(target) = pages;
  return SQLITE_OK;
}

}  // namespace

bool SqliteError::damaged() const { return (code_ & 0xFF) == SQLITE_CORRUPT || (code_ & 0xFF) == SQLITE_NOTADB; }
bool SqliteError::foreign() const { return (code_ & 0xFF) == SQLITE_NOTADB; }
bool SqliteError::full() const { return (code_ & 0xFF) == SQLITE_FULL || code_ == SQLITE_IOERR_SHMSIZE; }
bool SqliteError::busy() const { return (code_ & 0xFF) == SQLITE_BUSY || (code_ & 0xFF) == SQLITE_LOCKED; }
bool SqliteError::cannot_open() const { return (code_ & 0xFF) == SQLITE_CANTOPEN || (code_ & 0xFF) == SQLITE_READONLY; }

void CloseDatabase::operator()(sqlite3* handle) const noexcept { sqlite3_close_v2(handle); }
void FinalizeStatement::operator()(sqlite3_stmt* handle) const noexcept { sqlite3_finalize(handle); }

Connection::Connection(std::filesystem::path path, OpenMode mode)
    : path_(std::move(path)), wal_pages_(std::make_unique<int>(0)) {
  const std::string name = mode == OpenMode::immutable ? immutable_uri(path_) : path_.string();
  sqlite3* raw = nullptr;
  const int code = sqlite3_open_v2(name.c_str(), &raw, flags_of(mode), nullptr);
  handle_.reset(raw);
  check(code, "open");
  set_busy_timeout(kBusyMs);
  if (mode == OpenMode::read || mode == OpenMode::immutable) {
    check(sqlite3_db_config(raw, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr), "no checkpoint on close");
  }
}

void Connection::check(int code, std::string_view sql) const {
  if (code == SQLITE_OK || code == SQLITE_ROW || code == SQLITE_DONE) {
    return;
  }
  std::string cause = handle_ ? sqlite3_errmsg(handle_.get()) : sqlite3_errstr(code);
  cause += " (" + std::string(sqlite3_errstr(code)) + ", code " + std::to_string(code) + ", in \"" +
           std::string(sql.substr(0, 120)) + "\")";
  throw SqliteError(path_.string(), cause, remedy_for(code), code);
}

void Connection::exec(const std::string& sql) {
  check(sqlite3_exec(handle_.get(), sql.c_str(), nullptr, nullptr, nullptr), sql);
}

std::string Connection::scalar(const std::string& sql) {
  Statement statement(*this, sql);
  return statement.step() ? statement.text(0) : std::string();
}

std::int64_t Connection::integer(const std::string& sql) {
  Statement statement(*this, sql);
  return statement.step() ? statement.integer(0) : 0;
}

void Connection::set_pragma(const std::string& name, const std::string& value) {
  scalar("PRAGMA " + name + " = " + value);
  const std::string got = scalar("PRAGMA " + name);
  if (got != value) {
    throw Error(path_.string(), "PRAGMA " + name + " is " + got + " instead of " + value,
                "is the folder on a network file system, or open in another program?");
  }
}

bool Connection::has_table(std::string_view name) {
  return integer(fmt::format("SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND name = '{}'", name)) > 0;
}

std::int64_t Connection::last_insert_rowid() const { return sqlite3_last_insert_rowid(handle_.get()); }
bool Connection::in_transaction() const { return sqlite3_get_autocommit(handle_.get()) == 0; }

void Connection::set_busy_timeout(int milliseconds) {
  check(sqlite3_busy_timeout(handle_.get(), milliseconds), "busy timeout");
}

void Connection::own_checkpoints() {
  set_pragma("wal_autocheckpoint", "0");
  sqlite3_wal_hook(handle_.get(), remember_wal_pages, wal_pages_.get());
}

bool Connection::checkpoint_passive() {
  int pages = 0;
  int copied = 0;
  const int code = sqlite3_wal_checkpoint_v2(handle_.get(), nullptr, SQLITE_CHECKPOINT_PASSIVE, &pages, &copied);
  if ((code & 0xFF) == SQLITE_BUSY) {
    return false;
  }
  check(code, "checkpoint");
  return pages == copied;
}

bool Connection::checkpoint_truncate() {
  const int code = sqlite3_wal_checkpoint_v2(handle_.get(), nullptr, SQLITE_CHECKPOINT_TRUNCATE, nullptr, nullptr);
  if ((code & 0xFF) == SQLITE_BUSY) {
    return false;
  }
  check(code, "checkpoint");
  return true;
}

namespace {

sqlite3_file* file_of(sqlite3* handle) {
  sqlite3_file* file = nullptr;
  const int code = sqlite3_file_control(handle, "main", SQLITE_FCNTL_FILE_POINTER, static_cast<void*>(&file));
  return code == SQLITE_OK && file != nullptr && file->pMethods != nullptr ? file : nullptr;
}

}  // namespace

std::string Connection::file_bytes(std::uint64_t offset, int count) const {
  sqlite3_file* file = file_of(handle_.get());
  std::string bytes(static_cast<std::size_t>(count), '\0');
  const bool all = file != nullptr &&
                   file->pMethods->xRead(file, bytes.data(), count, static_cast<sqlite3_int64>(offset)) == SQLITE_OK;
  return all ? bytes : std::string();
}

Connection::FileSize Connection::file_size() const {
  FileSize size;
  sqlite3_file* file = file_of(handle_.get());
  sqlite3_int64 bytes = 0;
  if (file == nullptr || file->pMethods->xFileSize(file, &bytes) != SQLITE_OK) {
    return size;
  }
  size.actual = static_cast<std::uint64_t>(bytes);
  const std::string header = file_bytes(0, kHeaderBytes);
  // The page count is only valid while the change counter equals the "version valid for" number.
  if (!header.empty() && big_endian(header, 24, 4) == big_endian(header, 92, 4)) {
    const std::uint64_t page = big_endian(header, 16, 2) == 1 ? 65536 : big_endian(header, 16, 2);
    size.promised = page * big_endian(header, 28, 4);
  }
  return size;
}

Statement::Statement(Connection& connection, std::string_view sql) : connection_(&connection) {
  sqlite3_stmt* raw = nullptr;
  const int code = sqlite3_prepare_v3(connection.handle(), sql.data(), static_cast<int>(sql.size()),
                                      SQLITE_PREPARE_PERSISTENT, &raw, nullptr);
  handle_.reset(raw);
  connection.check(code, sql);
}

bool Statement::step() {
  const int code = sqlite3_step(handle_.get());
  if (code == SQLITE_ROW) {
    return true;
  }
  try {
    connection_->check(code, sqlite3_sql(handle_.get()));
  } catch (...) {
    reset();
    throw;
  }
  reset();
  return false;
}

void Statement::reset() { sqlite3_reset(handle_.get()); }

void Statement::bind(int index, std::int64_t value) {
  connection_->check(sqlite3_bind_int64(handle_.get(), index, value), sqlite3_sql(handle_.get()));
}

void Statement::bind(int index, double value) {
  connection_->check(sqlite3_bind_double(handle_.get(), index, value), sqlite3_sql(handle_.get()));
}

void Statement::bind(int index, std::string_view value) {
  const char* data = value.data() == nullptr ? "" : value.data();
  const int code = sqlite3_bind_text64(handle_.get(), index, data, value.size(), SQLITE_STATIC, SQLITE_UTF8);
  connection_->check(code, sqlite3_sql(handle_.get()));
}

void Statement::bind(int index, Blob value) {
  const char* data = value.bytes.data() == nullptr ? "" : value.bytes.data();
  const int code = sqlite3_bind_blob64(handle_.get(), index, data, value.bytes.size(), SQLITE_STATIC);
  connection_->check(code, sqlite3_sql(handle_.get()));
}

void Statement::bind(int index, std::nullopt_t) {
  connection_->check(sqlite3_bind_null(handle_.get(), index), sqlite3_sql(handle_.get()));
}

int Statement::columns() const { return sqlite3_column_count(handle_.get()); }
bool Statement::floating(int column) const { return sqlite3_column_type(handle_.get(), column) == SQLITE_FLOAT; }
bool Statement::whole(int column) const { return sqlite3_column_type(handle_.get(), column) == SQLITE_INTEGER; }
bool Statement::null(int column) const { return sqlite3_column_type(handle_.get(), column) == SQLITE_NULL; }
std::int64_t Statement::integer(int column) const { return sqlite3_column_int64(handle_.get(), column); }
double Statement::real(int column) const { return sqlite3_column_double(handle_.get(), column); }

std::string_view Statement::bytes(int column) const {
  const void* data = sqlite3_column_blob(handle_.get(), column);
  const auto size = static_cast<std::size_t>(sqlite3_column_bytes(handle_.get(), column));
  return data == nullptr ? std::string_view() : std::string_view(static_cast<const char*>(data), size);
}

void CloseBlob::operator()(sqlite3_blob* handle) const noexcept { sqlite3_blob_close(handle); }

bool BlobColumn::seek(std::int64_t id) {
  int code = SQLITE_OK;
  if (handle_ != nullptr) {
    code = sqlite3_blob_reopen(handle_.get(), id);
  } else {
    sqlite3_blob* raw = nullptr;
    code = sqlite3_blob_open(connection_->handle(), "main", table_, column_, id, 0, &raw);
    handle_.reset(raw);
  }
  if (code != SQLITE_OK) {
    const auto spent = std::move(handle_);  // it serves no other row, but knows what is wrong
    if (code == SQLITE_ERROR) {
      return false;
    }
    connection_->check(code, column_);
  }
  size_ = static_cast<std::size_t>(sqlite3_blob_bytes(handle_.get()));
  return true;
}

void BlobColumn::read(std::size_t offset, std::span<char> out) {
  const int code = sqlite3_blob_read(handle_.get(), out.data(), static_cast<int>(out.size()), static_cast<int>(offset));
  if (code != SQLITE_OK) {
    const auto spent = std::move(handle_);
    connection_->check(code, column_);
  }
}

Transaction::Transaction(Connection& connection) : connection_(&connection) { connection.exec("BEGIN IMMEDIATE"); }

Transaction::~Transaction() {
  if (connection_->in_transaction()) {
    sqlite3_exec(connection_->handle(), "ROLLBACK", nullptr, nullptr, nullptr);
  }
}

void Transaction::commit() { connection_->exec("COMMIT"); }

}  // namespace tacho::store
