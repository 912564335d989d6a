// A disk that fails at any of its calls, once or from then on: the writer throws Error and nothing else, and what it
// could not write becomes gap rows of cause disk.

#include <cstdlib>

#include "tests/schema/store_workload.hpp"
#include "tests/support/faulty_vfs.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

enum class Lasts : std::uint8_t {
  once,
  until_healed,  ///< the disk works again while the writer still records
  for_good,      ///< ... only after it has ended
};

/// What is recorded: `commits` times so many polls.
struct Shape {
  int commits;
  int polls;
  Micros period_us;
  Micros t0_us;
  std::uint64_t part_bytes;
};

/// Small, but it creates a log, changes the part (at midnight) and ends a session.
const Shape kPartChanges{6, 2, kSecond, kT0 + kDay - 6 * kSecond, workload_options().part_bytes};
/// Long enough for rows to be moved into blocks while it records.
const Shape kRowsMove{12, 70, 3 * kSecond, kT0, 1u << 20};

class Scenario {
 public:
  Scenario(const fs::path& folder, FaultyDisk& disk, Lasts lasts, const Shape& shape)
      : folder_(folder), disk_(&disk), lasts_(lasts), shape_(shape) {}

  /// False when the disk never let it finish.
  bool run() {
    std::optional<Workload> work;
    if (!tried([&] { work.emplace(folder_, ledger_, options()); }) || !begun(*work)) {
      return false;
    }
    for (int i = 0; i < shape_.commits; ++i) {
      if (i == shape_.commits * 2 / 3 && lasts_ == Lasts::until_healed) {
        disk_->heal();
      }
      for (int poll = 0; poll < shape_.polls; ++poll) {
        tried_once([&] { work->poll(); });
      }
      tried_once([&] { work->commit(); });
    }
    blocks_ = blocks_now();
    return tried([&] { work->end(); });
  }
  [[nodiscard]] const Ledger& ledger() const { return ledger_; }
  /// In the newest part before the session ended.
  [[nodiscard]] std::int64_t blocks() const { return blocks_; }
  /// What was thrown that is no Error; "" when nothing was.
  [[nodiscard]] const std::string& alien() const { return alien_; }

 private:
  [[nodiscard]] store::WriterOptions options() const {
    store::WriterOptions out = workload_options();
    out.part_bytes = shape_.part_bytes;
    return out;
  }
  [[nodiscard]] std::int64_t blocks_now() const {
    try {
      return store::Connection(part_files(folder_).back(), store::OpenMode::read).integer("SELECT count(*) FROM block");
    } catch (const Error&) {
      return 0;  // not on this disk
    }
  }
  bool begun(Workload& work) {
    return tried([&] { work.begin(shape_.t0_us, shape_.period_us); });
  }
  bool tried_once(const std::function<void()>& step) {
    try {
      step();
      return true;
    } catch (const Error&) {
    } catch (const std::exception& other) {
      alien_ = other.what();
    }
    return false;
  }
  /// What cannot be done without is tried again, on a healthy disk if there is one.
  bool tried(const std::function<void()>& step) {
    if (tried_once(step)) {
      return true;
    }
    if (lasts_ == Lasts::until_healed) {
      disk_->heal();
    }
    return tried_once(step);
  }

  fs::path folder_;
  FaultyDisk* disk_;
  Lasts lasts_;
  const Shape& shape_;
  std::int64_t blocks_ = 0;
  Ledger ledger_;
  std::string alien_;
};

const char* name_of(FaultKind kind) {
  return kind == FaultKind::no_space ? "ENOSPC" : kind == FaultKind::io_error ? "EIO" : "short write";
}

/// Runs the scenario with one fault and requires all promises; true when the fault struck.
bool survives(FaultKind kind, Lasts lasts, std::uint64_t call, const Shape& shape) {
  TempDir dir(memory_folder());
  FaultyDisk disk(dir / "log");
  disk.inject({kind, call, lasts != Lasts::once});
  Scenario scenario(dir / "log", disk, lasts, shape);
  const bool finished = scenario.run();
  const bool struck = disk.struck();
  disk.heal();
  INFO(name_of(kind) << (lasts == Lasts::once ? " at call " : " from call ") << call);
  REQUIRE(scenario.alien() == "");
  REQUIRE((finished || lasts == Lasts::for_good));
  { store::LogWriter writer(dir / "log"); }
  REQUIRE(integrity_of(dir / "log") == "");
  const Verdict verdict = judge(dir / "log", scenario.ledger());
  REQUIRE(verdict.fault == "");
  REQUIRE((struck || verdict.lost == 0));
  return struck;
}

