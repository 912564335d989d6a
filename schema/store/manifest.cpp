#include "schema/store/manifest.hpp"

#include <optional>
#include <utility>

#include "schema/store/checked_rows.hpp"
#include "schema/store/checksum.hpp"
#include "schema/store/fnv.hpp"
#include "schema/store/schema_sql.hpp"

namespace tacho::store {

namespace {

constexpr Micros kHourUs = 3'600'000'000;

Micros hour_of(Micros t_us) { return (t_us - (t_us < 0 ? kHourUs - 1 : 0)) / kHourUs * kHourUs; }

std::int64_t checksum(const ManifestKey& key, const RowSum& sum) {
  const auto& [robot, source, hour_us] = key;
  return Checksum()
      .add(static_cast<std::int64_t>(robot))
      .add(static_cast<std::int64_t>(source))
      .add(hour_us)
      .add(static_cast<std::int64_t>(sum.rows))
      .add(static_cast<std::int64_t>(sum.hash))
      .value();
}

std::optional<std::pair<ManifestKey, RowSum>> read_row(const Statement& row) {
  const std::int64_t source = row.integer(1);
  if (source < 0 || source >= static_cast<std::int64_t>(kSourceCount)) {
    return std::nullopt;
  }
  const ManifestKey key{static_cast<RobotId>(row.integer(0)), static_cast<Source>(source), row.integer(2)};
  const RowSum sum{static_cast<std::uint64_t>(row.integer(3)), static_cast<std::uint64_t>(row.integer(4))};
  return checksum(key, sum) == row.integer(5) ? std::make_optional(std::make_pair(key, sum)) : std::nullopt;
}

}  // namespace

ManifestKey manifest_key(const AnswerMeta& meta) { return {meta.robot, meta.source, hour_of(meta.t_send_us)}; }

std::uint64_t row_hash(const Answer& answer) {
  return Fnv()
      .add(static_cast<std::uint64_t>(answer.meta.source), 1)
      .add(answer.meta.session, 4)
      .add(answer.meta.seq, 8)
      .add(static_cast<std::uint64_t>(answer.meta.t_send_us), 8)
      .add(static_cast<std::uint64_t>(answer.meta.t_recv_us), 8)
      .add(answer.header.size(), 4)
      .add(answer.header)
      .add(answer.body)
      .value();
}

void write_manifest(Connection& connection, const Manifest& manifest) {
  if (manifest.empty() || !connection.has_table("manifest")) {
    return;
  }
  Statement known(connection, select_sql("manifest") + " WHERE robot = ?1 AND source = ?2 AND hour_us = ?3");
  Statement replace(connection, insert_sql("manifest", "OR REPLACE"));
  for (const auto& [key, more] : manifest) {
    const auto& [robot, source, hour_us] = key;
    known.query(robot, static_cast<std::int64_t>(source), hour_us);
    RowSum sum = more;
    bool whole = true;
    if (known.step()) {
      const auto before = read_row(known);
      whole = before.has_value();
      if (before) {
        sum.add(before->second);
      }
    }
    known.reset();
    if (whole) {
      replace.run(robot, static_cast<std::int64_t>(source), hour_us, static_cast<std::int64_t>(sum.rows),
                  static_cast<std::int64_t>(sum.hash), checksum(key, sum));
    }
  }
}

Manifest read_manifest(Connection& connection, const PartHead& head,
                       const std::function<void(const std::string&)>& report) {
  Manifest manifest;
  if (!connection.has_table("manifest")) {
    return manifest;
  }
  read_checked(connection, "manifest", head.sealed_rows, report, [&](const Statement& row) {
    const auto one = read_row(row);
    if (one) {
      manifest.insert(*one);
    }
    return one.has_value();
  });
  return manifest;
}

}  // namespace tacho::store
