#include "schema/store/block/shape_table.hpp"

#include <utility>

#include "schema/store/block/image_text.hpp"

namespace tacho::store {

namespace {

bool is_image(Source source) { return source == Source::registers || source == Source::inputs; }

LeafType type_of(char letter) {
  switch (letter) {
    case 'b':
      return LeafType::inputs;
    case 'f':
      return LeafType::real;
    case 'i':
      return LeafType::dword;
    default:
      return LeafType::word;
  }
}

std::vector<std::string> cut_at_holes(std::string_view shape) {
  std::vector<std::string> pieces;
  std::size_t from = 0;
  for (std::size_t hole = shape.find(kHole); hole != std::string_view::npos; hole = shape.find(kHole, from)) {
    pieces.emplace_back(shape.substr(from, hole - from));
    from = hole + 1;
  }
  pieces.emplace_back(shape.substr(from));
  return pieces;
}

}  // namespace

bool ShapeTable::split(std::string_view body, std::string& shape, std::vector<std::string_view>& leaves) const {
  return is_image(source_) ? split_image(body, source_ == Source::inputs, shape, leaves)
                           : split_json(body, false, shape, leaves);
}

bool ShapeTable::name(Shape& shape, std::vector<Named>& names) const {
  if (is_image(source_)) {
    std::vector<ImageHole> holes;
    if (!name_registers(shape.text, source_ == Source::inputs, holes)) {
      return false;
    }
    for (ImageHole& hole : holes) {
      shape.pieces.push_back(std::move(hole.before));
      names.push_back({std::move(hole.path), type_of(hole.letter), hole.first, hole.last});
    }
    shape.pieces.emplace_back();
    return true;
  }
  std::vector<JsonHole> holes;
  if (!name_holes(shape.text, holes, shape.objects)) {
    return false;
  }
  for (JsonHole& hole : holes) {
    names.push_back({std::move(hole.path), LeafType::json, 0, 0});
  }
  shape.pieces = cut_at_holes(shape.text);
  return shape.pieces.size() == names.size() + 1;
}

bool ShapeTable::add(std::string_view text) {
  Shape shape;
  shape.text = text;
  std::vector<Named> names;
  if (shapes_.size() >= kMaxShapes || !name(shape, names) || columns_.size() + names.size() > kMaxLeafColumns) {
    return false;
  }
  std::unordered_map<std::string, std::uint32_t> seen;  // in this shape
  std::uint32_t last = 0;
  for (Named& named : names) {
    ambiguous_ = ambiguous_ || (is_image(source_) && named.first <= last);
    last = named.last;
    std::vector<std::uint32_t>& known = by_path_[named.path];
    const std::uint32_t occurrence = seen[named.path]++;
    if (occurrence == known.size()) {
      known.push_back(static_cast<std::uint32_t>(columns_.size()));
      columns_.push_back({std::move(named.path), occurrence, named.type, 0, named.first, named.last});
    }
    shape.columns.push_back(known[occurrence]);
    ++columns_[known[occurrence]].shapes;
  }
  for (const JsonObject& object : shape.objects) {
    objects_.insert(object.path);
    ambiguous_ = ambiguous_ || seen.count(object.path) > 0;
  }
  shapes_.push_back(std::move(shape));
  return true;
}

std::optional<std::uint32_t> ShapeTable::find(const std::string& path) const {
  const auto found = by_path_.find(path);
  return found == by_path_.end() ? std::nullopt : std::optional(found->second.front());
}

}  // namespace tacho::store
