#include "schema/wire/key_index.hpp"

#include <cassert>

namespace tacho::wire {

namespace {

// Four times the entries: almost every lookup ends at its first slot.
constexpr std::size_t kSlots = 2048;

std::size_t slot_of(NodeId node, std::string_view key) {
  std::uint64_t hash = 0xCBF29CE484222325u + node;  // FNV-1a
  for (const char c : key) {
    hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001B3u;
  }
  return (hash ^ hash >> 32) % kSlots;
}

}  // namespace

KeyIndex::KeyIndex() : nodes_(1), slots_(kSlots, 0) {
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    const JsonSource& json = kFields[i].json;
    if (!json.key.empty()) {
      add_path(json.key, static_cast<FieldIndex>(i), false);
    }
    if (!json.former_key.empty()) {
      add_path(json.former_key, static_cast<FieldIndex>(i), true);
    }
    if (const std::string_view nested = push_object(json.key); !nested.empty()) {
      const NodeId node = object(kRootNode, nested);
      nodes_[node].fields.push_back({static_cast<FieldIndex>(i), true});
      add({node, json.key, static_cast<FieldIndex>(i), true, kRootNode});
    }
  }
}

const KeyIndex& KeyIndex::instance() {
  static const KeyIndex index;
  return index;
}

const KeyEntry* KeyIndex::find(NodeId node, std::string_view key) const {
  for (std::size_t slot = slot_of(node, key); slots_[slot] != 0; slot = (slot + 1) % kSlots) {
    const KeyEntry& entry = entries_[slots_[slot] - 1u];
    if (entry.parent == node && entry.key == key) {
      return &entry;
    }
  }
  return nullptr;
}

std::string KeyIndex::path(NodeId node, std::string_view key) const {
  std::string text = nodes_[node].path;
  text += node == kRootNode ? "" : ".";
  text += key;
  return text;
}

void KeyIndex::add_path(std::string_view path, FieldIndex field, bool former) {
  NodeId node = kRootNode;
  for (std::size_t dot = path.find('.'); dot != std::string_view::npos; dot = path.find('.')) {
    node = object(node, path.substr(0, dot));
    path.remove_prefix(dot + 1);
    nodes_[node].fields.push_back({field, former});
  }
  add({node, path, field, former, kRootNode});
}

NodeId KeyIndex::object(NodeId parent, std::string_view key) {
  if (const KeyEntry* const known = find(parent, key)) {
    assert(known->field == kNoField);  // a key is a field or an object around fields, not both
    return known->node;
  }
  const auto node = static_cast<NodeId>(nodes_.size());
  nodes_.push_back({path(parent, key), {}});
  add({parent, key, kNoField, false, node});
  return node;
}

void KeyIndex::add(const KeyEntry& entry) {
  assert(find(entry.parent, entry.key) == nullptr);
  entries_.push_back(entry);
  assert(entries_.size() * 2 < kSlots);
  std::size_t slot = slot_of(entry.parent, entry.key);
  while (slots_[slot] != 0) {
    slot = (slot + 1) % kSlots;
  }
  slots_[slot] = static_cast<std::uint16_t>(entries_.size());
}

}  // namespace tacho::wire
