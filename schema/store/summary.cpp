#include "schema/store/summary.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <string_view>
#include <type_traits>
#include <utility>

#include "schema/store/block/bytes.hpp"
#include "schema/store/checksum.hpp"
#include "schema/store/record_format.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

namespace fs = std::filesystem;

constexpr std::string_view kSummaryMagic = "TACHSUM1";  // the digit counts changes of what follows
/// `summary` is the first table that is created, and its one row needs no more than a leaf and overflow pages.
constexpr std::uint32_t kRootPage = 2;

// What a summary holds, in both directions: `to` is a SummaryPacker or an SummaryUnpacker.

template <class To>
void members(To& to, PartRow& row) {
  to(row.log, row.number, row.software, row.closed, row.counted_to, row.ended_us);
}
template <class To>
void members(To& to, Robot& r) {
  to(r.id, r.name, r.address, r.vehicle_id, r.mac, r.model_md5, r.firmware);
}
template <class To>
void members(To& to, Session& s) {
  to(s.id, s.t_start_us, s.t_end_us, s.clean, s.software, s.config, s.host);
}
template <class To>
void members(To& to, StreamRow& row) {
  Stream& s = row.stream;
  to(s.session, s.robot, s.source, s.period_us, s.word_order, s.request, s.planned, row.seq_from);
}
template <class To>
void members(To& to, StreamKey& key) {
  to(key.session, key.robot, key.source);
}
template <class To>
void members(To& to, StreamCount& c) {
  to(c.stored, c.bytes, c.undecodable, c.first_us, c.last_us, c.next_seq, c.seen, c.valued);
}
template <class To>
void members(To& to, GapSums::ByCause& sum) {
  to(sum.polls, sum.gaps, sum.length_us);
}
template <class To>
void members(To& to, GapCount& c) {
  to(c.missed, c.partial, c.next_seq, c.last_us, c.sums.causes, c.sums.off);
}
template <class To>
void members(To& to, UnknownKey& k) {
  to(k.robot, k.source, k.key, k.first_us);
}
template <class To>
void members(To& to, PartEnds& ends) {
  to(ends.row, ends.gap, ends.event, ends.clock);
}
template <class To>
void members(To& to, PartHead& head) {
  to(head.row, head.robots, head.sessions, head.streams, head.counts, head.gaps, head.unknown_keys, head.ends,
     head.sealed_rows);
}

template <class Value>
constexpr bool kNumber = std::is_integral_v<Value> || std::is_enum_v<Value>;

class SummaryPacker {
 public:
  explicit SummaryPacker(std::string& out) : out_(&out) {}

  template <class... Values>
  void operator()(Values&... values) {
    (put(values), ...);
  }

 private:
  std::string* out_;

  template <class Value>
  void put(Value& value) {
    if constexpr (kNumber<Value>) {
      put_varint(*out_, zigzag(static_cast<std::int64_t>(value)));
    } else {
      members(*this, value);
    }
  }
  void put(std::string& text) {
    put_varint(*out_, text.size());
    *out_ += text;
  }
  void put(FieldSet& fields) {
    std::string bits = pack_fields(fields);
    put(bits);
  }
  template <class Value>
  void put(std::optional<Value>& value) {
    put_varint(*out_, value ? 1 : 0);
    if (value) {
      put(*value);
    }
  }
  template <class A, class B>
  void put(std::pair<A, B>& both) {
    std::remove_const_t<A> first = both.first;  // a key
    put(first);
    put(both.second);
  }
  template <class Value>
  void put(std::vector<Value>& all) {
    put_all(all);
  }
  template <class Key, class Value, class Less>
  void put(std::map<Key, Value, Less>& all) {
    put_all(all);
  }
  template <class All>
  void put_all(All& all) {
    put_varint(*out_, all.size());
    for (auto& each : all) {
      put(each);
    }
  }
};

class SummaryUnpacker {
 public:
  explicit SummaryUnpacker(std::string_view bytes) : bytes_(bytes) {}

  template <class... Values>
  void operator()(Values&... values) {
    (get(values), ...);
  }
  [[nodiscard]] bool done() const { return bytes_.good() && bytes_.left() == 0; }

 private:
  ByteReader bytes_;

  template <class Value>
  void get(Value& value) {
    if constexpr (kNumber<Value>) {
      value = static_cast<Value>(bytes_.signed_varint());
    } else {
      members(*this, value);
    }
  }
  void get(std::string& text) { text = bytes_.take(bytes_.varint()); }
  void get(FieldSet& fields) { fields = unpack_fields(bytes_.take(bytes_.varint()), own_vocabulary()); }
  template <class Value>
  void get(std::optional<Value>& value) {
    if (bytes_.varint() != 0) {
      get(value.emplace());
    }
  }
  template <class A, class B>
  void get(std::pair<A, B>& both) {
    (*this)(both.first, both.second);
  }
  template <class Value>
  void get(std::vector<Value>& all) {
    for (std::uint64_t n = bytes_.varint(); n > 0 && bytes_.good(); --n) {
      get(all.emplace_back());
    }
  }
  template <class Key, class Value, class Less>
  void get(std::map<Key, Value, Less>& all) {
    for (std::uint64_t n = bytes_.varint(); n > 0 && bytes_.good(); --n) {
      std::pair<Key, Value> each;
      get(each);
      all.insert(all.end(), std::move(each));
    }
  }
};

