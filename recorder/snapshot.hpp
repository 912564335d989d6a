#pragma once
// A recording at one moment, as values: what the metrics, the dashboard and the status line are made of.

#include <array>
#include <chrono>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "schema/records.hpp"
#include "schema/store/log_writer.hpp"
#include "schema/store/retention.hpp"

namespace tacho::recorder {

/// How often something took how long.
struct Histogram {
  /// Upper bounds of the buckets in microseconds, inclusive; what is longer is in the last bucket.
  static constexpr std::array<Micros, 13> kBounds{500,     1'000,   2'000,   5'000,     10'000,    20'000,   50'000,
                                                  100'000, 200'000, 500'000, 1'000'000, 2'000'000, 5'000'000};
  std::array<std::uint64_t, kBounds.size() + 1> buckets{};
  std::uint64_t count = 0;
  Micros sum_us = 0;
  void add(Micros us);
};

/// One source of one robot. The counters only grow while the recorder runs. `stored` is what is committed, `missed`
/// what the poller has given up (and, cause disk, the writer), so planned - stored - missed is on its way. Of the ring,
/// planned - stored - missed - aged_out is in memory, and `missed` what is missing in what was written.
struct StreamNow {
  std::string robot;
  Source source = Source::status;
  Micros period_us = 0;  ///< 0: no longer asked, since the configuration was changed
  std::uint64_t planned = 0;
  std::uint64_t stored = 0;
  std::uint64_t partial = 0;
  std::array<std::uint64_t, kCauseCount> missed{};
  Histogram round_trip;
  Micros last_round_trip_us = 0;
  Micros last_answer_us = 0;   ///< wall clock; 0: none yet
  std::uint64_t aged_out = 0;  ///< polls of the ring that were not written, because nothing happened
  [[nodiscard]] std::uint64_t missed_total() const;
};

struct LinkNow {
  std::string robot;
  Protocol protocol = Protocol::status_port;
  bool up = false;
};

struct Snapshot {
  Micros now_us = 0;               ///< wall clock
  Micros since_us = 0;             ///< start of the session
  std::vector<StreamNow> streams;  ///< by robot as configured, ended ones last
  std::vector<LinkNow> links;
  std::map<std::string, Micros> clock_offset_us;  ///< robot's clock minus the host's, where the robot tells it
  std::size_t queue_items = 0;
  std::size_t queue_bytes = 0;
  std::size_t ring_bytes = 0;
  store::LogWriter::Stats writer;
  Histogram commits;
  store::Forecast forecast;  ///< some minutes old
};

/// One line of it.
struct Progress {
  std::size_t robots = 0;
  std::size_t robots_ok = 0;  ///< every connection of theirs is up
  std::uint64_t rows = 0;
  std::uint64_t missed = 0;
  std::size_t queued = 0;
  std::chrono::microseconds last_commit{0};
  std::uint64_t stored_bytes = 0;
};
Progress progress_of(const Snapshot& snapshot);

}  // namespace tacho::recorder
