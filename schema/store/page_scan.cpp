#include "schema/store/page_scan.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstring>

#include "schema/error.hpp"
#include "schema/store/hot_codec.hpp"
#include "schema/store/record_format.hpp"

namespace tacho::store {

namespace {

// The first is what parts are made with: it wins where a file is too short to tell.
constexpr std::array<std::uint32_t, 8> kPageSizes{1024, 4096, 512, 2048, 8192, 16384, 32768, 65536};
constexpr std::size_t kChunk = 65536;
constexpr std::uint64_t kChunksForPageSize = 1024;  // 64 MiB say it clearly enough
constexpr unsigned char kIndexLeaf = 0x0A;
/// A body is the longest value by far; longer lengths are not lengths.
constexpr std::uint64_t kMostPayload = kMaxBodyBytes + (std::size_t{1} << 20U);
/// More ways to read a damaged chain are not tried: each costs decoding a block.
constexpr std::size_t kMostWays = 256;

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
    gather(std::nullopt, payload_);
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

/// Puts a payload together from its overflow pages. What cannot be had is zero.
void PageScan::gather(std::optional<Mend> mend, std::string& out) {
  out.assign(spill_.local);
  std::uint32_t next = spill_.first;
  for (std::size_t link = 0; out.size() < spill_.total; ++link) {
    next = mend && mend->link == link ? mend->page : next;
    if (next < 2 || next > pages() || !read(std::uint64_t{next - 1} * page_bytes_, page_bytes_, overflow_)) {
      out.resize(spill_.total);
      return;
    }
    next = static_cast<std::uint32_t>(big_endian(overflow_, 0, kLinkBytes));
    out.append(overflow_, kLinkBytes, std::min<std::size_t>(page_bytes_ - kLinkBytes, spill_.total - out.size()));
  }
}

/// The page that this one leads to, if it is an overflow page.
std::uint32_t PageScan::link_of(std::uint32_t page) {
  read(std::uint64_t{page - 1} * page_bytes_, kLinkBytes, overflow_);
  return static_cast<std::uint32_t>(big_endian(overflow_, 0, kLinkBytes));
}

/// Pages of the chain that begins here and ends properly; 0 when it does not, or is longer than `most`.
std::size_t PageScan::chain_length(std::uint32_t page, std::size_t most) {
  for (std::size_t length = 1; length <= most && page >= 2 && page <= pages(); ++length) {
    page = link_of(page);
    if (page == 0) {
      return length;
    }
  }
  return 0;
}

void PageScan::find_loose_ends() {
  std::vector<bool> led_to(pages() + 1);
  const auto mark = [&](std::uint64_t page) {
    if (page <= pages()) {
      led_to[static_cast<std::size_t>(page)] = true;
    }
  };
  std::string page;
  for (std::uint32_t number = 1; number <= pages(); ++number) {
    mark(link_of(number));
    read(std::uint64_t{number - 1} * page_bytes_, page_bytes_, page);
    const std::size_t header = number == 1 ? kFileHeader : 0;
    const bool table = byte_at(page, header) == kTableLeaf;
    for (std::size_t at : cells_of(page, header)) {
      std::uint64_t total = 0;
      std::uint64_t rowid = 0;
      const bool sound = take_varint(page, at, total) && (!table || take_varint(page, at, rowid));
      const std::size_t local = sound ? local_bytes(total, page.size(), table) : 0;
      if (sound && local < total && at + local + kLinkBytes <= page.size()) {
        mark(big_endian(page, at + local, kLinkBytes));
      }
    }
  }
  loose_ends_.emplace();
  for (std::uint32_t number = 2; number <= pages(); ++number) {
    if (!led_to[number]) {
      loose_ends_->push_back(number);
    }
  }
}

void PageScan::find_ways() {
  ways_.clear();
  if (!loose_ends_) {
    find_loose_ends();
  }
  const std::size_t bytes = page_bytes_ - kLinkBytes;
  const std::size_t links = (spill_.total - spill_.local.size() + bytes - 1) / bytes;
  for (const std::uint32_t page : *loose_ends_) {
    const std::size_t length = chain_length(page, links);
    if (length > 0 && ways_.size() < kMostWays) {
      ways_.push_back({links - length, page});
    }
  }
}

std::optional<std::string> PageScan::other_payload(std::size_t way) {
  if (way == 0) {
    find_ways();
  }
  if (way >= ways_.size()) {
    return std::nullopt;
  }
  std::string out;
  gather(ways_[way], out);
  return out;
}

}  // namespace tacho::store
