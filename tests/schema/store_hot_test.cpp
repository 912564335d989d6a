// Hot rows: the answers of a stream between two commits are one row, and nobody who reads the log can tell.

#include <fmt/format.h>

#include <functional>
#include <random>

#include "schema/store/hot_codec.hpp"
#include "schema/store/sqlite.hpp"
#include "tests/schema/store_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

std::string random_bytes(std::mt19937_64& random, std::size_t count) {
  std::string bytes(count, '\0');
  for (char& c : bytes) {
    c = static_cast<char>(random());
  }
  return bytes;
}

/// Answers of two robots and three sources as they arrive: polls that are missing, clocks that step, bodies that
/// repeat, that are no JSON, that are empty, and headers.
std::vector<Answer> arrivals(std::size_t count) {
  std::mt19937_64 random(11);
  std::map<std::pair<RobotId, Source>, Answer> last;
  std::vector<Answer> out;
  Micros t = kT0;
  for (std::size_t i = 0; i < count; ++i) {
    t += static_cast<Micros>(random() % 300'000);
    const auto robot = static_cast<RobotId>(1 + random() % 2);
    const auto source = std::array{Source::status, Source::registers, Source::inputs}[random() % 3];
    Answer& answer = last.try_emplace({robot, source}, answer_of(1, robot, source, 0, t, body_of(i))).first->second;
    answer.meta.seq += 1 + (random() % 20 == 0 ? random() % 5 : 0);
    answer.meta.t_send_us = t - (random() % 50 == 0 ? 3 * kSecond : 0);
    answer.meta.t_recv_us = answer.meta.t_send_us + static_cast<Micros>(random() % 9000) - 50;
    answer.header = random() % 9 == 0 ? random_bytes(random, 16) : "";
    switch (random() % 8) {
      case 0:
        break;  // the same again
      case 1:
        answer.body = random_bytes(random, random() % 300);
        break;
      case 2:
        answer.body.clear();
        break;
      default:
        answer.body = body_of(random() % 5000);
    }
    out.push_back(answer);
  }
  return out;
}

/// Writes them, with a commit after each answer that `commits` wants one after. `end`: the session, so all moves into
/// blocks; else the log is one that a kill left.
void write_split(const fs::path& folder, const std::vector<Answer>& answers,
                 const std::function<bool(std::size_t)>& commits, bool end) {
  const fs::path live = end ? folder : fs::path(folder.string() + "-live");
  store::WriterOptions options;
  options.keyframe_every = 7;
  options.durable = false;
  store::LogWriter writer(live, options);
  Session session;
  session.t_start_us = kT0;
  writer.robot("amr-1", "10.0.0.1:19204:502");
  writer.robot("amr-2", "10.0.0.2:19204:502");
  writer.begin_session(session);
  for (const RobotId robot : {1U, 2U}) {
    for (const Source source : {Source::status, Source::registers, Source::inputs}) {
      writer.declare(stream_of(1, robot, source));
    }
  }
  for (std::size_t i = 0; i < answers.size(); ++i) {
    writer.append(answers[i]);
    if (commits(i)) {
      writer.commit();
    }
  }
  if (end) {
    writer.end_session(answers.back().meta.t_send_us, true);
  } else {
    writer.commit();
    copy_as_killed(live, folder);
  }
}

std::string text_of(const Answer& a) {
  return fmt::format("{} {} {} {} {} {} {} {}\n", a.meta.robot, source_name(a.meta.source), a.meta.session, a.meta.seq,
                     a.meta.t_send_us, a.meta.t_recv_us, a.header, a.body);
}

std::string answers_of(const fs::path& folder, RobotId robot) {
  std::string out;
  store::LogReader log = open_reader(folder);
  log.part_answers(0, robot, std::nullopt, [&](const Answer& a) { out += text_of(a); });
  CHECK(log.problems().empty());
  return out;
}

std::string columns_of(const fs::path& folder, RobotId robot) {
  std::map<Source, std::string> out;
  store::LogReader log = open_reader(folder);
  for (const Slice& slice : slices(log, robot, {}, {Source::status, Source::registers, Source::inputs})) {
    for (const Batch& batch : slice.batches) {
      const Column& x = *batch.find(field("x"));
      for (std::size_t i = 0; i < batch.rows(); ++i) {
        out[batch.source] += fmt::format("{} {} {} {} {}\n", batch.seq[i], batch.t_send_us[i], batch.t_recv_us[i],
                                         static_cast<int>(x.state[i]), x.has(i) ? x.real[i] : 0.0);
      }
    }
  }
  CHECK(log.problems().empty());
  return out[Source::status] + out[Source::registers] + out[Source::inputs];
}

std::int64_t number(const fs::path& part, const char* sql) {
  return store::Connection(part, store::OpenMode::read).integer(sql);
}

}  // namespace

