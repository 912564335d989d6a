// Bytes of a part turned, one at a time: verify names the damage or nothing has changed, and recover gives back all but
// one block of one source (of a part that a kill left: all but one row and those up to the next keyframe), with gap
// rows for exactly what is missing.

#include <fmt/format.h>

#include <fstream>
#include <set>

#include "schema/log.hpp"
#include "schema/recover.hpp"
#include "tests/schema/flip_sweep.hpp"
#include "tests/support/golden.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

constexpr int kPolls = 24;  // of a session

using Poll = std::tuple<SessionId, Source, std::uint64_t>;

/// What is in a log of one robot.
struct Contents {
  std::map<Poll, std::string> answers;
  std::map<Poll, Cause> missed;
  std::set<Poll> twice;
  std::multiset<std::string> events;
  std::multiset<std::string> clock;
};

Contents contents_of(const fs::path& folder) {
  Contents out;
  const auto log = open_log(std::vector<fs::path>{folder});
  Selection selection;
  for (const Source source : kWorkloadSources) {
    selection.add(source, field("x"));
    log->read_raw(1, source, {}, [&](const Answer& a) {
      if (!out.answers.emplace(Poll{a.meta.session, source, a.meta.seq}, a.body).second) {
        out.twice.insert({a.meta.session, source, a.meta.seq});
      }
    });
  }
  log->read(1, {}, selection, [&](const Slice& slice) {
    for (const Gap& gap : slice.gaps) {
      const std::uint64_t polls =
          gap.partial ? 0 : std::min<std::uint64_t>(gap.seq_count, 10 * kPolls);  // no more were
      for (std::uint64_t i = 0; i < polls; ++i) {
        const Poll poll{gap.session, gap.source, gap.seq_from + i};
        if (out.answers.count(poll) > 0 || !out.missed.emplace(poll, gap.cause).second) {
          out.twice.insert(poll);
        }
      }
    }
    for (const Event& e : slice.events) {
      out.events.insert(fmt::format("{} {} {} {} {}", e.session, event_kind_name(e.kind), e.seq, e.t_us, e.subject));
    }
    for (const ClockPoint& c : slice.clock) {
      out.clock.insert(fmt::format("{} {} {}", c.session, c.wall_us, c.mono_us));
    }
  });
  return out;
}

/// What `tacho-analyzer verify` ends with 3 or 1 for.
bool verify_names(const fs::path& folder) {
  try {
    const auto log = open_log(std::vector<fs::path>{folder});
    const Survey found = survey(dynamic_cast<store::LogReader&>(*log));
    const std::vector<ReadProblem> problems = log->problems();
    return !found.wrong_summaries.empty() || found.wrong_rollups > 0 || found.wrong_hours > 0 ||
           std::any_of(problems.begin(), problems.end(), [](const ReadProblem& p) { return !p.beside; }) ||
           std::any_of(found.streams.begin(), found.streams.end(), [](const auto& entry) {
             const StreamSurvey& s = entry.second;
             return s.doubled + s.beyond + s.disordered > 0 || !s.holes.empty();
           });
  } catch (const Error&) {
    return true;
  }
}

template <class Row>
std::size_t missing(const std::multiset<Row>& from, const std::multiset<Row>& in) {
  std::vector<Row> gone;
  std::set_difference(from.begin(), from.end(), in.begin(), in.end(), std::back_inserter(gone));
  return gone.size();
}

/// What may be gone of the answers: those of one stream of one session, so many at most.
struct Bound {
  std::size_t answers;
  std::optional<std::size_t> hot = std::nullopt;  ///< of the last session, whose rows are in no block
  /// Nobody knows yet how many polls there were: the newest can go without a trace.
  bool open_end = false;
};

bool is_newest(const Poll& poll, const Contents& now) {
  const auto& [session, source, seq] = poll;
  const Poll after{session, source, seq + 1};
  const Poll end{session, source, ~std::uint64_t{0}};
  return now.answers.lower_bound(after) == now.answers.upper_bound(end) &&
         now.missed.lower_bound(after) == now.missed.upper_bound(end);
}

