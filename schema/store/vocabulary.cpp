#include "schema/store/vocabulary.hpp"

#include "schema/docs.hpp"
#include "schema/store/checksum.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

constexpr std::array<std::string_view, 5> kRegisterTypes{"none", "u16", "i16", "i32", "f32"};

struct SentinelName {
  std::string_view name;
  std::string_view meaning;
};
constexpr std::array<SentinelName, 4> kSentinels{{{"none", "every value is a value"},
                                                  {"minus_one", "-1 = not supplied"},
                                                  {"negative_zero", "-0.0 = not supplied"},
                                                  {"any_zero", "0 = not supplied"}}};

std::string_view code_list_name(const Field& field) {
  for (const CodeList& list : kCodeLists) {
    if (list.codes.data() == field.codes.data()) {
      return list.name;
    }
  }
  return {};
}

void write_fields(Connection& connection) {
  Statement insert(connection, insert_sql("field"));
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    const Field& f = kFields[i];
    insert.run(i, f.name, kind_name(f.kind), f.unit, f.json.key, f.json.scale, f.json.former_key, f.reg.address,
               kRegisterTypes[static_cast<std::size_t>(f.reg.type)], f.reg.scale, f.reg.discrete, f.condition,
               code_list_name(f), kSentinels[static_cast<std::size_t>(f.sentinel)].name, f.retired, f.meaning);
  }
}

/// One list of this schema: `name(i)` for i in 0 .. count - 1.
template <class Name>
void write_list(Statement& insert, std::string_view list, std::size_t count, Name name) {
  for (std::size_t i = 0; i < count; ++i) {
    insert.run(list, i, name(i), std::string_view());
  }
}

}  // namespace

std::optional<Cause> parse_cause(std::string_view name) {
  for (std::size_t i = 0; i < kCauseCount; ++i) {
    if (cause_name(static_cast<Cause>(i)) == name) {
      return static_cast<Cause>(i);
    }
  }
  return std::nullopt;
}

std::optional<EventKind> parse_event_kind(std::string_view name) {
  for (std::size_t i = 0; i < kEventKindCount; ++i) {
    if (event_kind_name(static_cast<EventKind>(i)) == name) {
      return static_cast<EventKind>(i);
    }
  }
  return std::nullopt;
}

void write_vocabulary(Connection& connection) {
  write_fields(connection);
  Statement insert(connection, insert_sql("code"));
  for (const CodeList& list : kCodeLists) {
    for (const Code& code : list.codes) {
      insert.run(list.name, code.value, code.name, code.meaning);
    }
  }
  write_list(insert, "source", kSourceCount, [](std::size_t i) { return source_name(static_cast<Source>(i)); });
  write_list(insert, "event", kEventKindCount,
             [](std::size_t i) { return event_kind_name(static_cast<EventKind>(i)); });
  write_list(insert, "state", static_cast<std::size_t>(State::present) + 1,
             [](std::size_t i) { return state_name(static_cast<State>(i)); });
  write_list(insert, "word_order", static_cast<std::size_t>(WordOrder::dcba) + 1,
             [](std::size_t i) { return word_order_name(static_cast<WordOrder>(i)); });
  write_list(insert, "kind", static_cast<std::size_t>(Kind::points) + 1,
             [](std::size_t i) { return kind_name(static_cast<Kind>(i)); });
  write_list(insert, "register_type", kRegisterTypes.size(), [](std::size_t i) { return kRegisterTypes[i]; });
  for (std::size_t i = 0; i < kSentinels.size(); ++i) {
    insert.run("sentinel", i, kSentinels[i].name, kSentinels[i].meaning);
  }
  for (std::size_t i = 0; i < kCauseCount; ++i) {
    insert.run("cause", i, cause_name(static_cast<Cause>(i)), cause_meaning(static_cast<Cause>(i)));
  }
}

Vocabulary read_vocabulary(Connection& connection) {
  Vocabulary vocabulary;
  Statement sources(connection, "SELECT value, name FROM code WHERE list = 'source'");
  while (sources.step()) {
    const std::int64_t value = sources.integer(0);
    Source source{};
    if (value >= 0 && value < 256 && parse_source(sources.bytes(1), source)) {
      vocabulary.source[static_cast<std::size_t>(value)] = source;
    }
  }
  Statement fields(connection, "SELECT id, name FROM field ORDER BY id");
  while (fields.step()) {
    const auto id = static_cast<std::size_t>(fields.integer(0));
    if (id < kNoField) {
      vocabulary.field.resize(id + 1, kNoField);
      vocabulary.field[id] = find_field(fields.bytes(1));
    }
  }
  return vocabulary;
}

const Vocabulary& own_vocabulary() {
  static const Vocabulary own = [] {
    Vocabulary vocabulary;
    for (std::size_t i = 0; i < kSourceCount; ++i) {
      vocabulary.source[i] = static_cast<Source>(i);
    }
    for (std::size_t i = 0; i < kFieldCount; ++i) {
      vocabulary.field.push_back(static_cast<FieldIndex>(i));
    }
    return vocabulary;
  }();
  return own;
}

std::int64_t own_names() {
  static const std::int64_t own = [] {
    Checksum names;
    for (const Field& field : kFields) {
      names.add(field.name);
    }
    for (std::size_t i = 0; i < kSourceCount; ++i) {
      names.add(source_name(static_cast<Source>(i)));
    }
    for (std::size_t i = 0; i < kCauseCount; ++i) {
      names.add(cause_name(static_cast<Cause>(i)));
    }
    for (std::size_t i = 0; i <= static_cast<std::size_t>(WordOrder::dcba); ++i) {
      names.add(word_order_name(static_cast<WordOrder>(i)));
    }
    return names.value();
  }();
  return own;
}

std::string pack_fields(const FieldSet& fields) {
  std::string bits((kFieldCount + 7) / 8, '\0');
  for (std::size_t i = 0; i < kFieldCount; ++i) {
    if (fields[i]) {
      bits[i / 8] = static_cast<char>(static_cast<unsigned char>(bits[i / 8]) | 1U << (i % 8));
    }
  }
  return bits;
}

FieldSet unpack_fields(std::string_view bits, const Vocabulary& vocabulary) {
  FieldSet fields;
  for (std::size_t i = 0; i < bits.size() * 8 && i < vocabulary.field.size(); ++i) {
    const bool on = (static_cast<unsigned>(static_cast<unsigned char>(bits[i / 8])) >> (i % 8) & 1U) != 0;
    if (on && vocabulary.field[i] != kNoField) {
      fields.set(vocabulary.field[i]);
    }
  }
  return fields;
}

}  // namespace tacho::store
