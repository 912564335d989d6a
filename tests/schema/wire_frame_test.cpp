#include "schema/wire/frame.hpp"

#include "tests/support/catch.hpp"

using namespace tacho::wire;

namespace {

std::vector<Frame> decode_in_chunks(const std::string& bytes, std::size_t chunk, FrameDecoder& decoder) {
  std::vector<Frame> frames;
  Frame frame;
  for (std::size_t at = 0; at < bytes.size(); at += chunk) {
    decoder.feed(std::string_view(bytes).substr(at, chunk));
    while (decoder.next(frame)) {
      frames.push_back(frame);
    }
  }
  return frames;
}

Frame only_frame(const std::string& bytes) {
  FrameDecoder decoder;
  const std::vector<Frame> frames = decode_in_chunks(bytes, bytes.size(), decoder);
  REQUIRE(frames.size() == 1);
  return frames.front();
}

bool same(const Frame& a, const Frame& b) {
  return a.header_bytes == b.header_bytes && a.body == b.body && a.header.type == b.header.type &&
         a.header.sequence == b.header.sequence && a.header.version == b.header.version &&
         a.header.reserved == b.header.reserved && a.header.length == b.header.length;
}

}  // namespace

TEST_CASE("a frame survives encoding and decoding", "[wire]") {
  const Frame frame = only_frame(encode_frame(2, 0xBEEF, 11100, "{\"x\":1}", {0x04, 0x4C, 0, 0, 0, 2}));
  CHECK(frame.header.version == 2);
  CHECK(frame.header.sequence == 0xBEEF);
  CHECK(frame.header.type == 11100);
  CHECK(frame.header.length == 7);
  CHECK(frame.header.reserved == std::array<std::uint8_t, 6>{0x04, 0x4C, 0, 0, 0, 2});
  CHECK(frame.body == "{\"x\":1}");
  CHECK(std::string(frame.header_bytes.begin(), frame.header_bytes.end()) ==
        encode_frame(2, 0xBEEF, 11100, "{\"x\":1}", {0x04, 0x4C, 0, 0, 0, 2}).substr(0, kHeaderBytes));
}

TEST_CASE("every chunk size gives the same frames", "[wire]") {
  std::string bytes = encode_frame(1, 1, 11100, std::string(300, 'a'), {0x04, 0x4C, 0, 0, 0, 0});
  bytes += encode_frame(1, 2, 11013, "");
  bytes += encode_frame(255, 3, 60001, "");
  bytes += encode_frame(0, 4, 11100, std::string("\x5A\x01\x00\x5A", 4));
  FrameDecoder whole_decoder;
  const std::vector<Frame> whole = decode_in_chunks(bytes, bytes.size(), whole_decoder);
  REQUIRE(whole.size() == 4);
  for (std::size_t chunk = 1; chunk <= bytes.size(); ++chunk) {
    FrameDecoder decoder;
    const std::vector<Frame> frames = decode_in_chunks(bytes, chunk, decoder);
    INFO("chunk of " << chunk);
    REQUIRE(frames.size() == whole.size());
    for (std::size_t i = 0; i < frames.size(); ++i) {
      CHECK(same(frames[i], whole[i]));
    }
    CHECK_FALSE(decoder.bad());
    CHECK(decoder.buffered() == 0);
  }
}

TEST_CASE("a frame is not given before its last byte", "[wire]") {
  const std::string bytes = encode_frame(1, 7, 11100, "{}");
  Frame frame;
  for (std::size_t cut = 0; cut < bytes.size(); ++cut) {
    FrameDecoder decoder;
    decoder.feed(std::string_view(bytes).substr(0, cut));
    CHECK_FALSE(decoder.next(frame));
    CHECK(decoder.buffered() == cut);
    CHECK_FALSE(decoder.bad());
    decoder.feed(std::string_view(bytes).substr(cut));
    CHECK(decoder.next(frame));
  }
}

TEST_CASE("any version and any reserved bytes are accepted", "[wire]") {
  for (const int version : {0, 1, 2, 3, 0x5A, 255}) {
    const auto reserved = static_cast<std::uint8_t>(version);
    const Frame frame = only_frame(
        encode_frame(reserved, 9, 11100, "{}", {reserved, reserved, reserved, reserved, reserved, reserved}));
    CHECK(frame.header.version == version);
    CHECK(frame.body == "{}");
  }
}

TEST_CASE("a wrong first byte is said in words with the bytes", "[wire]") {
  FrameDecoder decoder;
  decoder.feed("HTTP/1.1 400 Bad Request\r\n");
  Frame frame;
  CHECK_FALSE(decoder.next(frame));
  REQUIRE(decoder.bad());
  CHECK(decoder.why().find("48 54 54 50") != std::string::npos);
  decoder.feed(encode_frame(1, 1, 11100, "{}"));
  CHECK_FALSE(decoder.next(frame));  // no way back into step
  decoder.reset();
  decoder.feed(encode_frame(1, 1, 11100, "{}"));
  CHECK(decoder.next(frame));
}

