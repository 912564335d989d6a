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
    : vocabulary_(&vocabulary),
      end_(last_id),
      lost_(std::move(lost)),
      batch_(connection, select_sql("hot") + " WHERE id > ?1 AND id <= ?2 ORDER BY id LIMIT ?3"),
      probe_(connection, "SELECT id FROM hot WHERE id >= ?1 ORDER BY id LIMIT 1") {}

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
  if (!open_) {
    batch_.query(last_, end_, kBatchRows);
    open_ = true;
    in_batch_ = 0;
    batch_start_ = last_;
  }
  while (batch_.step()) {
    ++in_batch_;
    row_ = read_hot(batch_, *vocabulary_);
    const bool known =
        row_.source >= 0 && row_.source < 256 && vocabulary_->source[static_cast<std::size_t>(row_.source)].has_value();
    if (row_.id > last_ && known && checksum(row_) == row_.crc) {
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
    probe_.query(from);
    const std::int64_t id = probe_.step() ? probe_.integer(0) : 0;
    probe_.reset();
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

BodyChain::BodyChain(Connection& connection, const Vocabulary& vocabulary)
    : vocabulary_(&vocabulary), fetch_(connection, select_sql("hot") + " WHERE id = ?1") {}

bool BodyChain::decode(std::string_view stored, std::uint64_t length, std::int64_t id, std::int64_t base, Last& last) {
  const std::string* prefix = base == 0 ? nullptr : &last.body;
  if (length > kMaxBodyBytes || !decoder_.decode(stored, static_cast<std::size_t>(length), prefix, last.next)) {
    return false;
  }
  last.body.swap(last.next);
  last.id = id;
  return true;
}

/// Reads the rows from a keyframe to `base`, so that last.body is the body of `base`.
bool BodyChain::walk_to(std::int64_t base, Last& last) {
  struct Link {
    std::int64_t id;
    std::int64_t base;
    std::uint64_t length;
    std::string stored;
  };
  std::vector<Link> links;
  while (base != 0 && base != last.id) {
    fetch_.query(base);
    if (!fetch_.step()) {
      return false;
    }
    const HotRow row = read_hot(fetch_, *vocabulary_);
    if (checksum(row) != row.crc || row.base >= row.id) {
      return false;
    }
    links.push_back({row.id, row.base, row.length, std::string(row.body)});
    base = row.base;
    fetch_.reset();
  }
  for (auto link = links.rbegin(); link != links.rend(); ++link) {
    if (!decode(link->stored, link->length, link->id, link->base, last)) {
      return false;
    }
  }
  return true;
}

const std::string* BodyChain::body(const HotRow& row) {
  Last& last = streams_[{row.meta.robot, row.source}];
  bool good = row.base == 0 || row.base == last.id;
  if (!good && row.base != last.broken) {
    try {
      good = walk_to(row.base, last);
    } catch (const SqliteError& error) {
      if (!error.damaged()) {
        throw;
      }
    }
    fetch_.reset();
  }
  if (!good || !decode(row.body, row.length, row.id, row.base, last)) {
    last.broken = row.id;
    return nullptr;
  }
  return &last.body;
}

}  // namespace tacho::store