/// The calls of the scenario on a disk that works.
std::vector<Call> calls(const Shape& shape) {
  TempDir dir(memory_folder());
  FaultyDisk disk(dir / "log");
  std::vector<Call> all;
  disk.before_each_call([&](Call call) { all.push_back(call); });
  Scenario scenario(dir / "log", disk, Lasts::once, shape);
  CHECK(scenario.run());
  CHECK((scenario.blocks() > 0) == (&shape == &kRowsMove));
  return all;
}

/// Writes that follow each other fill one file: the first, the last and every eighth stand for all of them, but with
/// TACHO_LONG.
bool stands_for_others(const std::vector<Call>& all, std::uint64_t call) {
  if (std::getenv("TACHO_LONG") != nullptr) {
    return true;
  }
  const auto writes = [&](std::uint64_t at) { return at < all.size() && all[at] == Call::write; };
  return !writes(call) || !writes(call - 1) || !writes(call + 1) || call % 8 == 0;
}

void fail_everywhere(FaultKind kind, Lasts lasts, const Shape& shape = kPartChanges) {
  const std::vector<Call> all = calls(shape);
  CHECK(all.size() > 100);
  for (std::uint64_t call = 0; call < all.size(); ++call) {
    // Other calls than writes know no difference between a short write and a full disk.
    if ((kind == FaultKind::short_write && all[call] != Call::write) || !stands_for_others(all, call)) {
      continue;
    }
    if (!survives(kind, lasts, call, shape)) {
      // The disk worked again before this call; or, how long packing may take being a matter of time, there was none.
      REQUIRE(call > (lasts == Lasts::until_healed ? all.size() / 3 : all.size() / 4 * 3));
      break;
    }
  }
}

}  // namespace

TEST_CASE("whichever call to the disk fails once, no acknowledged answer is lost and recording goes on") {
  for (const FaultKind kind : {FaultKind::no_space, FaultKind::io_error, FaultKind::short_write}) {
    fail_everywhere(kind, Lasts::once);
  }
}

TEST_CASE("whenever the disk fails for a while, what could not be written becomes gap rows of cause disk") {
  fail_everywhere(FaultKind::no_space, Lasts::until_healed);
}

TEST_CASE("whenever the disk fails for good, the next start on a healthy disk finds all that was acknowledged") {
  for (const FaultKind kind : {FaultKind::no_space, FaultKind::io_error, FaultKind::short_write}) {
    fail_everywhere(kind, Lasts::for_good);
  }
}

TEST_CASE("while rows move into blocks the disk may fail as well") {
  fail_everywhere(FaultKind::io_error, Lasts::once, kRowsMove);
  fail_everywhere(FaultKind::no_space, Lasts::until_healed, kRowsMove);
  fail_everywhere(FaultKind::short_write, Lasts::for_good, kRowsMove);
}

TEST_CASE("answers that wait in memory when the disk fails are lost together, up to the commit, and no others") {
  TempDir dir(memory_folder());
  FaultyDisk disk(dir / "log");
  {
    store::WriterOptions options;
    options.part_per_day = false;
    Recording recording(dir / "log", options);
    recording.writer.declare(stream_of(1, 1, Source::registers));
    recording.polls(3);
    recording.writer.commit();
    recording.polls(5);
    recording.writer.append(answer_of(1, 1, Source::registers, 0, recording.time(), "image"));
    disk.inject({FaultKind::io_error, disk.calls(), true});
    recording.polls(2);
    CHECK_THROWS_AS(recording.writer.commit(), Error);
    CHECK(recording.writer.tally(1, Source::status).stored == 3);
    recording.polls(4);  // begins anew: of these nothing is lost
    disk.heal();
    recording.writer.commit();
    CHECK(recording.writer.stats().rows == 7);
    CHECK(recording.writer.stats().lost == 8);
    CHECK(recording.writer.tally(1, Source::registers).stored == 0);
    recording.end();
  }
  store::LogReader log = open_reader(dir / "log");
  std::vector<std::uint64_t> polls;
  for (const Stored& answer : stored(log)) {
    CHECK(answer.body == body_of(answer.seq));
    polls.push_back(answer.seq);
  }
  CHECK(polls == std::vector<std::uint64_t>{0, 1, 2, 10, 11, 12, 13});
  CHECK(coverage_of(log).missed == 7);
  CHECK(coverage_of(log, 1, Source::registers).missed == 1);
  for (const Slice& slice : slices(log)) {
    for (const Gap& gap : slice.gaps) {
      CHECK(gap.cause == Cause::disk);
    }
  }
  CHECK(log.problems().empty());
}
