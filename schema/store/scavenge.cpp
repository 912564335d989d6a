#include "schema/store/scavenge.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <fstream>
#include <functional>
#include <map>
#include <optional>
#include <utility>

#include "schema/store/block/block_decoder.hpp"
#include "schema/store/hot_scan.hpp"
#include "schema/store/page_scan.hpp"
#include "schema/store/record_format.hpp"
#include "schema/store/record_shape.hpp"
#include "schema/store/schema_sql.hpp"
#include "schema/store/seal.hpp"
#include "schema/store/small_tables.hpp"

namespace tacho::store {

namespace {

namespace fs = std::filesystem;

/// Of the 32 hexadecimal digits of a log's identity: parts of different logs share some four of them.
constexpr std::size_t kLikeDigits = 24;

std::optional<std::uint32_t> number_in_name(const fs::path& path) {
  const std::string name = path.filename().string();
  std::uint32_t number = 0;
  const auto [end, error] =
      std::from_chars(name.data() + std::min<std::size_t>(5, name.size()), name.data() + name.size(), number);
  const bool good = error == std::errc() && name.rfind("part-", 0) == 0 && std::string_view(end) == ".db";
  return good ? std::optional(number) : std::nullopt;
}

/// Four bytes of the header of a file or a WAL; zeros behind its end.
std::uint32_t word_in_header(const fs::path& path, std::size_t at) {
  std::array<char, kFileHeader> header{};
  std::ifstream(path, std::ios::binary).read(header.data(), header.size());
  return static_cast<std::uint32_t>(big_endian({header.data(), header.size()}, at, sizeof(std::uint32_t)));
}

Connection scratch(const fs::path& path, std::uint32_t page_bytes = 0) {
  fs::remove(path);
  Connection connection(path, OpenMode::create);
  connection.exec("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF");
  if (page_bytes > 0) {
    connection.exec(fmt::format("PRAGMA page_size = {}", page_bytes));  // one that cannot be is not taken
  }
  connection.exec(schema_sql());
  // Fingerprints of the records taken so far: a record lies in the file more than once when SQLite has moved it.
  connection.exec("CREATE TEMP TABLE taken (fingerprint INTEGER PRIMARY KEY)");
  return connection;
}

class Rebuild {
 public:
  Rebuild(const fs::path& damaged, const fs::path& target, KnownLog known)
      : damaged_(damaged),
        known_(std::move(known)),
        out_(scratch(target)),
        take_(out_, "INSERT OR IGNORE INTO taken VALUES(?1) RETURNING 1") {
    result_.part = target;
    vocabulary_.source.fill(std::nullopt);
    for (std::size_t i = 0; i < kSourceCount; ++i) {
      vocabulary_.source[i] = static_cast<Source>(i);
    }
  }

  Scavenged run(const fs::path& file) {
    {
      Transaction transaction(out_);
      write_vocabulary(out_);
      collect(file);
      if (rows_ == 0) {
        return {};
      }
      read_seal();
      if (!is_of_this_log()) {
        return {};
      }
      drop_moved_rows();
      drop_bodiless_rows();
      mend();
      transaction.commit();
    }
    return std::move(result_);
  }

 private:
  const fs::path& damaged_;
  const KnownLog known_;
  Connection out_;
  Statement take_;
  Vocabulary vocabulary_;
  Scavenged result_;
  std::uint64_t rows_ = 0;
  std::map<std::uint64_t, std::int64_t> broken_blocks_;  ///< fingerprint without the data -> id
  PartRow part_;
  bool sealed_ = false;
  Seal seal_;

  void note(std::string text) { result_.notes.push_back(std::move(text)); }
  [[nodiscard]] bool trusted(const char* table) const { return seal_.damaged.count(table) == 0; }

