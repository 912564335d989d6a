// Blocks read as columns give what their answers, decoded one by one, give.

#include <bit>
#include <random>

#include "samples/simulator/write.hpp"
#include "schema/log.hpp"
#include "schema/store/log_reader.hpp"
#include "schema/wire/registers.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

constexpr Micros kT0 = 1'767'225'600'000'000;  // 2026-01-01T00:00:00Z
constexpr Micros kSecond = 1'000'000;

/// Reads the log with the decoder of answers alone.
store::LogReader row_by_row(const fs::path& log) {
  const auto decoder = std::make_shared<AnswerDecoder>();
  return store::LogReader(
      std::vector<fs::path>{log},
      {[decoder](const Answer& answer, const Stream& stream, const FieldSet& wanted, Gates& gates, Sample& out) {
         decoder->decode(answer, stream.word_order, wanted, false, gates, out);
       },
       {}});
}

std::vector<Slice> slices(RowSource& log, RobotId robot, Window window, const Selection& selection) {
  std::vector<Slice> out;
  log.read(robot, window, selection, [&](const Slice& slice) { out.push_back(slice); });
  return out;
}

void check_column(const Batch& a, const Batch& b, const Column& left, const Column& right) {
  const Field& field = kFields[left.field];
  INFO(source_name(a.source) << " " << field.name);
  REQUIRE(left.field == right.field);
  REQUIRE(left.state.size() == a.rows());
  REQUIRE(right.state.size() == a.rows());
  const bool text = field.kind == Kind::text || field.kind == Kind::list || field.kind == Kind::structured;
  const auto same = [&](std::size_t row) {
    return left.state[row] == right.state[row] &&
           (field.kind == Kind::real
                ? std::bit_cast<std::uint64_t>(left.real[row]) == std::bit_cast<std::uint64_t>(right.real[row])
            : text ? a.text(left, row) == b.text(right, row)
                   : left.integer[row] == right.integer[row]);
  };
  for (std::size_t row = 0; row < a.rows(); ++row) {
    if (!same(row)) {
      FAIL("row " << row << " poll " << a.seq[row] << " " << state_name(left.state[row]) << " and "
                  << state_name(right.state[row]));
    }
  }
}

void check_lists(const Batch& a, const Batch& b) {
  REQUIRE(a.alarm_begin == b.alarm_begin);
  REQUIRE(a.point_begin == b.point_begin);
  REQUIRE(a.alarms_incomplete == b.alarms_incomplete);
  REQUIRE(a.alarms.size() == b.alarms.size());
  for (std::size_t i = 0; i < a.alarms.size(); ++i) {
    const AlarmItem& left = a.alarms[i];
    const AlarmItem& right = b.alarms[i];
    REQUIRE(left.level == right.level);
    REQUIRE(left.code == right.code);
    REQUIRE(left.stamp_s == right.stamp_s);
    REQUIRE(left.times == right.times);
    REQUIRE(a.texts.at(left.desc) == b.texts.at(right.desc));
    REQUIRE(a.texts.at(left.solution) == b.texts.at(right.solution));
  }
  REQUIRE(a.points.size() == b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    const IoPoint& left = a.points[i];
    const IoPoint& right = b.points[i];
    REQUIRE(left.output == right.output);
    REQUIRE(left.status == right.status);
    REQUIRE(left.valid == right.valid);
    REQUIRE(left.id == right.id);
    REQUIRE(a.texts.at(left.source) == b.texts.at(right.source));
  }
}