/// The first thing that is wrong with what recover made of a damaged log; "" when it kept its promise.
std::string fault_of(const Contents& whole, const fs::path& recovered, const Recovery& said, Bound bound) {
  if (!said.different.empty()) {
    return said.different.front();
  }
  const Contents now = contents_of(recovered);
  if (!now.twice.empty()) {
    return "a poll is there twice";
  }
  std::set<std::pair<SessionId, Source>> streams;
  std::size_t gone = 0;
  std::size_t untold = 0;
  std::size_t lost = 0;
  for (const auto& [poll, body] : whole.answers) {
    const auto here = now.answers.find(poll);
    if (here == now.answers.end()) {
      ++gone;
      streams.insert({std::get<0>(poll), std::get<1>(poll)});
      const bool told = now.missed.count(poll) > 0;
      untold += told ? 0U : 1U;
      if (!told && !(bound.open_end && is_newest(poll, now))) {
        return fmt::format("poll {} of {} in session {} is neither stored nor in a gap row", std::get<2>(poll),
                           source_name(std::get<1>(poll)), std::get<0>(poll));
      }
    } else if (here->second != body) {
      return "an answer is not what was recorded";
    }
  }
  for (const auto& [poll, body] : now.answers) {
    if (whole.answers.count(poll) == 0) {
      return "an answer was never recorded";
    }
  }
  std::size_t forgotten = 0;
  for (const auto& [poll, cause] : now.missed) {
    lost += cause == Cause::damaged ? 1U : 0U;
    const auto before = whole.missed.find(poll);
    if (whole.answers.count(poll) == 0 && before == whole.missed.end()) {
      return "a gap row names a poll that never was";
    }
    forgotten += before != whole.missed.end() && before->second != cause ? 1U : 0U;
  }
  for (const auto& [poll, cause] : whole.missed) {
    const bool told = now.missed.count(poll) > 0;
    untold += told ? 0U : 1U;
    forgotten += told ? 0U : 1U;
    if (!told && !(bound.open_end && is_newest(poll, now))) {
      return "a poll that was missed is no longer on record";
    }
  }
  if (now.missed.size() + now.answers.size() + untold != whole.missed.size() + whole.answers.size()) {
    return "there are more polls than there were";
  }
  const bool last_session = !streams.empty() && streams.begin()->first == std::get<0>(whole.answers.rbegin()->first);
  const std::size_t most = last_session ? bound.hot.value_or(bound.answers) : bound.answers;
  const std::size_t records = forgotten + missing(whole.events, now.events) + missing(whole.clock, now.clock);
  if (streams.size() > 1 || gone > most || records > 1 || (gone > 0 && records > 0)) {
    return fmt::format("{} answers of {} streams and {} records are gone", gone, streams.size(), records);
  }
  if (now.events.size() > whole.events.size() || now.clock.size() > whole.clock.size()) {
    return "a record is there that never was";
  }
  if (said.lost != lost || gone + forgotten - untold != lost || said.left_out != 0 || (records > 0 && said.whole)) {
    return fmt::format("it said that {} polls are lost, {} left out: there are {}", said.lost, said.left_out, lost);
  }
  return "";
}

/// Some of the file header, of the head of a page every 4096 bytes, and of the rest.
bool in_sample(std::uint64_t offset) {
  const bool header = offset < 100 && offset % 10 == 3;
  const bool page_head = offset % 4096 == offset / 4096 % 8;
  return header || page_head || offset % 15'013 == 1;
}

/// What came of one turned byte: verify, and recover where it names damage.
Consequence consequence(const fs::path& folder, const Contents& whole, Bound bound) {
  if (verify_names(folder)) {
    const fs::path recovered = folder.string() + "-recovered";
    const Recovery said = recover(std::vector<fs::path>{folder}, recovered);
    const std::string fault = fault_of(whole, recovered, said, bound);
    fs::remove_all(recovered);
    return {true, fault};
  }
  const Contents now = contents_of(folder);
  const std::size_t fewer = missing(whole.events, now.events) + missing(whole.clock, now.clock);
  const std::size_t more = missing(now.events, whole.events) + missing(now.clock, whole.clock);
  const bool same = now.answers == whole.answers && now.missed == whole.missed;
  if (same && fewer == 0 && more == 0) {
    return {};
  }
  return {false,
          fmt::format("unnamed, but {} of {} answers, {} of {} misses, {} records fewer, {} more", now.answers.size(),
                      whole.answers.size(), now.missed.size(), whole.missed.size(), fewer, more)};
}

/// Turns byte after byte of the one part of a log.
void sweep_part(const fs::path& part, Bound bound) {
  const fs::path folder = part.parent_path();
  const Contents whole = contents_of(folder);
  REQUIRE(whole.twice.empty());
  REQUIRE(whole.answers.size() >= kPolls);
  std::error_code none;
  REQUIRE((fs::file_size(part.string() + "-wal", none) == 0 || none));  // all of it is in the file
  REQUIRE_FALSE(verify_names(folder));
  std::vector<std::uint64_t> offsets;
  for (std::uint64_t offset = 0; offset < fs::file_size(part); ++offset) {
    if (every_byte() || in_sample(offset)) {
      offsets.push_back(offset);
    }
  }
  const Sweep swept = sweep(part, offsets, [&](const fs::path& copy) { return consequence(copy, whole, bound); });
  CHECK(joined(swept.faults) == "");
  CHECK(swept.flips == offsets.size());
  CHECK(swept.named > 0);
}