  void collect(const fs::path& file);
  bool take(std::uint64_t fingerprint);
  void take_record(RecordShape& shape, const RawRecord& record, PageScan& scan);
  void take_block(RecordShape& shape, RawRecord record, PageScan& scan);
  std::int64_t insert(RecordShape& shape, const RawRecord& record);
  void read_seal();
  [[nodiscard]] bool is_newer() const;
  bool is_of_this_log();
  void drop_moved_rows();
  void drop_bodiless_rows();
  void mend();
};

bool Rebuild::take(std::uint64_t fingerprint) {
  take_.query(fingerprint);
  const bool fresh = take_.step();
  take_.reset();
  return fresh;
}

void Rebuild::collect(const fs::path& file) {
  using Good = std::function<bool(const Statement&)>;
  struct Table {
    RecordShape shape;
    Good good;  ///< by checksum
  };
  std::vector<Table> tables;
  const auto with_checksum = [&](const char* name, Good good) {
    tables.push_back({RecordShape(out_, name, "OR IGNORE"), std::move(good)});
  };
  with_checksum("hot", [this](const Statement& row) {
    const HotRow hot = read_hot(row);
    return source_of(hot, vocabulary_) && is_whole(hot);
  });
  with_checksum("block", [](const Statement& row) { return read_block_place(row).has_value(); });
  with_checksum("gap", [](const Statement& row) { return read_gap(row).has_value(); });
  with_checksum("event", [](const Statement& row) { return read_event(row).has_value(); });
  with_checksum("clock", [](const Statement& row) { return read_clock(row).has_value(); });
  std::vector<RecordShape> small;
  for (const char* name : {"part", "robot", "session", "stream", "seal"}) {
    small.emplace_back(out_, name, "OR REPLACE");
  }
  PageScan scan(file);
  scan.records([&](const RawRecord& record) {
    for (Table& table : tables) {
      if (table.shape.fits(record) && table.good(table.shape.row(record))) {
        take_record(table.shape, record, scan);
        return;
      }
    }
    for (RecordShape& shape : small) {
      if (record.live && shape.fits(record)) {
        shape.insert(record, record.rowid);
        return;
      }
    }
  });
  if (scan.unreadable() > 0) {
    note(fmt::format("{} pages cannot be read from the disk", scan.unreadable()));
  }
}

void Rebuild::take_record(RecordShape& shape, const RawRecord& record, PageScan& scan) {
  const std::string_view name = shape.name();
  ++rows_;
  if (name == "hot") {  // its checksum covers its id
    shape.insert(record, record.rowid);
    return;
  }
  if (name == "block") {
    take_block(shape, record, scan);
    return;
  }
  // Copies that SQLite left behind when it moved rows have the same values; ids of copies may be damaged.
  const std::uint64_t values = std::hash<std::string_view>()(record.payload) ^ std::hash<std::string_view>()(name);
  const std::uint64_t values_and_id = values * 31 + static_cast<std::uint64_t>(record.rowid);
  const bool fresh = take(values);
  if (take(values_and_id) && (record.live || fresh)) {
    insert(shape, record);
  }
}

/// Returns the id it got: its own, where that is not taken.
std::int64_t Rebuild::insert(RecordShape& shape, const RawRecord& record) {
  if (shape.insert(record, record.rowid)) {
    return record.rowid;
  }
  shape.insert(record, std::nullopt);
  return out_.last_insert_rowid();
}

/// Of all copies of a block, and all ways to put them together, the first that is whole, else the first.
void Rebuild::take_block(RecordShape& shape, RawRecord record, PageScan& scan) {
  std::string_view& data = record.values.back().bytes;
  // Its data may be put together wrongly: what tells it from others stands before them.
  const std::uint64_t place =
      std::hash<std::string_view>()(record.payload.substr(0, record.payload.size() - data.size()));
  const bool fresh = take(place);
  const auto broken = broken_blocks_.find(place);
  if (!fresh && broken == broken_blocks_.end()) {
    return;
  }
  BlockDecoder decoder;
  std::vector<std::int64_t> places;
  const auto whole = [&](std::string_view bytes) {
    return decoder.open(bytes).empty() && decoder.places(places).empty() &&
           decoder.answers([](std::size_t, const Answer&) {}).empty();
  };
  std::string other;
  bool good = whole(data);
  for (std::size_t way = 0; !good; ++way) {
    std::optional<std::string> payload = scan.other_payload(way);
    if (!payload) {
      break;
    }
    if (whole(std::string_view(*payload).substr(payload->size() - data.size()))) {
      other = payload->substr(payload->size() - data.size());
      data = other;
      good = true;
    }
  }
  if (!fresh && !good) {
    return;
  }
  if (!fresh) {
    Statement(out_, "DELETE FROM block WHERE id = ?1").run(broken->second);
    broken_blocks_.erase(broken);
  }
  const std::int64_t id = insert(shape, record);
  if (!good) {
    broken_blocks_[place] = id;
  }
}

void Rebuild::read_seal() {
  sealed_ = out_.integer("SELECT count(*) FROM seal WHERE name IN ('gap', 'event', 'clock')") > 0;
  seal_ = check_seal(out_, sealed_, true);
  part_ = read_part_row(out_);
  result_.whole = sealed_;
  for (const char* table : {"part", "robot", "session", "stream"}) {
    if (!trusted(table)) {
      note(fmt::format("table {} is damaged; its rows are taken from other parts, or as they were found", table));
      result_.whole = false;
    }
  }
  for (const char* table : {"gap", "event", "clock"}) {
    const std::int64_t found = out_.integer(fmt::format("SELECT count(*) FROM {}", table));
    const auto sealed = seal_.rows.find(table);
    const bool all = sealed != seal_.rows.end() && sealed->second == found;
    result_.whole = result_.whole && all;
    if (sealed != seal_.rows.end() && !all) {
      note(fmt::format("{} rows of table {} were found, but it had {}", found, table, sealed->second));
    }
  }
  if (!sealed_) {
    note("was not closed, or has lost its seal: whether small tables and newest rows are complete cannot be told");
  }
}

/// A header that says so may be damaged, but not when another version wrote the rest of the part too.
bool Rebuild::is_newer() const {
  constexpr std::size_t kVersionAt = 60;
  const auto version = static_cast<std::int64_t>(word_in_header(damaged_, kVersionAt));
  return version > kSchemaVersion && !part_.software.empty() && part_.software != "tachograph " TACHO_VERSION;
}

bool Rebuild::is_of_this_log() {
  const std::string& mine = part_.log;
  const std::string& other = known_.log;
  std::size_t like = 0;
  for (std::size_t i = 0; i < std::min(mine.size(), other.size()); ++i) {
    like += mine[i] == other[i] ? 1U : 0U;
  }
  if ((!mine.empty() && !other.empty() && like < kLikeDigits) || is_newer()) {
    return false;
  }
  const std::optional<std::uint32_t> name = number_in_name(damaged_);
  const bool believe_row = !mine.empty() && (!name || (sealed_ && trusted("part")));
  part_.number = believe_row ? part_.number : name.value_or(1);
  part_.log = other.empty() ? mine.empty() ? std::string(32, '0') : mine : other;
  return true;
}

/// Hot rows of which blocks give an answer back are copies from before they were moved.
void Rebuild::drop_moved_rows() {
  out_.exec("CREATE TEMP TABLE hot_place (place INTEGER PRIMARY KEY, row INTEGER)");
  Statement note(out_, "INSERT OR IGNORE INTO temp.hot_place VALUES(?1, ?2)");
  for_each_hot_row(out_, vocabulary_, 0, [&](const HotRow& row, Source, const std::vector<HotMark>& marks) {
    for (const HotMark& mark : marks) {
      note.run(mark.place, row.id);
    }
  });
  Statement block(out_, "SELECT data FROM block");
  Statement drop(out_, "DELETE FROM hot WHERE id = (SELECT row FROM temp.hot_place WHERE place = ?1)");
  BlockDecoder decoder;
  std::vector<std::int64_t> places;
  while (out_.integer("SELECT EXISTS (SELECT 1 FROM hot)") != 0 && block.step()) {
    if (decoder.open(block.bytes(0)).empty() && decoder.places(places).empty()) {
      static_cast<void>(decoder.answers([&](std::size_t i, const Answer&) { drop.run(places[i]); }));
    }
  }
  block.reset();
  out_.exec("DROP TABLE temp.hot_place");
}

/// Hot rows whose chain of bases is broken say nothing.
void Rebuild::drop_bodiless_rows() {
  Statement ids(out_, "SELECT id FROM hot ORDER BY id");
  Statement fetch(out_, select_sql("hot") + " WHERE id = ?1");
  BodyChain chain(out_);
  HotBatch batch;
  std::vector<std::int64_t> lost;
  while (ids.step()) {
    fetch.query(ids.integer(0));
    if (fetch.step() && !chain.open(read_hot(fetch), batch)) {
      lost.push_back(ids.integer(0));
    }
  }
  fetch.reset();
  Statement drop(out_, "DELETE FROM hot WHERE id = ?1");
  for (const std::int64_t id : lost) {
    drop.run(id);
  }
}

void Rebuild::mend() {
  const Mending mending = mend_small_tables(out_, part_, known_, seal_.damaged);
  result_.notes.insert(result_.notes.end(), mending.notes.begin(), mending.notes.end());
  result_.whole = result_.whole && !mending.made_up;
}

/// What the header of a WAL says; 0 when there is none.
std::uint32_t page_bytes_of_wal(const fs::path& wal) {
  constexpr std::size_t kPageBytesAt = 8;
  return word_in_header(wal, kPageBytesAt);
}

/// A copy with everything of the WAL in the file itself. SQLite does that page by page and needs no more than the
/// header, which is made anew when it is damaged: of the page size of the WAL, or SQLite would not take its pages.
void copy_with_wal(const fs::path& damaged, const fs::path& copy) {
  fs::copy_file(damaged, copy, fs::copy_options::overwrite_existing);
  fs::copy_file(damaged.string() + "-wal", copy.string() + "-wal", fs::copy_options::overwrite_existing);
  const auto empty_wal = [&] {
    Connection connection(copy, OpenMode::write);
    connection.scalar("PRAGMA schema_version");  // before it has read anything, SQLite knows of no WAL
    connection.checkpoint_truncate();
  };
  try {
    empty_wal();
  } catch (const SqliteError&) {
    const fs::path model = copy.string() + "-model";
    { scratch(model, page_bytes_of_wal(copy.string() + "-wal")).exec("PRAGMA journal_mode = WAL"); }
    std::array<char, kFileHeader> header{};
    std::ifstream(model, std::ios::binary).read(header.data(), header.size());
    std::fstream(copy, std::ios::in | std::ios::out | std::ios::binary).write(header.data(), header.size());
    fs::remove(model);
    try {
      empty_wal();
    } catch (const SqliteError&) {
      // What is in the file itself is left.
    }
  }
}

}  // namespace

bool may_be_part(const fs::path& path) {
  if (number_in_name(path)) {
    return true;
  }
  std::string start(65536, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(start.data(), static_cast<std::streamsize>(start.size()));
  // The schema stands at the end of the first page; either mark may be damaged.
  constexpr std::string_view kMark("TACH");
  return start.compare(68, kMark.size(), kMark) == 0 || start.find("CREATE TABLE hot (") != std::string::npos;
}

Scavenged scavenge(const fs::path& damaged, std::span<const fs::path> others, const fs::path& folder) {
  const fs::path target = folder / ("found-" + damaged.filename().string());
  const fs::path copy = folder / ("copy-" + damaged.filename().string());
  std::error_code none;
  const bool wal = fs::file_size(damaged.string() + "-wal", none) > 0 && !none;
  if (wal) {
    copy_with_wal(damaged, copy);
  }
  Scavenged found = Rebuild(damaged, target, ask(others)).run(wal ? copy : damaged);
  for (const char* suffix : {"", "-wal", "-shm"}) {
    fs::remove(copy.string() + suffix);
  }
  if (found.part.empty()) {
    fs::remove(target);
  }
  return found;
}

}  // namespace tacho::store
