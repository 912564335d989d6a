#include "recorder/snapshot.hpp"

#include <algorithm>
#include <numeric>

namespace tacho::recorder {

void Histogram::add(Micros us) {
  ++buckets[static_cast<std::size_t>(std::lower_bound(kBounds.begin(), kBounds.end(), us) - kBounds.begin())];
  ++count;
  sum_us += us;
}

std::uint64_t StreamNow::missed_total() const {
  return std::accumulate(missed.begin(), missed.end(), std::uint64_t{0});
}

Progress progress_of(const Snapshot& snapshot) {
  std::map<std::string, bool> ok;
  for (const LinkNow& link : snapshot.links) {
    const auto robot = ok.try_emplace(link.robot, true).first;
    robot->second = robot->second && link.up;
  }
  Progress out;
  out.robots = ok.size();
  out.robots_ok = static_cast<std::size_t>(std::count_if(ok.begin(), ok.end(), [](const auto& r) { return r.second; }));
  for (const StreamNow& stream : snapshot.streams) {
    out.missed += stream.missed_total();
  }
  out.rows = snapshot.writer.rows;
  out.queued = snapshot.queue_items;
  out.last_commit = snapshot.writer.last_commit;
  out.stored_bytes = snapshot.writer.stored_bytes;
  return out;
}

}  // namespace tacho::recorder
