#pragma once
// A log written by hand: bodies are "x=<number>" or anything at all; the decoder of these tests reads the number.

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "schema/store/log_reader.hpp"
#include "schema/store/log_writer.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/temp_dir.hpp"

namespace tacho::test {

inline constexpr Micros kT0 = 1'767'225'600'000'000;  // 2026-01-01T00:00:00Z
inline constexpr Micros kSecond = 1'000'000;
inline constexpr Micros kDay = 86'400 * kSecond;

inline Stream stream_of(SessionId session, RobotId robot, Source source, Micros period_us = kSecond) {
  Stream stream;
  stream.session = session;
  stream.robot = robot;
  stream.source = source;
  stream.period_us = period_us;
  return stream;
}

inline Answer answer_of(SessionId session, RobotId robot, Source source, std::uint64_t seq, Micros t_us,
                        std::string body) {
  return {{robot, source, session, seq, t_us, t_us + 4000}, std::move(body), {}};
}

inline Gap gap_of(SessionId session, RobotId robot, Source source, std::uint64_t seq_from, std::uint64_t seq_count,
                  Micros t_us) {
  Gap gap;
  gap.robot = robot;
  gap.source = source;
  gap.session = session;
  gap.seq_from = seq_from;
  gap.seq_count = seq_count;
  gap.t_from_us = t_us;
  gap.t_to_us = t_us + static_cast<Micros>(seq_count) * kSecond;
  return gap;
}

/// A body that looks like an answer: most of it repeats, some of it changes.
inline std::string body_of(std::uint64_t n) {
  std::string body = "{\"x\":" + std::to_string(static_cast<double>(n) * 0.125);
  for (int i = 0; i < 12; ++i) {
    body += (i == 0 ? std::string(",\"voltage") : ",\"field_" + std::to_string(i)) +
            "\":" + std::to_string((n * 2654435761U + static_cast<unsigned>(i)) % 97);
  }
  return body + "}";
}

/// One robot, one session, one source; polls a second apart from kT0.
class Recording {
 public:
  explicit Recording(const std::filesystem::path& folder, store::WriterOptions options = {}, Micros t0_us = kT0)
      : writer(folder, options), t0_us_(t0_us) {
    Session start;
    start.t_start_us = t0_us;
    start.software = "test";
    robot = writer.robot("amr-1", "127.0.0.1:19204:502");
    session = writer.begin_session(start);
    writer.declare(stream_of(session, robot, Source::status));
  }
  void poll(std::string body) {
    writer.append(answer_of(session, robot, Source::status, next, time(), std::move(body)));
    ++next;
  }
  void polls(std::uint64_t count) {
    for (std::uint64_t i = 0; i < count; ++i) {
      poll(body_of(next));
    }
  }
  void miss(std::uint64_t count) {
    writer.add(gap_of(session, robot, Source::status, next, count, time()));
    next += count;
  }
  void end(bool clean = true) {
    writer.planned(robot, Source::status, next);
    writer.end_session(time(), clean);
  }
  [[nodiscard]] Micros time() const { return t0_us_ + static_cast<Micros>(next) * kSecond; }

  store::LogWriter writer;
  RobotId robot = 0;
  SessionId session = 0;
  std::uint64_t next = 0;

 private:
  Micros t0_us_;
};

/// Decodes {"x":<number>...; everything else is undecodable.
inline void decode_x(const Answer& answer, const Stream&, const FieldSet&, Gates&, Sample& out) {
  out.clear();
  out.decodable = answer.body.rfind("{\"x\":", 0) == 0;
  if (out.decodable) {
    Cell& cell = out.cells[field("x")];
    cell.state = State::present;
    cell.real = std::stod(answer.body.substr(5));
  }
}

inline store::LogReader open_reader(const std::filesystem::path& path) {
  const std::vector<std::filesystem::path> paths{path};
  return store::LogReader(paths, {decode_x, {}});
}

struct Stored {
  SessionId session;
  std::uint64_t seq;
  Micros t_us;
  std::string body;
  friend bool operator==(const Stored&, const Stored&) = default;
};

inline std::vector<Stored> stored(store::LogReader& log, RobotId robot = 1, Source source = Source::status,
                                  Window window = {}) {
  std::vector<Stored> out;
  log.read_raw(robot, source, window, [&](const Answer& a) {
    out.push_back({a.meta.session, a.meta.seq, a.meta.t_send_us, a.body});
  });
  return out;
}

inline std::vector<Slice> slices(store::LogReader& log, RobotId robot = 1, Window window = {},
                                 std::vector<Source> sources = {Source::status}) {
  Selection selection;
  for (const Source source : sources) {
    selection.add(source, field("x"));
  }
  std::vector<Slice> out;
  log.read(robot, window, selection, [&](const Slice& slice) { out.push_back(slice); });
  return out;
}

inline Coverage coverage_of(const store::LogReader& log, RobotId robot = 1, Source source = Source::status) {
  for (const Coverage& coverage : log.coverage()) {
    if (coverage.robot == robot && coverage.source == source) {
      return coverage;
    }
  }
  return {};
}

/// What is left on disk when the process dies now.
inline void copy_as_killed(const std::filesystem::path& from, const std::filesystem::path& to) {
  std::filesystem::create_directories(to);
  for (const auto& entry : std::filesystem::directory_iterator(from)) {
    if (entry.path().extension() != ".db-shm" && entry.path().extension() != ".lock") {
      std::filesystem::copy_file(entry.path(), to / entry.path().filename());
    }
  }
}

inline std::vector<std::filesystem::path> part_files(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> out;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() == ".db" && entry.path().filename().string().front() != '.') {
      out.push_back(entry.path());
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace tacho::test
