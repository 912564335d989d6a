#pragma once
// Puts the text of rows together again, row by row, from the columns of a block.

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "schema/store/block/column.hpp"
#include "schema/store/block/shape_table.hpp"

namespace tacho::store {

/// A stretch of a shape: shape text [begin, end), its leaves [first, last).
struct ShapePart {
  std::size_t begin = 0;
  std::size_t end = 0;
  std::size_t first = 0;
  std::size_t last = 0;
};

class RowText {
 public:
  /// Null when the column cannot be read.
  using Load = std::function<const LoadedColumn*(std::uint32_t leaf_column)>;

  /// `parts`: element i belongs to shape i; an empty part (begin == end) means that its rows are not wanted. Columns
  /// are asked for once each and must outlive this.
  RowText(const ShapeTable& table, std::span<const ShapePart> parts, const Load& load);

  /// Rows in order, each once. Appends the text of the part; false when a column of it is missing or the text would be
  /// longer than any answer. `shape` counts from 0.
  bool append(std::size_t shape, std::string& out);
  [[nodiscard]] bool wanted(std::size_t shape) const { return recipes_[shape].wanted; }
  /// A column that could not be read; empty when all could.
  [[nodiscard]] const std::string& missing() const { return missing_; }

 private:
  struct Step {
    std::string before;  ///< with the constants that stand there
    std::uint32_t column = 0;
  };
  struct Recipe {
    bool wanted = false;
    bool complete = true;
    std::vector<Step> steps;
    std::string tail;
    std::vector<std::uint32_t> columns;  ///< that move on with a row of this shape
  };
  std::vector<Recipe> recipes_;
  std::vector<const LoadedColumn*> loaded_;
  std::vector<std::size_t> next_;
  std::string missing_;

  void prepare(const ShapeTable& table, const Shape& shape, ShapePart part, Recipe& recipe);
};

}  // namespace tacho::store
