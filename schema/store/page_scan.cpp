#include "schema/store/page_scan.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <limits>

#include "schema/error.hpp"
#include "schema/store/hot_codec.hpp"

namespace tacho::store {

namespace {

// The first is what parts are made with: it wins where a file is too short to tell.
constexpr std::array<std::uint32_t, 8> kPageSizes{4096, 512, 1024, 2048, 8192, 16384, 32768, 65536};
constexpr std::size_t kChunk = 65536;
constexpr std::uint64_t kChunksForPageSize = 1024;  // 64 MiB say it clearly enough
constexpr std::size_t kFileHeader = 100;
constexpr unsigned char kIndexLeaf = 0x0A;
constexpr unsigned char kTableLeaf = 0x0D;
constexpr std::size_t kLeafHeader = 8;
constexpr std::size_t kLinkBytes = 4;
/// A body is the longest value by far; longer lengths are not lengths.
constexpr std::uint64_t kMostPayload = kMaxBodyBytes + (std::size_t{1} << 20U);
/// Longest chain that is tried with one pointer corrected: 1 MiB of pages of 4096.
constexpr std::size_t kMostWays = 256;

unsigned byte_at(std::string_view bytes, std::size_t at) { return static_cast<unsigned char>(bytes[at]); }

std::uint64_t big_endian(std::string_view bytes, std::size_t at, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < count; ++i) {
    value = value << 8U | byte_at(bytes, at + i);
  }
  return value;
}

/// SQLite's variable-length integer, at most nine bytes. False at the end of the bytes.
bool take_varint(std::string_view bytes, std::size_t& at, std::uint64_t& value) {
  value = 0;
  for (int i = 0; i < 8; ++i) {
    if (at >= bytes.size()) {
      return false;
    }
    const unsigned byte = byte_at(bytes, at++);
    value = value << 7U | (byte & 0x7FU);
    if (byte < 0x80U) {
      return true;
    }
  }
  if (at >= bytes.size()) {
    return false;
  }
  value = value << 8U | byte_at(bytes, at++);
  return true;
}

/// Bytes of a value of this serial type; more than any payload for types that do not exist.
std::uint64_t serial_bytes(std::uint64_t type) {
  constexpr std::array<std::uint64_t, 12> kFixed{0, 1, 2, 3, 4, 6, 8, 8, 0, 0, kMostPayload, kMostPayload};
  return type < kFixed.size() ? kFixed[static_cast<std::size_t>(type)] : (type - 12) / 2;
}

RawValue value_of(std::uint64_t type, std::string_view bytes) {
  RawValue value;
  if (type == 0) {
    return value;
  }
  if (type >= 12) {
    value.type = type % 2 == 0 ? RawValue::Type::blob : RawValue::Type::text;
    value.bytes = bytes;
  } else if (type == 7) {
    value.type = RawValue::Type::real;
    value.real = std::bit_cast<double>(big_endian(bytes, 0, 8));
  } else {
    value.type = RawValue::Type::integer;
    const unsigned unused = 64U - 8U * static_cast<unsigned>(bytes.size());
    const bool constant = type >= 8;
    value.integer = constant ? static_cast<std::int64_t>(type - 8)
                             : static_cast<std::int64_t>(big_endian(bytes, 0, bytes.size()) << unused) >> unused;
  }
  return value;
}

/// The serial types of a record whose lengths add up to exactly `total`; false for anything else. `bytes` may end
/// after the header. `rowid_first`: the first column must be the NULL that stands for the rowid.
bool take_types(std::string_view bytes, std::uint64_t total, bool rowid_first, std::vector<std::uint64_t>& types) {
  types.clear();
  std::size_t at = 0;
  std::uint64_t header = 0;
  if (!take_varint(bytes, at, header) || header <= at || header > total || header > bytes.size() ||
      (rowid_first && bytes[at] != 0)) {
    return false;
  }
  const std::string_view head = bytes.substr(0, static_cast<std::size_t>(header));
  std::uint64_t sum = header;
  while (at < head.size()) {
    std::uint64_t type = 0;
    if (!take_varint(head, at, type) || serial_bytes(type) > total - sum) {
      return false;
    }
    sum += serial_bytes(type);
    types.push_back(type);
  }
  return sum == total;
}

/// Bytes of a payload that stand in the page itself.
std::size_t local_bytes(std::uint64_t total, std::size_t usable, bool table) {
  const std::size_t most = table ? usable - 35 : (usable - 12) * 64 / 255 - 23;
  if (total <= most) {
    return static_cast<std::size_t>(total);
  }
  const std::size_t least = (usable - 12) * 32 / 255 - 23;
  const std::size_t fitting = least + static_cast<std::size_t>((total - least) % (usable - kLinkBytes));
  return fitting <= most ? fitting : least;
}

/// Where the cells of a leaf page begin; empty when it is no leaf, or not sound.
std::vector<std::size_t> cells_of(std::string_view page, std::size_t header) {
  std::vector<std::size_t> cells;
  if (page.size() < header + kLeafHeader) {
    return cells;
  }
  const unsigned type = byte_at(page, header);
  const auto count = static_cast<std::size_t>(big_endian(page, header + 3, 2));
  auto content = static_cast<std::size_t>(big_endian(page, header + 5, 2));
  content = content == 0 ? kChunk : content;
  const std::size_t free_from = header + kLeafHeader + 2 * count;
  if ((type != kTableLeaf && type != kIndexLeaf) || count == 0 || free_from > content || content > page.size()) {
    return cells;
  }
  for (std::size_t i = 0; i < count; ++i) {
    cells.push_back(static_cast<std::size_t>(big_endian(page, header + kLeafHeader + 2 * i, 2)));
    if (cells.back() < content || cells.back() + 4 > page.size()) {
      return {};
    }
  }
  return cells;
}

}  // namespace