TEST_CASE("however the same answers are split into commits, the same answers and columns come back in the same order") {
  const std::vector<Answer> answers = arrivals(600);
  std::mt19937_64 random(5);
  const std::vector<std::function<bool(std::size_t)>> splits{
      [](std::size_t) { return false; },
      [](std::size_t) { return true; },
      [](std::size_t i) { return i % 7 == 6; },
      [](std::size_t i) { return i == 300; },
      [&](std::size_t) { return random() % 3 == 0; },
      [&](std::size_t) { return random() % 40 == 0; },
  };
  std::map<RobotId, std::string> columns;
  for (std::size_t s = 0; s < splits.size(); ++s) {
    for (const bool end : {false, true}) {
      TempDir dir;
      write_split(dir / "log", answers, splits[s], end);
      INFO("split " << s << (end ? ", ended" : ", killed"));
      CHECK((number(part_files(dir / "log")[0], "SELECT count(*) FROM hot") == 0) == end);
      for (const RobotId robot : {1U, 2U}) {
        std::string expected;
        for (const Answer& answer : answers) {
          expected += answer.meta.robot == robot ? text_of(answer) : "";
        }
        CHECK(answers_of(dir / "log", robot) == expected);
        const std::string found = columns_of(dir / "log", robot);
        CHECK(columns.try_emplace(robot, found).first->second == found);
      }
    }
  }
}

TEST_CASE("counts and the place of the newest answer are exact after a kill, however the answers were split") {
  const std::vector<Answer> answers = arrivals(300);
  for (const std::size_t every : {1U, 4U, 100U, 1000U}) {
    TempDir dir;
    write_split(
        dir / "log", answers, [&](std::size_t i) { return i % every == every - 1; }, false);
    std::uint64_t stored_answers = 0;
    std::uint64_t bytes = 0;
    for (const Answer& answer : answers) {
      bytes += answer.body.size();
    }
    std::uint64_t stored_bytes = 0;
    for (const Coverage& coverage : open_reader(dir / "log").coverage()) {
      stored_answers += coverage.stored;
      stored_bytes += coverage.bytes;
    }
    INFO("a commit every " << every);
    CHECK(stored_answers == answers.size());
    CHECK(stored_bytes == bytes);
    const store::PartHead head = store::read_head(part_files(dir / "log")[0]);
    CHECK(head.ends.row == static_cast<std::int64_t>(answers.size()));
    { store::LogWriter writer(dir / "log"); }
    CHECK(number(part_files(dir / "log")[0], "SELECT counted_to FROM part") == head.ends.row);
  }
}

