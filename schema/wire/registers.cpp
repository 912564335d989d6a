#include "schema/wire/registers.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <bitset>
#include <cassert>
#include <cmath>
#include <optional>

#include "schema/wire/validity.hpp"

namespace tacho::wire {

namespace {

// Documented addresses fit well below this; anything beyond is kept in raw only.
constexpr std::size_t kAddresses = 1024;
constexpr std::uint32_t kLastAddress = 0xFFFF;
/// Ends of ranges are rounded up to this when the gap rule allows it, so that the default requests are the very ones
/// the vendor's own tool sends to every robot: input registers 1-100, discrete inputs 1-80.
constexpr std::uint32_t kRoundedEnd = 10;

static_assert(std::all_of(kFields.begin(), kFields.end(),
                          [](const Field& f) { return std::size_t{f.reg.address} + f.reg.words() <= kAddresses; }));
static_assert(std::all_of(kFields.begin(), kFields.end(),
                          [](const Field& f) { return f.reg.scale == 1.0 || f.kind == Kind::real; }));
static_assert(std::all_of(kFields.begin(), kFields.end(), [](const Field& f) {
  return !f.reg.present() || f.kind == Kind::real || f.kind == Kind::integer || f.kind == Kind::flag ||
         f.kind == Kind::code;
}));

/// Every register of an image by address.
struct Image {
  std::array<std::uint16_t, kAddresses> value{};  // bits as 0 / 1
  std::bitset<kAddresses> known;

