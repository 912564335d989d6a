#pragma once
// A recording: pollers in front, one writer behind. Owns every thread.
//
//   poller thread per robot and protocol -> queue -> one writer thread (Ingest, LogWriter)

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "recorder/config.hpp"
#include "recorder/fleet.hpp"
#include "recorder/health.hpp"
#include "recorder/mark.hpp"
#include "recorder/snapshot.hpp"

namespace tacho::recorder {

/// One source of one robot at the end of a recording, as its log says. planned = stored + sum(missed) + aged_out.
struct SourceSummary {
  std::string robot;
  Source source = Source::status;
  std::uint64_t planned = 0;
  std::uint64_t stored = 0;
  std::uint64_t partial = 0;
  std::array<std::uint64_t, kCauseCount> missed{};
  std::uint64_t aged_out = 0;  ///< of the ring: nothing happened in time, so not in the log
};

class Recorder {
 public:
  struct Options {
    std::string config_text;                         ///< kept in the log verbatim
    std::optional<Micros> run_for_us;                ///< empty: until stop()
    std::function<void(const std::string&)> notice;  ///< what a person should see; called from any thread
    LinkFactory make;  ///< empty: links over sockets that remember what they learn in the log's folder
    std::size_t queue_items = 20'000;
    std::size_t queue_bytes = 64u << 20;
  };

  /// Opens the log, begins a session and starts polling. Throws Error when the log cannot be written.
  Recorder(const Config& config, Options options);
  ~Recorder();  ///< stops and waits; the session ends unclean when finish() was not called
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// The rules of retention and how long the disk will do, in words, as of the start.
  [[nodiscard]] std::vector<std::string> outlook() const;
  /// Goes on with another configuration, whose text is kept in the log: an event config_changed, written before
  /// anything changes, and an event rate for every stream that is asked differently often. Robots whose settings are
  /// the same lose no poll. The session goes on, and so do the numbers of polls of a robot that comes back. Says what
  /// has changed. Throws UsageError for what cannot be changed while recording, Error when the log cannot be written:
  /// nothing has changed then. From one thread.
  std::string reload(const Config& next, const std::string& text);
  /// An event `mark` of the robot it is for, by the configured name or that of its row, or of every robot that is
  /// recorded. How many robots that were. Thread-safe.
  std::size_t mark(const Mark& mark);
  /// Ends polling at once. Thread-safe.
  void stop();
  /// True when there is nothing to wait for: the time is over and every poller has returned, or the log broke.
  [[nodiscard]] bool done() const;
  /// From any thread, as are the next two.
  [[nodiscard]] Snapshot snapshot() const;
  [[nodiscard]] Progress progress() const { return progress_of(snapshot()); }
  [[nodiscard]] std::vector<Beat> beats() const;
  /// Stops if need be, writes everything out, ends the session. Throws what broke the log, if something did.
  std::vector<SourceSummary> finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho::recorder
