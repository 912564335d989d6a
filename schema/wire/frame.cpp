#include "schema/wire/frame.hpp"

#include <fmt/format.h>
#include <simdjson.h>

#include <algorithm>
#include <array>
#include <optional>
#include <utility>

#include "schema/text.hpp"

namespace tacho::wire {

namespace {

constexpr std::uint16_t kStatusPort = 19204;
constexpr std::int64_t kClientLimit = 61001;
constexpr std::size_t kQuotedBytes = 200;
constexpr std::size_t kKeptBufferBytes = 1u << 20;

struct ErrorText {
  std::uint16_t type;
  std::string_view cause;
  std::string_view remedy;
};

constexpr auto kErrorTexts = std::to_array<ErrorText>({
    {60000, "wrong port: this port does not serve the request", "status requests go to port 19204"},
    {60001, "the robot does not know the request number", "its firmware may be too old for this source; leave it out"},
    {60002, "the robot could not read the JSON of the request", "check the configured request parameters"},
    {60003, "the robot wants another protocol version", "set the version byte: 1 for firmware 3.4, 2 for firmware 3.5"},
    {60004, "the request was too large for the robot", "ask for fewer keys"},
});

const ErrorText* find_error(std::uint16_t type) {
  const auto* const row =
      std::find_if(kErrorTexts.begin(), kErrorTexts.end(), [&](const ErrorText& e) { return e.type == type; });
  return row == kErrorTexts.end() ? nullptr : row;
}

std::uint32_t read_be(const char* bytes, std::size_t count) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < count; ++i) {
    value = value << 8 | static_cast<unsigned char>(bytes[i]);
  }
  return value;
}

void write_be(std::string& out, std::uint32_t value, int count) {
  for (int shift = (count - 1) * 8; shift >= 0; shift -= 8) {
    out.push_back(static_cast<char>(value >> shift & 0xFFu));
  }
}

FrameHeader parse_header(const char* bytes) {
  FrameHeader header;
  header.version = static_cast<std::uint8_t>(bytes[1]);
  header.sequence = static_cast<std::uint16_t>(read_be(bytes + 2, 2));
  header.length = read_be(bytes + 4, 4);
  header.type = static_cast<std::uint16_t>(read_be(bytes + 8, 2));
  for (std::size_t i = 0; i < header.reserved.size(); ++i) {
    header.reserved[i] = static_cast<std::uint8_t>(bytes[10 + i]);
  }
  return header;
}

std::string hex(std::string_view bytes) {
  std::string text;
  for (const char c : bytes) {
    text += fmt::format("{}{:02X}", text.empty() ? "" : " ", static_cast<unsigned char>(c));
  }
  return text;
}

std::optional<std::int64_t> return_code(std::string_view body) {
  simdjson::dom::parser parser;
  simdjson::dom::element root;
  std::int64_t code = 0;
  if (parser.parse(body.data(), body.size()).get(root) != simdjson::SUCCESS ||
      root["ret_code"].get(code) != simdjson::SUCCESS) {
    return std::nullopt;
  }
  return code;
}

/// The robot's own words, fit for one line of UTF-8.
std::string own_words(std::string_view body) {
  if (body.empty()) {
    return "";
  }
  std::string_view start = body.substr(0, kQuotedBytes);
  while (start.size() < body.size() && !start.empty() &&
         (static_cast<unsigned char>(body[start.size()]) & 0xC0U) == 0x80U) {
    start.remove_suffix(1);  // not in the middle of a character
  }
  std::string words(start);
  if (!simdjson::validate_utf8(start.data(), start.size())) {
    std::replace_if(
        words.begin(), words.end(), [](char c) { return static_cast<unsigned char>(c) >= 0x80; }, ' ');
  }
  return "; the robot says: " + printable(std::move(words)) + (body.size() > start.size() ? "..." : "");
}

/// The port number as the type. A push has the same type, but no such code.
bool refuses_client(const Frame& frame) {
  const std::uint16_t type = frame.header.type;
  return (type == kStatusPort || type == kPush) && return_code(frame.body) == kClientLimit;
}

}  // namespace

