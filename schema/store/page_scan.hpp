#pragma once
// Records of an SQLite file found in its pages, without its header, schema, b-trees or free list: what salvage works
// on.
//
// File format: https://www.sqlite.org/fileformat2.html. A record is taken where its lengths fit each other exactly;
// whether it is what was written is for the caller to know (checksums). Records that SQLite has deleted or moved can
// come out too, and the same record more than once.
//
// Memory: two pages, the payload of one record, and a bit per page. Thread rule: one thread per object.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tacho::store {

struct RawValue {
  enum class Type : std::uint8_t { null, integer, real, text, blob };
  Type type = Type::null;
  std::int64_t integer = 0;
  double real = 0;
  std::string_view bytes;  ///< text and blob; valid during the call that gave it
};

struct RawRecord {
  bool table = true;         ///< of a table with rowid; false: of an index or a table without
  bool live = false;         ///< its page is sound and lists it; else it only lies there
  std::int64_t rowid = 0;    ///< of a table
  std::string_view payload;  ///< equal for equal values
  std::vector<RawValue> values;
};

class PageScan {
 public:
  /// Throws Error when the file cannot be opened.
  explicit PageScan(const std::filesystem::path& path);
  ~PageScan();
  PageScan(const PageScan&) = delete;
  PageScan& operator=(const PageScan&) = delete;

  using Yield = std::function<void(const RawRecord&)>;
  /// First all records that sound leaf pages list; then, wherever else they lie, records of tables whose first column
  /// is the rowid: those are looked for at every byte of the file.
  void records(const Yield& yield);

  /// Inside a call of Yield: other ways to read a record whose overflow pages do not follow each other as they should.
  /// One pointer of the chain is taken for damaged; in its place the chain goes on with a page that nothing leads to
  /// and from which it is as long as it must be. Empty: there is no way number `way`, counted from 0.
  std::optional<std::string> other_payload(std::size_t way);

  [[nodiscard]] std::uint32_t page_bytes() const { return page_bytes_; }
  /// Pages that the disk did not give.
  [[nodiscard]] std::uint64_t unreadable() const { return unreadable_; }

 private:
  int file_ = -1;
  std::uint64_t file_bytes_ = 0;
  std::uint32_t page_bytes_ = 0;
  std::uint64_t unreadable_ = 0;
  std::string page_;
  std::string overflow_;
  std::string payload_;
  std::uint32_t page_number_ = 0;
  RawRecord record_;
  std::vector<std::uint64_t> types_;
  /// Of the record that is read now.
  struct Spill {
    std::size_t total = 0;
    std::string_view local;
    std::uint32_t first = 0;  ///< overflow page
  };
  Spill spill_;
  /// Pointer number `link` of a chain leads to `page`.
  struct Mend {
    std::size_t link = 0;
    std::uint32_t page = 0;
  };
  std::vector<Mend> ways_;                                ///< of the record that is read now
  std::optional<std::vector<std::uint32_t>> loose_ends_;  ///< pages that nothing leads to; found when first needed

  [[nodiscard]] std::uint32_t pages() const;
  bool read(std::uint64_t offset, std::size_t bytes, std::string& out);
  void find_page_size();
  void scan_listed(const Yield& yield);
  void scan_bytes(const Yield& yield);
  bool cell_at(std::size_t offset, bool table);
  void gather(std::optional<Mend> mend, std::string& out);
  std::uint32_t link_of(std::uint32_t page);
  [[nodiscard]] std::size_t chain_length(std::uint32_t page, std::size_t most);
  void find_loose_ends();
  void find_ways();
};

}  // namespace tacho::store
