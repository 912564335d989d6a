// Slices: every row, gap and event exactly once, in order, however the log is cut.

#include <numeric>
#include <set>

#include "tests/schema/store_fixture.hpp"

using namespace tacho;
using namespace tacho::test;

namespace {

Event event_at(const Recording& recording, Micros t_us, const std::string& subject) {
  Event event;
  event.robot = recording.robot;
  event.session = recording.session;
  event.t_from_us = event.t_us = t_us;
  event.subject = subject;
  return event;
}

struct Tally {
  std::vector<std::pair<SessionId, std::uint64_t>> rows;
  std::vector<std::uint64_t> gaps;
  std::multiset<std::string> events;
};

Tally tally(const std::vector<Slice>& out) {
  Tally all;
  for (const Slice& slice : out) {
    for (const Batch& batch : slice.batches) {
      for (const std::uint64_t seq : batch.seq) {
        all.rows.emplace_back(slice.session, seq);
      }
    }
    for (const Gap& gap : slice.gaps) {
      CHECK(gap.session == slice.session);
      all.gaps.push_back(gap.seq_from);
    }
    for (const Event& event : slice.events) {
      CHECK(event.session == slice.session);
      all.events.insert(event.subject);
    }
  }
  return all;
}

}  // namespace

TEST_CASE("decoded values stand in the columns that were asked for") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.poll("{\"x\":1.5}");
    recording.poll("not JSON");
    recording.poll("{\"x\":-0.25}");
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  const std::vector<Slice> out = slices(log);
  REQUIRE(out.size() == 1);
  const Batch* batch = out[0].find(Source::status);
  REQUIRE(batch != nullptr);
  const Column* x = batch->find(field("x"));
  REQUIRE(x != nullptr);
  CHECK(batch->columns.size() == 1);
  CHECK(x->real[0] == 1.5);
  CHECK_FALSE(x->has(1));
  CHECK(x->real[2] == -0.25);
  CHECK(batch->t_recv_us[2] == kT0 + 2 * kSecond + 4000);
}

