#include "schema/store/hot_scan.hpp"

#include <algorithm>
#include <utility>
#include <vector>

#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

constexpr int kBatchRows = 4096;

}  // namespace

HotScan::HotScan(Connection& connection, const Vocabulary& vocabulary, std::int64_t last_id, Lost lost)
    : connection_(&connection), vocabulary_(&vocabulary), end_(last_id), lost_(std::move(lost)) {}

const HotRow* HotScan::next() {
  while (last_ < end_) {
    try {
      if (advance()) {
        return &row_;
      }
      // The statement ended although more rows are known to exist: they are damaged, or hidden behind a damaged id.
      const bool stuck = in_batch_ < kBatchRows || last_ == batch_start_;
      if (stuck && last_ < end_ && !skip_damage("rows are missing")) {
        return nullptr;
      }
    } catch (const SqliteError& error) {
      open_ = false;
      if (!error.damaged()) {
        throw;
      }
      if (!skip_damage(error.what())) {
        return nullptr;
      }
    }
  }
  return nullptr;
}

/// False at the end of a batch.
bool HotScan::advance() {
  if (!batch_) {
    batch_.emplace(*connection_, select_sql("hot") + " WHERE id > ?1 AND id <= ?2 ORDER BY id LIMIT ?3");
  }
  if (!open_) {
    batch_->query(last_, end_, kBatchRows);
    open_ = true;
    in_batch_ = 0;
    batch_start_ = last_;
  }
  while (batch_->step()) {
    ++in_batch_;
    row_ = read_hot(*batch_);
    if (row_.id > last_ && is_whole(row_) && source_of(row_, *vocabulary_)) {
      last_ = row_.id;
      return true;
    }
    report(row_.id + 1, "a row's checksum is wrong");
  }
  open_ = false;
  return false;
}

/// Rows that are met twice on the way round damage are named once.
void HotScan::report(std::int64_t before, const std::string& why) {
  if (before > reported_) {
    lost_(last_, before, why);
    reported_ = before;
  }
}

std::int64_t HotScan::probe(std::int64_t from) {
  try {
    if (!probe_) {
      probe_.emplace(*connection_, "SELECT id FROM hot WHERE id >= ?1 ORDER BY id LIMIT 1");
    }
    probe_->query(from);
    const std::int64_t id = probe_->step() ? probe_->integer(0) : 0;
    probe_->reset();
    return id <= end_ ? id : 0;
  } catch (const SqliteError& error) {
    if (!error.damaged()) {
      throw;
    }
    return 0;
  }
}

/// The first id after `id` that can be reached; 0 when there is none. Damage covers whole pages, so distances are first
/// doubled and then halved.
std::int64_t HotScan::readable_after(std::int64_t id) {
  std::int64_t bad = id + 1;
  std::int64_t good = 0;
  for (std::int64_t distance = 2; good == 0 && bad < end_; distance *= 2) {
    const std::int64_t from = std::min(id + distance, end_);
    good = probe(from);
    bad = good == 0 ? from : bad;
  }
  while (good > 0 && bad + 1 < good) {
    const std::int64_t middle = bad + (good - bad) / 2;
    const std::int64_t found = probe(middle);
    if (found == 0 || found > good) {  // damaged ids are in no order
      bad = middle;
    } else {
      good = middle == found ? found : std::min(good, found);
      bad = found > middle && found == good ? good - 1 : bad;
    }
  }
  return good;
}

bool HotScan::skip_damage(const std::string& why) {
  // A row that can be reached but has a wrong checksum must not be tried for ever.
  tried_ = readable_after(std::max(last_, tried_));
  report(tried_ == 0 ? end_ + 1 : tried_, why);
  last_ = tried_ == 0 ? end_ : tried_ - 1;
  return tried_ != 0;
}

void for_each_hot_row(Connection& connection, const Vocabulary& vocabulary, std::int64_t after,
                      const std::function<void(const HotRow&, Source, const std::vector<HotMark>&)>& yield) {
  Statement rows(connection, select_sql("hot") + " WHERE id > ?1 ORDER BY id");
  std::vector<HotMark> marks;
  rows.query(after);
  while (rows.step()) {
    const HotRow row = read_hot(rows);
    const std::optional<Source> source = source_of(row, vocabulary);
    if (source && is_whole(row) && read_marks(row, marks)) {
      yield(row, *source, marks);
    }
  }
}

/// last.body is the last body of row.base, where it has one.
bool BodyChain::unpack(const HotRow& row, HotBatch& out, Last& last) {
  if (!decoder_) {
    decoder_.emplace();
  }
  const std::optional<PackedBodies> packed = read_marks(row, out.marks);
  if (!packed || !decoder_->unpack(*packed, row.base == 0 ? nullptr : &last.body, out.bodies)) {
    return false;
  }
  last.body = out.last_body();
  last.id = row.id;
  return true;
}

/// Reads the rows from a keyframe to `base`, so that last.body is the last body of `base`.
bool BodyChain::walk_to(std::int64_t base, Last& last) {
  struct Link {
    HotRow row;
    std::string data;
  };
  std::vector<Link> links;
  if (!fetch_) {
    fetch_.emplace(*connection_, select_sql("hot") + " WHERE id = ?1");
  }
  while (base != 0 && base != last.id) {
    fetch_->query(base);
    if (!fetch_->step()) {
      return false;
    }
    const HotRow row = read_hot(*fetch_);
    if (!is_whole(row) || row.base >= row.id) {
      return false;
    }
    links.push_back({row, std::string(row.data)});
    base = row.base;
    fetch_->reset();
  }
  for (auto link = links.rbegin(); link != links.rend(); ++link) {
    link->row.data = link->data;
    if (!unpack(link->row, link_, last)) {
      return false;
    }
  }
  return true;
}

bool BodyChain::open(const HotRow& row, HotBatch& out) {
  Last& last = streams_[{row.robot, row.source}];
  bool good = row.base == 0 || row.base == last.id;
  if (!good && row.base != last.broken) {
    try {
      good = walk_to(row.base, last);
    } catch (const SqliteError& error) {
      if (!error.damaged()) {
        throw;
      }
    }
    if (fetch_) {
      fetch_->reset();
    }
  }
  if (good && unpack(row, out, last)) {
    return true;
  }
  last.broken = row.id;
  static_cast<void>(read_marks(row, out.marks));
  return false;
}

}  // namespace tacho::store
