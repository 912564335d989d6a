// Bytes of a block may be anything: what is wrong is said, what is right comes back.

#include <random>

#include "schema/store/checksum.hpp"
#include "schema/wire/registers.hpp"
#include "tests/schema/block_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
using store::BlockDecoder;
using store::ColumnValues;

namespace {

std::vector<Answer> small_answers() {
  std::vector<std::string> bodies;
  for (int row = 0; row < 24; ++row) {
    const std::string n = std::to_string(row);
    bodies.push_back(row == 5 ? "raw text"
                              : "{\"x\":" + n + ".125,\"noise\":0.123" + std::to_string(row * 7919 % 1000 * 1'000'003) +
                                    ",\"text\":\"" + (row % 3 == 0 ? "a" : "b") + "\",\"list\":[" + n + ",{\"k\":" + n +
                                    "}]" + (row > 12 ? ",\"more\":1" : "") + "}");
  }
  std::vector<Answer> answers = answers_of(bodies);
  answers[3].header = "0123456789abcdef";
  return answers;
}

/// What comes out is right, or something was said.
void check_honest(const std::string& block, const std::vector<Answer>& answers) {
  BlockDecoder decoder;
  if (!decoder.open(block).empty()) {
    return;
  }
  std::size_t right = 0;
  std::size_t wrong = 0;
  const std::string damage = decoder.answers([&](std::size_t row, const Answer& answer) {
    const bool good = row < answers.size() && answer.body == answers[row].body &&
                      answer.meta.seq == answers[row].meta.seq && answer.meta.t_recv_us == answers[row].meta.t_recv_us;
    (good ? right : wrong) += 1;
  });
  CHECK(wrong == 0);
  CHECK((right == answers.size() || !damage.empty()));
  TextPool pool;
  ColumnValues values;
  for (const char* path : {"x", "noise", "text", "list", "more", ""}) {
    const std::string said = decoder.read(path, {true, true, true}, pool, values);
    CHECK((!said.empty() || values.kind.size() == answers.size()));
  }
}

/// Writes the checksum that fits head and directory as they now are.
void reseal(std::string& block) {
  const std::size_t end =
      store::kBlockHeadBytes + store::ByteReader(std::string_view(block).substr(24)).fixed<std::uint32_t>();
  if (end > block.size()) {
    return;
  }
  const std::string_view head(block.data(), end);
  std::string sum;
  store::put_fixed(sum, static_cast<std::uint32_t>(
                            store::Checksum().add_bytes(head.substr(0, 12)).add_bytes(head.substr(16)).value()));
  block.replace(12, 4, sum);
}

/// Opens the block and asks for everything; only sanitizers can fail here.
void exercise(const std::string& block) {
  BlockDecoder decoder;
  if (!decoder.open(block).empty()) {
    return;
  }
  std::size_t bytes = 0;
  std::string damage =
      decoder.answers([&](std::size_t, const Answer& answer) { bytes += answer.body.size() + answer.header.size(); });
  damage += decoder.raw_bodies([&](std::size_t, std::string_view body) { bytes += body.size(); });
  TextPool pool;
  ColumnValues values;
  for (const store::ColumnInfo& column : decoder.columns()) {
    damage += decoder.read(column.path, {true, true, true}, pool, values);
  }
}

}  // namespace

TEST_CASE("a sum is the same however the bytes are added") {
  CHECK(static_cast<std::uint32_t>(store::Checksum().add_bytes("123456789").value()) == 0xE3069283U);
  std::mt19937 random(7);
  std::string bytes;
  while (bytes.size() < 3000) {
    bytes.push_back(static_cast<char>(random()));
  }
  for (std::size_t size = 0; size <= bytes.size(); size += 37) {
    store::Checksum one_by_one;
    for (std::size_t i = 0; i < size; ++i) {
      one_by_one.add_bytes({&bytes[i], 1});
    }
    CHECK(store::Checksum().add_bytes({bytes.data(), size}).value() == one_by_one.value());
  }
}

TEST_CASE("a changed byte anywhere is noticed or harmless") {
  const std::vector<Answer> answers = small_answers();
  const std::string block = encode(answers).block;
  for (std::size_t at = 0; at < block.size(); ++at) {
    for (const unsigned flip : {0x01U, 0x80U, 0xFFU}) {
      std::string damaged = block;
      damaged[at] = static_cast<char>(static_cast<unsigned char>(damaged[at]) ^ flip);
      INFO("byte " << at << " xor " << flip);
      check_honest(damaged, answers);
    }
  }
}

