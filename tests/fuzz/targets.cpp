#include "tests/fuzz/targets.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "schema/events.hpp"
#include "schema/store/block/block_decoder.hpp"
#include "schema/store/block/block_encoder.hpp"
#include "schema/wire/frame.hpp"
#include "schema/wire/registers.hpp"
#include "schema/wire/status_json.hpp"

namespace tacho::fuzz {

namespace {

void law(bool holds, const char* words) {
  if (!holds) {
    std::fprintf(stderr, "law broken: %s\n", words);
    std::abort();
  }
}

const FieldSet kAll = FieldSet().set();

struct Decoded {
  std::vector<wire::Frame> frames;
  bool bad = false;
};

Decoded decode_frames(std::string_view bytes, std::size_t chunk) {
  wire::FrameDecoder decoder;
  Decoded out;
  wire::Frame frame;
  for (std::size_t at = 0; at < bytes.size(); at += chunk) {
    decoder.feed(bytes.substr(at, chunk));
    while (decoder.next(frame)) {
      out.frames.push_back(frame);
    }
  }
  out.bad = decoder.bad();
  law(out.bad != decoder.why().empty(), "a bad stream is explained");
  return out;
}

bool same_bits(double a, double b) { return a == b || (a != a && b != b); }

bool has_text(Kind kind) { return kind == Kind::text || kind == Kind::list || kind == Kind::structured; }

/// Cell `f` is the same in both, texts compared as texts.
bool same_cell(const Sample& a, const Sample& b, FieldIndex f) {
  if (a.at(f).state != b.at(f).state || !same_bits(a.at(f).real, b.at(f).real)) {
    return false;
  }
  return has_text(field_at(f).kind) ? a.text(f) == b.text(f) : a.at(f).integer == b.at(f).integer;
}

std::size_t listed(const Sample& sample, std::initializer_list<FieldIndex> lists) {
  std::size_t count = 0;
  for (const FieldIndex f : lists) {
    count += sample.at(f).has() ? static_cast<std::size_t>(sample.at(f).integer) : 0;
  }
  return count;
}

/// Events can be derived from whatever was decoded, and the same answer again is none.
void derive_events(Sample sample) {
  EventMachine machine;
  machine.step(sample, [](const Event& event) { law(event.t_from_us <= event.t_us, "an edge ends after it begins"); });
  sample.meta.t_send_us += 1'000'000;
  sample.meta.t_recv_us += 1'000'000;
  machine.step(sample, [](const Event&) { law(false, "the same answer again is no event"); });
}

}  // namespace

void frame(std::string_view bytes) {
  const Decoded whole = decode_frames(bytes, bytes.size() + 1);
  for (const std::size_t chunk : {std::size_t{1}, std::size_t{3}, wire::kHeaderBytes, std::size_t{1000}}) {
    const Decoded parts = decode_frames(bytes, chunk);
    law(parts.bad == whole.bad && parts.frames.size() == whole.frames.size(), "chunks do not matter");
  }
  std::string again;
  for (const wire::Frame& f : whole.frames) {
    again += wire::encode_frame(f.header.version, f.header.sequence, f.header.type, f.body, f.header.reserved);
    law(!wire::explain_error(f).empty(), "every frame can be explained");
    wire::classify(f, wire::answer_type(wire::kStatusAll1));
    wire::classify(f, wire::kPush);
  }
  law(bytes.substr(0, again.size()) == again, "what was decoded encodes to the same bytes");
}

void status_json(std::string_view bytes) {
  static wire::JsonDecoder decoder;
  Sample all;
  Sample again;
  decoder.decode(bytes, kAll, true, all);
  decoder.decode(bytes, kAll, true, again);
  law(all.decodable == again.decodable && all.unknown_keys == again.unknown_keys, "decoding is repeatable");
  law(all.decodable || all.seen().none(), "an unreadable answer tells nothing");
  law(all.alarms.size() == listed(all, {field("fatals"), field("errors"), field("warnings"), field("notices")}),
      "every alarm belongs to a readable array");
  law(all.points.size() == listed(all, {field("di"), field("do")}), "every point belongs to a readable array");
  for (FieldIndex f = 0; f < kFieldCount; ++f) {
    law(same_cell(all, again, f), "decoding is repeatable");
    if (all.at(f).state != State::absent && has_text(field_at(f).kind) && all.at(f).has()) {
      law(field_at(f).kind == Kind::text || bytes.find(all.text(f)) != std::string_view::npos,
          "lists and objects are slices of the body");
    }
  }
  // One field alone, another one for every input.
  const auto one = static_cast<FieldIndex>(bytes.size() % kFieldCount);
  decoder.decode(bytes, FieldSet().set(one), false, again);
  law(same_cell(all, again, one), "a field alone decodes as it does among all");
  derive_events(all);
}

void registers(std::string_view bytes) {
  const auto order = static_cast<WordOrder>(bytes.empty() ? 0 : static_cast<unsigned char>(bytes[0]) % 4);
  const std::string_view image = bytes.substr(bytes.empty() ? 0 : 1);
  Gates gates;
  Sample inputs;
  wire::decode_inputs(image, kAll, gates, inputs);
  law(inputs.decodable || gates.known.none(), "an unreadable image opens no gate");
  law((gates.on & ~gates.known).none(), "what is on is known");
  Sample sample;
  wire::decode_registers(image, order, gates, kAll, sample);
  law(sample.decodable || sample.seen().none(), "an unreadable image tells nothing");
  const double share = wire::plausibility(image, order);
  law(share >= 0.0 && share <= 1.0, "plausibility is a share");
  sample.meta.source = Source::registers;
  derive_events(sample);
}

namespace {

std::vector<Answer> answers_in(std::string_view bytes, Source source) {
  std::vector<Answer> answers;
  constexpr std::size_t kMost = 300;
  while (!bytes.empty() && answers.size() < kMost) {
    const std::size_t end = std::min(bytes.find('\n'), bytes.size());
    const auto row = static_cast<Micros>(answers.size());
    Answer& answer = answers.emplace_back();
    answer.meta = {1, source, 1, static_cast<std::uint64_t>(row * 2), row * 1'000'003, row * 1'000'003 + row % 7 * 500};
    answer.body = bytes.substr(0, end);
    answer.header = answer.body.substr(0, answer.body.size() % 5 == 0 ? 16 : 0);
    bytes.remove_prefix(std::min(end + 1, bytes.size()));
  }
  return answers;
}

bool same_answer(const Answer& a, const Answer& b) {
  return a.meta.seq == b.meta.seq && a.meta.t_send_us == b.meta.t_send_us && a.meta.t_recv_us == b.meta.t_recv_us &&
         a.body == b.body && a.header == b.header;
}

/// Reads all that can be read; true when each of `answers` came back as it was.
bool read_block(std::string_view block, const std::vector<Answer>& answers) {
  store::BlockDecoder decoder;
  if (!decoder.open(block).empty()) {
    return false;
  }
  std::size_t good = 0;
  const std::string damage = decoder.answers([&](std::size_t row, const Answer& answer) {
    const bool same = row < answers.size() && same_answer(answers[row], answer);
    law(answers.empty() || same, "an answer is never wrong");
    good += same ? 1 : 0;
  });
  TextPool pool;
  store::ColumnValues values;
  for (const store::ColumnInfo& column : decoder.columns()) {
    const std::string trouble = decoder.read(column.path, {true, true, true}, pool, values);
    law(!trouble.empty() || values.kind.size() == decoder.head().rows, "a path has a value per row");
  }
  return damage.empty() && good == answers.size();
}

}  // namespace

void block(std::string_view bytes) {
  const unsigned choice = bytes.empty() ? 0 : static_cast<unsigned char>(bytes[0]);
  const std::vector<Answer> answers =
      answers_in(bytes.substr(bytes.empty() ? 0 : 1), static_cast<Source>(choice % kSourceCount));
  store::BlockEncoder encoder({answers.size() + 1, 3, static_cast<WordOrder>(choice / kSourceCount % 4)});
  for (const Answer& answer : answers) {
    law(encoder.add(answer), "answers of one stream go into one block");
  }
  std::string block = encoder.finish();
  law(block.empty() == answers.empty(), "answers make a block");
  law(answers.empty() || read_block(block, answers), "what went in comes out");
  for (std::size_t i = 0; i < bytes.size() && !block.empty(); i += 1 + bytes.size() / 8) {
    block[(i * 131 + choice) % block.size()] = bytes[i];
  }
  read_block(block, answers);
  read_block(bytes, {});
}

}  // namespace tacho::fuzz
