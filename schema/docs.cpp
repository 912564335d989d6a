#include "schema/docs.hpp"

#include <fmt/format.h>

namespace tacho {

namespace {

constexpr std::array<std::string_view, 9> kKindNames{"real", "integer",    "flag",   "code",  "text",
                                                     "list", "structured", "alarms", "points"};
constexpr std::array<std::string_view, 5> kTypeNames{"", "u16", "i16", "i32", "f32"};

std::string_view code_list_name(const Field& field) {
  for (const CodeList& list : kCodeLists) {
    if (list.codes.data() == field.codes.data()) {
      return list.name;
    }
  }
  return {};
}

std::string notes(const Field& field) {
  std::string out;
  if (!field.condition.empty()) {
    out += fmt::format("; only while `{}`", field.condition);
  }
  if (!field.codes.empty()) {
    out += fmt::format("; codes [{0}](#{0})", code_list_name(field));
  }
  constexpr std::array<std::string_view, 4> kSentinels{"", "; -1 = not supplied", "; -0.0 = not supplied",
                                                       "; 0 = not supplied"};
  out += kSentinels[static_cast<std::size_t>(field.sentinel)];
  return out;
}

}  // namespace

std::string_view kind_name(Kind kind) { return kKindNames[static_cast<std::size_t>(kind)]; }

std::string register_text(const Field& field) {
  const RegisterSource& r = field.reg;
  if (!r.present()) {
    return {};
  }
  if (r.discrete) {
    return fmt::format("input {}", r.address);
  }
  std::string out = fmt::format("{} {}", kTypeNames[static_cast<std::size_t>(r.type)], r.address);
  if (r.words() == 2) {
    out += fmt::format("-{}", r.address + 1);
  }
  return r.scale == 1.0 ? out : out + fmt::format(" x {}", r.scale);
}

std::string json_text(const Field& field) {
  std::string out(field.json.key);
  if (field.json.scale != 1.0) {
    out += fmt::format(" x {}", field.json.scale);
  }
  if (!field.json.former_key.empty()) {
    out += fmt::format(", formerly {}", field.json.former_key);
  }
  return out;
}

std::string fields_markdown() {
  std::string out =
      "# Fields\n\n"
      "Printed from the field table (`tacho-analyzer fields`); do not edit. Units are SI; `1` is a ratio. `list` and\n"
      "`structured` fields keep their JSON text; `alarms` and `points` are lists with an element format of their own\n"
      "(`schema/sample.hpp`). Register numbers are as documented, from 1: `u16`/`i16`/`i32`/`f32` are input registers "
      "[3x]\n"
      "(FC4), `input` are discrete inputs [1x] (FC2).\n\n"
      "| Field | Kind | Unit | 1100 / 1013 key | Register | Meaning |\n|---|---|---|---|---|---|\n";
  for (const Field& f : kFields) {
    out += fmt::format("| {} | {} | {} | {} | {} | {}{} |\n", f.name, kind_name(f.kind), f.unit, json_text(f),
                       register_text(f), f.meaning, notes(f));
  }
  out += "\n# Codes\n";
  for (const CodeList& list : kCodeLists) {
    out += fmt::format("\n## {}\n\n| Value | Name | Meaning |\n|---|---|---|\n", list.name);
    for (const Code& c : list.codes) {
      out += fmt::format("| {} | {} | {} |\n", c.value, c.name, c.meaning);
    }
  }
  return out;
}

}  // namespace tacho
