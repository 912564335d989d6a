#pragma once
// Bytes of a part turned one at a time, in several processes at once, and the small logs that this is done to.

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "schema/log.hpp"
#include "schema/store/part.hpp"
#include "schema/store/seal.hpp"
#include "tests/schema/store_workload.hpp"

namespace tacho::test {

/// The file with one byte changed, for as long as this lives.
class Flip {
 public:
  Flip(const std::filesystem::path& path, std::uint64_t offset)
      : file_(open(path.c_str(), O_RDWR | O_CLOEXEC)), offset_(static_cast<off_t>(offset)) {
    if (pread(file_, &byte_, 1, offset_) != 1) {
      throw std::runtime_error("cannot read " + path.string());
    }
    write(static_cast<unsigned char>(byte_ ^ mask(offset)));
  }
  ~Flip() {
    write(byte_);
    close(file_);
  }
  Flip(const Flip&) = delete;
  Flip& operator=(const Flip&) = delete;

  /// All bits of every third byte, one bit of the others.
  static unsigned mask(std::uint64_t offset) { return offset % 3 == 0 ? 0xFFU : 1U << (offset % 8); }

 private:
  int file_;
  off_t offset_;
  unsigned char byte_ = 0;
  void write(unsigned char byte) const { static_cast<void>(!pwrite(file_, &byte, 1, offset_)); }
};

/// Set by tests/run.sh --long, which takes a release build for it; else a sample of the bytes is turned.
inline bool every_byte() { return std::getenv("TACHO_EVERY_BYTE") != nullptr; }

/// What one turned byte led to.
struct Consequence {
  bool named = false;  ///< as damage
  std::string fault;   ///< a promise that was not kept; "" when all were
};

struct Sweep {
  std::uint64_t flips = 0;
  std::uint64_t named = 0;
  std::vector<std::string> faults;  ///< the first few of each process
};

namespace detail {

constexpr std::size_t kMostFaults = 50;
constexpr double kMostCpuSeconds = 20;  // of one flip: damage must not lead anybody in circles

using Look = std::function<Consequence(const std::filesystem::path& folder)>;

inline double cpu_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

inline Consequence look_once(const std::filesystem::path& part, std::uint64_t offset, const Look& look) {
  Consequence out;
  const double start = cpu_seconds();
  try {
    const Flip flip(part, offset);
    out = look(part.parent_path());
  } catch (const std::exception& error) {
    out.fault = error.what();
  }
  if (cpu_seconds() - start > kMostCpuSeconds) {
    out.fault += " and it took " + std::to_string(cpu_seconds() - start) + " s";
  }
  std::filesystem::remove(part.string() + "-wal");
  std::filesystem::remove(part.string() + "-shm");
  return out;
}

/// What one process found, in memory it shares with its parent.
struct Shared {
  std::uint64_t at = 0;  ///< the byte it turned last
  std::uint64_t flips = 0;
  std::uint64_t named = 0;
  std::size_t faults = 0;
  std::array<std::array<char, 400>, kMostFaults> words{};  // of each fault

