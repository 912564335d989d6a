#pragma once
// Answers in, block out, answers back.

#include <string>
#include <utility>
#include <vector>

#include "schema/store/block/block_decoder.hpp"
#include "schema/store/block/block_encoder.hpp"
#include "tests/support/catch.hpp"

namespace tacho::test {

inline constexpr Micros kBlockStart = 1'767'225'600'000'000;

inline Answer answer_of(std::string body, std::size_t row, Source source = Source::status) {
  Answer answer;
  const Micros send = kBlockStart + static_cast<Micros>(row) * 1'000'000 + static_cast<Micros>(row * 7919 % 211);
  answer.meta = {3, source, 2, 100 + row, send, send + 4000 + static_cast<Micros>(row * 31 % 97)};
  answer.body = std::move(body);
  return answer;
}

inline std::vector<Answer> answers_of(const std::vector<std::string>& bodies, Source source = Source::status) {
  std::vector<Answer> answers;
  for (const std::string& body : bodies) {
    answers.push_back(answer_of(body, answers.size(), source));
  }
  return answers;
}

struct Encoded {
  std::string block;
  store::BlockEncoder::Stats stats;
};

/// One block of all the answers.
inline Encoded encode(const std::vector<Answer>& answers, WordOrder order = WordOrder::cdab) {
  store::BlockEncoder encoder({answers.size(), 3, order});
  for (const Answer& answer : answers) {
    REQUIRE(encoder.add(answer));
  }
  Encoded encoded;
  encoded.block = encoder.finish();
  encoded.stats = encoder.stats();
  return encoded;
}

inline bool same(const Answer& a, const Answer& b) {
  return a.meta.robot == b.meta.robot && a.meta.source == b.meta.source && a.meta.session == b.meta.session &&
         a.meta.seq == b.meta.seq && a.meta.t_send_us == b.meta.t_send_us && a.meta.t_recv_us == b.meta.t_recv_us &&
         a.body == b.body && a.header == b.header;
}

/// The block gives back exactly these answers.
inline void check_answers(const std::string& block, const std::vector<Answer>& answers) {
  store::BlockDecoder decoder;
  REQUIRE(decoder.open(block).empty());
  REQUIRE(decoder.head().rows == answers.size());
  std::size_t count = 0;
  std::size_t different = 0;
  const std::string damage = decoder.answers([&](std::size_t row, const Answer& answer) {
    ++count;
    different += row < answers.size() && same(answer, answers[row]) ? 0U : 1U;
  });
  CHECK(damage == "");
  CHECK(count == answers.size());
  CHECK(different == 0);
}

/// They come back, and none had to be kept as it was.
inline Encoded check_columnar(const std::vector<std::string>& bodies, Source source = Source::status) {
  const std::vector<Answer> answers = answers_of(bodies, source);
  Encoded encoded = encode(answers);
  check_answers(encoded.block, answers);
  CHECK(encoded.stats.raw_rows == 0);
  return encoded;
}

inline store::ColumnInfo column_of(const std::string& block, const std::string& path) {
  store::BlockDecoder decoder;
  REQUIRE(decoder.open(block).empty());
  for (const store::ColumnInfo& column : decoder.columns()) {
    if (column.path == path) {
      return column;
    }
  }
  FAIL("no column " << path);
  return {};
}

}  // namespace tacho::test