/// Number of rows compared.
std::size_t check_same(const std::vector<Slice>& a, const std::vector<Slice>& b) {
  std::size_t rows = 0;
  REQUIRE(a.size() == b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    INFO("slice " << i);
    REQUIRE(a[i].session == b[i].session);
    REQUIRE(a[i].gaps.size() == b[i].gaps.size());
    REQUIRE(a[i].events.size() == b[i].events.size());
    REQUIRE(a[i].clock.size() == b[i].clock.size());
    REQUIRE(a[i].batches.size() == b[i].batches.size());
    for (std::size_t j = 0; j < a[i].batches.size(); ++j) {
      const Batch& left = a[i].batches[j];
      const Batch& right = b[i].batches[j];
      REQUIRE(left.source == right.source);
      REQUIRE(left.seq == right.seq);
      REQUIRE(left.t_send_us == right.t_send_us);
      REQUIRE(left.t_recv_us == right.t_recv_us);
      REQUIRE(left.columns.size() == right.columns.size());
      for (std::size_t c = 0; c < left.columns.size(); ++c) {
        check_column(left, right, left.columns[c], right.columns[c]);
      }
      check_lists(left, right);
      rows += left.rows();
    }
  }
  return rows;
}

Selection everything() {
  Selection selection;
  for (FieldSet& fields : selection.fields) {
    fields.set();
  }
  selection.rows.fill(true);
  return selection;
}

/// Rows of both readings, compared.
std::size_t check_log(const fs::path& log, const Selection& selection, Window window = {}) {
  const auto columns = open_log(std::vector<fs::path>{log});
  store::LogReader rows = row_by_row(log);
  std::size_t compared = 0;
  for (const Robot& robot : columns->robots()) {
    compared += check_same(slices(*columns, robot.id, window, selection), slices(rows, robot.id, window, selection));
  }
  CHECK(columns->problems().empty());
  CHECK(rows.problems().empty());
  return compared;
}

/// 40 minutes of a busy robot: blocks and hot rows, a gap of the inputs, two parts.
const fs::path& simulated_log() {
  static const TempDir dir;
  static const fs::path log = [] {
    sim::WriteOptions options;
    options.duration_us = 2400 * kSecond;
    options.status_period_us = 2 * kSecond;
    options.io_period_us = 5 * kSecond;
    options.registers_period_us = kSecond / 2;
    options.inputs_period_us = kSecond;
    options.t0_us = kT0 + 86'400 * kSecond - 1500 * kSecond;
    Gap gap;
    gap.robot = 1;
    gap.source = Source::inputs;
    gap.t_from_us = options.t0_us + 500 * kSecond;
    gap.t_to_us = options.t0_us + 560 * kSecond;
    gap.cause = Cause::timeout;
    options.gaps = {gap};
    sim::write_log({sim::busy_day(1)}, options, dir / "log");
    return dir / "log";
  }();
  return log;
}

/// A log of given bodies, a second apart, so many that most of them are in blocks.
class OddLog {
 public:
  explicit OddLog(const fs::path& folder) : writer_(folder) {
    Session start;
    start.t_start_us = kT0;
    robot_ = writer_.robot("odd", "127.0.0.1:19204:502");
    session_ = writer_.begin_session(start);
    for (std::size_t s = 0; s < kSourceCount; ++s) {
      Stream stream;
      stream.session = session_;
      stream.robot = robot_;
      stream.source = static_cast<Source>(s);
      stream.period_us = kSecond;
      writer_.declare(stream);
    }
  }
  void add(Source source, std::string body) {
    const Micros t = kT0 + rows_++ * kSecond / 2;
    writer_.append({{robot_, source, session_, seq_[static_cast<std::size_t>(source)]++, t, t + 2000}, body, {}});
    if (rows_ % 100 == 0) {
      writer_.commit();
    }
  }
  void miss_inputs() {
    Gap gap;
    gap.robot = robot_;
    gap.source = Source::inputs;
    gap.session = session_;
    gap.seq_from = seq_[3]++;
    gap.seq_count = 1;
    gap.t_from_us = gap.t_to_us = kT0 + rows_ * kSecond / 2;
    writer_.add(gap);
  }
  void word_order(WordOrder order) { writer_.set_word_order(robot_, Source::registers, order); }
  void end() {
    writer_.commit();
    writer_.end_session(kT0 + rows_ * kSecond, true);
  }

 private:
  store::LogWriter writer_;
  RobotId robot_ = 0;
  SessionId session_ = 0;
  Micros rows_ = 0;
  std::array<std::uint64_t, kSourceCount> seq_{};
};

