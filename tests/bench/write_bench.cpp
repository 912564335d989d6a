// What recording costs the disk and the processor: one JSON object per figure.
// Usage: write_bench [MINUTES_ALONE] [MINUTES_SHARED]
//
// Simulated robots of profile S (1100 at 1 Hz, 1013 at 2 Hz, registers and inputs at 5 Hz) write through Ingest and a
// durable LogWriter, with a commit every 1 or 10 s of simulated time; simulated seconds follow each other without
// waiting. Bytes are those that the kernel charges to this process for its disk (write_bytes of /proc/self/io: whole
// pages of the page cache; wchar: what was handed to write()), from the first answer to the closed part, so moving rows
// into blocks, checkpoints and closing are in them. One robot alone is recorded for 60 simulated minutes, a hundred
// for 25: every stream has blocks by then. The folder is below TMPDIR, which must be on a real disk.
//
// `commit` is inserting what was packed and making it durable; `pause` is all of LogWriter::commit(), so packing, the
// checkpoint and the moving of rows into blocks too: as long as that answers wait in the queue. `disk_alone` is what
// the disk takes for the bytes of a commit without us. Processor time is the writer's: decoding, events and store,
// without what making the answers takes.

#include <fcntl.h>
#include <fmt/format.h>
#include <stdlib.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "samples/simulator/answers.hpp"
#include "samples/simulator/robot.hpp"
#include "schema/log.hpp"
#include "schema/store/sqlite.hpp"
#include "tests/support/measure.hpp"

namespace {

using namespace tacho;
namespace fs = std::filesystem;

constexpr Micros kT0 = 1'767'250'800'000'000;  // 2026-01-01T07:00:00Z: no midnight within the run
constexpr Micros kSecond = 1'000'000;
constexpr std::array<Micros, 4> kPeriods{kSecond, kSecond / 2, kSecond / 5, kSecond / 5};  // status to inputs

void print(const std::string& name, double value, const char* unit, double limit = 0.0) {
  fmt::print("{{\"name\":\"write/{}\",\"value\":{:.4g},\"unit\":\"{}\"{}}}\n", name, value, unit,
             limit > 0.0 ? fmt::format(",\"limit\":{:g},\"better\":\"lower\"", limit) : "");
  std::fflush(stdout);
}

struct DiskBytes {
  double charged = 0;  ///< write_bytes
  double handed = 0;   ///< wchar
};
DiskBytes disk_bytes() {
  std::ifstream io("/proc/self/io");
  DiskBytes out;
  std::string name;
  for (double value = 0; io >> name >> value;) {
    out.charged = name == "write_bytes:" ? value : out.charged;
    out.handed = name == "wchar:" ? value : out.handed;
  }
  return out;
}

double thread_cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + static_cast<double>(now.tv_nsec) * 1e-9;
}

double milliseconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

/// The simulated robots, and what they answer in each second.
class Fleet {
 public:
  explicit Fleet(int robots) {
    for (int i = 0; i < robots; ++i) {
      const sim::Scenario scenario = sim::busy_day(static_cast<std::uint64_t>(i + 1));
      robots_.push_back(std::make_unique<One>(scenario));
    }
  }

  void declare(store::LogWriter& writer, Ingest& ingest, SessionId session) {
    session_ = session;
    for (const auto& one : robots_) {
      one->seq = {};
      one->id = writer.robot(one->robot.scenario().name, one->robot.scenario().ip + ":19204:502");
      for (std::size_t s = 0; s < kPeriods.size(); ++s) {
        Stream stream;
        stream.session = session;
        stream.robot = one->id;
        stream.source = static_cast<Source>(s);
        stream.period_us = kPeriods[s];
        stream.word_order = one->robot.scenario().word_order;
        ingest.declare(stream);
      }
    }
  }