  void put(std::uint32_t address, std::uint16_t v) {
    if (address < kAddresses) {
      value[address] = v;
      known.set(address);
    }
  }
  [[nodiscard]] bool has(RegisterSource reg) const {
    return known.test(reg.address) && known.test(reg.address + reg.words() - 1u);
  }
};

std::uint16_t word_at(std::string_view bytes, std::size_t offset) {
  return static_cast<std::uint16_t>(static_cast<unsigned char>(bytes[offset]) << 8 |
                                    static_cast<unsigned char>(bytes[offset + 1]));
}

void put_word(std::string& out, std::uint16_t word) {
  out.push_back(static_cast<char>(word >> 8));
  out.push_back(static_cast<char>(word & 0xFF));
}

void put_range(std::string& out, Range range) {
  put_word(out, range.first);
  put_word(out, range.count);
}

/// Empty when the bytes are no image: nothing in it, a range cut short, or an address outside 1-65535.
std::optional<Image> parse_image(std::string_view bytes, bool discrete) {
  if (bytes.empty()) {
    return std::nullopt;
  }
  Image image;
  while (!bytes.empty()) {
    if (bytes.size() < 4) {
      return std::nullopt;
    }
    const std::uint32_t first = word_at(bytes, 0);
    const std::uint32_t count = word_at(bytes, 2);
    const std::size_t payload = discrete ? (count + 7) / 8 : std::size_t{2} * count;
    if (first == 0 || count == 0 || first + count - 1 > kLastAddress || bytes.size() - 4 < payload) {
      return std::nullopt;
    }
    bytes.remove_prefix(4);
    for (std::uint32_t i = 0; i < count; ++i) {
      const std::uint16_t value =
          discrete ? static_cast<std::uint16_t>(static_cast<unsigned char>(bytes[i / 8]) >> (i % 8) & 1)
                   : word_at(bytes, std::size_t{2} * i);
      image.put(first + i, value);
    }
    bytes.remove_prefix(payload);
  }
  return image;
}

void start_sample(Sample& out, bool decodable) {
  const AnswerMeta meta = out.meta;
  out.clear();
  out.meta = meta;
  out.decodable = decodable;
}

double number_at(const Image& image, RegisterSource reg, WordOrder order) {
  const std::uint16_t first = image.value[reg.address];
  switch (reg.type) {
    case RegisterType::i16:
      return static_cast<std::int16_t>(first);
    case RegisterType::i32:
      return static_cast<std::int32_t>(join_words(first, image.value[reg.address + 1u], order));
    case RegisterType::f32:
      return static_cast<double>(std::bit_cast<float>(join_words(first, image.value[reg.address + 1u], order)));
    case RegisterType::u16:
    case RegisterType::none:
      break;
  }
  return first;
}

Cell decode_cell(const Field& field, double value) {
  Cell cell;
  if (!std::isfinite(value)) {
    cell.state = State::wrong_type;
    return cell;
  }
  cell.state = is_sentinel(field.sentinel, value) ? State::not_supplied : State::present;
  if (field.kind == Kind::real) {
    cell.real = without_minus_zero(field.sentinel, value * field.reg.scale);
  } else {
    cell.integer = static_cast<std::int64_t>(value);
  }
  return cell;
}

bool holds(FieldIndex flag, const Gates& gates) { return gates.known.test(flag) && gates.on.test(flag); }

struct Span {
  std::uint32_t first;
  std::uint32_t end;  // exclusive
};

std::vector<Span> documented_spans(bool discrete) {
  std::vector<Span> spans;
  for (const Field& field : kFields) {
    if (field.reg.present() && field.reg.discrete == discrete) {
      spans.push_back({field.reg.address, std::uint32_t{field.reg.address} + field.reg.words()});
    }
  }
  std::sort(spans.begin(), spans.end(), [](const Span& a, const Span& b) { return a.first < b.first; });
  return spans;
}

/// One order-dependent value of the image: is it inside physical bounds? Empty when it cannot tell: not read, or zero.
std::optional<bool> plausible(const Field& field, const Image& image, WordOrder order) {
  if (field.reg.type != RegisterType::f32 || field.reg.discrete || !image.has(field.reg)) {
    return std::nullopt;
  }
  const double value = number_at(image, field.reg, order);
  if (value == 0.0) {
    return std::nullopt;
  }
  // Read in the wrong order, a round value becomes a denormal near zero.
  constexpr double kTiny = 1e-6;
  const bool real = std::isfinite(value) && std::abs(value) > kTiny;
  if (field.unit == "degC") {
    return real && value > -40.0 && value < 120.0;
  }
  if (field.unit == "V") {
    return real && value > 5.0 && value < 120.0;
  }
  if (field.unit == "A") {
    return real && std::abs(value) < 1000.0;
  }
  constexpr double kHour = 3600.0;
  if (field.unit == "s" && field.reg.scale == kHour) {
    return real && value > 0.0 && value < 2e6;
  }
  return std::nullopt;
}

}  // namespace

std::string to_text(std::span<const Range> ranges) {
  std::string text;
  for (const Range& range : ranges) {
    text += fmt::format("{}{}-{}", text.empty() ? "" : ",", range.first, range.first + range.count - 1);
  }
  return text;
}

void append_words(std::string& image, Range range, std::span<const std::uint16_t> words) {
  assert(words.size() == range.count);
  put_range(image, range);
  for (const std::uint16_t word : words) {
    put_word(image, word);
  }
}

void append_bits(std::string& image, Range range, std::span<const std::uint8_t> bits) {
  assert(bits.size() == range.count);
  put_range(image, range);
  for (std::size_t i = 0; i < bits.size(); i += 8) {
    unsigned byte = 0;
    for (std::size_t k = 0; k < 8 && i + k < bits.size(); ++k) {
      byte |= (bits[i + k] != 0 ? 1u : 0u) << k;
    }
    image.push_back(static_cast<char>(byte));
  }
}

void append_range(std::string& image, Range range, std::string_view payload) {
  put_range(image, range);
  image += payload;
}

void decode_registers(std::string_view image, WordOrder order, const Gates& gates, const FieldSet& wanted,
                      Sample& out) {
  const std::optional<Image> parsed = parse_image(image, false);
  start_sample(out, parsed.has_value());
  if (!parsed) {
    return;
  }
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    const Field& field = kFields[i];
    if (!wanted.test(i) || !field.reg.present() || field.reg.discrete || !parsed->has(field.reg)) {
      continue;
    }
    Cell& cell = out.cells[i];
    cell = decode_cell(field, number_at(*parsed, field.reg, order));
    if (cell.state != State::wrong_type && kConditionOf[i] != kNoField && !holds(kConditionOf[i], gates)) {
      cell.state = State::not_meaningful;
    }
  }
}