class Dice {
 public:
  explicit Dice(unsigned seed) : engine_(seed) {}
  std::size_t below(std::size_t n) { return engine_() % n; }
  bool one_in(std::size_t n) { return below(n) == 0; }
  template <class List>
  auto& of(const List& list) {
    return list[below(list.size())];
  }

 private:
  std::mt19937 engine_;
};

std::string odd_value(Dice& dice) {
  static const std::vector<std::string> kValues{"1",
                                                "0",
                                                "-0",
                                                "-0.0",
                                                "-1",
                                                "-1.0",
                                                "5.0",
                                                "7.5",
                                                "1e-05",
                                                "true",
                                                "false",
                                                "null",
                                                "\"3\"",
                                                "\"\\u00e9\\/\"",
                                                "[]",
                                                "[1,2]",
                                                "[{\"50000\":1700000000,\"desc\":\"x\"}]",
                                                "[{\"code\":54001,\"timestamp\":3,\"times\":2}]",
                                                "[{\"id\":3,\"status\":true,\"source\":\"normal\",\"valid\":false}]",
                                                "[true,false]",
                                                "[\"text\"]",
                                                "{}",
                                                "{\"errors\":[{\"code\":7}],\"desc\":\"d\",\"status\":2}",
                                                "{\"a\":[1]}",
                                                "9007199254740993",
                                                "18446744073709551615",
                                                "1e400",
                                                "\"\\ud800\"",
                                                "2026-11-01"};
  return dice.of(kValues);
}

/// An object with some fields of the table, some junk, now and then a key twice.
std::string odd_answer(Dice& dice) {
  if (dice.one_in(200)) {
    return "junk";
  }
  std::string body = "{";
  const std::size_t keys = dice.below(25);
  for (std::size_t i = 0; i < keys; ++i) {
    const Field& field = dice.of(kFields);
    std::string key(!field.json.former_key.empty() && dice.one_in(2) ? field.json.former_key : field.json.key);
    std::string value = odd_value(dice);
    if (const std::size_t dot = key.find('.'); dot != std::string::npos && !dice.one_in(4)) {
      value = "{\"" + key.substr(dot + 1) + "\":" + value + "}";
      key.resize(dot);
    }
    body += (body.size() > 1 ? ",\"" : "\"") + (key.empty() ? "junk" : key) + "\":" + value;
  }
  return body + "}";
}

std::string odd_image(Dice& dice, bool discrete) {
  std::string image;
  std::uint16_t first = static_cast<std::uint16_t>(1 + dice.below(4));
  const std::size_t ranges = 1 + dice.below(3);
  for (std::size_t i = 0; i < ranges; ++i) {
    const wire::Range range{first, static_cast<std::uint16_t>(1 + dice.below(90))};
    std::vector<std::uint16_t> words(range.count);
    std::vector<std::uint8_t> bits(range.count);
    for (std::size_t k = 0; k < range.count; ++k) {
      words[k] = static_cast<std::uint16_t>(dice.one_in(3) ? dice.below(65536) : 0);
      bits[k] = dice.one_in(2) ? 1 : 0;
    }
    discrete ? wire::append_bits(image, range, bits) : wire::append_words(image, range, words);
    first = static_cast<std::uint16_t>(first + (dice.one_in(8) ? 0 : range.count + dice.below(3)));
  }
  return dice.one_in(300) ? image.substr(0, image.size() - 1) : image;
}

}  // namespace

TEST_CASE("a simulated log reads the same as columns and row by row, every field of every source") {
  CHECK(check_log(simulated_log(), everything()) > 8000);
}

TEST_CASE("any choice of sources, fields and time reads the same as columns and row by row") {
  Dice dice(4);
  for (int round = 0; round < 12; ++round) {
    Selection selection;
    for (std::size_t s = 0; s < kSourceCount; ++s) {
      for (std::size_t i = dice.below(5); i > 0; --i) {
        selection.add(static_cast<Source>(s), static_cast<FieldIndex>(dice.below(kFieldCount)));
      }
    }
    const Micros from = kT0 + 86'400 * kSecond - static_cast<Micros>(dice.below(1500)) * kSecond;
    INFO("round " << round);
    check_log(simulated_log(), selection, {from, from + static_cast<Micros>(dice.below(2000)) * kSecond});
  }
}