/// Magic, checksum of the rest, checksum of the names that numbers stand for, the head.
std::string packed(PartHead head) {
  std::string rest;
  put_fixed(rest, own_names());
  SummaryPacker to(rest);
  to(head);
  std::string out(kSummaryMagic);
  put_fixed(out, Checksum().add(rest).value());
  return out + rest;
}

std::optional<PartHead> unpacked(std::string_view bytes) {
  bytes.remove_prefix(kSummaryMagic.size());
  ByteReader front(bytes);
  const auto sum = front.fixed<std::int64_t>();
  if (!front.good() || Checksum().add(bytes.substr(sizeof sum)).value() != sum ||
      front.fixed<std::int64_t>() != own_names()) {
    return std::nullopt;
  }
  PartHead head;
  SummaryUnpacker from(bytes.substr(2 * sizeof sum));
  from(head);
  return from.done() ? std::optional(std::move(head)) : std::nullopt;
}

/// What the one cell of the leaf at kRootPage holds: a record that ends with the summary.
std::string record_of(const Connection& connection, std::uint32_t page_bytes, std::uint64_t file_bytes) {
  const std::string page =
      connection.file_bytes(std::uint64_t{kRootPage - 1} * page_bytes, static_cast<int>(page_bytes));
  if (page.empty() || byte_at(page, 0) != kTableLeaf || big_endian(page, 3, 2) != 1) {
    return "";
  }
  auto at = static_cast<std::size_t>(big_endian(page, kLeafHeader, 2));
  std::uint64_t total = 0;
  std::uint64_t rowid = 0;
  if (!take_varint(page, at, total) || !take_varint(page, at, rowid) || total > file_bytes) {
    return "";
  }
  const std::size_t local = local_bytes(total, page_bytes, true);
  if (at + local + kLinkBytes > page.size()) {
    return local == total && at + local <= page.size() ? page.substr(at, local) : "";
  }
  std::string record = page.substr(at, local);
  std::uint64_t next = big_endian(page, at + local, kLinkBytes);
  while (record.size() < total) {
    const std::string more =
        next < kRootPage ? "" : connection.file_bytes((next - 1) * page_bytes, static_cast<int>(page_bytes));
    if (more.empty()) {
      return "";
    }
    next = big_endian(more, 0, kLinkBytes);
    record.append(more, kLinkBytes, std::min<std::size_t>(page_bytes - kLinkBytes, total - record.size()));
  }
  return record;
}

bool has_bytes(const fs::path& path) {
  std::error_code missing;
  const auto size = fs::file_size(path, missing);
  return !missing && size > 0;
}

/// The page size of a part of this version that nobody writes and that is all there; else 0.
std::uint32_t settled_page_bytes(const Connection& connection, std::uint64_t& file_bytes) {
  const std::string header = connection.file_bytes(0, kFileHeader);
  const Connection::FileSize size = connection.file_size();
  file_bytes = size.actual;
  if (header.empty() || header.compare(0, 16, "SQLite format 3\0", 16) != 0 || size.promised != size.actual) {
    return 0;
  }
  const bool not_wal = byte_at(header, 18) == 1 && byte_at(header, 19) == 1;
  const bool ours = big_endian(header, 68, 4) == kApplicationId && big_endian(header, 60, 4) == kSchemaVersion;
  const bool no_reserve = byte_at(header, 20) == 0;
  const std::string name = connection.path().string();
  if (!not_wal || !ours || !no_reserve || has_bytes(name + "-wal") || has_bytes(name + "-journal")) {
    return 0;
  }
  return static_cast<std::uint32_t>(big_endian(header, 16, 2));
}

}  // namespace

void write_summary(Connection& connection, SealedRows sealed) {
  PartHead head;
  head.row = read_part_row(connection);
  head.sealed_rows = std::move(sealed);
  read_head_tables(connection, head);
  delete_summary(connection);
  if (head.damage.empty() && head.vocabulary == own_vocabulary()) {
    const std::string data = packed(std::move(head));
    Statement(connection, insert_sql("summary")).run(1, Statement::Blob{data});
  }
}

void delete_summary(Connection& connection) { connection.exec("DELETE FROM summary"); }

std::optional<PartHead> read_summary(const fs::path& path) {
  try {
    const Connection connection(path, OpenMode::read);
    std::uint64_t file_bytes = 0;
    const std::uint32_t page_bytes = settled_page_bytes(connection, file_bytes);
    const std::string record = page_bytes < 512 ? "" : record_of(connection, page_bytes, file_bytes);
    const std::size_t begin = record.find(kSummaryMagic);
    std::optional<PartHead> head =
        begin == std::string::npos ? std::nullopt : unpacked(std::string_view(record).substr(begin));
    if (!head || !head->row.closed) {
      return std::nullopt;
    }
    head->path = path;
    head->version = kSchemaVersion;
    head->checkpointed = true;
    head->file_bytes = file_bytes;
    head->vocabulary = own_vocabulary();
    return head;
  } catch (const SqliteError&) {
    return std::nullopt;  // who opens it next says why
  }
}

std::string check_summary(Connection& connection, const PartHead& head) {
  try {
    Statement row(connection, select_sql("summary"));
    const bool fits = !row.step() || row.bytes(1) == packed(head);
    return fits ? "" : "table summary is not as it was when the part was closed";
  } catch (const SqliteError& error) {
    return fmt::format("table summary cannot be read: {}", error.what());
  }
}

}  // namespace tacho::store