std::int64_t rows_in(const fs::path& part, const std::string& table) {
  return store::Connection(part, store::OpenMode::read).integer("SELECT count(*) FROM " + table);
}

}  // namespace

TEST_CASE(
    "whichever byte of a closed part flips (a sample of them, all with --long), recover gives back all but one block, "
    "and says what is missing") {
  TempDir dir(memory_folder());
  const fs::path part = write_closed_part(dir / "log", 2, kPolls);
  for (const char* table : {"block", "gap", "event", "clock", "rollup", "summary", "manifest"}) {
    INFO(table);
    CHECK(rows_in(part, table) > 0);
  }
  sweep_part(part, {kPolls});
}

TEST_CASE(
    "whichever byte of a part that a kill left flips (a sample of them, all with --long), recover loses no more than "
    "one block, or one row and what is based on it") {
  TempDir dir(memory_folder());
  const fs::path part = write_killed_part(dir / "log", kPolls);
  for (const char* table : {"hot", "block", "gap", "event", "clock", "rollup"}) {
    INFO(table);
    CHECK(rows_in(part, table) > 0);
  }
  sweep_part(part, {kPolls, static_cast<std::size_t>(one_part_options().keyframe_every + kPollsPerCommit), true});
}

namespace {

/// Which page an overflow page leads to.
std::uint32_t link_of(const std::string& file, std::size_t page) {
  std::uint32_t link = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    link = link << 8U | static_cast<unsigned char>(file[(page - 1) * page_bytes_of(file) + i]);
  }
  return link;
}

/// Pages of the chain that begins here, if it ends.
std::size_t chain_length(const std::string& file, std::size_t page) {
  const std::size_t pages = file.size() / page_bytes_of(file);
  for (std::size_t length = 1; page >= 2 && page <= pages && length <= pages; ++length) {
    page = link_of(file, page);
    if (page == 0) {
      return length;
    }
  }
  return 0;
}

void write_over(const fs::path& file, std::uint64_t offset, const std::string& bytes) {
  std::fstream out(file, std::ios::in | std::ios::out | std::ios::binary);
  out.seekp(static_cast<std::streamoff>(offset));
  out << bytes;
}

void check_nothing_is_lost(const Contents& whole, const fs::path& log, const fs::path& target) {
  const std::vector<fs::path> logs{log};
  const Recovery said = recover(logs, target);
  CHECK_FALSE(said.problems.empty());
  CHECK(said.lost == 0);
  CHECK(fault_of(whole, target, said, {0}) == "");
  CHECK_FALSE(fs::exists(target / ".scavenged"));
}

}  // namespace

TEST_CASE("rows that a page of a part that is not closed has forgotten are named") {
  TempDir dir(memory_folder());
  const fs::path part = write_killed_part(dir / "log", kPolls);
  const std::string bytes = read_file(part);
  const std::size_t page_bytes = page_bytes_of(bytes);
  for (const char* table : {"gap", "event", "clock", "hot"}) {
    // The last leaf of the table, down the last links of interior pages.
    std::size_t page = 0;
    {
      store::Connection connection(part, store::OpenMode::read);
      page = static_cast<std::size_t>(
          connection.integer(std::string("SELECT rootpage FROM sqlite_schema WHERE name = '") + table + "'"));
    }
    const auto at = [&](std::size_t offset) {
      return static_cast<unsigned char>(bytes[(page - 1) * page_bytes + offset]);
    };
    while (at(0) == 5) {
      page = (std::size_t{at(8)} << 24U) + (std::size_t{at(9)} << 16U) + (std::size_t{at(10)} << 8U) + at(11);
    }
    INFO(table << " page " << page << " of " << int{at(4)} << " rows");
    REQUIRE(at(0) == 13);
    REQUIRE(at(4) > 1);
    write_over(part, (page - 1) * page_bytes + 4, std::string(1, static_cast<char>(at(4) - 1)));
    CHECK(verify_names(dir / "log"));
    write_over(part, 0, bytes);
    CHECK_FALSE(verify_names(dir / "log"));
  }
}