PageScan::PageScan(const std::filesystem::path& path) : file_(open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
  const off_t size = file_ < 0 ? -1 : lseek(file_, 0, SEEK_END);
  if (size < 0) {
    const int error = errno;
    if (file_ >= 0) {
      close(file_);
    }
    throw Error(path.string(), std::strerror(error), "check that this user may read it");
  }
  file_bytes_ = static_cast<std::uint64_t>(size);
  find_page_size();
}

PageScan::~PageScan() { close(file_); }

std::uint32_t PageScan::pages() const {
  return static_cast<std::uint32_t>((file_bytes_ + page_bytes_ - 1) / page_bytes_);
}

/// What the disk does not give, and what lies beyond the end of the file, is zero.
bool PageScan::read(std::uint64_t offset, std::size_t bytes, std::string& out) {
  out.assign(bytes, '\0');
  std::size_t have = 0;
  while (have < bytes) {
    const ssize_t got = pread(file_, out.data() + have, bytes - have, static_cast<off_t>(offset + have));
    if (got < 0 && errno == EINTR) {
      continue;
    }
    if (got <= 0) {
      return got == 0;
    }
    have += static_cast<std::size_t>(got);
  }
  return true;
}

/// The header may be damaged, so the pages are asked: the size under which most of them are sound leaves.
void PageScan::find_page_size() {
  std::array<std::uint64_t, kPageSizes.size()> votes{};
  std::string chunk;
  const std::uint64_t chunks = std::min((file_bytes_ + kChunk - 1) / kChunk, kChunksForPageSize);
  for (std::uint64_t c = 0; c < chunks; ++c) {
    read(c * kChunk, kChunk, chunk);
    for (std::size_t s = 0; s < kPageSizes.size(); ++s) {
      for (std::size_t at = 0; at < kChunk; at += kPageSizes[s]) {
        const std::size_t header = c == 0 && at == 0 ? kFileHeader : 0;
        votes[s] += cells_of(std::string_view(chunk).substr(at, kPageSizes[s]), header).empty() ? 0U : 1U;
      }
    }
  }
  page_bytes_ = kPageSizes[static_cast<std::size_t>(std::max_element(votes.begin(), votes.end()) - votes.begin())];
}