std::string encode_frame(std::uint8_t version, std::uint16_t sequence, std::uint16_t type, std::string_view body,
                         std::array<std::uint8_t, 6> reserved) {
  std::string frame;
  frame.reserve(kHeaderBytes + body.size());
  frame.push_back(static_cast<char>(kSync));
  frame.push_back(static_cast<char>(version));
  write_be(frame, sequence, 2);
  write_be(frame, static_cast<std::uint32_t>(body.size()), 4);
  write_be(frame, type, 2);
  for (const std::uint8_t byte : reserved) {
    frame.push_back(static_cast<char>(byte));
  }
  frame.append(body);
  return frame;
}

bool unusual_header(const FrameHeader& header) {
  // Reserved byte i is header byte 10 + i.
  return header.reserved[2] != 0 || header.reserved[3] != 0 || header.reserved[4] != 0;
}

void FrameDecoder::feed(std::string_view bytes) {
  if (bad()) {
    return;
  }
  if (begin_ == buffer_.size()) {
    buffer_.clear();
    begin_ = 0;
    if (buffer_.capacity() > kKeptBufferBytes) {
      buffer_.shrink_to_fit();
    }
  } else if (begin_ > buffer_.size() / 2) {
    buffer_.erase(0, begin_);
    begin_ = 0;
  }
  buffer_.append(bytes);
}

bool FrameDecoder::next(Frame& out) {
  if (bad() || buffered() == 0) {
    return false;
  }
  const char* const start = buffer_.data() + begin_;
  const std::string_view seen(start, std::min(buffered(), kHeaderBytes));
  if (static_cast<std::uint8_t>(*start) != kSync) {
    why_ = fmt::format("not a Robokit frame: it starts with {} instead of {:02X}", hex(seen), kSync);
    return false;
  }
  // The length stands in bytes 4 to 7; a bad one need not wait for the rest of the header.
  if (buffered() < 8) {
    return false;
  }
  const std::uint32_t length = read_be(start + 4, 4);
  if (length > max_body_) {
    why_ = fmt::format("frame announces {} bytes, more than the limit of {}; it starts with {}", length, max_body_,
                       hex(seen));
    return false;
  }
  if (buffered() < kHeaderBytes + length) {
    return false;
  }
  out.header = parse_header(start);
  std::copy_n(start, kHeaderBytes, out.header_bytes.begin());
  out.body.assign(start + kHeaderBytes, length);
  begin_ += kHeaderBytes + length;
  return true;
}

void FrameDecoder::reset() {
  buffer_.clear();
  begin_ = 0;
  why_.clear();
}

AnswerClass classify(const Frame& frame, std::uint16_t expected_type) {
  const std::uint16_t type = frame.header.type;
  if (refuses_client(frame)) {
    return AnswerClass::client_limit;
  }
  if (type == expected_type) {
    return AnswerClass::expected;
  }
  if (find_error(type) != nullptr) {
    return AnswerClass::error_frame;
  }
  return AnswerClass::other;
}

std::string explain_error(const Frame& frame) {
  const std::uint16_t type = frame.header.type;
  if (const ErrorText* const error = find_error(type)) {
    return fmt::format("error frame {}: {}; {}{}", type, error->cause, error->remedy, own_words(frame.body));
  }
  if (refuses_client(frame)) {
    return fmt::format(
        "port {} refused this client with code {}: too many clients are connected; close another client or raise the "
        "robot's limit (1 to 20, usually 10){}",
        type, kClientLimit, own_words(frame.body));
  }
  return fmt::format(
      "unexpected frame of type {} with {} bytes: it answers another request; the connection is closed{}", type,
      frame.body.size(), own_words(frame.body));
}

std::string error_key(const Frame& frame) {
  const std::optional<std::int64_t> code = return_code(frame.body);
  return fmt::format("{} {}", frame.header.type, code ? std::to_string(*code) : "");
}

}  // namespace tacho::wire