TEST_CASE(
    "small tables of a part that is not closed are sealed too: a wrong number of planned polls is named and mended") {
  TempDir dir(memory_folder());
  const fs::path part = write_killed_part(dir / "log", kPolls);
  const Contents whole = contents_of(dir / "log");
  int target = 0;
  for (const char* change : {"UPDATE stream SET planned = 1000000 WHERE session = 1", "UPDATE stream SET period_us = 7",
                             "UPDATE coverage SET last_us = 5", "UPDATE session SET t_start_us = 12",
                             "UPDATE robot SET name = 'other'", "UPDATE part SET counted_to = 1"}) {
    INFO(change);
    const std::string bytes = read_file(part);
    store::Connection(part, store::OpenMode::write).exec(change);
    fs::remove(part.string() + "-wal");
    CHECK(verify_names(dir / "log"));
    const fs::path recovered = dir / ("new" + std::to_string(++target));
    const Recovery said = recover(std::vector<fs::path>{dir / "log"}, recovered);
    CHECK(said.lost == 0);
    CHECK(fault_of(whole, recovered, said, {0}) == "");
    std::ofstream(part, std::ios::binary) << bytes;
  }
}

TEST_CASE("a block whose pages no longer lead to each other is put together again") {
  TempDir dir(memory_folder());
  Ledger ledger;
  {
    Workload work(dir / "log", ledger, one_part_options());
    work.begin(kT0, 1000);  // rows that come so fast make one large block
    record(work, 3000);
    work.end();
  }
  const fs::path part = dir / "log" / "part-000001.db";
  const Contents whole = contents_of(dir / "log");
  const std::string bytes = read_file(part);
  std::size_t page = 2;  // where the longest chain begins
  for (std::size_t other = 2; other <= bytes.size() / page_bytes_of(bytes); ++other) {
    page = chain_length(bytes, other) > chain_length(bytes, page) ? other : page;
  }
  REQUIRE(chain_length(bytes, page) > 1);
  int target = 0;
  for (const std::string& wrong : {std::string("\xFF\xFF\xFF\xFF"), std::string("\0\0\0\3", 4)}) {
    write_over(part, (page - 1) * page_bytes_of(bytes), wrong);
    INFO("page " << page << " leads to " << int{static_cast<unsigned char>(wrong[3])});
    CHECK(verify_names(dir / "log"));
    check_nothing_is_lost(whole, dir / "log", dir / ("new" + std::to_string(++target)));
  }
  // A copy of the row in a page that SQLite has left behind is the same block, not one more.
  const std::size_t page_bytes = page_bytes_of(bytes);
  std::string first;
  for (const unsigned shift : {24U, 16U, 8U, 0U}) {
    first += static_cast<char>(page >> shift & 0xFFU);
  }
  std::size_t leaf = 0;
  std::size_t link = std::string::npos;
  for (std::size_t at = bytes.find("TACHOBLK"); at != std::string::npos && link == std::string::npos;
       at = bytes.find("TACHOBLK", at + 1)) {
    leaf = at / page_bytes * page_bytes;
    const std::size_t found = bytes.find(first, at);
    link = found < leaf + page_bytes ? found : std::string::npos;
  }
  REQUIRE(link != std::string::npos);
  std::ofstream(part, std::ios::binary) << bytes << bytes.substr(leaf, page_bytes);
  write_over(part, link, "\xFF\xFF\xFF\xFF");
  check_nothing_is_lost(whole, dir / "log", dir / "new3");
}

TEST_CASE("a part that a kill left gives back its WAL also when the header of the file is gone") {
  // Of a few polls all is in the WAL; of more it has begun anew, and does not have the first page.
  for (const int polls : {20, 80}) {
    INFO(polls << " polls");
    TempDir dir;
    Ledger ledger;
    {
      Workload work(dir / "live", ledger, one_part_options());
      work.begin(kT0);
      record(work, polls);
      copy_as_killed(dir / "live", dir / "log");
    }
    const fs::path part = dir / "log" / "part-000001.db";
    REQUIRE(fs::file_size(part.string() + "-wal") > 0);
    const Contents whole = contents_of(dir / "log");
    REQUIRE(whole.answers.size() + whole.missed.size() == 2 * static_cast<std::size_t>(polls));
    fs::remove(part.string() + "-shm");
    write_over(part, 0, std::string(100, '\0'));
    const std::string before = read_file(part);
    const std::vector<fs::path> logs{dir / "log"};
    const Recovery said = recover(logs, dir / "new");
    CHECK(said.lost == 0);
    CHECK(fault_of(whole, dir / "new", said, {0}) == "");
    CHECK(read_file(part) == before);
  }
}
