#pragma once
// One SQL statement over a whole log, read only: the virtual tables of rows (status, io, registers, inputs), the plain
// tables of all parts as one (robot, session, gap, event, ...), and the field reference (field, code).

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "schema/error.hpp"
#include "schema/row_source.hpp"

namespace tacho::store::sql {

/// The statement is wrong, or would do something else than read. Names the place, the cause and what to do.
class StatementError : public Error {
  using Error::Error;
};

struct SqlBlob {
  std::string bytes;
};
/// A value of a result; empty is NULL.
using SqlValue = std::variant<std::monostate, std::int64_t, double, std::string, SqlBlob>;

/// Thread rule: one thread, that of the log. The first SqlSession of a program must be made before it has a second
/// thread that opens databases.
class SqlSession {
 public:
  /// `log` must outlive the session.
  explicit SqlSession(RowSource& log);
  ~SqlSession();
  SqlSession(const SqlSession&) = delete;
  SqlSession& operator=(const SqlSession&) = delete;

  using Head = std::function<void(const std::vector<std::string>&)>;
  using Row = std::function<void(std::span<const SqlValue>)>;
  /// Runs one statement: `head` gets the names of the columns, once, before the first row; `row` gets each row, valid
  /// during the call. Throws StatementError, also for a log that cannot be read.
  void run(const std::string& sql, const Head& head, const Row& row);

 private:
  struct Impl;
  RowSource* log_;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho::store::sql
