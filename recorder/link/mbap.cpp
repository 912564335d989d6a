#include "recorder/link/mbap.hpp"

#include <fmt/format.h>

#include <cassert>
#include <utility>

namespace tacho::recorder::mbap {

namespace {

constexpr std::size_t kBeforeLength = 6;  // bytes that the length does not count
constexpr std::size_t kLeastLength = 3;   // unit, function, one byte: an exception
constexpr std::size_t kFunctionAt = 7;
constexpr std::size_t kCountAt = 8;  // byte count, or the code of an exception
constexpr std::size_t kPayloadAt = 9;
constexpr unsigned kRefused = 0x80;

void put(std::string& out, unsigned value) {
  out.push_back(static_cast<char>(value >> 8 & 0xFF));
  out.push_back(static_cast<char>(value & 0xFF));
}

unsigned byte(std::string_view bytes, std::size_t at) { return static_cast<unsigned char>(bytes[at]); }
unsigned word(std::string_view bytes, std::size_t at) { return byte(bytes, at) << 8 | byte(bytes, at + 1); }

unsigned expected_bytes(const Request& request) {
  return request.function == Function::discrete_inputs ? (request.count + 7u) / 8u : request.count * 2u;
}

Answer bad(std::string why, Verdict verdict = Verdict::malformed) { return {verdict, {}, 0, 0, std::move(why)}; }

/// Incomplete when nothing is wrong with the header.
Answer judge_header(std::string_view bytes, const Request& request) {
  const unsigned length = word(bytes, 4);
  if (word(bytes, 2) != 0) {
    return bad(fmt::format("protocol number {:04X}, not 0", word(bytes, 2)));
  }
  if (length < kLeastLength || length + kBeforeLength > kMaxFrameBytes) {
    return bad(fmt::format("a frame that says it is {} bytes long", length));
  }
  if (word(bytes, 0) != request.transaction) {
    return bad(fmt::format("asked as transaction {}, answered as {}", request.transaction, word(bytes, 0)),
               Verdict::other_request);
  }
  if (byte(bytes, 6) != request.unit) {
    return bad(fmt::format("asked unit {}, answered by unit {}; compare `unit` with the robot's modbusSlaveId",
                           request.unit, byte(bytes, 6)));
  }
  return {};
}

/// `frame`: whole, its header judged.
Answer judge_content(std::string_view frame, const Request& request) {
  const auto function = static_cast<unsigned>(request.function);
  const unsigned got = byte(frame, kFunctionAt);
  const std::size_t content = frame.size() - kPayloadAt;
  if (got == (function | kRefused)) {
    return content == 0
               ? Answer{Verdict::exception, {}, static_cast<std::uint8_t>(byte(frame, kCountAt)), frame.size(), {}}
               : bad(fmt::format("an exception of {} bytes", frame.size()));
  }
  if (got != function) {
    return bad(fmt::format("asked function {}, answered function {}", function, got));
  }
  if (byte(frame, kCountAt) != expected_bytes(request) || content != expected_bytes(request)) {
    return bad(fmt::format("{} bytes of values announced and {} sent, where {} were asked for", byte(frame, kCountAt),
                           content, expected_bytes(request)));
  }
  return {Verdict::data, frame.substr(kPayloadAt), 0, frame.size(), {}};
}

}  // namespace

std::string encode(const Request& request) {
  assert(request.count >= 1);
  assert(request.count <= (request.function == Function::discrete_inputs ? kMaxInputs : kMaxRegisters));
  std::string out;
  put(out, request.transaction);
  put(out, 0);
  put(out, 6);  // unit, function, address, count
  out.push_back(static_cast<char>(request.unit));
  out.push_back(static_cast<char>(request.function));
  put(out, request.address);
  put(out, request.count);
  return out;
}

Answer judge(std::string_view bytes, const Request& request) {
  if (bytes.size() < kHeaderBytes) {
    return {};
  }
  Answer header = judge_header(bytes, request);
  const std::size_t size = kBeforeLength + word(bytes, 4);
  if (header.verdict != Verdict::incomplete || bytes.size() < size) {
    return header;
  }
  return judge_content(bytes.substr(0, size), request);
}

}  // namespace tacho::recorder::mbap