void decode_inputs(std::string_view image, const FieldSet& wanted, Gates& gates, Sample& out) {
  const std::optional<Image> parsed = parse_image(image, true);
  start_sample(out, parsed.has_value());
  if (!parsed) {
    return;
  }
  const FieldSet& flags = condition_flags();
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    const Field& field = kFields[i];
    if (!field.reg.discrete || !field.reg.present() || !parsed->has(field.reg)) {
      continue;
    }
    const bool on = parsed->value[field.reg.address] != 0;
    if (flags.test(i)) {
      gates.known.set(i);
      gates.on.set(i, on);
    }
    if (wanted.test(i)) {
      out.cells[i].state = State::present;
      out.cells[i].integer = on ? 1 : 0;
    }
  }
}

std::uint32_t join_words(std::uint16_t first, std::uint16_t second, WordOrder order) {
  const auto swap = [](std::uint16_t w) { return static_cast<std::uint16_t>(w << 8 | w >> 8); };
  if (order == WordOrder::badc || order == WordOrder::dcba) {
    first = swap(first);
    second = swap(second);
  }
  const bool high_first = order == WordOrder::abcd || order == WordOrder::badc;
  const std::uint32_t high = high_first ? first : second;
  const std::uint32_t low = high_first ? second : first;
  return high << 16 | low;
}

void split_words(std::uint32_t bits, WordOrder order, std::uint16_t& first, std::uint16_t& second) {
  // Joining and splitting are the same permutation of four bytes, each its own inverse.
  const std::uint32_t joined =
      join_words(static_cast<std::uint16_t>(bits >> 16), static_cast<std::uint16_t>(bits & 0xFFFFu), order);
  first = static_cast<std::uint16_t>(joined >> 16);
  second = static_cast<std::uint16_t>(joined & 0xFFFFu);
}

std::vector<Range> plan_ranges(bool discrete, std::uint16_t max_count, std::uint16_t max_gap) {
  assert(max_count >= 2);
  const std::uint32_t gap = discrete ? std::uint32_t{max_gap} * 16 : max_gap;
  std::vector<Span> merged;
  for (const Span& span : documented_spans(discrete)) {
    if (!merged.empty() && span.first <= merged.back().end + gap && span.end - merged.back().first <= max_count) {
      merged.back().end = std::max(merged.back().end, span.end);
    } else {
      merged.push_back(span);
    }
  }
  std::vector<Range> ranges;
  for (std::size_t i = 0; i < merged.size(); ++i) {
    const auto [first, end] = merged[i];
    const std::uint32_t last = end - 1;
    const std::uint32_t rounded = (last + kRoundedEnd - 1) / kRoundedEnd * kRoundedEnd;
    const std::uint32_t next = i + 1 < merged.size() ? merged[i + 1].first : kLastAddress;
    const bool fits = rounded - last <= gap && rounded - first + 1 <= max_count && rounded < next;
    ranges.push_back(
        {static_cast<std::uint16_t>(first), static_cast<std::uint16_t>((fits ? rounded : last) - first + 1)});
  }
  return ranges;
}

std::vector<Range> documented_runs(bool discrete) {
  constexpr std::uint16_t kProtocolMaximum = 125;
  return plan_ranges(discrete, kProtocolMaximum, 0);
}

double plausibility(std::string_view image, WordOrder order) {
  const std::optional<Image> parsed = parse_image(image, false);
  if (!parsed) {
    return 0.0;
  }
  int told = 0;
  int good = 0;
  for (const Field& field : kFields) {
    if (const std::optional<bool> verdict = plausible(field, *parsed, order)) {
      ++told;
      good += *verdict ? 1 : 0;
    }
  }
  return told == 0 ? 0.0 : static_cast<double>(good) / told;
}

}  // namespace tacho::wire