TEST_CASE("a block cut short or lengthened is refused") {
  const std::string block = encode(small_answers()).block;
  BlockDecoder decoder;
  for (std::size_t length = 0; length < block.size(); ++length) {
    CHECK_FALSE(decoder.open(std::string_view(block).substr(0, length)).empty());
  }
  CHECK_FALSE(decoder.open(block + "x").empty());
  CHECK(decoder.open(block).empty());
}

TEST_CASE("a damaged column costs the answers that have it and no other column") {
  std::vector<std::string> bodies;
  for (int row = 0; row < 200; ++row) {
    const std::string n = std::to_string(row * row % 97);
    bodies.push_back(row < 50 ? "{\"x\":" + n + "}" : "{\"x\":" + n + ",\"y\":" + n + ".5}");
  }
  const std::vector<Answer> answers = answers_of(bodies);
  std::string block = encode(answers).block;
  block.back() = static_cast<char>(block.back() ^ 1);  // the last frame is that of y
  BlockDecoder decoder;
  REQUIRE(decoder.open(block).empty());
  std::size_t count = 0;
  const std::string damage = decoder.answers([&](std::size_t row, const Answer& answer) {
    ++count;
    CHECK(same(answer, answers[row]));
  });
  CHECK(count == 50);
  CHECK(damage == "150 of 200 answers are left out: column y is damaged");
  TextPool pool;
  ColumnValues values;
  CHECK(decoder.read("x", {true, false, false}, pool, values) == "");
  CHECK(values.real[199] == 199 * 199 % 97);
  CHECK(decoder.read("y", {true, false, false}, pool, values) == "column y is damaged");
}

TEST_CASE("a directory that lies is survived") {
  const std::string block = encode(small_answers()).block;
  const std::size_t end =
      store::kBlockHeadBytes + store::ByteReader(std::string_view(block).substr(24)).fixed<std::uint32_t>();
  std::mt19937_64 random(3);
  for (int round = 0; round < 6000; ++round) {
    std::string damaged = block;
    for (std::uint64_t changes = 1 + random() % 3; changes > 0; --changes) {
      const std::size_t at = 8 + random() % (end - 8);
      damaged[at] = static_cast<char>(random() % 4 == 0 ? 0xFFU : random());
    }
    reseal(damaged);
    exercise(damaged);
  }
}

TEST_CASE("frames that lie are survived") {
  std::vector<std::string> texts;
  std::mt19937_64 random(9);
  for (int row = 0; row < 100; ++row) {
    texts.push_back("[" + std::to_string(random() % 1000) + ",\"" + std::to_string(row) + "\"]");
  }
  const std::vector<std::string_view> views(texts.begin(), texts.end());
  std::vector<std::string_view> numbers;
  for (const std::string_view text : views) {
    numbers.push_back(text.substr(1, text.find(',') - 1));
  }
  numbers[7] = "null";
  store::ColumnWriter writer(3, WordOrder::cdab);
  store::ColumnReader reader;
  for (const store::EncodedColumn& column :
       {writer.encode(views, store::LeafType::bytes), writer.encode(numbers, store::LeafType::json)}) {
    for (int round = 0; round < 4000; ++round) {
      std::string frame = column.frame;
      for (std::uint64_t changes = 1 + random() % 3; changes > 0; --changes) {
        frame[random() % std::min<std::size_t>(frame.size(), 40)] = static_cast<char>(random());
      }
      store::ColumnEntry entry = column.entry;
      entry.length = frame.size();
      entry.checksum = static_cast<std::uint32_t>(store::Checksum().add_bytes(frame).value());
      store::WholeBlock bytes(frame);
      reader.start(bytes);
      reader.set_budget(1 << 20);
      store::LoadedColumn loaded;
      std::string text;
      if (reader.load(entry, loaded)) {
        for (std::size_t i = 0; i < entry.count; ++i) {
          loaded.append(i, text);
        }
      }
    }
  }
}

TEST_CASE("a column does not take more memory than it may") {
  std::vector<std::string> texts;
  for (int row = 0; row < 300; ++row) {
    texts.push_back(std::string(1000, static_cast<char>('a' + row % 26)) + std::to_string(row));
  }
  const std::vector<std::string_view> views(texts.begin(), texts.end());
  store::ColumnWriter writer(3, WordOrder::cdab);
  const store::EncodedColumn column = writer.encode(views, store::LeafType::bytes);
  store::ColumnReader reader;
  store::LoadedColumn loaded;
  store::WholeBlock bytes(column.frame);
  reader.start(bytes);
  reader.set_budget(200'000);
  CHECK_FALSE(reader.load(column.entry, loaded));
  reader.set_budget(400'000);
  CHECK(reader.load(column.entry, loaded));
}
