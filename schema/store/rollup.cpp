#include "schema/store/rollup.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "schema/store/checked_rows.hpp"
#include "schema/store/coverage.hpp"
#include "schema/store/rows.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

constexpr Micros kMinuteUs = 60'000'000;

/// None of them has a condition, so registers need no inputs to tell what they mean.
constexpr auto kRolledUp = std::to_array<FieldIndex>({
    field("battery_level"),
    field("battery_temp"),
    field("voltage"),
    field("current"),
    field("charging"),
    field("vx"),
    field("w"),
    field("odo"),
    field("is_stop"),
    field("blocked"),
    field("slowed"),
    field("emergency"),
    field("confidence"),
    field("rssi"),
    field("controller_temp"),
    field("fatals"),
    field("errors"),
    field("reloc_status"),
});
static_assert(std::all_of(kRolledUp.begin(), kRolledUp.end(), [](FieldIndex f) {
  const Kind kind = kFields[f].kind;
  return kFields[f].condition.empty() && kind != Kind::text && kind != Kind::list && kind != Kind::structured;
}));

std::int64_t minute_of(Micros t_us) { return t_us / kMinuteUs - (t_us % kMinuteUs < 0 ? 1 : 0); }

/// Number of the field in the part; none when the part is older than the field.
std::optional<std::int64_t> number_of(const Vocabulary& vocabulary, FieldIndex f) {
  const auto found = std::find(vocabulary.field.begin(), vocabulary.field.end(), f);
  return found == vocabulary.field.end() ? std::nullopt : std::optional<std::int64_t>(found - vocabulary.field.begin());
}

}  // namespace

const FieldSet& rollup_fields() {
  static const FieldSet kSet = [] {
    FieldSet set;
    for (const FieldIndex f : kRolledUp) {
      set.set(f);
    }
    return set;
  }();
  return kSet;
}

FieldSet rollup_fields(Connection& connection, const Stream& stream) {
  FieldSet fields = rollup_fields();
  if (stream.source != Source::status) {
    const StreamCounts counts = read_coverage_rows(connection, read_vocabulary(connection));
    const auto status = counts.find({stream.session, stream.robot, Source::status});
    fields &= status == counts.end() ? fields : ~status->second.valued;
  }
  return fields;
}

void add_to(RollupRows& rows, const AnswerMeta& meta, const Sample& sample, const FieldSet& wanted) {
  const std::int64_t minute = minute_of(meta.t_mid_us());
  for (const FieldIndex f : kRolledUp) {
    const Cell& cell = sample.at(f);
    if (!wanted[f] || !cell.has()) {
      continue;
    }
    const double value = field_at(f).kind == Kind::real ? cell.real : static_cast<double>(cell.integer);
    if (!std::isfinite(value)) {
      continue;
    }
    const Rollup one{meta.robot, meta.source, minute, f, 1, value, value, value, value};
    const auto [row, fresh] = rows.try_emplace({minute, f}, one);
    if (!fresh) {
      row->second.add(one);
    }
  }
}

void RollupMaker::add(const Answer& answer) {
  (*decode_)(answer, stream_, wanted_, gates_, sample_);
  add_to(rows_, answer.meta, sample_, wanted_);
}

void Rollups::write(Connection& connection) const {
  if (rows.empty()) {
    return;
  }
  const Vocabulary vocabulary = read_vocabulary(connection);
  Statement known(connection,
                  select_sql("rollup") + " WHERE robot = ?1 AND source = ?2 AND minute = ?3 AND field = ?4");
  Statement replace(connection, insert_sql("rollup", "OR REPLACE"));
  const auto number_of_source = static_cast<std::int64_t>(source);
  for (const auto& [key, row] : rows) {
    const std::optional<std::int64_t> number = number_of(vocabulary, key.second);
    if (!number) {
      continue;
    }
    known.query(row.robot, number_of_source, row.minute, *number);
    std::optional<Rollup> sum = row;
    if (known.step()) {
      sum = read_rollup(known, vocabulary);
      if (sum) {
        sum->add(row);
      }
    }
    known.reset();
    if (sum) {
      store::write(replace, *sum, number_of_source, *number);
    }
  }
}

std::vector<Rollup> read_rollups(Connection& connection, const PartHead& head, RobotId robot,
                                 const std::function<void(const std::string&)>& report) {
  std::vector<Rollup> rows;
  read_checked(connection, "rollup", head.sealed_rows, report, [&](const Statement& row) {
    const std::optional<Rollup> one = read_rollup(row, head.vocabulary);
    if (one && one->robot == robot && one->field != kNoField) {
      rows.push_back(*one);
    }
    return one.has_value();
  });
  return rows;
}

}  // namespace tacho::store
