#include "schema/sample.hpp"

#include <algorithm>
#include <cassert>
#include <functional>

namespace tacho {

namespace {
constexpr std::array<SourceInfo, kSourceCount> kSources{{
    {"status", Encoding::json, Protocol::status_port, true},
    {"io", Encoding::json, Protocol::status_port},
    {"registers", Encoding::registers, Protocol::modbus},
    {"inputs", Encoding::inputs, Protocol::modbus},
    {"pose", Encoding::json, Protocol::status_port},
    {"push", Encoding::json, Protocol::push_port, true},
    {"ring", Encoding::json, Protocol::status_port, true},
}};
constexpr std::array<std::string_view, kProtocolCount> kProtocolNames{"status port", "modbus", "push port"};
constexpr std::array<std::string_view, 6> kStateNames{"absent",       "null",       "not_meaningful",
                                                      "not_supplied", "wrong_type", "present"};
constexpr std::array<std::string_view, 4> kLevelNames{"fatal", "error", "warning", "notice"};
constexpr std::size_t kFirstSlots = 64;
}  // namespace

const SourceInfo& source_info(Source source) { return kSources[static_cast<std::size_t>(source)]; }

std::string_view source_name(Source source) { return source_info(source).name; }

std::vector<std::string> source_names() {
  std::vector<std::string> names;
  for (const SourceInfo& source : kSources) {
    names.emplace_back(source.name);
  }
  return names;
}

std::string_view protocol_name(Protocol protocol) { return kProtocolNames[static_cast<std::size_t>(protocol)]; }

const std::array<Source, kSourceCount>& all_sources() {
  static const auto all = [] {
    std::array<Source, kSourceCount> sources{};
    for (std::size_t i = 0; i < kSourceCount; ++i) {
      sources[i] = static_cast<Source>(i);
    }
    return sources;
  }();
  return all;
}

bool parse_source(std::string_view name, Source& out) {
  for (std::size_t i = 0; i < kSourceCount; ++i) {
    if (kSources[i].name == name) {
      out = static_cast<Source>(i);
      return true;
    }
  }
  return false;
}

std::string_view state_name(State state) { return kStateNames[static_cast<std::size_t>(state)]; }

std::string_view alarm_level_name(AlarmLevel level) { return kLevelNames[static_cast<std::size_t>(level)]; }

void TextPool::clear() {
  bytes_.clear();
  spans_.assign(1, Span{0, 0});
  if (slots_.empty()) {
    slots_.assign(kFirstSlots, 0);
  } else {
    std::fill(slots_.begin(), slots_.end(), 0u);
  }
}

std::string_view TextPool::at(std::uint32_t id) const {
  assert(id < spans_.size());
  return std::string_view(bytes_).substr(spans_[id].begin, spans_[id].length);
}

std::uint32_t TextPool::intern(std::string_view text) {
  if (text.empty()) {
    return 0;
  }
  if (spans_.size() * 2 > slots_.size()) {
    rehash(slots_.size() * 2);
  }
  const std::size_t mask = slots_.size() - 1;
  std::size_t slot = std::hash<std::string_view>{}(text)&mask;
  while (slots_[slot] != 0) {
    if (at(slots_[slot]) == text) {
      return slots_[slot];
    }
    slot = (slot + 1) & mask;
  }
  const auto id = static_cast<std::uint32_t>(spans_.size());
  spans_.push_back({static_cast<std::uint32_t>(bytes_.size()), static_cast<std::uint32_t>(text.size())});
  bytes_.append(text);
  slots_[slot] = id;
  return id;
}

void TextPool::rehash(std::size_t slots) {
  slots_.assign(slots, 0);
  for (std::uint32_t id = 1; id < spans_.size(); ++id) {
    std::size_t slot = std::hash<std::string_view>{}(at(id)) & (slots - 1);
    while (slots_[slot] != 0) {
      slot = (slot + 1) & (slots - 1);
    }
    slots_[slot] = id;
  }
}

void Sample::clear() {
  meta = {};
  cells.fill(Cell{});
  alarms.clear();
  alarms_incomplete.reset();
  points.clear();
  unknown_keys.clear();
  texts.clear();
  decodable = true;
}

FieldSet Sample::seen() const {
  FieldSet set;
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    set[i] = cells[i].state != State::absent;
  }
  return set;
}

FieldSet Sample::valued() const {
  FieldSet set;
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    set[i] = cells[i].has();
  }
  return set;
}

}  // namespace tacho