TEST_CASE("a slice is cut when the session changes, after an hour, after 4096 rows, and at the end of a part") {
  TempDir dir;
  store::WriterOptions options;
  options.durable = false;
  {
    Recording recording(dir.path(), options);
    recording.polls(9000);  // 2.5 h
    recording.end();
  }
  {
    Recording recording(dir.path(), options, kT0 + 10'000 * kSecond);
    recording.polls(10);
    recording.end();
  }
  {
    Recording recording(dir.path(), options, kT0 + kDay - 3 * kSecond);
    recording.polls(6);
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  const std::vector<Slice> out = slices(log);
  std::vector<std::size_t> rows;
  for (const Slice& slice : out) {
    REQUIRE(slice.batches.size() == 1);
    rows.push_back(slice.batches[0].rows());
    CHECK(slice.batches[0].t_send_us.back() - slice.batches[0].t_send_us.front() <= 3600 * kSecond);
  }
  // How blocks divide the first session is theirs.
  REQUIRE(rows.size() > 3);
  CHECK(std::vector<std::size_t>(rows.end() - 3, rows.end()) == std::vector<std::size_t>{10, 3, 3});
  CHECK(std::accumulate(rows.begin(), rows.end() - 3, std::size_t{0}) == 9000);
  CHECK(rows.size() <= 3 + 8);
  const Tally all = tally(out);
  CHECK(all.rows.size() == 9016);
  CHECK(std::is_sorted(all.rows.begin(), all.rows.end()));
}

TEST_CASE("fast sources are cut by rows, and each source keeps its own batch") {
  TempDir dir;
  store::WriterOptions options;
  options.durable = false;
  {
    Recording recording(dir.path(), options);
    store::LogWriter& w = recording.writer;
    w.declare(stream_of(1, 1, Source::io, 10'000));
    for (std::uint64_t i = 0; i < 10'000; ++i) {
      const Micros t = kT0 + static_cast<Micros>(i) * 10'000;
      w.append(answer_of(1, 1, Source::io, i, t, "{\"x\":1}"));
      if (i % 100 == 0) {
        recording.polls(1);
      }
    }
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  const std::vector<Slice> out = slices(log, 1, {}, {Source::status, Source::io});
  REQUIRE(out.size() == 3);
  std::size_t status = 0;
  std::size_t io = 0;
  for (const Slice& slice : out) {
    status += slice.find(Source::status)->rows();
    io += slice.find(Source::io)->rows();
    CHECK(slice.find(Source::io)->rows() <= 4096);
  }
  CHECK(status == 100);
  CHECK(io == 10'000);
  CHECK(slices(log, 1, {}, {Source::status}).size() == 1);
}

TEST_CASE("gaps and events come out exactly once, also before, after and without rows") {
  TempDir dir;
  {
    Recording recording(dir.path());
    recording.writer.add(event_at(recording, kT0 - 10 * kSecond, "before"));
    recording.miss(5);
    for (int i = 0; i < 4; ++i) {
      recording.polls(1500);
      recording.writer.add(event_at(recording, recording.time(), "step " + std::to_string(i)));
      recording.miss(10);
    }
    recording.writer.add(event_at(recording, recording.time() + 10'000 * kSecond, "after"));
    recording.miss(50);
    recording.end();
  }
  {
    Recording nothing_but_gaps(dir.path(), {}, kT0 + 20'000 * kSecond);
    nothing_but_gaps.miss(7);
    nothing_but_gaps.writer.add(event_at(nothing_but_gaps, kT0 + 20'001 * kSecond, "alone"));
    nothing_but_gaps.end();
  }
  {
    Recording recording(dir.path(), {}, kT0 + 30'000 * kSecond);
    recording.polls(3);
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  const std::vector<Slice> out = slices(log);
  const Tally all = tally(out);
  CHECK(all.rows.size() == 6003);
  CHECK(all.gaps.size() == 6 + 1 + 2);  // two recorder_off
  CHECK(all.events == std::multiset<std::string>{"before", "after", "step 0", "step 1", "step 2", "step 3", "alone"});
  std::vector<SessionId> order;
  for (const Slice& slice : out) {
    order.push_back(slice.session);
  }
  CHECK(std::is_sorted(order.begin(), order.end()));
  CHECK(order.front() == 1);
  CHECK(order.back() == 3);

  // Each in the slice of its time: not later than the last row of its slice, unless it is the last of its session.
  for (std::size_t i = 0; i + 1 < out.size(); ++i) {
    if (out[i].session == out[i + 1].session) {
      for (const Event& event : out[i].events) {
        CHECK(event.t_us < out[i + 1].batches[0].t_send_us.front());
      }
    }
  }
  const Coverage coverage = coverage_of(log);
  CHECK(coverage.stored + coverage.missed == coverage.planned);
  CHECK(coverage.missed == 5 + 40 + 50 + 7);
}

TEST_CASE("order is session and poll number, whatever the clock did") {
  TempDir dir;
  {
    Recording recording(dir.path());
    for (const Micros step : {0, 100, 50, -4000, 7200, 3}) {
      recording.writer.append(
          answer_of(1, 1, Source::status, recording.next, kT0 + 50'000 * kSecond + step * kSecond, "{\"x\":1}"));
      recording.writer.add(event_at(recording, kT0 + 50'000 * kSecond + step * kSecond, std::to_string(step)));
      ++recording.next;
    }
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  const Tally all = tally(slices(log));
  REQUIRE(all.rows.size() == 6);
  for (std::uint64_t i = 0; i < 6; ++i) {
    CHECK(all.rows[i].second == i);
  }
  CHECK(all.events.size() == 6);
}

TEST_CASE("a window yields exactly its rows, from whatever keyframe they need") {
  TempDir dir;
  store::WriterOptions options;
  options.keyframe_every = 25;
  {
    Recording recording(dir.path(), options);
    recording.polls(300);
    recording.miss(20);
    recording.polls(100);
    recording.end();
  }
  store::LogReader log = open_reader(dir.path());
  const std::vector<Stored> all = stored(log);
  for (std::int64_t from = 0; from < 420; from += 17) {
    for (const std::int64_t length : {0, 1, 2, 40, 200}) {
      const Window window{kT0 + from * kSecond, kT0 + (from + length) * kSecond};
      std::vector<Stored> expected;
      for (const Stored& row : all) {
        if (window.contains(row.t_us)) {
          expected.push_back(row);
        }
      }
      INFO("from " << from << " length " << length);
      CHECK(stored(log, 1, Source::status, window) == expected);
    }
  }
  std::vector<Gap> gaps;
  for (const Slice& slice : slices(log, 1, {kT0 + 310 * kSecond, kT0 + 311 * kSecond})) {
    CHECK(slice.batches.empty());
    gaps.insert(gaps.end(), slice.gaps.begin(), slice.gaps.end());
  }
  REQUIRE(gaps.size() == 1);
  CHECK(gaps[0].seq_from == 300);
  CHECK(slices(log, 1, {kT0 - 100, kT0 - 50}).empty());
  CHECK(slices(log, 99).empty());
}

TEST_CASE("the decoder is handed the stream of the row and the flags of the inputs") {
  TempDir dir;
  {
    Recording recording(dir.path());
    store::LogWriter& w = recording.writer;
    w.declare(stream_of(1, 1, Source::registers));
    w.declare(stream_of(1, 1, Source::inputs));
    w.set_word_order(1, Source::registers, WordOrder::badc);
    for (std::uint64_t i = 0; i < 3; ++i) {
      const Micros t = kT0 + static_cast<Micros>(i) * kSecond;
      w.append(answer_of(1, 1, Source::inputs, i, t, "inputs"));
      w.append(answer_of(1, 1, Source::registers, i, t + 1, "registers"));
    }
    recording.end();
  }
  int inputs = 0;
  const auto decode = [&](const Answer& answer, const Stream& stream, const FieldSet& wanted, Gates&, Sample& out) {
    out.clear();
    CHECK(stream.source == answer.meta.source);
    if (answer.meta.source == Source::inputs) {
      ++inputs;
      CHECK(wanted[field("blocked")]);
      out.cells[field("blocked")] = {State::present, 0.0, 1};
    } else {
      CHECK(stream.word_order == WordOrder::badc);
      CHECK(answer.body == "registers");
      out.cells[field("block_reason")] = {State::present, 0.0, 2};
    }
  };
  const std::vector<std::filesystem::path> paths{dir.path()};
  store::LogReader log(paths, {decode, {}});
  Selection selection;
  selection.add(Source::registers, field("block_reason"));
  std::size_t batches = 0;
  log.read(1, {}, selection, [&](const Slice& slice) {
    batches += slice.batches.size();
    CHECK(slice.batches.front().columns.front().state == std::vector<State>(3, State::present));
  });
  CHECK(batches == 1);
  CHECK(inputs == 3);
}

TEST_CASE("flags of the inputs count for registers until the inputs have a gap, and again after it") {
  TempDir dir;
  {
    Recording recording(dir.path());
    store::LogWriter& w = recording.writer;
    w.declare(stream_of(1, 1, Source::registers));
    w.declare(stream_of(1, 1, Source::inputs));
    for (std::uint64_t i = 0; i < 9; ++i) {
      const Micros t = kT0 + static_cast<Micros>(i) * kSecond;
      if (i == 3) {
        w.add(gap_of(1, 1, Source::inputs, 3, 2, t));
      } else if (i != 4) {
        w.append(answer_of(1, 1, Source::inputs, i, t, "inputs"));
      }
      w.append(answer_of(1, 1, Source::registers, i, t + 1, "registers"));
    }
    Gap partial = gap_of(1, 1, Source::inputs, 8, 1, kT0 + 8 * kSecond);
    partial.partial = true;
    w.add(partial);
    recording.end();
  }
  const auto decode = [&](const Answer& answer, const Stream&, const FieldSet&, Gates&, Sample& out) {
    out.clear();
    const bool flags = answer.meta.source == Source::inputs;
    out.cells[flags ? field("blocked") : field("block_reason")] = {State::present, 0.0, 1};
  };
  const std::vector<std::filesystem::path> paths{dir.path()};
  store::LogReader log(paths, {decode, {}});
  Selection selection;
  selection.add(Source::registers, field("block_reason"));
  std::vector<bool> known;
  log.read(1, {}, selection, [&](const Slice& slice) {
    for (const Batch& batch : slice.batches) {
      for (const State state : batch.columns.front().state) {
        known.push_back(state == State::present);
      }
    }
  });
  CHECK(known == std::vector<bool>{true, true, true, false, false, true, true, true, true});
}
