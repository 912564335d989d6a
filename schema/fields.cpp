#include "schema/fields.hpp"

#include <string>
#include <vector>

#include "schema/text.hpp"

namespace tacho {

namespace {

consteval bool names_are_unique() {
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    for (std::size_t j = i + 1; j < kFieldCount; ++j) {
      if (kFields[i].name == kFields[j].name) {
        return false;
      }
    }
  }
  return true;
}

consteval bool json_keys_are_unique() {
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    for (std::size_t j = i + 1; j < kFieldCount; ++j) {
      if (!kFields[i].json.key.empty() && kFields[i].json.key == kFields[j].json.key) {
        return false;
      }
    }
  }
  return true;
}

consteval bool registers_do_not_overlap() {
  std::array<bool, 512> words{};
  std::array<bool, 512> bits{};
  for (const Field& f : kFields) {
    for (std::uint16_t k = 0; f.reg.present() && k < f.reg.words(); ++k) {
      bool& used = (f.reg.discrete ? bits : words)[static_cast<std::size_t>(f.reg.address + k)];
      if (used) {
        return false;
      }
      used = true;
    }
  }
  return true;
}

consteval bool conditions_are_flags() {
  for (const Field& f : kFields) {
    const FieldIndex c = find_field(f.condition);
    if (!f.condition.empty() && (c == kNoField || kFields[c].kind != Kind::flag)) {
      return false;
    }
  }
  return true;
}

consteval bool codes_have_lists() {
  for (const Field& f : kFields) {
    if ((f.kind == Kind::code) != !f.codes.empty()) {
      return false;
    }
  }
  return true;
}

consteval bool meanings_are_clauses() {
  for (const Field& f : kFields) {
    if (f.meaning.empty() || f.meaning.back() == '.') {
      return false;
    }
  }
  return true;
}

consteval bool every_field_has_a_source() {
  for (const Field& f : kFields) {
    if (f.json.key.empty() && !f.reg.present()) {
      return false;
    }
  }
  return true;
}

static_assert(names_are_unique());
static_assert(json_keys_are_unique());
static_assert(registers_do_not_overlap());
static_assert(conditions_are_flags());
static_assert(codes_have_lists());
static_assert(meanings_are_clauses());
static_assert(every_field_has_a_source());

}  // namespace

std::string_view code_name(const Field& field, std::int64_t code) {
  for (const Code& c : field.codes) {
    if (c.value == code) {
      return c.name;
    }
  }
  return {};
}

std::string_view nearest_field(std::string_view name) {
  std::vector<std::string> names;
  names.reserve(kFieldCount);
  for (const Field& f : kFields) {
    names.emplace_back(f.name);
  }
  const FieldIndex found = find_field(nearest(name, names));
  return found == kNoField ? std::string_view{} : kFields[found].name;
}

}  // namespace tacho