  /// In order of sending.
  const std::vector<Answer>& answers_of(Micros second) {
    polls_.clear();
    for (std::size_t r = 0; r < robots_.size(); ++r) {
      for (std::size_t s = 0; s < kPeriods.size(); ++s) {
        const Micros phase = static_cast<Micros>(s) * 20'000 + static_cast<Micros>(r) * 13'000 % kPeriods[s];
        for (Micros t = second * kSecond + phase % kPeriods[s]; t < (second + 1) * kSecond; t += kPeriods[s]) {
          polls_.push_back({kT0 + t, r, static_cast<Source>(s)});
        }
      }
    }
    std::sort(polls_.begin(), polls_.end(), [](const Poll& a, const Poll& b) { return a.t_us < b.t_us; });
    answers_.resize(polls_.size());
    for (std::size_t i = 0; i < polls_.size(); ++i) {
      One& one = *robots_[polls_[i].robot];
      const auto source = static_cast<std::size_t>(polls_[i].source);
      answers_[i].meta = {one.id,         polls_[i].source,      session_, one.seq[source]++,
                          polls_[i].t_us, polls_[i].t_us + rtt()};
      answers_[i].body = one.answers.body(polls_[i].source, one.robot.at(polls_[i].t_us));
    }
    return answers_;
  }

 private:
  struct One {
    explicit One(const sim::Scenario& scenario) : robot(scenario, kT0), answers(scenario) {}
    sim::Robot robot;
    sim::AnswerMaker answers;
    RobotId id = 0;
    std::array<std::uint64_t, kSourceCount> seq{};
  };
  struct Poll {
    Micros t_us;
    std::size_t robot;
    Source source;
  };
  std::vector<std::unique_ptr<One>> robots_;
  std::vector<Poll> polls_;
  std::vector<Answer> answers_;
  SessionId session_ = 0;
  std::uint64_t random_ = 1;

  Micros rtt() {
    random_ = random_ * 6364136223846793005ULL + 1442695040888963407ULL;
    return 4'000 + static_cast<Micros>(random_ >> 53U);
  }
};

struct Times {
  std::vector<double> ms;
  [[nodiscard]] double share(double of) {
    std::sort(ms.begin(), ms.end());
    return ms[std::min(ms.size() - 1, static_cast<std::size_t>(of * static_cast<double>(ms.size())))];
  }
};

/// What the files of a closed log take, and how much of that are pages that nothing needs.
struct FileBytes {
  double all = 0;
  double free_pages = 0;
};
FileBytes file_bytes(const fs::path& folder) {
  FileBytes bytes;
  for (const auto& entry : fs::directory_iterator(folder)) {
    bytes.all += static_cast<double>(entry.file_size());
    if (entry.path().extension() == ".db") {
      store::Connection part(entry.path(), store::OpenMode::read);
      store::Statement pages(part, "SELECT freelist_count * page_size FROM pragma_freelist_count, pragma_page_size");
      pages.query();
      bytes.free_pages += pages.step() ? pages.real(0) : 0;
    }
  }
  return bytes;
}

/// What the disk alone takes: as many bytes as a commit hands over, appended to a file and synchronised.
Times disk_alone(const fs::path& file, std::size_t bytes) {
  constexpr int kRounds = 300;
  const std::string block(bytes, 'x');
  Times times;
  const int fd = open(file.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0644);
  for (int i = 0; i < kRounds; ++i) {
    const auto begun = std::chrono::steady_clock::now();
    if (write(fd, block.data(), block.size()) < 0 || fdatasync(fd) != 0) {
      break;
    }
    times.ms.push_back(milliseconds_since(begun));
  }
  close(fd);
  return times;
}

struct Goals {
  double mb_per_robot_day = 0;  ///< 0: none
  double commit_ms = 0;
};