TEST_CASE("the answers of a stream between two commits are one row, but for more than are kept in memory") {
  TempDir dir;
  store::WriterOptions options;
  options.blocks = false;
  Recording recording(dir.path(), options);
  recording.writer.declare(stream_of(1, 1, Source::registers));
  for (std::uint64_t i = 0; i < 5; ++i) {
    recording.poll(body_of(i));
    recording.writer.append(answer_of(1, 1, Source::registers, i, recording.time(), body_of(i)));
  }
  recording.writer.commit();
  const fs::path part = part_files(dir.path())[0];
  CHECK(number(part, "SELECT count(*) FROM hot") == 2);
  CHECK(number(part, "SELECT min(rows) FROM hot") == 5);
  recording.polls(1000);
  recording.writer.commit();
  CHECK(number(part, "SELECT sum(rows) FROM hot") == 1010);
  CHECK(number(part, "SELECT max(rows) FROM hot") == 128);
  for (int i = 0; i < 8; ++i) {
    recording.poll(std::string(100'000, static_cast<char>('a' + i)));
  }
  recording.writer.commit();
  CHECK(number(part, "SELECT rows FROM hot ORDER BY id DESC LIMIT 1") == 2);
}

TEST_CASE("a row that repeats its base stores no bodies") {
  TempDir dir;
  Recording recording(dir.path());
  const std::string body(5000, 'x');
  for (int i = 0; i < 2; ++i) {
    recording.poll(body);
    recording.poll(body);
    recording.poll(body);
    recording.writer.commit();
  }
  CHECK(number(part_files(dir.path())[0], "SELECT length(data) FROM hot ORDER BY id DESC LIMIT 1") < 20);
  store::LogReader log = open_reader(dir.path());
  REQUIRE(stored(log).size() == 6);
  CHECK(stored(log).back().body == body);
}

TEST_CASE("a reader that was opened before rows moved reads the log as it was") {
  TempDir dir;
  Recording recording(dir.path());
  recording.polls(1000);
  recording.writer.commit();
  store::LogReader log = open_reader(dir.path());
  recording.polls(850);
  recording.writer.commit();  // half an hour: they move
  recording.polls(100);
  recording.writer.commit();
  CHECK(number(part_files(dir.path())[0], "SELECT min(id) FROM hot") == 1851);
  CHECK(stored(log).size() == 1000);
  CHECK(log.problems().empty());
}

namespace {

store::HotBatch random_batch(std::mt19937_64& random) {
  store::HotBatch batch;
  std::int64_t place = 10;
  Answer answer = answer_of(1, 1, Source::status, 3, kT0, body_of(1));
  for (std::uint64_t i = 0; i < 1 + random() % 9; ++i) {
    batch.add(place, answer);
    place += 1 + static_cast<std::int64_t>(random() % 400);
    answer.meta.seq += 1 + random() % 3;
    answer.meta.t_send_us += kSecond - static_cast<Micros>(random() % 3000);
    answer.meta.t_recv_us = answer.meta.t_send_us + static_cast<Micros>(random() % 5000);
    answer.body = random() % 3 == 0   ? answer.body
                  : random() % 4 == 0 ? random_bytes(random, random() % 90)
                                      : body_of(i);
    answer.header = random() % 4 == 0 ? random_bytes(random, random() % 20) : "";
  }
  return batch;
}

/// As it is stored: the other columns are those of the first answer.
store::HotRow row_of(const store::HotBatch& batch, std::string_view data) {
  store::HotRow row;
  row.id = batch.marks.front().place;
  row.seq = batch.marks.front().seq;
  row.t_send_us = batch.marks.front().t_send_us;
  row.rows = batch.marks.size();
  row.data = data;
  return row;
}

}  // namespace

TEST_CASE("the data of a row gives its answers back, and damaged data gives none or other ones, never more than fits") {
  std::mt19937_64 random(3);
  store::HotEncoder encoder;
  store::HotDecoder decoder;
  store::HotBatch out;
  for (int round = 0; round < 300; ++round) {
    const store::HotBatch batch = random_batch(random);
    const std::string base = random() % 2 == 0 ? body_of(1) : random_bytes(random, random() % 60);
    const std::string* prefix = random() % 3 == 0 ? nullptr : &base;
    const store::HotEncoder::Stored stored = encoder.encode(batch, prefix);
    std::string data(stored.data);
    prefix = stored.needs_base ? prefix : nullptr;
    const auto packed = store::read_marks(row_of(batch, data), out.marks);
    REQUIRE(packed);
    REQUIRE(decoder.unpack(*packed, prefix, out.bodies));
    REQUIRE(out.marks.size() == batch.marks.size());
    for (std::size_t i = 0; i < batch.marks.size(); ++i) {
      Answer was;
      Answer is;
      batch.fill(batch.marks[i], was);
      out.fill(out.marks[i], is);
      CHECK(text_of(is) == text_of(was));
      CHECK(out.marks[i].place == batch.marks[i].place);
    }
    data[random() % data.size()] ^= static_cast<char>(1U << random() % 8);
    data.resize(data.size() - (random() % 4 == 0 ? random() % data.size() : 0));
    if (const auto other = store::read_marks(row_of(batch, data), out.marks)) {
      CHECK(other->total <= store::kMaxBodyBytes);
      CHECK_NOTHROW(decoder.unpack(*other, prefix, out.bodies));
    }
  }
}