void PageScan::records(const Yield& yield) {
  unreadable_ = 0;
  for (const bool live : {true, false}) {
    record_.live = live;
    for (page_number_ = 1; page_number_ <= pages(); ++page_number_) {
      if (!read(std::uint64_t{page_number_ - 1} * page_bytes_, page_bytes_, page_) && live) {
        ++unreadable_;
      }
      (live ? scan_listed(yield) : scan_bytes(yield));
    }
  }
}

void PageScan::scan_listed(const Yield& yield) {
  const std::size_t header = page_number_ == 1 ? kFileHeader : 0;
  for (const std::size_t offset : cells_of(page_, header)) {
    if (cell_at(offset, byte_at(page_, header) == kTableLeaf)) {
      yield(record_);
    }
  }
}

void PageScan::scan_bytes(const Yield& yield) {
  const std::size_t header = page_number_ == 1 ? kFileHeader : 0;
  std::vector<std::size_t> listed = cells_of(page_, header);
  if (byte_at(page_, header) != kTableLeaf) {
    listed.clear();
  }
  std::sort(listed.begin(), listed.end());
  for (std::size_t offset = header; offset < page_.size(); ++offset) {
    if (!std::binary_search(listed.begin(), listed.end(), offset) && cell_at(offset, true)) {
      yield(record_);
    }
  }
}

/// Reads the record of the cell at this place into record_.
bool PageScan::cell_at(std::size_t offset, bool table) {
  const std::string_view page = page_;
  std::size_t at = offset;
  std::uint64_t total = 0;
  std::uint64_t rowid = 0;
  if (!take_varint(page, at, total) || total < 2 || total > kMostPayload || (table && !take_varint(page, at, rowid))) {
    return false;
  }
  const std::size_t local = local_bytes(total, page_.size(), table);
  const bool spilled = local < total;
  if (at + local + (spilled ? kLinkBytes : 0) > page.size()) {
    return false;
  }
  if (!take_types(page.substr(at, local), total, table && !record_.live, types_)) {
    return false;
  }
  const auto link = spilled ? static_cast<std::uint32_t>(big_endian(page, at + local, kLinkBytes)) : 0U;
  spill_ = {static_cast<std::size_t>(total), page.substr(at, local), link};
  if (!spilled) {
    record_.payload = spill_.local;
  } else {
    gather(std::numeric_limits<std::size_t>::max(), payload_);
    record_.payload = payload_;
  }
  record_.table = table;
  record_.rowid = static_cast<std::int64_t>(rowid);
  record_.values.clear();
  std::size_t header_at = 0;
  std::uint64_t value_at = 0;
  take_varint(record_.payload, header_at, value_at);
  for (const std::uint64_t type : types_) {
    const auto bytes = static_cast<std::size_t>(serial_bytes(type));
    record_.values.push_back(value_of(type, record_.payload.substr(static_cast<std::size_t>(value_at), bytes)));
    value_at += bytes;
  }
  return true;
}

/// Puts a payload together from its overflow pages. Pointer number `wrong_link` is not believed: the page after the one
/// it stands in is read instead, as it is where a pointer leads out of the file. What cannot be had is zero. False when
/// the chain does not have that link.
bool PageScan::gather(std::size_t wrong_link, std::string& out) {
  out.assign(spill_.local);
  std::uint32_t before = page_number_;
  std::uint32_t next = spill_.first;
  std::size_t link = 0;
  for (; out.size() < spill_.total; ++link) {
    const bool lost = link == wrong_link || next < 2 || next > pages();
    next = lost ? before + 1 : next;
    if (next > pages() || !read(std::uint64_t{next - 1} * page_bytes_, page_bytes_, overflow_)) {
      ++unreadable_;
      out.resize(spill_.total);
      break;
    }
    before = next;
    next = static_cast<std::uint32_t>(big_endian(overflow_, 0, kLinkBytes));
    out.append(overflow_, kLinkBytes, std::min<std::size_t>(page_bytes_ - kLinkBytes, spill_.total - out.size()));
  }
  return wrong_link < link;
}

std::optional<std::string> PageScan::other_payload(std::size_t way) {
  std::string out;
  const bool possible = spill_.local.size() < spill_.total && way < kMostWays && gather(way, out);
  return possible ? std::optional(std::move(out)) : std::nullopt;
}

}  // namespace tacho::store