TEST_CASE("flags of the inputs gate registers that are read as columns") {
  Selection selection;
  selection.add(Source::registers, field("block_reason"));
  const auto log = open_log(std::vector<fs::path>{simulated_log()});
  std::map<State, std::size_t> states;
  for (const Slice& slice : slices(*log, 1, {}, selection)) {
    CHECK(slice.find(Source::inputs) == nullptr);
    for (const State state : slice.batches.front().columns.front().state) {
      ++states[state];
    }
  }
  CHECK(states[State::present] > 0);
  CHECK(states[State::not_meaningful] > 0);
}

TEST_CASE("law: a window reads its rows as the whole log does, whatever inputs before it say") {
  Selection selection;
  selection.add(Source::registers, field("block_reason"));
  const auto log = open_log(std::vector<fs::path>{simulated_log()});
  const auto read = [&](Window window) {
    std::vector<std::pair<Micros, State>> out;
    log->read(1, window, selection, [&](const Slice& slice) {
      const Batch& batch = *slice.find(Source::registers);
      for (std::size_t row = 0; row < batch.rows(); ++row) {
        out.emplace_back(batch.t_send_us[row], batch.columns.front().state[row]);
      }
    });
    return out;
  };
  const std::vector<std::pair<Micros, State>> all = read({});
  const auto meaning =
      std::find_if(all.begin(), all.end(), [](const auto& row) { return row.second == State::present; });
  REQUIRE(meaning != all.end());
  Dice dice(5);
  for (int round = 0; round < 40; ++round) {
    // Half of them begin where the robot is blocked.
    const Micros from = round % 2 == 0 ? all[dice.below(all.size())].first : meaning->first + round * kSecond / 8;
    const Window window{from, from + static_cast<Micros>(dice.below(600)) * kSecond};
    std::vector<std::pair<Micros, State>> expected;
    std::copy_if(all.begin(), all.end(), std::back_inserter(expected),
                 [&](const auto& row) { return window.contains(row.first); });
    INFO("round " << round);
    CHECK(read(window) == expected);
  }
}

TEST_CASE("odd answers read the same as columns and row by row") {
  for (const unsigned seed : {1U, 2U, 3U}) {
    TempDir dir;
    Dice dice(seed);
    OddLog log(dir / "log");
    // Few kinds of answers, so that they share shapes; now and then a new one.
    std::vector<std::string> kinds;
    for (int row = 0; row < 1500; ++row) {
      if (kinds.size() < 30 || dice.one_in(20)) {
        kinds.push_back(odd_answer(dice));
      }
      log.add(dice.one_in(4) ? Source::io : Source::status, dice.of(kinds));
    }
    log.end();
    INFO("seed " << seed);
    CHECK(check_log(dir / "log", everything()) == 1500);
  }
}

TEST_CASE("odd register images read the same as columns and row by row, whatever word order is learnt later") {
  for (const unsigned seed : {1U, 2U, 3U}) {
    TempDir dir;
    Dice dice(seed);
    OddLog log(dir / "log");
    std::vector<std::string> words;
    std::vector<std::string> bits;
    for (int row = 0; row < 2600; ++row) {
      if (words.size() < 5 || dice.one_in(200)) {
        words.push_back(odd_image(dice, false));
        bits.push_back(odd_image(dice, true));
      }
      if (dice.one_in(3)) {
        log.add(Source::inputs, dice.of(bits));
      } else {
        log.add(Source::registers, dice.of(words));
      }
      if (dice.one_in(300)) {
        log.miss_inputs();
      }
      if (row == 2400 && seed == 2) {
        log.word_order(WordOrder::badc);
      }
    }
    log.end();
    INFO("seed " << seed);
    CHECK(check_log(dir / "log", everything()) == 2600);
  }
}
