// Bytes of a closed part turned, one at a time: reading gives the same, or names the damage; never a wrong answer.

#include <fmt/format.h>

#include "tests/schema/flip_sweep.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

/// All that a reader gets out of a log, as text; `wrong` is set when an answer is not what was recorded.
struct Reading {
  std::string text;
  std::string wrong;
  bool named = false;  ///< damage, in problems() or as an Error
};

void print_head(const store::LogReader& log, std::string& out) {
  for (const Robot& r : log.robots()) {
    out += fmt::format("robot {} {} {} {} {} {} {}\n", r.id, r.name, r.address, r.vehicle_id, r.mac, r.model_md5,
                       r.firmware);
  }
  for (const Session& s : log.sessions()) {
    out += fmt::format("session {} {} {} {} {} {} {}\n", s.id, s.t_start_us, s.t_end_us, s.clean, s.software, s.config,
                       s.host);
  }
  for (const Stream& s : log.streams()) {
    out += fmt::format("stream {} {} {} {} {} {} {}\n", s.session, s.robot, source_name(s.source), s.period_us,
                       word_order_name(s.word_order), s.request, s.planned.value_or(0));
  }
  for (const Coverage& c : log.coverage()) {
    out +=
        fmt::format("coverage {} {} {} {} {} {} {} {} {} {} {}\n", c.robot, source_name(c.source), c.planned, c.stored,
                    c.missed, c.partial, c.undecodable, c.bytes, c.first_us, c.last_us, c.seen.to_string());
  }
  for (const UnknownKey& k : log.unknown_keys()) {
    out += fmt::format("key {} {} {} {}\n", k.robot, source_name(k.source), k.key, k.first_us);
  }
}

void print_records(const Slice& slice, std::string& out) {
  for (const Gap& g : slice.gaps) {
    out += fmt::format("gap {} {} {} {} {} {} {} {}\n", g.session, source_name(g.source), g.seq_from, g.seq_count,
                       g.t_from_us, g.t_to_us, cause_name(g.cause), g.detail);
  }
  for (const Event& e : slice.events) {
    out += fmt::format("event {} {} {} {} {}\n", e.session, event_kind_name(e.kind), e.seq, e.t_us, e.subject);
  }
  for (const ClockPoint& c : slice.clock) {
    out += fmt::format("clock {} {} {}\n", c.session, c.wall_us, c.mono_us);
  }
}

Reading read_everything(const fs::path& folder) {
  Reading out;
  try {
    store::LogReader log = open_reader(folder);
    print_head(log, out.text);
    Selection selection;
    for (const Source source : kWorkloadSources) {
      selection.add(source, field("x"));
      log.read_raw(1, source, {}, [&](const Answer& a) {
        out.text += fmt::format("answer {} {} {} {} {}\n", a.meta.session, source_name(source), a.meta.seq,
                                a.meta.t_send_us, a.meta.t_recv_us);
        if (a.meta.session != 1 || a.body != answer_body(1, source, a.meta.seq)) {
          out.wrong = detail::named(a.meta.session, source, a.meta.seq);
        }
      });
    }
    log.read(1, {}, selection, [&](const Slice& slice) { print_records(slice, out.text); });
    out.named = !log.problems().empty();
  } catch (const Error& error) {
    out.text = error.what();
    out.named = true;
  }
  return out;
}

/// All of the file header, head and first cells of a page every 4096 bytes, and a sample of the rest.
bool in_sample(std::uint64_t offset) { return offset < 100 || offset % 4096 < 12 || offset % 151 == 0; }

}  // namespace

TEST_CASE(
    "whichever byte of a closed part flips (a sample of them, all with --long), reading gives the same or names the "
    "damage") {
  TempDir dir(memory_folder());
  const fs::path part = write_closed_part(dir / "log", 1, 40);
  const Reading whole = read_everything(dir / "log");
  REQUIRE_FALSE(whole.named);
  REQUIRE(whole.wrong == "");
  std::vector<std::uint64_t> offsets;
  for (std::uint64_t offset = 0; offset < fs::file_size(part); ++offset) {
    if (every_byte() || in_sample(offset)) {
      offsets.push_back(offset);
    }
  }
  const Sweep swept = sweep(part, offsets, [&](const fs::path& folder) {
    const Reading now = read_everything(folder);
    const bool silent = !now.named && now.text != whole.text;
    return Consequence{now.named, !now.wrong.empty() ? "wrong: " + now.wrong : silent ? "read otherwise, unnamed" : ""};
  });
  CHECK(joined(swept.faults) == "");
  CHECK(swept.flips == offsets.size());
  CHECK(swept.named > swept.flips / 10);
}