  void tell(const std::string& fault) {
    if (faults < kMostFaults) {
      fault.copy(words[faults++].data(), words[0].size() - 1);
    }
  }
};

}  // namespace detail

namespace detail {

/// Every so-many-th, then those beside them: the first minute of a long sweep has been everywhere.
inline std::vector<std::uint64_t> in_strides(const std::vector<std::uint64_t>& offsets) {
  constexpr std::size_t kStride = 17;
  std::vector<std::uint64_t> out;
  for (std::size_t first = 0; first < kStride; ++first) {
    for (std::size_t i = first; i < offsets.size(); i += kStride) {
      out.push_back(offsets[i]);
    }
  }
  return out;
}

/// Of a sweep that takes an hour, what it finds is told at once.
inline void tell_progress(std::uint64_t flips, std::uint64_t offset, const std::string& fault) {
  if (every_byte() && (!fault.empty() || flips % 1000 == 0)) {
    std::fprintf(stderr, "%llu bytes turned, now %llu%s%s\n", static_cast<unsigned long long>(flips),
                 static_cast<unsigned long long>(offset), fault.empty() ? "" : ": ", fault.c_str());
  }
}

}  // namespace detail

/// Turns each of these bytes of `part`, in copies of its folder. `look` says what came of it; it runs in child
/// processes.
inline Sweep sweep(const std::filesystem::path& part, const std::vector<std::uint64_t>& bytes_of_part,
                   const detail::Look& look) {
  const std::vector<std::uint64_t> offsets = detail::in_strides(bytes_of_part);
  namespace fs = std::filesystem;
  const std::size_t processes = std::max(1U, std::thread::hardware_concurrency());
  const std::size_t bytes = processes * sizeof(detail::Shared);
  void* memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  REQUIRE(memory != MAP_FAILED);
  auto* shared = static_cast<detail::Shared*>(memory);
  std::vector<pid_t> children;
  for (std::size_t child = 0; child < processes; ++child) {
    const fs::path own = part.parent_path().string() + "-" + std::to_string(child);
    fs::copy(part.parent_path(), own);
    children.push_back(fork());
    if (children.back() == 0) {
      for (std::size_t i = child; i < offsets.size(); i += processes) {
        shared[child].at = offsets[i];
        const Consequence found = detail::look_once(own / part.filename(), offsets[i], look);
        ++shared[child].flips;
        detail::tell_progress(shared[child].flips, offsets[i], found.fault);
        shared[child].named += found.named ? 1 : 0;
        if (!found.fault.empty()) {
          shared[child].tell("byte " + std::to_string(offsets[i]) + ": " + found.fault);
        }
      }
      _exit(0);
    }
  }
  Sweep all;
  for (std::size_t child = 0; child < processes; ++child) {
    int status = 0;
    REQUIRE(waitpid(children[child], &status, 0) == children[child]);
    detail::Shared& found = shared[child];
    if (status != 0) {
      all.faults.push_back("byte " + std::to_string(found.at) + ": the process died of it");
    }
    all.flips += found.flips;
    all.named += found.named;
    for (std::size_t i = 0; i < found.faults; ++i) {
      all.faults.emplace_back(found.words[i].data());
    }
  }
  munmap(memory, bytes);
  return all;
}

inline std::string joined(const std::vector<std::string>& lines) {
  std::string out;
  for (const std::string& line : lines) {
    out += line + "\n";
  }
  return out;
}

/// Of a whole SQLite file.
inline std::size_t page_bytes_of(const std::string& file) {
  return static_cast<std::size_t>(static_cast<unsigned char>(file[16])) << 8U | static_cast<unsigned char>(file[17]);
}

/// For parts that are not full after a few polls.
inline store::WriterOptions one_part_options() {
  store::WriterOptions options = workload_options();
  options.part_bytes = 1 << 20;
  options.durable = false;
  options.decode = answer_decode();
  return options;
}

/// What makes one hot row.
inline constexpr int kPollsPerCommit = 4;

/// Polls as the recorder makes them: decoded and noted, with clock points, committed now and then.
inline void record(Workload& work, int polls) {
  AnswerDecoder decoder;
  Sample sample;
  for (int i = 0; i < polls; ++i) {
    const std::uint64_t seq = work.next();
    work.poll();
    for (const Source source : kWorkloadSources) {
      if (!misses(source, seq)) {
        Gates gates;
        const std::string body = answer_body(work.session(), source, seq);
        decoder.decode(answer_of(work.session(), 1, source, seq, work.time(), body), WordOrder::cdab, FieldSet().set(),
                       true, gates, sample);
        work.writer().note(sample);
      }
    }
    ClockPoint point;
    point.session = work.session();
    point.wall_us = work.time();
    point.mono_us = work.time() - kT0;
    work.writer().add(point);
    if (i % kPollsPerCommit == kPollsPerCommit - 1) {
      work.commit();
    }
  }
}

/// The text of a CREATE TABLE without its comments.
inline std::string without_comments(const std::string& sql) {
  std::string out;
  for (std::size_t at = 0; at < sql.size();) {
    const std::size_t end = std::min(sql.find('\n', at), sql.size());
    std::string line = sql.substr(at, end - at);
    line.resize(std::min(line.find(" --"), line.size()));
    line.resize(line.find_last_not_of(' ') + 1);
    out += line + ' ';
    at = end + 1;
  }
  return out;
}

/// Most of a small part are words that explain tables, fields and codes. Without them there is less to turn; the tables
/// and their interior pages stay.
inline void cut_words(const std::filesystem::path& part) {
  store::Connection connection(part, store::OpenMode::write);
  {
    std::map<std::string, std::string> tables;
    store::Statement row(connection, "SELECT name, sql FROM sqlite_schema WHERE sql IS NOT NULL");
    while (row.step()) {
      tables[row.text(0)] = without_comments(row.text(1));
    }
    connection.exec("PRAGMA writable_schema = ON");
    store::Statement update(connection, "UPDATE sqlite_schema SET sql = ?2 WHERE name = ?1");
    for (const auto& [name, sql] : tables) {
      update.run(name, sql);
    }
    connection.exec("PRAGMA writable_schema = RESET");
  }
  connection.exec(
      "UPDATE field SET kind = '', unit = '', json_key = '', former_key = '', register_type = '', condition = '', "
      "code_list = '', sentinel = '', meaning = '';"
      "DELETE FROM code WHERE list <> 'source'; VACUUM");
  store::seal_vocabulary(connection);
  REQUIRE(store::close_part(connection, kT0));
}

/// One closed part of sessions of so many polls, with something in every table and a block of each source and session.
inline std::filesystem::path write_closed_part(const std::filesystem::path& folder, int sessions, int polls) {
  const std::filesystem::path part = folder / "part-000001.db";
  {
    Ledger ledger;
    Workload work(folder, ledger, one_part_options());
    for (int session = 0; session < sessions; ++session) {
      work.begin(kT0 + session * 1000 * kSecond);
      Robot identity;
      identity.vehicle_id = "AMB-150-17";
      identity.mac = "00:11:22:33:44:55";
      work.writer().identify(1, identity);
      record(work, polls);
      work.end();
    }
  }
  cut_words(part);
  return part;
}

/// One part that a kill left: blocks of a session before, hot rows of the last, and no WAL, so that all of it is in the
/// file.
inline std::filesystem::path write_killed_part(const std::filesystem::path& folder, int polls) {
  const std::filesystem::path live = folder.string() + "-live";
  write_closed_part(live, 1, polls);
  Ledger ledger;
  {
    Workload work(live, ledger, one_part_options());
    work.begin(kT0 + 1000 * kSecond);
    record(work, polls);
    copy_as_killed(live, folder);
  }
  const std::filesystem::path part = folder / "part-000001.db";
  store::Connection connection(part, store::OpenMode::write);
  connection.exec("PRAGMA wal_checkpoint(TRUNCATE)");
  return part;
}

}  // namespace tacho::test
