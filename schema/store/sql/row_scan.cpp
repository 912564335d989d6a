#include "schema/store/sql/row_scan.hpp"

#include <algorithm>
#include <utility>

#include "schema/error.hpp"

namespace tacho::store::sql {

namespace {

constexpr std::int64_t kFirstRows = 1024;
constexpr std::int64_t kMostRows = 262'144;
constexpr std::int64_t kBudgetBytes = 16'000'000;
constexpr std::int64_t kGrowth = 4;
/// Stretches without rows may grow further: a robot that was away for months.
constexpr std::int64_t kEmptyFactor = 16;

std::int64_t row_bytes(const FieldSet& fields) {
  std::int64_t bytes = 32;
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    if (fields[i]) {
      const Kind kind = kFields[i].kind;
      const bool numeric = kind == Kind::real || kind == Kind::integer || kind == Kind::flag || kind == Kind::code;
      bytes += numeric || kind == Kind::text ? 16 : 256;
    }
  }
  return bytes;
}

Micros plus(Micros a, Micros b) {
  constexpr Micros kMax = std::numeric_limits<Micros>::max();
  return a > kMax - b ? kMax : a + b;
}

}  // namespace

RowScan::RowScan(RowSource& log, Query query) : log_(&log), query_(std::move(query)) {}

bool RowScan::next() {
  while (true) {
    if (next_in_memory()) {
      return true;
    }
    if (robot_ >= query_.robots.size()) {
      return false;
    }
    if (!until_ && !begin_robot()) {
      ++robot_;
      continue;
    }
    if (!next_stretch()) {
      until_.reset();
      ++robot_;
    }
  }
}

bool RowScan::next_in_memory() {
  while (piece_ < pieces_.size()) {
    row_ = started_ ? row_ + 1 : 0;
    started_ = true;
    if (row_ < piece().batch.rows()) {
      return true;
    }
    ++piece_;
    started_ = false;
    enter_piece();
  }
  return false;
}

/// Where the robot's rows begin and end, and how dense they are; false when it has none in the window.
bool RowScan::begin_robot() {
  const RobotId id = robot().id;
  Window held{std::numeric_limits<Micros>::max(), std::numeric_limits<Micros>::min()};
  for (const Coverage& c : log_->coverage()) {
    if (c.robot == id && c.source == query_.source && c.stored > 0) {
      held = {std::min(held.from_us, c.first_us), std::max(held.to_us, plus(c.last_us, 1))};
    }
  }
  const Micros from = std::max(held.from_us, query_.window.from_us);
  const Micros to = std::min(held.to_us, query_.window.to_us);
  if (from >= to) {
    return false;
  }
  period_us_ = 0;
  for (const Stream& stream : log_->streams()) {
    if (stream.robot == id && stream.source == query_.source && stream.period_us > 0) {
      period_us_ = period_us_ == 0 ? stream.period_us : std::min(period_us_, stream.period_us);
    }
  }
  period_us_ = period_us_ == 0 ? 1'000'000 : period_us_;
  until_ = to;
  stretch_ = {from, from};
  length_ = std::min(kFirstRows * period_us_, longest());
  return true;
}

Micros RowScan::longest() const {
  return std::clamp(kBudgetBytes / row_bytes(query_.fields), kFirstRows / 4, kMostRows) * period_us_;
}

bool RowScan::next_stretch() {
  if (stretch_.to_us >= *until_) {
    return false;
  }
  stretch_ = {stretch_.to_us, std::min(*until_, plus(stretch_.to_us, length_))};
  load();
  length_ = std::min(plus(length_, (kGrowth - 1) * length_), longest() * (pieces_.empty() ? kEmptyFactor : 1));
  return true;
}

void RowScan::load() {
  pieces_.clear();
  Selection selection;
  selection.fields[static_cast<std::size_t>(query_.source)] = query_.fields;
  selection.rows[static_cast<std::size_t>(query_.source)] = true;
  selection.records = false;
  log_->read(robot().id, stretch_, selection, [&](const Slice& slice) {
    if (const Batch* batch = slice.find(query_.source)) {
      pieces_.push_back({slice.session, *batch});
    }
  });
  piece_ = 0;
  row_ = 0;
  started_ = false;
  enter_piece();
}

void RowScan::enter_piece() {
  columns_.fill(nullptr);
  if (piece_ < pieces_.size()) {
    for (const Column& column : piece().batch.columns) {
      columns_[column.field] = &column;
    }
  }
}

void RowScan::need(const FieldSet& fields) {
  if ((fields & ~query_.fields).none()) {
    return;
  }
  query_.fields |= fields;
  const std::size_t at_piece = piece_;
  const std::size_t at_row = row_;
  const std::vector<Piece> before = std::move(pieces_);
  load();
  // The log reads as it was when it was opened, so the rows are the same; unless a part has gone in between.
  const bool same =
      std::equal(before.begin(), before.end(), pieces_.begin(), pieces_.end(),
                 [](const Piece& a, const Piece& b) { return a.session == b.session && a.batch.seq == b.batch.seq; });
  if (!same) {
    throw Error("the log", "has lost a part while it was read", "ask again");
  }
  piece_ = at_piece;
  row_ = at_row;
  started_ = true;
  enter_piece();
}

const Column* RowScan::column(FieldIndex field) {
  if (!query_.fields[field]) {
    FieldSet one;
    one.set(field);
    need(one);
  }
  return columns_[field];
}

}  // namespace tacho::store::sql