TEST_CASE("a body over the limit is refused as soon as its length is known", "[wire]") {
  std::string header = encode_frame(1, 1, 11100, "");
  header[4] = 0x01;  // 16 MiB
  FrameDecoder exactly;
  Frame frame;
  exactly.feed(header);
  CHECK_FALSE(exactly.next(frame));
  CHECK_FALSE(exactly.bad());
  header[7] = 0x01;  // one byte more
  FrameDecoder over;
  over.feed(std::string_view(header).substr(0, 8));
  CHECK_FALSE(over.next(frame));
  REQUIRE(over.bad());
  CHECK(over.why().find("16777217") != std::string::npos);
  CHECK(over.why().find("16777216") != std::string::npos);
}

TEST_CASE("frames before a bad one are still given, for every chunk size", "[wire]") {
  const std::string bytes = encode_frame(1, 1, 11100, "{}") + "garbage";
  for (std::size_t chunk = 1; chunk <= bytes.size(); ++chunk) {
    FrameDecoder decoder;
    CHECK(decode_in_chunks(bytes, chunk, decoder).size() == 1);
    CHECK(decoder.bad());
  }
}

TEST_CASE("compression and routing bytes are unusual, the echoed request number is not", "[wire]") {
  FrameHeader header;
  header.reserved = {0x04, 0x4C, 0, 0, 0, 2};
  CHECK_FALSE(unusual_header(header));
  header.reserved = {0x04, 0x4C, 0, 0, 1, 0};
  CHECK(unusual_header(header));
  header.reserved = {0x04, 0x4C, 0, 12, 0, 0};
  CHECK(unusual_header(header));
}

TEST_CASE("answers are told apart from refusals", "[wire]") {
  const auto classify_frame = [](std::uint16_t type, std::string_view body) {
    return classify(only_frame(encode_frame(1, 1, type, body)), answer_type(kStatusAll1));
  };
  CHECK(classify_frame(11100, "{}") == AnswerClass::expected);
  CHECK(classify_frame(11100, "not json at all") == AnswerClass::expected);
  CHECK(classify_frame(11100, "{\"ret_code\":61001}") == AnswerClass::expected);
  CHECK(classify_frame(11013, "{}") == AnswerClass::other);
  for (std::uint16_t type = 60000; type <= 60004; ++type) {
    CHECK(classify_frame(type, "") == AnswerClass::error_frame);
  }
  CHECK(classify_frame(60005, "") == AnswerClass::other);
  CHECK(classify_frame(19204, "{\"ip\":\"192.168.4.2\",\"port\":19204,\"ret_code\":61001}") ==
        AnswerClass::client_limit);
  CHECK(classify_frame(19204, "{\"ret_code\":0}") == AnswerClass::other);
  CHECK(classify_frame(19204, "") == AnswerClass::other);
  const auto classify_push = [](std::uint16_t type, std::string_view body) {
    return classify(only_frame(encode_frame(1, 1, type, body)), kPush);
  };
  CHECK(classify_push(19301, "{\"ret_code\":0}") == AnswerClass::expected);
  CHECK(classify_push(19301, "{\"ret_code\":61001}") == AnswerClass::client_limit);
  CHECK(classify_push(11100, "{}") == AnswerClass::other);
}

TEST_CASE("a refusal is explained: what, why, and what to do", "[wire]") {
  const auto explain = [](std::uint16_t type, std::string_view body) {
    return explain_error(only_frame(encode_frame(1, 1, type, body)));
  };
  CHECK(explain(60000, "").find("wrong port") != std::string::npos);
  CHECK(explain(60000, "").find("19204") != std::string::npos);
  CHECK(explain(60001, "").find("request number") != std::string::npos);
  CHECK(explain(60002, "").find("JSON") != std::string::npos);
  CHECK(explain(60003, "").find("version") != std::string::npos);
  CHECK(explain(60004, "").find("too large") != std::string::npos);
  CHECK(explain(60001, "{\"err_msg\":\"no\nsuch api\"}").find("no such api") != std::string::npos);
  const std::string limit = explain(19204, "{\"ret_code\":61001}");
  CHECK(limit.find("61001") != std::string::npos);
  CHECK(limit.find("too many clients") != std::string::npos);
  CHECK(explain(12345, "x").find("12345") != std::string::npos);
}

TEST_CASE("the words of a robot are cut and never leave invalid text in a message", "[wire]") {
  const std::string text = explain_error(only_frame(encode_frame(1, 1, 60002, std::string(5000, '\xFF'))));
  CHECK(text.size() < 600);
  CHECK(text.find('\xFF') == std::string::npos);
  // A cut in the middle of a character costs that character and no other.
  for (std::size_t shift = 0; shift < 3; ++shift) {
    std::string words(shift, 'a');
    while (words.size() < 5000) {
      words += "障";
    }
    CHECK(explain_error(only_frame(encode_frame(1, 1, 60002, words))).find("障障障...") != std::string::npos);
  }
}

TEST_CASE("a refusal that repeats is known again, whatever else its body says", "[wire]") {
  const auto key = [](std::uint16_t type, std::string_view body) {
    return error_key(only_frame(encode_frame(1, 1, type, body)));
  };
  CHECK(key(60001, R"({"ret_code":40001,"create_on":"1"})") == key(60001, R"({"ret_code":40001,"create_on":"2"})"));
  CHECK(key(60001, R"({"ret_code":40001})") != key(60001, R"({"ret_code":40002})"));
  CHECK(key(60001, "") != key(60002, ""));
  CHECK(key(60001, "x") == key(60001, "y"));
}