void bench(const fs::path& folder, int robots, Micros commit_s, Micros minutes, Goals goals) {
  Fleet fleet(robots);
  fleet.answers_of(0);  // from here on the robots take no more memory
  const double without_mb = test::resident_bytes() / 1e6;
  double most_mb = 0;
  double cpu_s = 0;
  Times commits;
  Times pauses;
  const DiskBytes before = disk_bytes();
  {
    double start = thread_cpu_seconds();
    store::LogWriter writer(folder);
    Session session;
    session.t_start_us = kT0;
    const SessionId id = writer.begin_session(session);
    Ingest ingest(writer, [] { return kT0; });
    fleet.declare(writer, ingest, id);
    cpu_s += thread_cpu_seconds() - start;
    for (Micros second = 1; second <= minutes * 60; ++second) {
      const std::vector<Answer>& answers = fleet.answers_of(second);
      start = thread_cpu_seconds();
      for (const Answer& answer : answers) {
        ingest.append(answer);
      }
      if (second % commit_s == 0) {
        const auto begun = std::chrono::steady_clock::now();
        writer.commit();
        pauses.ms.push_back(milliseconds_since(begun));
        commits.ms.push_back(static_cast<double>(writer.stats().last_commit.count()) / 1e3);
      }
      cpu_s += thread_cpu_seconds() - start;
      if (second % 10 == 0) {
        most_mb = std::max(most_mb, test::resident_bytes() / 1e6);
      }
    }
    start = thread_cpu_seconds();
    writer.end_session(kT0 + minutes * 60 * kSecond, true);
    cpu_s += thread_cpu_seconds() - start;
  }
  const DiskBytes after = disk_bytes();
  const FileBytes kept = file_bytes(folder);
  const double robot_days = robots * static_cast<double>(minutes) / 1440.0;
  const std::string what = fmt::format("{}_robot{}_commit_{}s", robots, robots == 1 ? "" : "s", commit_s);
  print("disk_" + what, (after.charged - before.charged) / robot_days / 1e6, "MB/robot-day", goals.mb_per_robot_day);
  print("handed_" + what, (after.handed - before.handed) / robot_days / 1e6, "MB/robot-day");
  print("kept_" + what, kept.all / robot_days / 1e6, "MB/robot-day");
  print("kept_free_pages_" + what, kept.free_pages / robot_days / 1e6, "MB/robot-day");
  print("cpu_" + what, cpu_s / robot_days, "s/robot-day");
  print("cpu_share_" + what, 100.0 * cpu_s / (60.0 * static_cast<double>(minutes)), "% of one core");
  print("commit_p50_" + what, commits.share(0.5), "ms");
  print("commit_p99_" + what, commits.share(0.99), "ms", goals.commit_ms);
  print("commit_max_" + what, commits.share(1.0), "ms");
  Times disk = disk_alone(folder / "alone", static_cast<std::size_t>((after.handed - before.handed) /
                                                                     static_cast<double>(commits.ms.size())));
  print("disk_alone_p50_" + what, disk.share(0.5), "ms");
  print("disk_alone_p99_" + what, disk.share(0.99), "ms");
  print("pause_p50_" + what, pauses.share(0.5), "ms");
  print("pause_p99_" + what, pauses.share(0.99), "ms");
  print("pause_max_" + what, pauses.share(1.0), "ms");
  print("memory_" + what, most_mb - without_mb, "MB");
}

}  // namespace

int main(int argc, char** argv) {
  const Micros alone = argc > 1 ? std::stol(argv[1]) : 60;
  const Micros shared = argc > 2 ? std::stol(argv[2]) : 25;
  std::string name = (fs::temp_directory_path() / "tacho-bench-XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) {
    return 1;
  }
  const fs::path dir(name);
  if (alone > 0) {
    bench(dir / "alone-1s", 1, 1, alone, {1000, 5});
    bench(dir / "alone-10s", 1, 10, alone, {400, 5});
  }
  if (shared > 0) {
    bench(dir / "shared", 100, 1, shared, {250, 5});
  }
  fs::remove_all(dir);
}
