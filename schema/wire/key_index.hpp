#pragma once
// JSON keys of the field table -> fields, by hashing. Built once from kFields; nothing here names a key.

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "schema/fields.hpp"

namespace tacho::wire {

/// An object of the answer whose members are fields: 0 is the answer itself, others are flattened ("calib_status").
using NodeId = std::uint16_t;
inline constexpr NodeId kRootNode = 0;

/// What a key inside a node stands for: a field, or a flattened object.
struct KeyEntry {
  NodeId parent = kRootNode;
  std::string_view key;
  FieldIndex field = kNoField;
  bool former = false;      ///< spelling of older firmware, or place in a push
  NodeId node = kRootNode;  ///< the flattened object, when `field` is kNoField
};

class KeyIndex {
 public:
  KeyIndex();
  /// Null when no field stands at this key.
  [[nodiscard]] const KeyEntry* find(NodeId node, std::string_view key) const;
  /// "calib_status.foo": the key with the objects around it.
  [[nodiscard]] std::string path(NodeId node, std::string_view key) const;
  /// A field inside a flattened object, at any depth, and whether that is its former spelling.
  struct Inner {
    FieldIndex field;
    bool former;
  };
  [[nodiscard]] const std::vector<Inner>& below(NodeId node) const { return nodes_[node].fields; }

  static const KeyIndex& instance();

 private:
  struct Node {
    std::string path;
    std::vector<Inner> fields;
  };
  std::vector<Node> nodes_;
  std::vector<KeyEntry> entries_;
  std::vector<std::uint16_t> slots_;  // open addressing, 1 + index into entries_, 0 = free

  void add_path(std::string_view path, FieldIndex field, bool former);
  NodeId object(NodeId parent, std::string_view key);
  void add(const KeyEntry& entry);
};

}  // namespace tacho::wire
