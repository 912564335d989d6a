#pragma once
// SQLite behind two owners: Connection and Statement. sqlite3.h is included in sqlite.cpp only.
//
// Every return code that is not a success becomes a SqliteError with file and SQL. A Statement must not outlive its
// Connection. Thread rule: a Connection and its Statements belong to one thread.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "schema/error.hpp"

struct sqlite3;
struct sqlite3_stmt;
struct sqlite3_blob;

namespace tacho::store {

class SqliteError : public Error {
 public:
  SqliteError(const std::string& what, const std::string& cause, const std::string& remedy, int code)
      : Error(what, cause, remedy), code_(code) {}
  /// The bytes of the file are wrong or cannot be read: damaged, truncated, bad sectors, or no SQLite database at all.
  [[nodiscard]] bool damaged() const;
  /// The file is no SQLite database at all.
  [[nodiscard]] bool foreign() const;
  /// No space is left on the disk.
  [[nodiscard]] bool full() const;
  /// Another connection is in the way.
  [[nodiscard]] bool busy() const;
  /// The file or a file beside it cannot be opened or created.
  [[nodiscard]] bool cannot_open() const;

 private:
  int code_;
};

enum class OpenMode : std::uint8_t {
  create,     ///< read and write, created when missing
  write,      ///< read and write, must exist
  read,       ///< never changes the database, never checkpoints
  immutable,  ///< read without locks or WAL: only for a file that nobody writes
};

struct CloseDatabase {
  void operator()(sqlite3* handle) const noexcept;
};
struct FinalizeStatement {
  void operator()(sqlite3_stmt* handle) const noexcept;
};

struct CloseBlob {
  void operator()(sqlite3_blob* handle) const noexcept;
};

class Connection {
 public:
  Connection(std::filesystem::path path, OpenMode mode);

  /// Runs one or more statements without results.
  void exec(const std::string& sql);
  /// First column of the first row as text; empty when there is no row.
  std::string scalar(const std::string& sql);
  [[nodiscard]] std::int64_t integer(const std::string& sql);
  /// Sets a pragma and reads it back; Error when SQLite did not take it.
  void set_pragma(const std::string& name, const std::string& value);
  /// False for those that newer parts have and older ones do not.
  [[nodiscard]] bool has_table(std::string_view name);
  [[nodiscard]] std::int64_t last_insert_rowid() const;
  [[nodiscard]] bool in_transaction() const;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

  /// How long to wait for other connections; 5 s unless set.
  void set_busy_timeout(int milliseconds);

  /// From now on wal_pages() counts; SQLite itself never checkpoints.
  void own_checkpoints();
  /// Pages in the WAL after the last commit of this connection.
  [[nodiscard]] int wal_pages() const { return *wal_pages_; }
  /// Copies what readers allow into the database file, without waiting; true when that was the whole WAL.
  bool checkpoint_passive();
  /// Copies the whole WAL into the database file and empties it; false when a reader is in the way.
  bool checkpoint_truncate();

  /// Bytes of the file itself, past WAL, cache and locks; empty when they are not all there. Asked of SQLite's own file
  /// handle: opening the file a second time would drop the POSIX locks of this process.
  [[nodiscard]] std::string file_bytes(std::uint64_t offset, int count) const;
  /// Bytes of the file, and the bytes its header promises; 0 when there is no readable header.
  struct FileSize {
    std::uint64_t actual = 0;
    std::uint64_t promised = 0;
  };
  [[nodiscard]] FileSize file_size() const;

  [[nodiscard]] sqlite3* handle() const { return handle_.get(); }
  /// Throws when `code` is not OK, ROW or DONE.
  void check(int code, std::string_view sql) const;

 private:
  std::filesystem::path path_;
  std::unique_ptr<int> wal_pages_;  // its address is handed to SQLite
  std::unique_ptr<sqlite3, CloseDatabase> handle_;
};

class Statement {
 public:
  Statement(Connection& connection, std::string_view sql);

  /// Binds the arguments to ?1, ?2, ... and starts over; texts must live until the next call of query() or run().
  template <class... Values>
  void query(const Values&... values) {
    reset();
    int index = 0;
    (bind(++index, values), ...);
  }
  /// True when there is a row. Resets itself at the end and on error, which ends SQLite's read transaction.
  bool step();
  /// query() and steps to the end.
  template <class... Values>
  void run(const Values&... values) {
    query(values...);
    while (step()) {
    }
  }
  void reset();
  /// Binds one value, for statements whose number of parameters is not known when compiling; reset() comes first. A
  /// text must live until the statement has run.
  template <class Value>
  void set(int index, const Value& value) {
    bind(index, value);
  }

  [[nodiscard]] int columns() const;
  [[nodiscard]] bool null(int column) const;
  [[nodiscard]] bool floating(int column) const;
  [[nodiscard]] bool whole(int column) const;
  [[nodiscard]] std::int64_t integer(int column) const;
  [[nodiscard]] double real(int column) const;
  /// Text or blob. Valid until the next step() or reset().
  [[nodiscard]] std::string_view bytes(int column) const;
  [[nodiscard]] std::string text(int column) const { return std::string(bytes(column)); }

  /// A value that is bound as a blob; an empty one stays an empty blob.
  struct Blob {
    std::string_view bytes;
  };

 private:
  Connection* connection_;
  std::unique_ptr<sqlite3_stmt, FinalizeStatement> handle_;
  void bind(int index, std::int64_t value);
  void bind(int index, std::uint64_t value) { bind(index, static_cast<std::int64_t>(value)); }
  void bind(int index, std::uint32_t value) { bind(index, static_cast<std::int64_t>(value)); }
  void bind(int index, std::uint16_t value) { bind(index, static_cast<std::int64_t>(value)); }
  void bind(int index, int value) { bind(index, static_cast<std::int64_t>(value)); }
  void bind(int index, bool value) { bind(index, static_cast<std::int64_t>(value ? 1 : 0)); }
  void bind(int index, double value);
  void bind(int index, std::string_view value);
  void bind(int index, const std::string& value) { bind(index, std::string_view(value)); }
  void bind(int index, const char* value) { bind(index, std::string_view(value)); }
  void bind(int index, Blob value);
  void bind(int index, std::nullopt_t);
  template <class Value>
  void bind(int index, const std::optional<Value>& value) {
    if (value) {
      bind(index, *value);
    } else {
      bind(index, std::nullopt);
    }
  }
};

/// One column of a table, of whose blobs parts can be read without the rest. Belongs inside a transaction of reading;
/// it keeps that open while it lives.
class BlobColumn {
 public:
  BlobColumn(Connection& connection, const char* table, const char* column)
      : connection_(&connection), table_(table), column_(column) {}

  /// Goes to a row. False: there is no such row, or no blob in it.
  [[nodiscard]] bool seek(std::int64_t id);
  /// Bytes of the blob.
  [[nodiscard]] std::size_t size() const { return size_; }
  /// The bytes from `offset` on; all of them must lie inside.
  void read(std::size_t offset, std::span<char> out);

 private:
  Connection* connection_;
  const char* table_;
  const char* column_;
  std::unique_ptr<sqlite3_blob, CloseBlob> handle_;
  std::size_t size_ = 0;
};

/// A transaction that rolls back unless committed.
class Transaction {
 public:
  explicit Transaction(Connection& connection);
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit();

 private:
  Connection* connection_;
};

}  // namespace tacho::store
