#pragma once
// The shapes of a block and the columns they share: leaves of the same name belong to the same column, whatever shape
// they stand in. Writer and reader number the columns by adding the same shapes in the same order, so no names are
// stored beside the shapes.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "schema/sample.hpp"
#include "schema/store/block/column.hpp"
#include "schema/store/block/json_text.hpp"

namespace tacho::store {

inline constexpr std::size_t kMaxShapes = 200;
inline constexpr std::size_t kMaxLeafColumns = 16384;

struct Shape {
  std::string text;
  std::vector<std::string> pieces;     ///< before, between and after the leaves
  std::vector<std::uint32_t> columns;  ///< column of each leaf, each column at most once
  std::vector<JsonObject> objects;     ///< JSON only
};

struct LeafColumn {
  std::string path;
  std::uint32_t occurrence = 0;  ///< which of several leaves of the same path in one answer, from 0
  LeafType type = LeafType::json;
  std::uint32_t shapes = 0;  ///< how many shapes have it
  std::uint32_t first = 0;   ///< images: addresses in it
  std::uint32_t last = 0;
};

class ShapeTable {
 public:
  explicit ShapeTable(Source source = Source::status) : source_(source) {}

  /// Takes an answer apart. False: it has no shape (it is no JSON object, or no register image).
  [[nodiscard]] bool split(std::string_view body, std::string& shape, std::vector<std::string_view>& leaves) const;

  /// False, and nothing is changed: no shape, or too many of them.
  [[nodiscard]] bool add(std::string_view shape);

  [[nodiscard]] const std::vector<Shape>& shapes() const { return shapes_; }
  [[nodiscard]] const std::vector<LeafColumn>& columns() const { return columns_; }
  /// Column of the first leaf of that path.
  [[nodiscard]] std::optional<std::uint32_t> find(const std::string& path) const;
  [[nodiscard]] bool has_object(const std::string& path) const { return objects_.count(path) > 0; }
  /// Some answer says one thing twice, in a way that makes columns lose which came first: a key with an object and
  /// with something else, or a register in two ranges.
  [[nodiscard]] bool ambiguous() const { return ambiguous_; }

 private:
  Source source_;
  std::vector<Shape> shapes_;
  std::vector<LeafColumn> columns_;
  std::unordered_map<std::string, std::vector<std::uint32_t>> by_path_;  ///< element i: occurrence i
  std::unordered_set<std::string> objects_;                              ///< paths of all objects
  bool ambiguous_ = false;

  struct Named {
    std::string path;
    LeafType type;
    std::uint32_t first = 0;
    std::uint32_t last = 0;
  };
  bool name(Shape& shape, std::vector<Named>& names) const;
};

}  // namespace tacho::store
