// A power cut at any moment: what commit() returned for is there, the rest is gone cleanly. RECORDER-LESSONS section 4.

#include <cstdlib>
#include <random>

#include "tests/schema/store_workload.hpp"
#include "tests/support/faulty_vfs.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

constexpr int kRoundsPerLog = 2;
constexpr Micros kAnHour = 3600 * kSecond;  // before midnight, so that the day turns in the middle of a session

/// What a power cut left, and what had been promised by then.
struct Cut {
  FaultyDisk::Image image;
  Ledger ledger;
  std::string where;
};

/// Records one session on a disk that may lose power at each of its calls, and returns some of those moments.
class Round {
 public:
  /// `moves`: so many polls in one part that rows are moved into blocks meanwhile.
  Round(const fs::path& folder, const Ledger& before, bool moves, std::mt19937& random)
      : folder_(folder), ledger_(before), moves_(moves), random_(&random) {}

  std::vector<Cut> record(Micros t0_us, bool ends) {
    FaultyDisk disk(folder_);
    disk.before_each_call([&](Call) {
      if ((*random_)() % one_in_ == 0) {
        cuts_.push_back({disk.after_power_cut(*random_), ledger_, doing_ + ", call " + std::to_string(disk.calls())});
      }
    });
    doing_ = "opening";
    one_in_ = 12;
    store::WriterOptions options = workload_options();
    options.part_bytes = moves_ ? 1u << 20 : options.part_bytes;
    Workload work(folder_, ledger_, options);
    doing_ = "beginning";
    work.begin(t0_us, 60 * kSecond);
    doing_ = "recording";
    one_in_ = 40;
    const auto commits = 20 + (*random_)() % 60;
    const unsigned most = moves_ ? 40 : 3;
    for (auto i = commits; i > 0; --i) {
      for (auto polls = 1 + (*random_)() % most; polls > 0; --polls) {
        work.poll();
      }
      work.commit();
    }
    store::Connection part(part_files(folder_).back(), store::OpenMode::read);
    moved_ = part.integer("SELECT count(*) FROM block") > 0;
    doing_ = "ending";
    one_in_ = 8;
    if (ends) {
      work.end();
    }
    return std::move(cuts_);
  }

  /// Rows were moved into blocks while it recorded.
  [[nodiscard]] bool moved() const { return moved_; }

 private:
  fs::path folder_;
  Ledger ledger_;
  bool moves_;
  bool moved_ = false;
  std::mt19937* random_;
  std::vector<Cut> cuts_;
  std::string doing_;
  std::mt19937::result_type one_in_ = 1;
};

bool nothing_promised(const Ledger& ledger) {
  return std::all_of(ledger.streams.begin(), ledger.streams.end(),
                     [](const auto& stream) { return stream.second.acknowledged == 0; });
}

/// The first thing that is wrong with the log that a cut left; "" when it keeps all promises.
std::string fault_of(const Cut& cut, const fs::path& folder) {
  write_image(cut.image, folder);
  const FaultyDisk without_real_syncs(folder);
  const bool empty = !fs::exists(folder) || part_files(folder).empty();
  if (empty && !nothing_promised(cut.ledger)) {
    return "no part is left";
  }
  if (!empty) {
    if (const Verdict verdict = judge(folder, cut.ledger, false); !verdict.fault.empty()) {
      return "before repair: " + verdict.fault;
    }
  }
  { store::LogWriter writer(folder); }
  if (const std::string damage = integrity_of(folder); !damage.empty()) {
    return damage;
  }
  return judge(folder, cut.ledger).fault;
}

}  // namespace

TEST_CASE("after a power cut at any moment every acknowledged answer is there and the log is whole") {
  const int wanted = std::getenv("TACHO_LONG") != nullptr ? 10'000 : 1000;
  std::mt19937 random(20260101);
  TempDir dir(memory_folder());
  int cuts = 0;
  int logs = 0;
  int moved = 0;
  while (cuts < wanted) {
    const fs::path folder = dir / ("log" + std::to_string(++logs));
    Ledger ledger;
    for (int round = 0; round < kRoundsPerLog && cuts < wanted; ++round) {
      Round recording(folder, ledger, logs % 3 == 0, random);
      const std::vector<Cut> taken = recording.record(kT0 + (round * 2 + 1) * kDay - kAnHour, round % 2 == 0);
      moved += recording.moved() ? 1 : 0;
      for (const Cut& cut : taken) {
        INFO("log " << logs << ", round " << round << ", while " << cut.where);
        REQUIRE(fault_of(cut, dir / "cut") == "");
        ++cuts;
      }
      // The next round begins after one of these cuts, not repaired yet.
      const Cut& next = taken[random() % taken.size()];
      write_image(next.image, folder);
      ledger = next.ledger;
    }
    fs::remove_all(folder);
  }
  CHECK(cuts >= wanted);
  CHECK(moved >= logs / 6);
}
