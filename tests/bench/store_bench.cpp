// Size and speed of the hot tier: one JSON object per line. Usage: store_bench [ROWS]
//
// The answer is shaped like the real one (7.8 KB compact JSON: 43 inputs and outputs, some 130 keys). Sixteen readings
// are full-precision doubles that all change, thirteen are rounded and change, the rest stays.

#include <fmt/format.h>
#include <stdlib.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "schema/store/log_reader.hpp"
#include "schema/store/log_writer.hpp"

namespace {

using namespace tacho;
namespace fs = std::filesystem;

constexpr Micros kT0 = 1'767'225'600'000'000;
constexpr std::size_t kBodyBytes = 7800;

class Answers {
 public:
  std::string next() {
    ++n_;
    std::string body = "{";
    for (int i = 0; i < 16; ++i) {
      body += fmt::format("\"imu_{}\":{:.17g},", i, noise_(random_));
    }
    for (int i = 0; i < 13; ++i) {
      walk_[static_cast<std::size_t>(i)] += noise_(random_) * 0.01;
      body += fmt::format("\"reading_{}\":{:.4f},", i, walk_[static_cast<std::size_t>(i)]);
    }
    body += fmt::format("\"time\":{},\"odo\":{:.3f},", 1000 * n_, 21773.948 + 0.3 * static_cast<double>(n_));
    body += "\"DI\":[";
    for (std::uint64_t i = 0; i < 43; ++i) {
      body +=
          fmt::format("{{\"id\":{},\"source\":\"normal\",\"status\":{},\"valid\":true}},", i, (n_ / 50 + i) % 7 == 0);
    }
    body.back() = ']';
    for (int i = 0; body.size() + 3 < kBodyBytes; ++i) {
      body += fmt::format(",\"setting_{}\":\"{:x}\"", i, static_cast<unsigned>(i) * 2654435761U);
    }
    body += '}';
    return body;
  }

 private:
  std::mt19937_64 random_{1};
  std::normal_distribution<double> noise_;
  std::array<double, 13> walk_{};
  std::uint64_t n_ = 0;
};

void print(const char* name, double value, const char* unit) {
  fmt::print("{{\"name\":\"store/{}\",\"value\":{:.6g},\"unit\":\"{}\"}}\n", name, value, unit);
}

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Memory of this process that is in RAM, MB.
double resident_mb() {
  std::ifstream statm("/proc/self/statm");
  std::uint64_t total = 0;
  std::uint64_t resident = 0;
  statm >> total >> resident;
  return static_cast<double>(resident) * 4096.0 / 1e6;
}

std::uint64_t folder_bytes(const fs::path& folder) {
  std::uint64_t bytes = 0;
  for (const auto& entry : fs::directory_iterator(folder)) {
    bytes += entry.file_size();
  }
  return bytes;
}

/// Writes `bodies` at 1 Hz with a commit every `rows_per_commit`; returns seconds and the slowest commit.
struct Written {
  double seconds = 0;
  double worst_commit_ms = 0;
  double stored_bytes = 0;
  double growth_mb = 0;  ///< memory at the end less memory after a quarter of the rows
};
Written write(const fs::path& folder, const std::vector<std::string>& bodies, bool durable,
              std::size_t rows_per_commit) {
  store::WriterOptions options;
  options.durable = durable;
  store::LogWriter writer(folder, options);
  const RobotId robot = writer.robot("bench", "127.0.0.1:19204:502");
  Session session;
  session.t_start_us = kT0;
  const SessionId id = writer.begin_session(session);
  Stream stream;
  stream.session = id;
  stream.robot = robot;
  stream.period_us = 1'000'000;
  writer.declare(stream);

  Written result;
  Answer answer;
  double quarter_mb = 0;
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const Micros t = kT0 + static_cast<Micros>(i) * 1'000'000;
    answer.meta = {robot, Source::status, id, i, t, t + 4321};
    answer.body = bodies[i];
    writer.append(answer);
    if (i == bodies.size() / 4) {
      quarter_mb = resident_mb();
    }
    if ((i + 1) % rows_per_commit == 0) {
      writer.commit();
      result.worst_commit_ms =
          std::max(result.worst_commit_ms, static_cast<double>(writer.stats().last_commit.count()) / 1000.0);
    }
  }
  writer.end_session(kT0 + static_cast<Micros>(bodies.size()) * 1'000'000, true);
  result.seconds = seconds_since(start);
  result.growth_mb = resident_mb() - quarter_mb;
  result.stored_bytes = static_cast<double>(writer.stats().stored_bytes);
  return result;
}

void bench_status(const fs::path& dir, std::size_t rows) {
  Answers answers;
  std::vector<std::string> bodies;
  for (std::size_t i = 0; i < rows; ++i) {
    bodies.push_back(answers.next());
  }
  const auto count = static_cast<double>(rows);
  const fs::path folder = dir / "status";
  { store::LogWriter empty(dir / "empty"); }
  const Written fast = write(folder, bodies, false, 1000);
  print("status_body", static_cast<double>(bodies.front().size()), "B");
  print("status_blob", fast.stored_bytes / count, "B/row");
  print("status_file", static_cast<double>(folder_bytes(folder) - folder_bytes(dir / "empty")) / count, "B/row");
  print("writer_memory_growth", fast.growth_mb, "MB");
  print("append_batched", count / fast.seconds, "rows/s");
  const std::vector<std::string> few(bodies.begin(),
                                     bodies.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(rows, 1000)));
  const Written durable = write(dir / "durable", few, true, 13);
  print("append_durable_commit_per_13", static_cast<double>(few.size()) / durable.seconds, "rows/s");
  print("worst_durable_commit", durable.worst_commit_ms, "ms");

  const std::vector<fs::path> paths{folder};
  auto start = std::chrono::steady_clock::now();
  store::LogReader log(paths, [](const Answer&, const Stream&, const FieldSet&, Gates&, Sample&) {});
  print("open", seconds_since(start) * 1000.0, "ms");
  start = std::chrono::steady_clock::now();
  std::uint64_t bytes = 0;
  log.read_raw(1, Source::status, Window{}, [&](const Answer& answer) { bytes += answer.body.size(); });
  const double seconds = seconds_since(start);
  print("read_raw", count / seconds, "rows/s");
  print("read_raw_bytes", static_cast<double>(bytes) / seconds / 1e6, "MB/s");
}

/// Images of 121 registers, of which four words change.
void bench_registers(const fs::path& dir, std::size_t rows) {
  std::mt19937_64 random(2);
  std::string image(250, '\0');
  for (char& c : image) {
    c = static_cast<char>(random());
  }
  std::vector<std::string> images;
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t word = 0; word < 8; ++word) {
      image[4 + word] = static_cast<char>(random());
    }
    images.push_back(image);
  }
  const Written written = write(dir / "registers", images, false, 1000);
  print("registers_blob", written.stored_bytes / static_cast<double>(rows), "B/row");
  print("registers_file",
        static_cast<double>(folder_bytes(dir / "registers") - folder_bytes(dir / "empty")) / static_cast<double>(rows),
        "B/row");
}

}  // namespace

int main(int argc, char** argv) {
  const std::size_t rows = argc > 1 ? std::stoul(argv[1]) : 20'000;
  std::string name = (fs::temp_directory_path() / "tacho-bench-XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) {
    return 1;
  }
  bench_status(name, rows);
  bench_registers(name, rows);
  fs::remove_all(name);
}
