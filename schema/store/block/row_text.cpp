#include "schema/store/block/row_text.hpp"

#include <algorithm>

#include "schema/store/hot_codec.hpp"

namespace tacho::store {

RowText::RowText(const ShapeTable& table, std::span<const ShapePart> parts, const Load& load)
    : recipes_(parts.size()), loaded_(table.columns().size()), next_(table.columns().size()) {
  std::vector<bool> asked(loaded_.size());
  for (std::size_t s = 0; s < parts.size(); ++s) {
    for (std::size_t leaf = parts[s].first; leaf < parts[s].last; ++leaf) {
      const std::uint32_t column = table.shapes()[s].columns[leaf];
      if (!asked[column]) {
        asked[column] = true;
        loaded_[column] = load(column);
      }
    }
  }
  for (std::size_t s = 0; s < parts.size(); ++s) {
    prepare(table, table.shapes()[s], parts[s], recipes_[s]);
  }
}

void RowText::prepare(const ShapeTable& table, const Shape& shape, ShapePart part, Recipe& recipe) {
  recipe.wanted = part.begin < part.end;
  // The first and the last piece of the part may be cut: what stands before it, what stands behind it.
  std::size_t at = 0;
  std::string text;
  const auto piece = [&](std::size_t index) {
    const std::string& whole = shape.pieces[index];
    const std::size_t from = std::clamp(part.begin, at, at + whole.size());
    const std::size_t to = std::clamp(part.end, from, at + whole.size());
    text.append(whole, from - at, to - from);
    at += whole.size() + 1;  // the hole
  };
  for (std::size_t leaf = 0; leaf < shape.columns.size(); ++leaf) {
    const std::uint32_t column = shape.columns[leaf];
    piece(leaf);
    const LoadedColumn* const loaded = loaded_[column];
    if (loaded != nullptr && loaded->form != ColumnForm::constant) {
      recipe.columns.push_back(column);
    }
    if (leaf < part.first || leaf >= part.last) {
      continue;
    }
    if (loaded == nullptr) {
      recipe.complete = false;
      missing_ = missing_.empty() ? table.columns()[column].path : missing_;
    } else if (loaded->form == ColumnForm::constant) {
      text += loaded->texts[0];
    } else {
      recipe.steps.push_back({text, column});
      text.clear();
    }
  }
  piece(shape.columns.size());
  recipe.tail = text;
}

bool RowText::append(std::size_t shape, std::string& out) {
  const Recipe& recipe = recipes_[shape];
  const bool known = recipe.wanted && recipe.complete;
  if (known) {
    for (auto step = recipe.steps.begin(); step != recipe.steps.end() && out.size() <= kMaxBodyBytes; ++step) {
      out += step->before;
      loaded_[step->column]->append(next_[step->column], out);
    }
    out += recipe.tail;
  }
  for (const std::uint32_t column : recipe.columns) {
    ++next_[column];  // also of a row that is too long: the next one has the next values
  }
  return known && out.size() <= kMaxBodyBytes;
}

}  // namespace tacho::store
