#include "schema/store/keeper.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "schema/store/kept_parts.hpp"
#include "schema/store/part_sequence.hpp"
#include "schema/time.hpp"

namespace tacho::store {

namespace {

std::string words_of(RemovalReason reason, const RetentionRules& rules) {
  switch (reason) {
    case RemovalReason::age:
      return fmt::format("it ended more than {} ago", duration_text(rules.age_us));
    case RemovalReason::size:
      return fmt::format("the log was above {}", size_text(rules.size_bytes));
    case RemovalReason::reserve:
      return fmt::format("less than {} of the disk was free", size_text(rules.reserve_bytes));
    case RemovalReason::disk_full:
      return "the disk was full";
  }
  return "";
}

}  // namespace

std::optional<Micros> Keeper::now() { return how_.time ? trust_.now(how_.time()) : std::nullopt; }

std::optional<std::uint64_t> Keeper::free_bytes(const std::filesystem::path& folder) const {
  return how_.free_bytes ? how_.free_bytes(folder) : free_disk_bytes(folder);
}

bool Keeper::remove_one(PartSequence& parts, When when) {
  const RetentionRules& rules = how_.rules;
  if (rules.age_us == 0 && rules.size_bytes == 0 && rules.reserve_bytes == 0) {
    return false;
  }
  const Surroundings around{now(), free_bytes(parts.folder()), when == When::disk_full};
  if (wait_ > 0 && when == When::as_usual) {
    --wait_;
    return false;
  }
  const std::vector<KeptPart> all = parts.parts();
  const std::vector<Removal> due = parts_to_remove(rules, all, around);
  if (due.empty()) {
    return false;
  }
  const KeptPart& part = all.front();
  try {
    parts.remove_oldest();
  } catch (const Error& error) {
    if (how_.tell) {
      how_.tell(error.what());
    }
    wait_ = kCallsAfterFailure;
    return false;
  }
  untold_.push_back(event_of(part, due.front().reason));
  if (how_.tell) {
    how_.tell(fmt::format("removed {}: {}", part.path.filename().string(), untold_.back().detail));
  }
  return true;
}

Event Keeper::event_of(const KeptPart& part, RemovalReason reason) const {
  const Micros now_us = how_.time ? how_.time().wall_us : std::max(part.last_us, part.first_us);
  Event event;
  event.kind = EventKind::part_removed;
  event.t_from_us = event.t_us = now_us;
  event.subject = fmt::format("part {}", part.number);
  event.new_value = removal_reason_name(reason);
  event.detail = fmt::format(
      "{} of {}: {}", size_text(part.bytes),
      part.first_us == 0 ? std::string("an unknown time") : iso_utc(part.first_us) + " to " + iso_utc(part.last_us),
      words_of(reason, how_.rules));
  return event;
}

Forecast Keeper::forecast(const std::filesystem::path& folder) const {
  return store::forecast(how_.rules, read_kept_parts(folder), free_bytes(folder));
}

}  // namespace tacho::store
