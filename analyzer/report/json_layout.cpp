#include "analyzer/report/json_layout.hpp"

namespace tacho::report {
namespace {

using Json = nlohmann::ordered_json;
constexpr std::size_t kLine = 120;

std::string flat(const Json& value) { return value.dump(-1, ' ', false, Json::error_handler_t::replace); }

/// True when `value` certainly is longer than a line, found without printing all of it.
bool surely_long(const Json& value) {
  if (value.is_string()) {
    return false;
  }
  std::size_t room = kLine;
  for (const Json& item : value) {
    const std::size_t least = item.is_structured() ? 2 + 2 * item.size() : 1;
    if (least + 1 > room || (item.is_structured() && surely_long(item))) {
      return true;
    }
    room -= least + 1;
  }
  return false;
}

bool scalars_only(const Json& value) {
  for (const Json& item : value) {
    if (item.is_structured() || item.is_string()) {
      return false;
    }
  }
  return value.is_array();
}

class Printer {
 public:
  std::string out;

  void print(const Json& value, std::size_t depth, std::size_t used) {
    if (!value.is_structured() || value.empty()) {
      out += flat(value);
      return;
    }
    if (!surely_long(value)) {
      const std::string line = flat(value);
      if (used + line.size() <= kLine) {
        out += line;
        return;
      }
    }
    if (scalars_only(value)) {
      fill(value, depth);
    } else {
      members(value, depth);
    }
  }

 private:
  void new_line(std::size_t depth) {
    out += '\n';
    out.append(depth, ' ');
  }

  void members(const Json& value, std::size_t depth) {
    out += value.is_object() ? '{' : '[';
    bool first = true;
    for (const auto& [key, item] : value.items()) {
      if (!first) {
        out += ',';
      }
      first = false;
      new_line(depth + 1);
      std::size_t used = depth + 2;
      if (value.is_object()) {
        const std::string name = flat(Json(key)) + ": ";
        out += name;
        used += name.size();
      }
      print(item, depth + 1, used);
    }
    new_line(depth);
    out += value.is_object() ? '}' : ']';
  }

  void fill(const Json& value, std::size_t depth) {
    out += '[';
    new_line(depth + 1);
    std::size_t used = depth + 1;
    for (std::size_t i = 0; i < value.size(); ++i) {
      const std::string item = flat(value[i]) + (i + 1 < value.size() ? "," : "");
      if (used + item.size() > kLine) {
        new_line(depth + 1);
        used = depth + 1;
      }
      out += item;
      used += item.size();
    }
    new_line(depth);
    out += ']';
  }
};

}  // namespace

std::string laid_out(const Json& document) {
  Printer printer;
  printer.print(document, 0, 0);
  printer.out += '\n';
  return std::move(printer.out);
}

}  // namespace tacho::report
